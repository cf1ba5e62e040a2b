"""The estimated error of motions with a fixed step: by how much runs with other steps differ."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tensegrity_codegen.runtime.integrate.raw_results import RawBatch, RawTrajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import Manifest

FACTORS = (2.0, 0.5)  # steps to compare with, over the step, until one says that the result is of use
# The same where the step loses the fastest vibration: the longest that keeps it.
SHORTER_FACTORS = (0.5, 0.25, 0.125, 0.0625)
MAX_PHASE_ERROR = 0.1  # rad, by which the fastest vibration may be off at the end and still count as followed
MAX_FADING = 0.3  # e-folds, by which it may have faded in a run that shows that it is there
MAX_ERROR = 5e-3  # over the mean member length and the largest speed: beyond, a result is lost


def check_by_doubling(
    run: Callable[[float], RawTrajectory], step: float, manifest: Manifest, frequency: float = 0.0
) -> RawTrajectory:
    """Return the run with this step [s], its status "inaccurate" where its estimated error is beyond use.

    run: step -> trajectory, with the step that it took. error_estimate: what the difference to a run with
    twice the step says of one of order 2, as where cables go slack, over half a hundredth of the mean member
    length in coordinates and of the largest speed in velocities; where that is beyond use, or that run fails,
    or the step is the whole time, the whole difference to a run with half the step. frequency [rad/s]: of the
    fastest vibration; where these steps lose it, longer ones do so too, and the run is held to one that does
    not.
    """
    return _check_all(lambda step: [run(step)], step, manifest, [frequency])[0]


def check_batch_by_doubling(
    run: Callable[[float], RawBatch], step: float, manifest: Manifest, frequency: FloatArray
) -> RawBatch:
    """Return a batch of runs with this step [s], each held to another step as `check_by_doubling` does.

    frequency (n_batch,) [rad/s]: of the fastest vibration of each.
    """
    batches: list[RawBatch] = []

    def run_all(step: float) -> list[RawTrajectory]:
        batch = run(step)
        if not batches:
            batches.append(batch)
        return [batch.motion(k) for k in range(len(batch.status))]

    checked = _check_all(run_all, step, manifest, frequency.tolist())
    estimates = [np.nan if one.error_estimate is None else one.error_estimate for one in checked]
    return replace(
        batches[0],
        status=tuple(one.status for one in checked),
        message=tuple(one.message for one in checked),
        n_evaluations=np.array([one.n_evaluations for one in checked], dtype=np.int64),
        error_estimate=np.array(estimates),
    )


def _check_all(
    run: Callable[[float], list[RawTrajectory]], step: float, manifest: Manifest, frequency: list[float]
) -> list[RawTrajectory]:
    """Return runs of motions with this step [s], each compared with runs with other steps."""
    found = run(step)
    step = found[0].step or step  # a longer one was cut to the whole time
    checks = [_Check(one, step, manifest, w) for one, w in zip(found, frequency, strict=True)]
    for factor in (FACTORS[0], *SHORTER_FACTORS):
        if any(check.wants(factor) for check in checks):
            for check, other in zip(checks, run(factor * step), strict=True):
                check.compare(other, factor)
    return [check.result() for check in checks]


@dataclass
class _Check:
    """One run with the step [s], and its estimated error over that which loses it; None: not known."""

    found: RawTrajectory
    step: float
    manifest: Manifest
    frequency: float
    error: float | None = None

    def __post_init__(self) -> None:
        self.is_good, self.n_evaluations = self.found.status == "ok", self.found.n_evaluations
        self.factors = self._choose_factors() if self.is_good else ()

    def _choose_factors(self) -> tuple[float, ...]:
        """Return steps to compare with, over the step.

        Runge-Kutta 4 with h takes a vibration w by (w h)^4 / 120 of its phase and (w h)^5 / 144 of its size.
        """
        turned, reach = self.frequency * float(self.found.time[-1]), self.frequency * self.step
        if turned * reach**4 <= 120.0 * MAX_PHASE_ERROR:
            return FACTORS
        longest = (144.0 * MAX_FADING / turned) ** 0.2 / reach
        return (next((one for one in SHORTER_FACTORS if one <= longest), SHORTER_FACTORS[-1]),)

    @property
    def is_within(self) -> bool:
        """Whether the estimated error is of use."""
        return self.error is not None and self.error <= 1.0

    def wants(self, factor: float) -> bool:
        """Return whether the run must be compared with one with this step, over its own."""
        return factor in self.factors and not self.is_within

    def compare(self, other: RawTrajectory, factor: float) -> None:
        """Take the difference to another run for the error, where that says anything."""
        if not self.wants(factor):
            return
        self.n_evaluations += other.n_evaluations
        ratio = float(other.step or 0.0) / float(self.found.step or 1.0)
        if other.status == "ok" and (factor < 1.0 or ratio > 1.1):
            self.error = self._estimate(other, ratio)

    def _estimate(self, other: RawTrajectory, ratio: float) -> float:
        """Return the estimated error beside another run; infinite where an event has ended only one."""
        found = self.found
        shared = min(len(found.time), len(other.time))
        if max(len(found.time), len(other.time)) > shared + 1:
            return float(np.inf)
        state = found.state[:shared]
        share = min(1.0, 1.0 / abs(ratio**2 - 1.0))
        apart = np.abs(state - other.state[:shared]) / self._find_lost(state)
        return float(share * apart.max())

    def _find_lost(self, state: FloatArray) -> FloatArray:
        """Return the error of each component (n_states,) at which a run (n_t, n_states) is lost."""
        n = state.shape[1] // 2
        place = np.array(self.manifest.node_position).reshape(-1, 3)
        lengths = self.manifest.strands.lengths(place)
        length = float(lengths.mean()) if len(lengths) else 0.0
        if find_formulation(self.manifest.formulation).has_angles or not length > 0.0:
            length = float(np.abs(state[:, :n]).max()) or 1.0
        speed = max(float(np.abs(state[:, n:]).max()), length / float(self.found.time[-1]))
        return MAX_ERROR * np.repeat([length, speed], n)

    def result(self) -> RawTrajectory:
        """Return the run with its estimated error."""
        found, error = self.found, self.error
        if not self.is_good:
            return found
        known = "not known" if error is None else f"{100.0 * MAX_ERROR * error:.3g} % of a mean member length"
        checked = replace(found, n_evaluations=self.n_evaluations, error_estimate=error)
        if self.is_within:
            return replace(checked, message=f"{found.message}; the estimated error is {known}")
        message = f"the estimated error is {known}: take a smaller step"
        return replace(checked, status="inaccurate", message=message)
