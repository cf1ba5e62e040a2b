"""The operation `linearize`: the linear model of every case, its frequencies and damping ratios."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.linear.linearize import LinearModel
from tensegrity_codegen.runtime.linear.linearize import linearize as linearize_one
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.state_names import name_states
from tensegrity_codegen.sweeps.tasks.at_point import Arrays, AtPoint, Point
from tensegrity_codegen.sweeps.tasks.operation import Output
from tensegrity_codegen.tables.manifest import Manifest

DEFAULT_RESULTS = ("natural_frequency", "damping_ratio", "A", "B")
RESULTS = (*DEFAULT_RESULTS, "residual_rate", "zero_eigenvalues", "growing_eigenvalues")


@dataclass(frozen=True)
class Linearize(AtPoint):
    """Linear models x' = A (x - x0) + B (u - u0) + r of every case.

    Attributes
    ----------
    keep : tuple of str
        Names of RESULTS; by default DEFAULT_RESULTS.
    about : str
        See `AtPoint`.
    """

    name: ClassVar[str] = "linearize"
    success_phrase: ClassVar[str] = "were linearized"
    analysis: ClassVar[str] = "linearize"
    result_names: ClassVar[tuple[str, ...]] = RESULTS
    default_results: ClassVar[tuple[str, ...]] = DEFAULT_RESULTS

    def outputs(self, manifest: Manifest) -> tuple[Output, ...]:
        """Return one array for each thing that is kept; frequencies are NAN behind the last oscillation."""
        states, inputs = name_states(manifest), manifest.input_name
        modes = len(states) // 2
        known = {
            "natural_frequency": (("mode",), (modes,), "float64", "Hz", "Undamped natural frequencies."),
            "damping_ratio": (("mode",), (modes,), "float64", "1", "Damping ratios of these modes."),
            "A": (("state", "state_column"), (len(states),) * 2, "float64", "", "Jacobian dx'/dx."),
            "B": (("state", "input"), (len(states), len(inputs)), "float64", "", "Jacobian dx'/du."),
            "residual_rate": (("state",), (len(states),), "float64", "", "State derivative at the point."),
            "zero_eigenvalues": ((), (), "int64", "1", "Eigenvalues that are zero to rounding."),
            "growing_eigenvalues": ((), (), "int64", "1", "Eigenvalues with a positive real part."),
        }
        labels = {"state": states, "state_column": states, "input": inputs}
        kept = [name for name in self.list_kept() if inputs or name != "B" or "B" in self.keep]
        return tuple(
            Output(name, *known[name], {dim: labels[dim] for dim in known[name][0] if dim in labels})
            for name in kept
        )

    def compute_case(
        self,
        model: CompiledModel,
        point: Point,
        arguments: Mapping[str, Any],
        empty: Arrays,
    ) -> Mapping[str, Any]:
        """Return what is kept of the linear model of one case."""
        coordinate, velocity = point
        linear = linearize_one(model, coordinate=coordinate, velocity=velocity, arguments=arguments)
        return {name: _read(linear, name, array) for name, array in empty.items()}


def _read(linear: LinearModel, name: str, empty: NDArray[Any]) -> Any:
    """Return one result of a linear model; behind the last oscillation frequencies stay `empty`."""
    if name in ("natural_frequency", "damping_ratio"):
        found = getattr(linear, name)
        return np.concatenate([found, empty[len(found) :]])
    if name in ("A", "B"):
        return getattr(linear, name).toarray()
    if name == "residual_rate":
        return linear.residual_rate
    spectrum = linear.spectrum
    return spectrum.growing if name == "growing_eigenvalues" else spectrum.zero_eigenvalues


OPERATION = Linearize
