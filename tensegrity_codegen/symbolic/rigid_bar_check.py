"""Formulations in which every member is a spring refuse rigid bars, all in the same words."""

from __future__ import annotations

import numpy as np

from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.structure import Structure

__all__ = ["check_no_rigid_bar"]


def check_no_rigid_bar(structure: Structure, formulation: str) -> None:
    """Raise FormulationError if a member has neither spring constant nor axial stiffness."""
    rigid = np.flatnonzero(structure.is_rigid)
    if rigid.size:
        name = structure.member_name[rigid[0]]
        others = f" and {rigid.size - 1} more" if rigid.size > 1 else ""
        raise FormulationError(
            f"formulation {formulation!r} has no rigid bars; rigid bars will be served by the formulation "
            "'rigid_bar', which this version does not have yet",
            where=f"{structure.name}: members.{name}",
            given=f"bar {name}{others} without axial_stiffness and spring_constant",
            allowed="axial_stiffness > 0 [N] or spring_constant > 0 [N/m] on every bar",
            hint="give the bar a finite stiffness, 1,000 times that of the cables is nearly rigid",
        )
