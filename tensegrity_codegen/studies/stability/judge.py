"""What an ending is worth: against a reference that two methods certify, or by its status alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.own import Ending, tolerance_of

__all__ = ["VERDICTS", "Truth", "certify_case", "judge", "judge_peer"]

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
LOST = 1e-2  # error, over mean length or largest speed, from which a result without a tolerance is wrong


@dataclass(frozen=True)
class Truth:
    """States (n_t, n) that two methods agree on, and by how much they differ, component by component.

    apart: with the vibrations of stiff members that one of them leaves out.
    """

    state: FloatArray
    apart: FloatArray


def certify_case(case: Case, runs: Sequence[Callable[[float], Ending]]) -> Truth | None:
    """Return states on which two runs of different methods agree to a tenth of what the case allows, if any.

    runs: tolerance -> ending, the quickest first; a third is asked where the first two do not agree.
    """
    if case.expects_refusal:
        return None
    for factor in SHARPER:
        found: list[Ending] = []
        for run in runs:
            ending = run(factor * case.rtol)
            if ending.status != "ok":
                continue
            for other in found:
                apart = np.abs(ending.state - other.state)
                if np.all(apart <= 0.1 * ALLOWED * _allowed(case, other.state, other, ending)):
                    n = apart.shape[1] // 2
                    apart[:, :n] += max(ending.vibration, other.vibration)
                    apart[:, n:] += max(ending.vibration_speed, other.vibration_speed)
                    return Truth(other.state, apart)
            found.append(ending)
        if len(found) < 2:
            return None
    return None


def judge(case: Case, ending: Ending, truth: Truth | None) -> tuple[str, float | None]:
    """Return one of VERDICTS, and the largest certified error over the tolerance where there is one.

    Of a method with a fixed step, which is told no tolerance, a hundredth of the mean member length, and of
    the largest speed, stands for ten times the tolerance.
    """
    verdict = _judge_status(case, ending)
    if verdict is not None:
        return verdict, None
    if truth is None:
        return "unchecked", None
    if ending.state.shape != truth.state.shape:
        return "wrong", None
    error = np.abs(ending.state - truth.state)
    allowed = _allowed(case, truth.state, ending)
    ratio = float(np.max(error / np.maximum(allowed, np.finfo(np.float64).tiny)))
    is_wrong = np.any(error > ALLOWED * allowed + truth.apart)
    return ("wrong" if is_wrong else "survived"), ratio


def judge_peer(case: Case, ending: Ending, truth: Truth | None) -> tuple[str, float | None]:
    """Judge coordinates alone, leniently: wrong from a hundredth of the mean member length on."""
    verdict = _judge_status(case, ending)
    if verdict is not None:
        return verdict, None
    if truth is None:
        return "unchecked", None
    n = truth.state.shape[1] // 2
    if ending.state.shape != (len(truth.state), n):
        return "wrong", None
    error = float(np.abs(ending.state - truth.state[:, :n]).max())
    length = float(case.structure.member_length().mean())
    return ("wrong" if error > LOST * length else "survived"), error


def _judge_status(case: Case, ending: Ending) -> str | None:
    """Return the verdict where the status alone decides."""
    if ending.status == "over time":
        return "over time"
    if ending.status != "ok":
        return "stopped"
    return "wrong" if case.expects_refusal or not np.isfinite(ending.state).all() else None


def _allowed(case: Case, state: FloatArray, *endings: Ending) -> FloatArray:
    """Return the tolerance of every component of states (n_t, n).

    A method for stiff members damps their vibrations out, and says how far and how fast they were.
    """
    n = state.shape[1] // 2
    if case.step is not None:
        length = float(case.structure.member_length().mean())
        speed = max(float(np.abs(state[:, n:]).max()), length / case.t_end)
        return np.repeat([length, speed], n)[None, :] * LOST / ALLOWED + np.zeros_like(state)
    allowed = tolerance_of(state, case.rtol)
    allowed[:, :n] += sum(ending.vibration for ending in endings) / ALLOWED
    allowed[:, n:] += sum(ending.vibration_speed for ending in endings) / ALLOWED
    return allowed
