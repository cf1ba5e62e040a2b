"""The operation `analyse`: self-stresses, mechanisms, prestress and stiffness of every case."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tensegrity_codegen.analyses.cases.at_point import AtPoint, Point, Result
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.state_names import name_states

DEFAULT_RESULTS = (
    *("is_stable", "n_selfstress", "n_mechanisms", "prestress", "least_tension", "mechanism_stiffness"),
    *("smallest_eigenvalue", "natural_frequency"),
)
# Results of each analysis: axes, type, unit, sentence.
RESULTS: Mapping[str, Result] = {
    "is_stable": (
        (),
        "int64",
        "1",
        "1 where tensions exist that stretch all cables and stiffen all mechanisms.",
    ),
    "n_selfstress": ((), "int64", "1", "Independent self-stresses."),
    "n_mechanisms": ((), "int64", "1", "Independent mechanisms."),
    "n_rigid_motions": ((), "int64", "1", "Independent rigid motions."),
    "prestress": (("member",), "float64", "1", "Tensions without loads, the largest force being 1."),
    "least_tension": ((), "float64", "1", "Least tension of a cable in this prestress; NAN without cables."),
    "mechanism_stiffness": (
        (),
        "float64",
        "1",
        "Least stiffness that the tensions give to a mechanism, over the largest force density; NAN without.",
    ),
    "smallest_eigenvalue": (
        (),
        "float64",
        "N/m",
        "Smallest eigenvalue of the stiffness off neutral motions.",
    ),
    "residual": ((), "float64", "N", "Largest static force on a node."),
    "natural_frequency": (("mode",), "float64", "Hz", "Undamped natural frequencies; NAN without masses."),
}


@dataclass(frozen=True)
class Analyse(AtPoint):
    """Analyses of every case, which say for what shapes there is a prestress that stiffens them.

    keep: names of RESULTS; by default DEFAULT_RESULTS; about: whether each case is analysed at its start or
    its equilibrium, see `AtPoint`.
    """

    name: ClassVar[str] = "analyse"
    success_phrase: ClassVar[str] = "were analysed"
    analysis: ClassVar[str] = "analyse"
    results: ClassVar[Mapping[str, Result]] = RESULTS
    default_results: ClassVar[tuple[str, ...]] = DEFAULT_RESULTS

    def compute_case(
        self, model: CompiledModel, point: Point, arguments: Mapping[str, Any], names: Collection[str]
    ) -> Mapping[str, Any]:
        """Return what is kept of the analysis of one case."""
        coordinate, _ = point
        static_arguments = {name: value for name, value in arguments.items() if name != "velocity"}
        n_modes = len(name_states(model.manifest)) // 2
        found = analyse(model, coordinate=coordinate, arguments=static_arguments, n_modes=n_modes)
        results: dict[str, Any] = {name: getattr(found, name, None) for name in names}
        results["is_stable"] = found.status == "stable"
        results["prestress"] = found.prestress.tension
        results["least_tension"] = _replace_infinite(found.prestress.least_tension)
        results["mechanism_stiffness"] = _replace_infinite(found.stability.smallest_eigenvalue)
        results["natural_frequency"] = () if found.modes is None else found.modes.frequency
        return results


def _replace_infinite(value: float) -> float:
    """Return the value, NAN for an infinite one."""
    return value if np.isfinite(value) else np.nan


ANALYSIS = Analyse
