"""What an ending is worth: against a reference that two methods certify, or by its status alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.own import Ending, tolerance_of

__all__ = ["VERDICTS", "Truth", "certify_case", "judge"]

FloatArray = NDArray[np.float64]

# Verdict -> what it means.
VERDICTS = {
    "survived": "called good, and its certified error is at most ten times the tolerance",
    "stopped": "said by a status or a named error that it has no result",
    "over time": "was stopped because its time was up",
    "unchecked": "called good where no two methods agree on a reference",
    "wrong": "called good, and its certified error is more than ten times the tolerance",
}
ALLOWED = 10.0  # times the tolerance
SHARPER = (1e-1, 1e-2, 1e-3)  # tolerances of references, over that asked for


@dataclass(frozen=True)
class Truth:
    """States (n_t, n) that two methods agree on, and by how much they differ, component by component."""

    state: FloatArray
    apart: FloatArray


def certify_case(case: Case, runs: Sequence[Callable[[float], Ending]]) -> Truth | None:
    """Return states on which two runs of different methods agree to a tenth of what the case allows, if any.

    runs: tolerance -> ending.
    """
    if case.expects_refusal:
        return None
    for factor in SHARPER:
        endings = [run(factor * case.rtol) for run in runs]
        found = [ending.state for ending in endings if ending.status == "ok"]
        if len(found) < 2:
            return None
        for n, first in enumerate(found):
            for second in found[n + 1 :]:
                apart = np.abs(first - second)
                if np.all(apart <= 0.1 * ALLOWED * tolerance_of(first, case.rtol)):
                    return Truth(first, apart)
    return None


def judge(case: Case, ending: Ending, truth: Truth | None) -> tuple[str, float | None]:
    """Return one of VERDICTS, and the largest certified error over the tolerance where there is one."""
    if ending.status == "over time":
        return "over time", None
    if ending.status != "ok":
        return "stopped", None
    if case.expects_refusal:
        return "wrong", None
    if truth is None:
        return "unchecked", None
    if ending.state.shape != truth.state.shape or not np.isfinite(ending.state).all():
        return "wrong", None
    error = np.abs(ending.state - truth.state)
    allowed = tolerance_of(truth.state, case.rtol)
    # A method for stiff members damps their vibrations out of the velocities, and says how fast they were.
    allowed[:, truth.state.shape[1] // 2 :] += ending.vibration_speed / ALLOWED
    ratio = float(np.max(error / allowed))
    is_wrong = np.any(error > ALLOWED * allowed + truth.apart)
    return ("wrong" if is_wrong else "survived"), ratio
