"""The reference model with rigid bars: the statics of its springs, and lengths that are kept."""

from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tests.reference import ReferenceModel

FAINT = 1e-200  # spring constant that stands for none


class RigidReference(ReferenceModel):
    """The model of a structure whose bars without stiffness keep their rest lengths."""

    def __init__(self, structure: Structure, parameters: dict[str, tuple[int, ...]] | None = None) -> None:
        rigid = structure.is_rigid
        faint = structure.with_changes(spring_constant=np.where(rigid, FAINT, structure.spring_constant))
        super().__init__(faint, parameters)
        names = tuple(structure.member_name[e] for e in np.flatnonzero(rigid))
        self.manifest = replace(self.manifest, formulation="rigid_bar", rigid_bar=names)

    def has(self, quantity: str) -> bool:
        return quantity == "spring_tension" or super().has(quantity)

    def compute(self, quantity: str, /, **arguments: Any) -> Any:
        if quantity == "spring_tension":
            return super().compute("member_tension", **arguments)
        return super().compute(quantity, **arguments)


def stiffened(structure: Structure, spring_constant: float) -> Structure:
    """Return the structure with springs of this constant [N/m] in place of rigid bars."""
    return structure.with_changes(
        spring_constant=np.where(structure.is_rigid, spring_constant, structure.spring_constant)
    )
