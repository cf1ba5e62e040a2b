"""Control of the error at the samples, not of each step: tighten the steps until two runs agree.

Rounding limits that: positions x are held to eps |x|, which stiff members turn into forces. A force that is
off by mu eps |x| in a step, at random, drives a vibration of the frequency w to w eps |x| in about one
period, and on with the root of the number of steps. No tolerance of steps makes it smaller.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.accuracy.tolerance import Comparison, Tolerance, compare_runs
from tensegrity_codegen.runtime.integrate.raw_results import STOPPED_AT, RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray

Run = Callable[[float, float], RawTrajectory]

MAX_ROUNDS = 7  # one more where the first run has looser steps
MIN_RTOL = 1e-15  # below, a step's error is rounding; of methods in C
# Where vibrations that steps leave out keep the rounds going: they end all at once.
MIN_FACTOR_WITH_VIBRATION = 0.03
MAX_WORK = 3e10  # evaluations times states; some minutes on one core
ORDER = 5  # the number of steps grows as the tolerance to the power -1 / ORDER
MIN_ATOL_RATIO = 3.0  # times the least tolerance: nearer to it two runs are as wrong as each other
MAX_STALLED_RATIO = 0.5  # of the difference before: a difference that rounding keeps from becoming smaller
MAX_GROWN = 10.0  # the same where it became larger: by more, the runs before agreed by chance
LOOSE_RTOL = 1e-3  # relative tolerance of steps above which two runs may pass over the same events and agree
ROUNDING_SAFETY = 3.0  # times the difference of two runs that rounding keeps apart: the error of either
MAX_SPEED_ERROR = 5e-3  # of the largest speed: velocities that may be so wrong are of no use
ROUNDING_SPREAD = 3.0  # measured: up to 1.5 times the root of the number of steps
EPS = float(np.finfo(np.float64).eps)
MIN_COUNTED_WITH_KINKS = 0.7  # of the difference of two runs counts where steps do not end at kinks
# Where contacts begin, members yield or relax, rings slip: these cut steps, whose errors then shrink less
# than the tolerance, and amplify errors.
MAX_SHRINK_WITH_SWITCHES, MIN_COUNTED_WITH_SWITCHES = 0.03, 2.0
# Of the tolerance: two runs that agree so well share an error that may be more than twice their difference.
# Where the slip of a foot nearly ends, both may pass that in one step: of 272 random motions, by 0.133.
LEAST_ERROR_WITH_SWITCHES = 0.15
# Where method or tolerance are left open: steps of the first run over those that the samples ask for, and
# tightening of each next one, at least.
FIRST_FACTOR, SECOND_FACTOR, OPEN_SHRINK = 5.0, 0.5, 0.3
MAX_SHRINK = 0.1  # otherwise
ROUNDING_OF_FACTORS = 1e-9
# Of the difference of two runs that counts: tighter steps are not trusted to gain more; the second where the
# difference before has shown how fast errors shrink.
LEAST_PART, LEAST_PART_SHOWN = 0.1, 0.02
FEW_SAMPLES = (
    4.0  # over the number of samples: of the difference counts at least this; few may agree by chance
)
MIN_STEP_GROWTH = 1.15  # of the number of steps, below which tightening has gained nothing to count on
# Of the tolerance of the steps: two runs that took the same steps agree, and each may be off by so much.
LEAST_SHARE_OF_STEPS = 0.1
FORGOTTEN = 0.1  # of the largest error: one at the end that is less is stated too
TOO_MANY_EVENTS = "too_many_events"  # the status of a run that events hold up


@dataclass(frozen=True)
class Rounding:
    """The effect of rounding on a run.

    find_frequency: returns the fastest frequency [rad/s]; is_centre (n_coordinates,): coordinates that no
    force of a member depends on, see Manifest: far from the origin they are large, and make no vibration.
    """

    find_frequency: Callable[[], float]
    is_centre: NDArray[np.bool_]

    def least(self, run: RawTrajectory) -> float:
        """Return the error of velocities [m/s] that rounding leaves in any run."""
        return self.find_frequency() * EPS * self._largest(run)

    def noise(self, run: RawTrajectory) -> FloatArray:
        """Return what it comes to at most by the end of a run, [m] and [m/s]."""
        farthest = float(np.abs(run.state[:, : run.state.shape[1] // 2]).max(initial=0.0))
        steps = ROUNDING_SPREAD * np.sqrt(max(run.n_steps, 1))
        return np.asarray(steps * EPS * np.array([farthest, self._largest(run) * self.find_frequency()]))

    def words(self, run: RawTrajectory, bound: float) -> str:
        """Return the words for a bound of velocities [m/s]."""
        rounded = EPS / 2 * self._largest(run)
        return (
            f"velocities may be wrong by up to {bound:.2g} m/s, since positions have rounding errors of "
            f"{rounded:.1g} m"
        )

    def _largest(self, run: RawTrajectory) -> float:
        """Return the largest coordinate that forces depend on."""
        n = run.state.shape[1] // 2
        return float(np.abs(run.state[:, :n][:, ~self.is_centre]).max(initial=0.0))


@dataclass(frozen=True)
class Checks:
    """What is known of the errors of runs beside their differences.

    vibration: run -> amounts (2,) [m], [m/s] of vibrations that all runs leave out alike. They do not keep
    the rounds going; those of positions count in the estimate, those of velocities are the caller's to state.
    resolves_vibration: whether tighter steps leave less out, so that amounts of positions keep the rounds
    going after all. lost: run, tolerance -> error over that by vibrations that tighter steps keep, and what
    it would be if more could be lost than there is: how far the steps are from keeping them. least_atol:
    below which the steps' absolute tolerance does not go; there the whole difference to a run with ten times
    that counts; find_least_atol: the same by the first run, where what stands on the ground has other
    vibrations than at the start. least_rtol: the same of the relative one, for which rounding ends the
    rounds. min_counted: the part of a difference that counts at least, for methods that pass over kinks.
    least_error: estimate over the tolerance below which none is stated. max_shrink: factor by which a round
    tightens the steps at least. rounding: what it makes of velocities. is_open: whether the first run may
    have looser steps than the samples ask for; find_first: tolerance -> that of these steps over it.
    counts_speeds: whether amounts of velocities count as those of positions.
    """

    vibration: Callable[[RawTrajectory], FloatArray] | None = None
    resolves_vibration: bool = False
    lost: Callable[[RawTrajectory, Tolerance], tuple[float, float]] | None = None
    least_atol: float = 0.0
    find_least_atol: Callable[[RawTrajectory], float] | None = None
    least_rtol: float = MIN_RTOL
    min_counted: float = 0.0
    least_error: float = 0.0
    max_shrink: float = MAX_SHRINK
    rounding: Rounding | None = None
    is_open: bool = False
    find_first: Callable[[Tolerance], float] | None = None
    counts_speeds: bool = False


def tighten_until_converged(run: Run, tolerance: Tolerance, checks: Checks | None = None) -> RawTrajectory:
    """Return a run whose estimated error is within the tolerance at every sample.

    run: (rtol, atol) of one step -> trajectory. Each round tightens the steps' tolerance by a factor s of at
    most 1/10, 3/10 where `is_open`, and takes 3 s^p, at least 1/10 and at most 1/3 (1 where s is larger than
    1/10), of the difference of the two runs for the error
    of the tighter one, which is returned: errors shrink with the tolerance, here trusted to a third of that,
    and with the power p <= 1 with which they did so in the round before. All of it counts where the tighter
    run took hardly more steps. Of the difference that rounding may cause nothing is taken off. No less is
    stated than LEAST_SHARE_OF_STEPS of the tolerance of the last run's steps. Where rounding keeps velocities
    from the tolerance, but not positions, the result says how far off they may be (`vibration_speed_error` in
    its evidence), unless that is beyond use.

    Status "ok" means an estimated error of at most 1; "not_converged" with the last run and estimate if the
    rounds do not come together, or the next one would take all beyond MAX_WORK.
    """
    rounds = _Rounds(run, tolerance, checks or Checks())
    return rounds.beyond_rounding() if tolerance.rtol < 10.0 * rounds.checks.least_rtol else rounds.result()


class _Rounds:
    """Runs with ever tighter steps; factor: of the last one's tolerance, over that of the first."""

    def __init__(self, run: Run, tolerance: Tolerance, checks: Checks) -> None:
        self.run, self.tolerance, self.checks = run, tolerance, checks
        self.rtol, self.atol = tolerance.rtol, min(tolerance.atol, tolerance.atol_speed)
        self.least = checks.least_atol
        self.factor, self.error, self.where = 1.0, np.inf, ""
        self.second = SECOND_FACTOR  # factor of the second run, at most
        self.excess = 0.0  # error by vibrations that the steps of the last run lose, if it went on growing
        self.vibration = 0.0  # part of the tolerance that vibrations take which steps leave out
        self.tightened, self.difference = MAX_SHRINK, np.inf  # tightening and difference of the round before
        self.n_evaluations = 0

    def result(self) -> RawTrajectory:
        """Return the first run that meets the tolerance, or the last one with what is wrong with it."""
        if self.checks.is_open:
            self.factor = self._find_first_factor()
        self.previous = self._try(self.rtol * self.factor, self.atol * self.factor)
        if self.previous.status != "ok" and self.factor > 1.0:
            self.factor = 1.0
            self.previous = self._try(self.rtol, self.atol)
        if self.previous.status == "ok":
            self.tolerance = self.tolerance.measure(self.previous.state)
            self.atol = min(self.atol, self.tolerance.atol_speed)
            self.second = min(SECOND_FACTOR, self._find_first_factor())
        if self.checks.find_least_atol is not None and self.previous.status == "ok":
            self.least = max(self.least, self.checks.find_least_atol(self.previous))
        most = MAX_ROUNDS + self.checks.is_open
        for _ in range(most):
            found = self._go_on()
            if found is not None:
                return found
        return self._give_up(self.previous, f"no convergence after {most} refinements")

    def beyond_rounding(self) -> RawTrajectory:
        """Return the best run there is for a tolerance below rounding, and how far it is from that."""
        scale = self.checks.least_rtol / self.rtol
        loose, tight = (self._try(f * scale * self.rtol, f * scale * self.atol) for f in (10.0, 1.0))
        if tight.status == "unstable":
            return replace(tight, method=_name(tight))
        if tight.status == "ok":
            found = compare_runs(loose, tight, self.tolerance)
            self.error, self.where = found.error, found.where
        stopped = "" if tight.status == "ok" else f" ({tight.message})"
        return self._give_up(tight, f"the tolerance is smaller than the rounding error{stopped}")

    def _try(self, rtol: float, atol: float) -> RawTrajectory:
        found = self.run(rtol, max(atol, self.least))
        self.n_evaluations += found.n_evaluations
        return found

    def _go_on(self) -> RawTrajectory | None:
        """Do one round; return what ends them, if it does."""
        previous = self.previous
        if previous.status == "unstable":
            return replace(previous, method=_name(previous))
        if previous.status != "ok":
            return self._give_up(previous, previous.message, previous)
        # Refuse a run that would take too long.
        shrink = self._next_shrink()
        expected = self.n_evaluations + previous.n_evaluations * shrink ** (-1.0 / ORDER)
        if expected * previous.state.shape[1] > MAX_WORK:
            steps = self.rtol * self.factor * shrink
            return self._give_up(previous, f"a run with steps of rtol = {steps:.3g} would take too long")
        # Do the next run, and at the least tolerance another one that is as far from it as it can be.
        before = max(self.atol * self.factor, self.least)
        finer = self._try_finer(shrink)
        if finer.status != "ok":
            return self._give_up(previous, finer.message, finer)
        if self.atol * self.factor <= self.least and before < MIN_ATOL_RATIO * self.least:
            before = 10.0 * self.least
            self.previous = self._try(10.0 * self.rtol * self.factor, before)
        return self._judge(finer, before, shrink)

    def _find_first_factor(self) -> float:
        """Return the factor of the first run, as far as the tolerance is known."""
        find = self.checks.find_first
        return min(FIRST_FACTOR if find is None else find(self.tolerance), LOOSE_RTOL / self.rtol)

    def _next_shrink(self) -> float:
        """Return the factor by which the next run is tighter."""
        if self.atol * self.factor <= self.least:  # rounding is near
            return self.checks.max_shrink
        least = MIN_FACTOR_WITH_VIBRATION if self.vibration > 1.0 else 1e-3
        most = self.checks.max_shrink
        error = max(self.error, self.excess)
        wanted = 0.3 / error if 0.0 < error < np.inf else self.second / self.factor
        shrink = float(np.clip(wanted, least, most))
        return min(most, max(shrink, self.checks.least_rtol / (self.rtol * self.factor)))

    def _try_finer(self, shrink: float) -> RawTrajectory:
        """Return a tighter run; halfway there where it stops early: rounding may let no step be so exact."""
        self.factor *= shrink
        finer = self._try(self.rtol * self.factor, self.atol * self.factor)
        is_short = finer.n_evaluations < 0.5 * self.previous.n_evaluations
        if finer.status == "not_converged" and is_short and shrink < 0.1:
            self.factor /= math.sqrt(shrink)
            finer = self._try(self.rtol * self.factor, self.atol * self.factor)
        return finer

    def _judge(self, finer: RawTrajectory, before: float, shrink: float) -> RawTrajectory | None:
        """Return the run if it is good or no other will be; else remember it.

        before: the absolute tolerance of the run that it is compared with.
        """
        checks, at_least = self.checks, self.atol * self.factor <= self.least
        tightened = max(shrink, max(self.atol * self.factor, self.least) / before)
        allowance = None if checks.vibration is None else checks.vibration(finer)
        noise = None if checks.rounding is None else checks.rounding.noise(finer)
        # The difference to the looser run, and the part of it that is taken for the error of this one.
        difference_before = self.difference
        is_no_finer = at_least or finer.n_steps < MIN_STEP_GROWTH * self.previous.n_steps
        most = 1.0 / 3.0 if tightened <= (1.0 + ROUNDING_OF_FACTORS) * MAX_SHRINK else 1.0

        def find_part(whole: float) -> float:
            power = _find_power(difference_before, whole, self.tightened)
            # Where the difference before this one has shown how fast errors shrink, that is trusted farther.
            is_shown = checks.is_open and np.isfinite(difference_before)
            least = LEAST_PART_SHOWN if is_shown else LEAST_PART
            few = FEW_SAMPLES / (len(finer.time) * (len(self.tolerance.first) if is_shown else 1))
            part = 1.0 if is_no_finer else min(most, max(3.0 * tightened**power, least))
            return max(part, checks.min_counted, min(1.0, few))

        found = compare_runs(
            self.previous, finer, self.tolerance, part=find_part, more=allowance, noise=noise
        )
        self.tightened, self.difference = tightened, found.whole
        self.error, self.where = found.error, found.where
        # What both runs lose alike adds to it.
        self.excess = 0.0
        share = self.vibration = self._find_share(finer, allowance)
        if self.error <= 1.0 and checks.lost is not None:
            lost, excess = checks.lost(finer, self.tolerance)
            self.excess = excess if checks.is_open else 0.0
            self.where = "by vibrations that the steps do not resolve" if lost > 1.0 else self.where
            self.error += lost
        estimate = self.error + share
        may_pass_over = finer.log.count > 0 or checks.min_counted > 0.0
        is_loose = (
            may_pass_over and self.rtol * self.factor / shrink > (1.0 + ROUNDING_OF_FACTORS) * LOOSE_RTOL
        )
        if estimate <= 1.0 and not is_loose:
            self.error = estimate
            return self._accept(finer, found)
        # Tighter steps do not help where rounding keeps the runs apart, or vibrations are left out.
        is_stalled = (
            MAX_STALLED_RATIO * difference_before < self.difference < MAX_GROWN * difference_before
        ) and (at_least or found.reducible <= 1.0)
        if (is_stalled and found.error > 1.0) or self.factor * self.rtol <= checks.least_rtol:
            return self._state_rounding(finer, found, allowance, share)
        is_left_out = share > 1.0 and not checks.resolves_vibration and self.error <= 1.0
        self.error = estimate
        if is_left_out:
            return self._give_up(finer, "vibrations of bars exceed the tolerance")
        self.previous = finer
        return None

    def _find_share(self, run: RawTrajectory, more: FloatArray | None) -> float:
        """Return the largest part of the tolerance that positions are off by after the start.

        And velocities, if they count too.
        """
        if more is None or not more[0] > 0.0:
            return 0.0
        counted = 1 + self.checks.counts_speeds
        allowed = self.tolerance.allowed(run.state[1:]).reshape(len(run.state) - 1, 2, -1)
        return float(np.max(more[:counted, None] / allowed[:, :counted], initial=0.0))

    def _accept(self, run: RawTrajectory, found: Comparison) -> RawTrajectory:
        """Return a run within the tolerance; with a bound of velocities where rounding may be more."""
        good, rounding = self._accept_as_it_is(run), self.checks.rounding
        if rounding is None:
            return good
        least = rounding.least(run)
        allowed = self.tolerance.allowed(run.state)[:, len(self.tolerance.first) :]
        if least <= float(allowed.min(initial=np.inf)):
            return good
        return _note_bound(good, rounding, max(least, ROUNDING_SAFETY * found.speed))

    def _state_rounding(
        self, run: RawTrajectory, found: Comparison, more: FloatArray | None, share: float
    ) -> RawTrajectory:
        """Return a run that no tighter steps improve: good if velocities alone miss, by a known amount."""
        rounding = self.checks.rounding
        if rounding is not None and np.isfinite(found.speed):
            bound = max(ROUNDING_SAFETY * found.speed, rounding.least(run))
            allowed = np.array([0.0, bound]) + (0.0 if more is None else more)
            error = compare_runs(self.previous, run, self.tolerance, more=allowed).error + share
            n = run.state.shape[1] // 2
            speed = float(np.abs(run.state[:, n:]).max(initial=0.0))
            if error <= 1.0 and bound <= MAX_SPEED_ERROR * max(
                speed, self.tolerance.length / float(run.time[-1])
            ):
                self.error = error
                return _note_bound(self._accept_as_it_is(run), rounding, bound)
        self.error += share
        why = "rounding error prevents convergence"
        if found.end < FORGOTTEN * found.error:
            why += f", which the motion amplifies and forgets: {found.end:.3g} times the tolerance at the end"
        return self._give_up(run, why)

    def _accept_as_it_is(self, run: RawTrajectory) -> RawTrajectory:
        self.error = max(self.error, self.checks.least_error, LEAST_SHARE_OF_STEPS * self.factor)
        message = f"{run.message}; estimated error {self.error:.2g} of the tolerance"
        evidence = {**run.evidence, "atol": self.tolerance.atol, "atol_speed": self.tolerance.atol_speed}
        if run.columns is not None and self.previous.columns is not None:
            apart = _compare_columns(self.previous.columns, run.columns)
            least = self.error * self.rtol if self.checks.is_open else 0.0  # events shift both runs alike
            evidence = {**evidence, "column_error": max(1.0, self.checks.min_counted) * max(apart, least)}
        return replace(
            run,
            method=_name(run),
            message=message,
            error_estimate=self.error,
            n_evaluations=self.n_evaluations,
            evidence=evidence,
        )

    def _give_up(self, last: RawTrajectory, why: str, stopped: RawTrajectory | None = None) -> RawTrajectory:
        """Return the last run with what ended the rounds; stopped: the run that did not reach its end."""
        estimate = self.error if np.isfinite(self.error) else None
        words = "unknown" if estimate is None else f"{estimate:.3g} times the tolerance {self.where}".rstrip()
        held_up = stopped is not None and stopped.status == TOO_MANY_EVENTS
        reached = None if stopped is None else stopped.evidence.get(STOPPED_AT)
        advice = "take another method or other tolerances" if held_up else "loosen `rtol` and `atol`"
        return replace(
            last,
            status=TOO_MANY_EVENTS if held_up else "not_converged",
            message=f"{why}; estimated error {words}: {advice}, simulate a shorter time, "
            "or control the error of each step only",
            method=_name(last),
            error_estimate=estimate,
            evidence=last.evidence if reached is None else {**last.evidence, STOPPED_AT: reached},
        )


