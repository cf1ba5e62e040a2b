"""The operation `linearize`: the linear model of every case, its frequencies and damping ratios."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from tensegrity_codegen.analyses.cases.at_point import AtPoint, Point, Result
from tensegrity_codegen.analyses.cases.record import Output
from tensegrity_codegen.runtime.linear.linearize import LinearModel
from tensegrity_codegen.runtime.linear.linearize import linearize as linearize_one
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.tables.manifest import Manifest

DEFAULT_RESULTS = ("natural_frequency", "damping_ratio", "A", "B")
# Results of each linear model: axes, type, unit, sentence.
RESULTS: Mapping[str, Result] = {
    "natural_frequency": (("mode",), "float64", "Hz", "Undamped natural frequencies."),
    "damping_ratio": (("mode",), "float64", "1", "Damping ratios of these modes."),
    "A": (("state", "state_column"), "float64", "", "Jacobian dx'/dx."),
    "B": (("state", "input"), "float64", "", "Jacobian dx'/du."),
    "residual_rate": (("state",), "float64", "", "State derivative at the point."),
    "zero_eigenvalues": ((), "int64", "1", "Eigenvalues that are zero to rounding."),
    "growing_eigenvalues": ((), "int64", "1", "Eigenvalues with a positive real part."),
    "is_balanced": ((), "int64", "1", "1 where forces are in balance at the point."),
    "one_sided_cables": ((), "int64", "1", "Cables exactly at rest length, where the stiffness jumps."),
}


@dataclass(frozen=True)
class Linearize(AtPoint):
    """Linear models x' = A (x - x0) + B (u - u0) + r of every case.

    keep: names of RESULTS; by default DEFAULT_RESULTS; about: see `AtPoint`.
    """

    name: ClassVar[str] = "linearize"
    success_phrase: ClassVar[str] = "were linearized"
    analysis: ClassVar[str] = "linearize"
    results: ClassVar[Mapping[str, Result]] = RESULTS
    default_results: ClassVar[tuple[str, ...]] = DEFAULT_RESULTS

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept; without inputs B only where it is named."""
        found = super().outputs(manifest)
        return tuple(item for item in found if manifest.input_name or item.name != "B" or "B" in self.keep)

    def compute_case(
        self,
        model: CompiledModel,
        point: Point,
        arguments: Mapping[str, Any],
        names: Collection[str],
    ) -> Mapping[str, Any]:
        """Return what is kept of the linear model of one case."""
        coordinate, velocity = point
        settled, start = (coordinate, None) if self.about == "equilibrium" else (None, coordinate)
        linear = linearize_one(model, settled, coordinate=start, velocity=velocity, arguments=arguments)
        return {name: _read(linear, name) for name in names}


def _read(linear: LinearModel, name: str) -> Any:
    """Return one result of a linear model."""
    if name in ("A", "B"):
        return getattr(linear, name).toarray()
    value = linear.as_evidence()[name]
    return len(value) if name == "one_sided_cables" else value


ANALYSIS = Linearize
