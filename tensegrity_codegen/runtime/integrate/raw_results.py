"""Results of integrators, of one state and of many, and how each run ended."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.event_log import EMPTY_LOG, EventLog
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.manifest import STATUS

CountArray = NDArray[np.int64]

MAX_STEPS = 1_000_000  # steps that a run may try unless told otherwise: seconds for a dozen members
NOT_ESTIMATED = 'the error at the samples is not estimated (`control="samples"`)'
STOPPED_AT = "stopped_at"  # evidence of a run that did not reach its end: where it was [s]
GIVEN_UP = -1  # in place of a status of C's: too many steps are in sight


@dataclass(frozen=True)
class RawTrajectory:
    """What an integrator returns: samples (n_t, n_states) that it reached, and how it ended.

    tension (n_t, len(tension_member)) [N]: of members whose tension is an unknown of its own; evidence: what
    the method counted; why: why this method, where it was chosen; internal (n_t, n_internal): internal
    states, None without any; columns (n_t, n_states, n_columns): derivatives of states and internal states.
    """

    time: FloatArray
    state: FloatArray
    status: str
    message: str
    method: str
    n_steps: int
    n_evaluations: int
    step: float | None = None
    error_estimate: float | None = None
    log: EventLog = EMPTY_LOG
    tension: FloatArray | None = None
    tension_member: tuple[int, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)
    why: str = ""
    internal: FloatArray | None = None
    columns: FloatArray | None = None


@dataclass(frozen=True)
class RawBatch:
    """What a batch integrator returns: samples, NAN where they were not reached, and how each run ended.

    time (n_t,) [s]; state (n_batch, n_t, n_states); n_reached: samples of each run; status, message: a word
    and what it means, one a run; n_steps, n_rejected, n_evaluations (n_batch,); step [s]: of a fixed-step
    method; error_estimate (n_batch,), if there is one; internal (n_batch, n_t, n_internal), if there are any.
    """

    time: FloatArray
    state: FloatArray
    n_reached: CountArray
    status: tuple[str, ...]
    message: tuple[str, ...]
    method: str
    n_steps: CountArray
    n_rejected: CountArray
    n_evaluations: CountArray
    step: float | None = None
    error_estimate: FloatArray | None = None
    internal: FloatArray | None = None

    def motion(self, k: int) -> RawTrajectory:
        """Return one motion, its samples those that it reached."""
        reached = slice(0, int(self.n_reached[k]))
        return RawTrajectory(
            time=self.time[reached],
            state=self.state[k, reached],
            status=self.status[k],
            message=self.message[k],
            method=self.method,
            n_steps=int(self.n_steps[k]),
            n_evaluations=int(self.n_evaluations[k]),
            step=self.step,
            error_estimate=None if self.error_estimate is None else float(self.error_estimate[k]),
        )


def is_within_reach(trials: int, fraction: float, most: int, foresight: int) -> bool:
    """Return whether a run may go on: not too many steps yet, and not ten times too many in sight.

    trials: steps tried so far, of at most `most`; fraction: part of the time span done; foresight: steps from
    which on the rest is foreseen.
    """
    return trials < most and (trials < foresight or trials < 10 * most * fraction)


def judge_end(word: str, time: float, end: float) -> tuple[str, str]:
    """Return the status of a run that stopped at `time` [s] and, if it is not good, what stopped it."""
    if word == "non_finite_result":
        return "unstable", f"the state is not finite after t = {time:.6g} s"
    if word == "step_too_small":
        return "not_converged", f"no step meets the tolerance after t = {time:.6g} s: loosen it"
    if word == "too_many_events":
        return "too_many_events", f"events follow each other ever more closely after t = {time:.9g} s"
    if time < end:
        return (
            "not_converged",
            f"too many steps: stopped at t = {time:.6g} s; simulate a shorter time, loosen the tolerance, "
            "or allow more (`max_steps`)",
        )
    return "ok", ""


def say_unmonitored(n_cables: int, n_contacts: int) -> str:
    """Return the words for events at which no step ends, none for no events."""
    cables = describe_count(n_cables, "cable")
    contacts = describe_count(n_contacts, "contact with the ground", "contacts with the ground")
    named = [words for words, count in ((cables, n_cables), (contacts, n_contacts)) if count]
    return f", events of {' and '.join(named)} are not monitored" if named else ""


def judge_ends(
    status: NDArray[np.int32],
    time: FloatArray,
    end: float,
    count: CountArray,
    step: float | None,
    unmonitored: str,
) -> list[tuple[str, str]]:
    """Return status word and message of every run.

    status (n_batch,): what C says, or GIVEN_UP; time (n_batch,) [s]: where each stopped; end [s]: where all
    should; count (n_batch, 3): steps taken, steps tried in vain, evaluations; step [s]: if it is fixed;
    unmonitored: words for the events at which no step is cut.
    """
    ends: list[tuple[str, str]] = []
    for number, stopped, (taken, rejected, _) in zip(status, time, count, strict=True):
        word = "ok" if number == GIVEN_UP else STATUS[number]
        if word == "non_finite_input":
            ends.append((word, "the initial state or an argument is not finite"))
            continue
        verdict, message = judge_end(word, float(stopped), end)
        if step is None:
            ends.append((verdict, message or f"{taken} steps, {rejected} rejected{unmonitored}"))
        else:
            more = ": take a smaller step" if verdict == "unstable" else ""
            ends.append((verdict, message + more or f"fixed step {step:.6g} s{unmonitored}"))
    return ends