def _note_bound(run: RawTrajectory, rounding: Rounding, bound: float) -> RawTrajectory:
    """Return the run with the bound of its velocities [m/s] in its evidence and its message."""
    whole = run.evidence.get("vibration_speed_error", 0.0) + bound
    evidence = {**run.evidence, "vibration_speed_error": whole, "rounding_speed_error": bound}
    return replace(run, evidence=evidence, message=f"{run.message}; {rounding.words(run, bound)}")


def _compare_columns(loose: FloatArray, tight: FloatArray) -> float:
    """Return the largest difference of derivatives (n_t, n_states, k) over the largest of a column."""
    size = np.abs(tight).max(axis=(0, 1), initial=0.0)
    apart = np.abs(tight - loose).max(axis=(0, 1), initial=0.0)
    return float(np.divide(apart, size, out=np.zeros_like(size), where=size > 0.0).max(initial=0.0))


def _find_power(before: float, difference: float, shrink: float) -> float:
    """Return the power p of s with which the difference of two runs shrank when the tolerance did by s."""
    if not 0.0 < difference < before < np.inf:
        return 1.0 if not np.isfinite(before) or difference == 0.0 else 0.0
    return min(1.0, float(np.log(difference / before) / np.log(shrink))) if shrink < 1.0 else 0.0


def _name(run: RawTrajectory) -> str:
    """Return the method's name: what ran, and that its tolerance was tightened."""
    return f"{run.method}, tolerance tightened"
