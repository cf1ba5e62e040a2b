"""Error control at the samples of explicit methods in C, and of SciPy's methods.

Beside the difference of two runs the estimate has what both lose alike: fast vibrations that the steps take
away unseen. A step over an angle a = w h of a vibration changes its size and phase by a part e(a). Each step
may keep the tolerance while all of them together take the vibration away, in a run and in one that is
compared with it. How large it is shows in a short run with tight steps from the same start.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from tensegrity_codegen.runtime.accuracy.damped_vibration import find_min_counted
from tensegrity_codegen.runtime.accuracy.error_control import (
    FIRST_FACTOR,
    LEAST_ERROR_WITH_SWITCHES,
    MAX_SHRINK,
    MAX_SHRINK_WITH_SWITCHES,
    MIN_COUNTED_WITH_KINKS,
    MIN_COUNTED_WITH_SWITCHES,
    OPEN_SHRINK,
    Checks,
    Rounding,
    tighten_until_converged,
)
from tensegrity_codegen.runtime.accuracy.rates import (
    FEW_ITERATIONS,
    ITERATIONS,
    bound_fastest,
    find_decay,
    find_fastest,
    find_noise,
)
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.methods import SCIPY_EXPLICIT, SCIPY_IMPLICIT, find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import MIN_SCIPY_RTOL, RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.integrators import find_row

WHY_SCIPY = (
    "methods in C take values over time from a Profile of inputs only, so this schedule runs through SciPy"
)
MAX_EXPLICIT_STEPS = 20_000  # of an explicit method, from which on SciPy's implicit one has its turn first
NEGLIGIBLE_LOSS = 0.01  # change of the whole vibration, from which on two runs may agree on it
# Steps of SciPy that pass over jumps of forces: the longest of a first run, as a part of its time, and of
# each next one, as a part of the mean step before.
FIRST_STEP_OVER_JUMPS, STEP_AFTER_STEP = 0.05, 0.4
# Two such runs err alike at a jump by chance: what counts of their difference, and the least estimate stated.
MIN_COUNTED_OVER_JUMPS, LEAST_ERROR_OVER_JUMPS = 4.0, 0.1
# Vibrations from which on they decide how tight steps are, and the tolerance of the first steps times these.
MANY_RADIANS, SHARE_OF_ALL_STEPS = 300.0, 15.0
LOSS_SAFETY = 3.0  # times that change: steps are not all of the same length
# The short run: radians of the fastest vibration between its samples, their number, and its tolerance.
# There, where method or tolerance are left open: order of the differences that show vibrations, and what they
# make of one of the fastest frequency.
OPEN_ORDER, OPEN_SIZE = 6, (2.0 * math.sin(1.0)) ** 6
SHORT_RUN_SPACING, SHORT_RUN_SAMPLES, SHORT_RUN_TOLERANCE = 2.0, 26, 1e-2


@dataclass(frozen=True)
class LeftOut:
    """What a model leaves out in which nothing stiff vibrates: no two runs that agree lose a vibration alike.

    find: run -> error of its positions [m] and velocities [m/s], see Checks.vibration; both count in the
    estimate; frequency: a bound of its fastest vibration [rad/s].
    """

    find: Callable[[RawTrajectory], FloatArray]
    frequency: float


def integrate_explicit_to_samples(
    motion: Motion,
    options: RunOptions,
    left_out: LeftOut | None = None,
) -> RawTrajectory:
    """Return a run of the explicit or SciPy method of the options, its estimated error within the tolerance.

    left_out: what the model itself leaves out.

    What rounding makes of velocities is in `evidence` where it is more than the tolerance, see
    tighten_until_converged. Steps of SciPy's methods pass over the kinks where cables go slack and taut.
    Raises as integrate_adaptive and integrate_scipy.
    """
    manifest = motion.model.manifest
    begun = begin_motion(motion)
    iterations = FEW_ITERATIONS if options.is_open else ITERATIONS
    find_frequency = cache(partial(find_fastest, begun, iterations))
    find_bound: Callable[[], float] = find_frequency
    if left_out is not None:
        find_bound = partial(float, left_out.frequency)
    elif options.is_open:
        find_bound = cache(partial(bound_fastest, begun))
    tolerance = tolerance_of_options(manifest, options)
    rounding = Rounding(find_bound, manifest.is_centre)
    noise = find_noise(motion, find_bound())
    counted = _find_min_counted(motion, options.method)
    is_rough = counted == MIN_COUNTED_OVER_JUMPS
    shrink = OPEN_SHRINK if options.is_open else MAX_SHRINK
    switches = manifest.needs_state_jacobian  # contacts, or members and rings with memory
    least_error = LEAST_ERROR_OVER_JUMPS if is_rough else LEAST_ERROR_WITH_SWITCHES if switches else 0.0
    if not find_method(options.method).scipy:
        lost = _LostVibration(motion, options, find_bound, find_frequency, integrate_adaptive, options.method)
        share = find_row(options.method, switches).noise_share

        def find_least_atol(run: RawTrajectory) -> float:
            return share * find_noise(
                motion, find_fastest(replace(begin_motion(motion), state=run.state[-1]))
            )

        checks = Checks(
            least_atol=share * noise,
            find_least_atol=find_least_atol if manifest.has_contacts else None,
            min_counted=max(counted, MIN_COUNTED_WITH_SWITCHES if switches else 0.0),
            least_error=least_error,
            max_shrink=MAX_SHRINK_WITH_SWITCHES if switches else shrink,
            rounding=rounding,
            lost=lost.estimate if left_out is None else None,
            vibration=None if left_out is None else left_out.find,
            counts_speeds=left_out is not None,
            is_open=options.is_open,
            find_first=lost.find_first_factor if left_out is None and options.is_open else None,
        )
        return tighten_until_converged(
            lambda rtol, atol: integrate_adaptive(motion, options.within(rtol, atol)), tolerance, checks
        )
    like = "rk853" if options.method == SCIPY_EXPLICIT.name else "rk54"
    lost = _LostVibration(motion, options, find_bound, find_frequency, integrate_scipy, like)
    checks = Checks(
        least_atol=noise,
        least_rtol=MIN_SCIPY_RTOL,
        min_counted=counted,
        least_error=least_error,
        rounding=rounding,
        max_shrink=shrink,
        lost=lost.estimate,
        is_open=options.is_open,
    )

    longest = FIRST_STEP_OVER_JUMPS * motion.t_end if is_rough else np.inf

    def run(rtol: float, atol: float) -> RawTrajectory:
        nonlocal longest
        found = integrate_scipy(motion, options.within(max(rtol, MIN_SCIPY_RTOL), atol), longest)
        # Steps that are alike pass over the same jumps with the same error.
        longest = STEP_AFTER_STEP * motion.t_end / max(found.n_steps, 1) if is_rough else np.inf
        return found

    return tighten_until_converged(run, tolerance, checks)


def _find_min_counted(motion: Motion, method: str) -> float:
    """Return the part of the difference of two runs that counts at least: where steps pass over kinks."""
    structure = motion.model.structure
    is_blind = structure is None or bool(np.any(structure.tension_only | structure.has_switch))
    if not find_method(method).scipy:
        is_blind = find_min_counted(motion, method) > 0.0
    if not is_blind:
        return 0.0
    return MIN_COUNTED_OVER_JUMPS if has_force_jumps(motion) else MIN_COUNTED_WITH_KINKS


def has_force_jumps(motion: Motion) -> bool:
    """Return whether forces may jump along a motion, as those of cables with damping do."""
    manifest, structure = motion.model.manifest, motion.model.structure
    jumps = structure is None or bool(np.any(structure.tension_only & (structure.damping > 0.0)))
    return jumps or any(item.name == "damping" for item in manifest.arguments)


def integrate_scheduled(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Integrate a motion with a schedule by SciPy's DOP853 or implicit method, whichever meets the tolerance.

    The implicit one has its turn first where the fastest vibration or damping would take the explicit method
    more than MAX_EXPLICIT_STEPS steps. The estimated error at the samples is within atol + rtol |x|, unless
    `control` is "steps"; status "not_converged" where neither method meets that.
    """
    begun = begin_motion(motion)
    frequency = find_fastest(begun)
    steps = motion.t_end * (0.75 * frequency + 0.2 * find_decay(begun))
    noise = find_noise(motion, frequency)

    def run(name: str) -> RawTrajectory:
        if options.control == "steps":
            atol = max(options.absolute, noise)
            return integrate_scipy(motion, replace(options, method=name, atol=atol))
        return integrate_explicit_to_samples(motion, replace(options, method=name))

    names = (SCIPY_EXPLICIT.name, SCIPY_IMPLICIT.name)
    if steps > MAX_EXPLICIT_STEPS:
        names = names[::-1]
        why = f"{WHY_SCIPY}: {names[0]}, since an explicit method needs about {steps:,.0f} steps"
    else:
        why = f"{WHY_SCIPY}: {names[0]}" + (f", for about {steps:,.0f} steps" if steps >= 1 else "")
    found = run(names[0])
    if found.status != "ok":
        other = run(names[1])
        if other.status == "ok":
            why, found = f"{why}; {names[0]} missed the tolerance, so {names[1]}", other
    return replace(found, method=f"auto ({found.method})", why=why)


