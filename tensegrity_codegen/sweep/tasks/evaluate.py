"""The operation `evaluate`: quantities of every case at its state, side by side in the lanes of a core."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tensegrity_codegen.analyses import BATCH_WIDTH, Needs
from tensegrity_codegen.errors import FormulationError, InvalidValueError
from tensegrity_codegen.manifest import Manifest
from tensegrity_codegen.quantities import find_quantity
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweep.statuses import encode_status
from tensegrity_codegen.sweep.tasks.case_arguments import read_case_arguments
from tensegrity_codegen.sweep.tasks.dimensions import describe_quantity
from tensegrity_codegen.sweep.tasks.operation import Operation, Output, TaskResult
from tensegrity_codegen.sweep.tasks.quantities import compute_rows

__all__ = ["Evaluate"]


@dataclass(frozen=True)
class Evaluate(Operation):
    """Quantities at the state of each case; by default those that the scene requests."""

    name: ClassVar[str] = "evaluate"

    def needs(self, structure: Subject, request: ModelRequest) -> Needs:
        """Return the quantities, with batch functions."""
        for name in self.keep:
            find_quantity(name)
        if not (self.keep or request.quantities):
            raise InvalidValueError(
                "nothing to evaluate",
                where="keep",
                allowed="names of quantities, here or as model.quantities of the scene",
                hint="keep member_tension, for example",
            )
        return Needs(self.keep or request.quantities, batch_width=BATCH_WIDTH)

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array a quantity."""
        known = {spec.quantity: spec for spec in manifest.functions}
        for name in self.keep:
            if name not in known:
                raise FormulationError(
                    "the library does not compute a quantity that is kept",
                    where=manifest.name,
                    given=name,
                    allowed=", ".join(known),
                    hint="build the library with what the operation needs",
                )
        return tuple(describe_quantity(manifest, known[name]) for name in self.keep or known)

    def run(
        self, model: CompiledModel, arguments: Mapping[str, Any], count: int, *, threads: int = 1
    ) -> TaskResult:
        """Compute the quantities; a case of which one is not finite has the status "non_finite_result"."""
        given = read_case_arguments(model, arguments, count)
        status, messages = given.status()
        arrays: dict[str, Any] = {}
        for output in self.outputs(model.manifest):
            found, is_good = compute_rows(model, output.name, given.rows, given.shared, count, threads)
            arrays[output.name] = found
            for k in np.flatnonzero(~is_good & (status == encode_status("ok"))):
                status[k] = encode_status("non_finite_result")
                messages[k] = f"{output.name} is not finite"
        result = TaskResult(arrays, status, tuple(messages))
        for array in arrays.values():
            array[~result.is_good] = np.nan
        return result
