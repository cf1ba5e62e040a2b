"""What a fixed step is worth: the same run with twice the step, and by how much it differs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.manifest import Manifest
from tensegrity_codegen.runtime.trajectory import RawTrajectory

__all__ = ["check_by_doubling"]

FloatArray = NDArray[np.float64]

MOST_ERROR = 1e-2  # over the longest member and the largest speed: beyond, a result is lost


def check_by_doubling(
    run: Callable[[float], RawTrajectory], step: float, manifest: Manifest
) -> RawTrajectory:
    """Return the run with this step [s], its status "inaccurate" where its estimated error is beyond use.

    run: step -> trajectory, with the step that it took. error_estimate: what the difference to a run with
    twice the step says of one of order 2, as where cables go slack, over a hundredth of the longest member in
    coordinates and of the largest speed in velocities; where that run fails, or the step is the whole time,
    the whole difference to a run with half the step.
    """
    found = run(step)
    if found.status != "ok":
        return found
    other = run(2.0 * step)
    n_evaluations = found.n_evaluations + other.n_evaluations
    if other.status != "ok" or not _ratio(other, found) > 1.1:
        other = run(0.5 * step)
        n_evaluations += other.n_evaluations
    error = None
    if other.status == "ok":
        share = min(1.0, 1.0 / abs(_ratio(other, found) ** 2 - 1.0))
        error = share * float(np.max(np.abs(found.state - other.state) / _lost(found, manifest)))
    checked = replace(found, n_evaluations=n_evaluations, error_estimate=error)
    if error is not None and error <= 1.0:
        return checked
    told = "not known" if error is None else f"{100.0 * MOST_ERROR * error:.3g} % of the structure's size"
    message = f"the estimated error is {told}: take a smaller step"
    return replace(checked, status="inaccurate", message=message)


def _ratio(other: RawTrajectory, found: RawTrajectory) -> float:
    return float(other.step or 0.0) / float(found.step or 1.0)


def _lost(run: RawTrajectory, manifest: Manifest) -> FloatArray:
    """Return the error of each component (n_states,) at which a result is lost."""
    n = run.state.shape[1] // 2
    place = np.array(manifest.node_position).reshape(-1, 3)
    ends = place[np.array(manifest.connectivity, dtype=np.int64).reshape(-1, 2)]
    length = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max(initial=0.0))
    if manifest.formulation == "bodies" or not length > 0.0:
        length = float(np.abs(run.state[:, :n]).max()) or 1.0
    speed = max(float(np.abs(run.state[:, n:]).max()), length / float(run.time[-1]))
    return MOST_ERROR * np.repeat([length, speed], n)