def begin_motion(motion: Motion) -> Motion:
    """Return the motion with the arguments that it has at the start."""
    changed = motion.schedule(0.0) if motion.schedule else {}
    return replace(motion, arguments={**motion.arguments, **changed})


@dataclass(frozen=True)
class _LostVibration:
    """What runs of a motion lose.

    find_bound, find_frequency: return a bound of the fastest frequency, and this itself [rad/s]; integrate:
    does one run; like: name of the integrator whose steps lose as much; found: speeds by frequency.
    """

    motion: Motion
    options: RunOptions
    find_bound: Callable[[], float]
    find_frequency: Callable[[], float]
    integrate: Callable[[Motion, RunOptions], RawTrajectory]
    like: str
    found: dict[float, FloatArray] = field(default_factory=dict)

    def find_first_factor(self, tolerance: Tolerance) -> float:
        """Return the tolerance of the first run's steps over that of the samples.

        Vibrations larger than the tolerance have to be followed: the errors of all N steps add up.
        """
        frequency, last = self.find_bound(), self.motion.t_end
        if frequency * last < MANY_RADIANS:
            return FIRST_FACTOR
        allowed = tolerance.allowed(self.motion.state[None])[0, len(tolerance.first) :]
        if not (self._keep_amplitude(frequency, last, tolerance) > allowed).any():
            return FIRST_FACTOR
        return min(FIRST_FACTOR, SHARE_OF_ALL_STEPS / (frequency * last))

    def estimate(self, run: RawTrajectory, tolerance: Tolerance) -> tuple[float, float]:
        """Return the error over the tolerance by vibrations that a run has lost, 0 where it shows them.

        And the same as if a vibration could lose more than there is of it: how far steps are from showing it.
        """
        last, steps = float(run.time[-1]), max(run.n_steps, 1)
        factor, power = find_row(self.like, self.motion.model.manifest.needs_state_jacobian).vibration_loss
        for find in (self.find_bound, self.find_frequency):
            frequency = find()
            changed = run.n_steps * factor * (frequency * last / steps) ** power
            if changed <= NEGLIGIBLE_LOSS:
                return 0.0, 0.0
        lost = min(2.0, LOSS_SAFETY * changed)
        speed = lost * self._keep_amplitude(frequency, last, tolerance)
        allowed = tolerance.allowed(run.state[1:])
        error = float(np.max(np.concatenate([speed / frequency, speed]) / allowed, initial=0.0))
        return error, error * LOSS_SAFETY * changed / lost

    def _keep_amplitude(self, frequency: float, last: float, tolerance: Tolerance) -> FloatArray:
        """Return what _find_amplitude finds, once for each frequency."""
        if frequency not in self.found:
            self.found[frequency] = self._find_amplitude(frequency, last, tolerance)
        return self.found[frequency]

    def _find_amplitude(self, frequency: float, last: float, tolerance: Tolerance) -> FloatArray:
        """Return the speed [m/s] with which each node vibrates at the start, (n_groups,)."""
        end = min(last, (SHORT_RUN_SAMPLES - 1) * SHORT_RUN_SPACING / frequency)
        times = np.linspace(0.0, end, SHORT_RUN_SAMPLES)
        motion = replace(self.motion, sample_time=times, progress=None, watch=Watch())
        rtol, atol = (SHORT_RUN_TOLERANCE * value for value in (self.options.rtol, self.options.absolute))
        state = self.integrate(motion, self.options.within(rtol, atol)).state
        found = np.zeros(len(tolerance.first))
        for lag in (1, 2):
            # Differences of the order k of a vibration are (2 sin)^k times its size, of slower ones far less.
            bend, size = state[2 * lag :] - 2.0 * state[lag:-lag] + state[: -2 * lag], 2.0
            if self.options.is_open:
                size = OPEN_SIZE
                for _ in range(OPEN_ORDER - 2):
                    bend = bend[lag:] - bend[:-lag]
            if len(bend):
                speeds = tolerance.lengths(bend)[:, len(tolerance.first) :]
                found = np.maximum(found, speeds.max(axis=0) / size)
        return found
