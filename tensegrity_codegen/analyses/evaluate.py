"""The operation `evaluate`: quantities of every case at its state, side by side in the lanes of a core."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Output
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.kept import Kept
    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Evaluate(CaseAnalysis):
    """Quantities and expressions at the state of each case; by default all that the scene requests."""

    name: ClassVar[str] = "evaluate"
    success_phrase: ClassVar[str] = "were evaluated"

    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the quantities, with batch functions."""
        from tensegrity_codegen.analyses.cases.keep_text import parse_kept
        from tensegrity_codegen.analyses.cases.kept import find_kept_quantities
        from tensegrity_codegen.pipeline.analyses import BATCH_WIDTH, Needs

        quantities = find_kept_quantities(parse_kept(self.keep), request)
        if not (self.keep or request.quantities):
            raise InvalidValueError(
                "nothing to evaluate",
                where="keep",
                allowed="names of quantities, here or as model.quantities of the scene",
                hint="keep member_tension, for example",
            )
        return Needs(quantities if self.keep else request.quantities, batch_width=BATCH_WIDTH)

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays."""
        return tuple(kept_result.output for kept_result in self._bind(manifest))

    def _bind(self, manifest: "Manifest") -> "tuple[Kept, ...]":
        from tensegrity_codegen.analyses.cases.keep_text import parse_kept
        from tensegrity_codegen.analyses.cases.kept import bind_kept

        texts = self.keep or tuple(spec.quantity for spec in manifest.functions)
        return bind_kept(parse_kept(texts), manifest)

    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Compute the results; a case with one that is not finite has the status "non_finite_result"."""
        import numpy as np

        from tensegrity_codegen.analyses.cases.quantities import compute_values

        kept_results, count = self._bind(model.manifest), case_arguments.count
        names = dict.fromkeys(name for kept_result in kept_results for name in kept_result.names)
        computed = compute_values(model, names, case_arguments, threads)
        values = {name: value for name, (value, _) in computed.items()}
        arrays: dict[str, NDArray[Any]] = {}
        for kept_result in kept_results:
            array = kept_result.evaluate(values, (count,))
            is_good = np.logical_and.reduce([computed[name][1] for name in kept_result.names])
            if kept_result.formula is not None:
                array = np.array(array, dtype=model.dtype)
                is_good = is_good & np.isfinite(array.reshape(count, -1)).all(axis=1)
            for k in np.flatnonzero(~is_good & outcomes.is_ok).tolist():
                outcomes.mark(k, "non_finite_result", f"{kept_result.kept_text.text} is not finite")
            arrays[kept_result.output.name] = array
        return arrays


ANALYSIS = Evaluate
