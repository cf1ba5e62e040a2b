"""What an ending is worth: against a reference that two methods certify, or by its status alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.own import Ending, tolerance_of
from tensegrity_codegen.studies.stability.tension_rule import tension_tolerance
from tensegrity_codegen.system.arrays import FloatArray

Runs = Sequence[Callable[[float], Ending]]

# Verdict -> what it means.
VERDICTS = {
    "survived": "status ok, and the certified error is within the stated bound",
    "stopped": "a status or a named error says that there is no result",
    "over time": "the run was stopped at its time limit",
    "unchecked": "status ok, but no reference could be certified",
    "wrong": "status ok, but the certified error is beyond the stated bound",
    "not able": "the peer is not installed, or does not have the physics of the case",
    "not run": "the case was not run, for example since the time budget was exceeded",
}
# Rule -> what is checked, where an error is certified.
RULES = {
    "plain": "positions and velocities are within ten times the tolerance",
    "told": "positions are, and velocities keep the bound that the run itself states for vibrating bars",
    "positions": "positions are; velocities are not judged, since no two methods agree on them",
}
ALLOWED = 10.0  # times the tolerance
SHARPER = (1e-1, 1e-3)  # tolerances of references, over that asked for
AGREE = 0.1  # of what is allowed, that two references may differ by
LOST = 1e-2  # error, over mean length or largest speed, from which a result without a tolerance is wrong


@dataclass(frozen=True)
class Truth:
    """States (n_t, n) that two methods agree on, and by how much they differ, component by component.

    tension (n_t, n_members) [N] and how far the methods differ in it, where they have it; knows_speed:
    whether they agree on velocities too.
    """

    state: FloatArray
    apart: FloatArray
    tension: FloatArray | None = None
    tension_apart: FloatArray | None = None
    knows_speed: bool = True


@dataclass(frozen=True)
class Judgement:
    """One of VERDICTS; where an error is certified also the rule by which, and how large it is.

    error: the largest over the tolerance, or over what the run said where the rule is "told"; of a peer, of a
    coordinate [m]. tension_error: the largest of a tension, over the largest tension.
    """

    verdict: str
    error: float | None = None
    rule: str = ""
    tension_error: float | None = None


def certify_case(case: Case, runs: Runs, *, positions_only: bool = False) -> Truth | None:
    """Return states on which two runs of different methods agree to a tenth of what the case allows, if any.

    runs: tolerance -> ending, the quickest first; a third is asked where the first two do not agree. What
    runs say of themselves counts for nothing here.
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
                if is_agreed(case, other.state, apart, positions_only=positions_only):
                    return _truth(case, other, ending, apart, not positions_only)
            found.append(ending)
        if len(found) < 2:
            return None
    return None


def is_agreed(case: Case, state: FloatArray, apart: FloatArray, *, positions_only: bool = False) -> bool:
    """Return whether two results for a state (n_t, n) that are so far apart agree well enough to judge by."""
    good = apart <= AGREE * ALLOWED * _allowed(case, state)
    return bool(np.all(good[:, : good.shape[1] // 2] if positions_only else good))


def _truth(case: Case, one: Ending, other: Ending, apart: FloatArray, knows_speed: bool) -> Truth:
    """Return what two endings agree on; their tensions are as uncertain as their states make them, too."""
    if one.tension is None or other.tension is None or not knows_speed:
        return Truth(one.state, apart, knows_speed=knows_speed)
    uncertain = tension_tolerance(case.structure, one.state, apart, case.structure.is_rigid)
    return Truth(one.state, apart, one.tension, np.abs(one.tension - other.tension) + uncertain)


def judge(case: Case, ending: Ending, truth: Truth | None) -> Judgement:
    """Hold one of our methods to what it calls good.

    Positions must be within ten times the tolerance, velocities too unless the run says by how much bars
    vibrate unseen, tensions as tension_tolerance says. Of a method with a fixed step, which is told no
    tolerance, a hundredth of the mean member length, and of the largest speed, stands for ten times the
    tolerance, and tensions are not judged.
    """
    verdict = _judge_status(case, ending)
    if verdict is not None:
        return Judgement(verdict)
    if truth is None:
        return Judgement("unchecked")
    if ending.state.shape != truth.state.shape:
        return Judgement("wrong")
    error, allowed = np.abs(ending.state - truth.state), _allowed(case, truth.state)
    n = error.shape[1] // 2
    rule = "plain" if truth.knows_speed else "positions"
    if not truth.knows_speed:
        error[:, n:] = 0.0
    elif np.any((error > ALLOWED * allowed + truth.apart)[:, n:]) and ending.speed_bound > 0.0:
        rule = "told"
        allowed[:, n:] += ending.speed_bound / ALLOWED
    is_wrong = bool(np.any(error > ALLOWED * allowed + truth.apart))
    ratio = float(np.max(error / np.maximum(allowed, np.finfo(np.float64).tiny)))
    tension_error, is_off = _judge_tension(case, ending, truth, allowed)
    return Judgement("wrong" if is_wrong or is_off else "survived", ratio, rule, tension_error)


def _judge_tension(
    case: Case, ending: Ending, truth: Truth, allowed: FloatArray
) -> tuple[float | None, bool]:
    """Return the largest error of a tension over the largest tension, and whether one is too large."""
    if (
        truth.tension is None
        or truth.tension_apart is None
        or ending.tension is None
        or case.step is not None
    ):
        return None, False
    structure, bound = case.structure, ending.tension_bound
    own = structure.is_rigid if bound is None else structure.is_mixed
    error = np.abs(ending.tension - truth.tension)
    largest = float(np.abs(truth.tension).max(initial=0.0))
    most = tension_tolerance(structure, truth.state, ALLOWED * allowed, own)
    most += ALLOWED * case.rtol * largest + truth.tension_apart + np.where(own, bound or 0.0, 0.0)
    is_off = not np.all(error <= most)
    return (float(error.max(initial=0.0)) / largest if largest > 0.0 else None), is_off


def judge_peer(case: Case, ending: Ending, truth: Truth | None) -> Judgement:
    """Judge coordinates alone, by ten times the tolerance or a hundredth of the mean member length.

    The larger counts: tolerances of other programs bound the error of each step, or they have none.
    """
    verdict = _judge_status(case, ending)
    if verdict is not None:
        return Judgement(verdict)
    if truth is None:
        return Judgement("unchecked")
    n = truth.state.shape[1] // 2
    if ending.state.shape != (len(truth.state), n):
        return Judgement("wrong")
    error = np.abs(ending.state - truth.state[:, :n])
    least = LOST * float(case.structure.member_length().mean())
    is_wrong = bool(np.any(error > np.maximum(least, ALLOWED * _allowed(case, truth.state)[:, :n])))
    return Judgement("wrong" if is_wrong else "survived", float(error.max()), "positions")


def _judge_status(case: Case, ending: Ending) -> str | None:
    """Return the verdict where the status alone decides."""
    if ending.status in ("over time", "not able"):
        return ending.status
    if ending.status != "ok":
        return "stopped"
    return "wrong" if case.expects_refusal or not np.isfinite(ending.state).all() else None


def _allowed(case: Case, state: FloatArray) -> FloatArray:
    """Return the tolerance of every component of states (n_t, n)."""
    if case.step is None:
        return tolerance_of(case.structure, state, case.rtol)
    n = state.shape[1] // 2
    length = float(case.structure.member_length().mean())
    speed = max(float(np.abs(state[:, n:]).max()), length / case.t_end)
    return np.repeat([length, speed], n)[None, :] * LOST / ALLOWED + np.zeros_like(state)
