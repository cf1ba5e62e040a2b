"""The verdict on a result: against a reference that two methods certify, or by its status alone."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.methods import Ending, tolerance_of
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.journal import read_record

ROUNDING = 1e-15  # of positions, in lengths of members and so in their tensions


def tension_tolerance(
    structure: Structure, state: FloatArray, allowed: FloatArray, is_multiplier: NDArray[np.bool_]
) -> FloatArray:
    """Return the errors of tensions (n_t, n_members) [N] from errors `allowed` (n_t, n_states) of states.

    is_multiplier: which members have tensions that do not follow from lengths, rigid ones at least.

        mu dl + c (dl' + 2 |d'| dl / l)      of a spring; of a damped cable near its kink c |l'| besides
        m (2 |d'| dl' / l + |d'|^2 dl / l^2) + what the others come to + sqrt(mu m) dl'      of these
    """
    position, velocity = np.split(state, 2, axis=1)
    place, speed = _of_nodes(structure, position, structure.node_position), _of_nodes(structure, velocity)
    distance, fast = (_of_nodes(structure, component) for component in np.split(allowed, 2, axis=1))
    i, j = structure.connectivity.T
    vector, moving = place[:, i] - place[:, j], speed[:, i] - speed[:, j]
    length = np.maximum(np.linalg.norm(vector, axis=2), 1e-300)
    pace = np.linalg.norm(moving, axis=2)
    dl, dv = (np.linalg.norm(x[:, i], axis=2) + np.linalg.norm(x[:, j], axis=2) for x in (distance, fast))
    dl = dl + ROUNDING * np.abs(place).max(axis=(1, 2), initial=0.0)[:, None]
    turned = dv + 2.0 * pace * dl / length
    mu, c = structure.mu, structure.damping
    springs = mu * dl + c * turned
    is_near = structure.tension_only & (np.abs(length - structure.rest_length) <= dl)
    springs += np.where(is_near, c * np.abs(np.sum(vector * moving, axis=2)) / length, 0.0)
    mass = structure.lumped_mass
    rigid = (mass[i] + mass[j]) * (2.0 * pace * dv / length + (pace / length) ** 2 * dl)
    rigid += springs[:, ~is_multiplier].sum(axis=1)[:, None]
    # The masses (n_members,) with which members vibrate, 1 / (1 / m_i + 1 / m_j)
    held = structure.node_anchored[:, list(structure.axes)].all(axis=1)
    inverse = np.where(held, 0.0, 1.0 / np.maximum(mass, 1e-300))[structure.connectivity].sum(axis=1)
    rigid += np.sqrt(
        mu * np.asarray(np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), 0.0))
    ) * dv.max(axis=0)
    tolerance: FloatArray = np.where(is_multiplier, rigid, springs)
    return tolerance


def _of_nodes(structure: Structure, values: FloatArray, fill: FloatArray | float = 0.0) -> FloatArray:
    """Return values (n_t, n_coordinates) as (n_t, n_nodes, 3), those of anchored axes as in `fill`."""
    node, axis = structure.coordinate_node_axis.T
    nodes = np.zeros((len(values), structure.n_nodes, 3))
    nodes += fill
    nodes[:, node, axis] = values
    return nodes


Runs = Sequence[Callable[[float], Ending]]

# Verdict -> its meaning.
VERDICTS = {
    "survived": "status ok, and the certified error is within the stated bound",
    "stopped": "a status or a named error says that there is no result",
    "over time": "the run was stopped at its time limit",
    "unchecked": "status ok, but no reference could be certified",
    "wrong": "status ok, but the certified error is beyond the stated bound",
    "not able": "the peer is not installed, or does not have the physics of the case",
    "not run": "the case was not run, for example since the time budget was exceeded",
}
# Rule -> its criterion, where an error is certified.
RULES = {
    "plain": "positions and velocities are within ten times the tolerance",
    "told": "positions are, and velocities keep the bound that the run itself states for vibrating bars",
    "positions": "positions are; velocities are not judged, since no two methods agree on them",
}
ALLOWED = 10.0  # times the tolerance
SHARPER = (1e-1, 1e-3)  # tolerances of references, over that asked for
AGREE = 0.1  # of what is allowed, that two references may differ by
# Error, over mean length or largest speed, from which a result without a tolerance is wrong.
LOST_ERROR = 1e-2


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
        endings: list[Ending] = []
        for run in runs:
            ending = run(factor * case.rtol)
            if ending.status != "ok":
                continue
            for known_ending in endings:
                difference = np.abs(ending.state - known_ending.state)
                if is_agreed(case, known_ending.state, difference, positions_only=positions_only):
                    return _truth(case, known_ending, ending, difference, not positions_only)
            endings.append(ending)
        if len(endings) < 2:
            return None
    return None


def is_agreed(case: Case, state: FloatArray, difference: FloatArray, *, positions_only: bool = False) -> bool:
    """Return whether two results for a state (n_t, n) that are so far apart agree well enough to judge by."""
    good = difference <= AGREE * ALLOWED * _allowed(case, state)
    return bool(np.all(good[:, : good.shape[1] // 2] if positions_only else good))


def _truth(case: Case, ending: Ending, witness: Ending, difference: FloatArray, knows_speed: bool) -> Truth:
    """Return the agreement of two endings; their tensions are as uncertain as their states make them, too."""
    if ending.tension is None or witness.tension is None or not knows_speed:
        return Truth(ending.state, difference, knows_speed=knows_speed)
    uncertain = tension_tolerance(case.structure, ending.state, difference, case.structure.is_rigid)
    return Truth(
        ending.state, difference, ending.tension, np.abs(ending.tension - witness.tension) + uncertain
    )


def judge(case: Case, ending: Ending, truth: Truth | None) -> Judgement:
    """Compare the result of one of our methods with its own tolerance.

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
    is_multiplier = structure.is_rigid if bound is None else structure.is_mixed
    error = np.abs(ending.tension - truth.tension)
    largest = float(np.abs(truth.tension).max(initial=0.0))
    tolerance = tension_tolerance(structure, truth.state, ALLOWED * allowed, is_multiplier)
    tolerance += (
        ALLOWED * case.rtol * largest + truth.tension_apart + np.where(is_multiplier, bound or 0.0, 0.0)
    )
    is_off = not np.all(error <= tolerance)
    return (float(error.max(initial=0.0)) / largest if largest > 0.0 else None), is_off


def judge_peer(case: Case, ending: Ending, truth: Truth | None) -> Judgement:
    """Judge coordinates alone, by ten times the tolerance or a hundredth of the mean member length."""
    verdict = _judge_status(case, ending)
    if verdict is not None:
        return Judgement(verdict)
    if truth is None:
        return Judgement("unchecked")
    n = truth.state.shape[1] // 2
    if ending.state.shape != (len(truth.state), n):
        return Judgement("wrong")
    error = np.abs(ending.state - truth.state[:, :n])
    min_error = LOST_ERROR * float(case.structure.member_length().mean())
    is_wrong = bool(np.any(error > np.maximum(min_error, ALLOWED * _allowed(case, truth.state)[:, :n])))
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
    return np.repeat([length, speed], n)[None, :] * LOST_ERROR / ALLOWED + np.zeros_like(state)


NOT_RUN = "not run"


@dataclass(frozen=True)
class Limits:
    """How long a run may take, a reference, and all runs together.

    run, reference: CPU time of one run, and of one run for a reference [s].
    total: time by the clock for all cases of all scenes [s]. Cases that are not done by then are not run.
    peers: whether peers are run too.
    compiles: whether a reference may be compiled for one case alone, where two methods do not certify it.
    """

    run: float = 2.0
    reference: float = 4.0
    total: float = 540.0
    peers: bool = True
    compiles: bool = True

    def check(self) -> None:
        """Raise InvalidValueError if a time is out of range."""
        for key, value in (("limit", self.run), ("limit", self.reference), ("budget", self.total)):
            check_positive(value, key, "[s]")


@dataclass(frozen=True)
class Outcome:
    """One case with one method.

    error: of ours, the largest certified error over the tolerance; of a peer, the largest error of a
    coordinate [m]; None where nothing certifies. rule: one of RULES by which it was judged, "" where none;
    tension_error: of ours, the largest error of a tension over the largest tension.
    """

    group: str
    case: str
    contender: str
    is_own: bool
    verdict: str
    error: float | None
    status: str
    message: str
    seconds: float
    rule: str
    tension_error: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome in JSON's types."""
        return dataclasses.asdict(self)

    @classmethod
    def not_run(cls, group: str, case: str, contender: str, is_own: bool, why: str) -> "Outcome":
        """Return the outcome of what was not run, with the reason."""
        return cls(group, case, contender, is_own, NOT_RUN, None, NOT_RUN, why, 0.0, "", None)


def read_outcomes(data: Any, contenders: Mapping[str, bool]) -> list[Outcome] | None:
    """Return the outcomes of a case from a journal, None if they are not those of just these contenders.

    contenders: name -> whether it is one of our methods.
    """
    if not isinstance(data, list):
        return None
    outcomes = [outcome for entry in data if (outcome := read_record(Outcome, entry)) is not None]
    if len(outcomes) != len(data) or {row.contender: row.is_own for row in outcomes} != dict(contenders):
        return None
    is_known = all(row.verdict in VERDICTS and row.rule in ("", *RULES) for row in outcomes)
    return outcomes if is_known and len(outcomes) == len(contenders) else None
