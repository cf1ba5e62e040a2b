"""Trajectories in node positions and in node distances (S&K Fig. 5).

The map from one to the other is linear, so with equal steps the two differ by rounding alone. The paper's
1e-5 is the error of two runs whose variable steps differ, not one of the model.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.models import compile_in
from tensegrity_codegen.studies.papers.sk.sample import sample_prism

FORMULATIONS = ("node_position", "node_distance")
ADAPTIVE = "scipy_rk45"
REFERENCE = {"method": "scipy_dop853", "rtol": 1e-12, "atol": 1e-13, "control": "steps"}


def compare_trajectories(
    structure: Structure | None = None,
    *,
    t_end: float = 2.0,
    step: float = 1e-3,
    tolerances: Iterable[float] = (1e-3, 1e-6, 1e-9),
    samples: int = 201,
) -> dict[str, Any]:
    """Return how far apart node positions are when both models are integrated, sample by sample.

    structure: a free prism if not given. time (n_t,) [s]; equal_steps (n_t,): largest difference [m] with
    Runge-Kutta 4 in C at `step` [s]; adaptive: tolerance -> {difference (n_t,) between the models,
    error: formulation -> (n_t,) against a run at 1e-12}, by an adaptive Runge-Kutta 4(5) with rtol =
    tolerance and atol = tolerance / 10, as the paper's variable step; auto: the same for the halved steps
    in C, rtol = tolerance.
    """
    structure = structure or sample_prism()
    models = {name: compile_in(structure, name) for name in FORMULATIONS}

    def run(name: str, **options: Any) -> Trajectory:
        return simulate(models[name], t_end, samples=samples, **options)

    equal = {name: run(name, method="rk4", step=step) for name in FORMULATIONS}
    truth = run("node_position", **REFERENCE)
    result: dict[str, Any] = {
        "time": truth.time,
        "step": step,
        "equal_steps": _difference(equal["node_position"], equal["node_distance"]),
        "adaptive": {},
        "auto": {},
    }
    for tolerance in tolerances:
        for kind, method, control in (("adaptive", ADAPTIVE, "steps"), ("auto", "auto", "samples")):
            given = {"method": method, "control": control, "rtol": tolerance, "atol": 0.1 * tolerance}
            runs = {name: run(name, **given) for name in FORMULATIONS}
            result[kind][tolerance] = {
                "difference": _difference(runs["node_position"], runs["node_distance"]),
                "error": {name: _difference(found, truth) for name, found in runs.items()},
                "n_evaluations": {name: found.n_evaluations for name, found in runs.items()},
            }
    return result


def _difference(a: Trajectory, b: Trajectory) -> np.ndarray:
    """Return the largest difference of node positions at each sample that both reached [m]."""
    count = min(len(a.time), len(b.time))
    apart = np.abs(a.node_position[:count] - b.node_position[:count])
    return np.asarray(apart.max(axis=(1, 2)))
