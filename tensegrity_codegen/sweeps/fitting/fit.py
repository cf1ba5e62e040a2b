"""The search for numbers of a scene: weighted least squares, short times first, noise estimated by kind."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy

from tensegrity_codegen.sweeps.fitting.keyed_motion import KeyedMotion
from tensegrity_codegen.sweeps.fitting.keyed_statics import KeyedStatics
from tensegrity_codegen.sweeps.fitting.measurements import Measurements
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError

HORIZONS = (0.1, 0.3)  # parts of the time that are fitted before all of it, lest a long motion misleads
MIN_TIMES_IN_PART = 8  # with fewer times a part is left out
MAX_RUNS = 60  # of one fit
MAX_NOISE_ROUNDS = 6  # estimates of the noise
NOISE_CHANGE = 0.01  # part by which the noise may still change
LEAST_NOISE = 1e-12  # of the largest value of a kind
MAX_KNOWN = 3  # motions that are kept
PULL = 1e-6  # to the start, of the largest derivative: where the data show nothing, values stay


@dataclass
class Fit:
    """One search: the problem, what was measured, and the noise, None where it is to be estimated."""

    problem: KeyedMotion | KeyedStatics
    data: Measurements
    limits: FloatArray
    noise: dict[str, float] | None
    hold_out: float
    progress: Callable[[float], None] | None
    n_motions: int = 0
    known: dict[bytes, tuple[FloatArray, FloatArray]] = field(default_factory=dict)
    best: tuple[float, FloatArray] | None = None  # of the search that runs: sum of squares, and the values

    def run(self) -> "Fitted":
        """Fit short times, then all, and the noise where it is not given; return what was found."""
        used = self._count_used()
        count = int(np.isfinite(self.data.value[:used]).sum())
        n_keys = len(self.problem.keys)
        if count <= n_keys:
            raise InvalidValueError(
                "there are too few measured values",
                where=self.data.source,
                given=f"{count} values for {n_keys} numbers",
                allowed="more values than numbers",
            )
        is_given, noise = self.noise is not None, self.noise or self._guess_noise()
        scaled, status = self.problem.start / self.problem.size, "ok"
        self.evaluate(scaled, used)
        try:
            for part in () if self.data.is_static else HORIZONS:
                until = int(part * used)
                enough = np.isfinite(self.data.value[:until]).sum() > 2 * n_keys
                if until >= MIN_TIMES_IN_PART and enough:
                    scaled, _ = self._search(scaled, until, noise, 1e-4)
            for _ in range(1 if is_given else MAX_NOISE_ROUNDS):
                scaled, is_found = self._search(scaled, used, noise, 1e-12)
                status = "ok" if is_found else "not_converged"
                if is_given:
                    break
                before, noise = noise, self._estimate_noise(scaled, used)
                if all(abs(noise[kind] - before[kind]) <= NOISE_CHANGE * before[kind] for kind in noise):
                    break
        except KeyboardInterrupt:
            status, scaled = "interrupted", scaled if self.best is None else self.best[1]
        if self.progress is not None:
            self.progress(1.0)
        return Fitted(self, scaled, used, noise, status)

    def _count_used(self) -> int:
        return max(1, len(self.data.time) - round(self.hold_out * len(self.data.time)))

    def sigma(self, noise: Mapping[str, float]) -> FloatArray:
        """Return the noise of each channel, (n_channels,)."""
        return np.array([noise[item.kind] for item in self.data.channels])

    def _guess_noise(self) -> dict[str, float]:
        """Return sizes that weigh kinds of measurements against each other: a thousandth of their spread."""
        found = {}
        for kind in dict.fromkeys(item.kind for item in self.data.channels):
            values = self._of_kind(self.data.value, kind)
            spread = np.sqrt(np.nanmean((values - np.nanmean(values, axis=0)) ** 2))
            found[kind] = max(1e-3 * float(spread), self.floor(kind))
        return found

    def _of_kind(self, values: FloatArray, kind: str) -> FloatArray:
        chosen = [k for k, item in enumerate(self.data.channels) if item.kind == kind]
        return values[:, [k for k in chosen if np.isfinite(self.data.value[:, k]).any()]]

    def floor(self, kind: str) -> float:
        """Return the least noise of a kind that counts, by its largest value."""
        return LEAST_NOISE * max(float(np.nanmax(np.abs(self._of_kind(self.data.value, kind)))), 1e-300)

    def _estimate_noise(self, scaled: FloatArray, used: int) -> dict[str, float]:
        """Return the standard deviation of each kind, by its residuals and its part of the numbers found."""
        left = self.evaluate(scaled, used)[0] - self.data.value[:used]
        total, found = int(np.isfinite(left).sum()), {}
        for kind in dict.fromkeys(item.kind for item in self.data.channels):
            own = self._of_kind(left, kind)
            count = int(np.isfinite(own).sum())
            if not count:
                found[kind] = self.floor(kind)
                continue
            free = count * (1.0 - len(self.problem.keys) / total)
            found[kind] = max(float(np.sqrt(np.nansum(own**2) / free)), self.floor(kind))
        return found

    def _search(
        self, scaled: FloatArray, until: int, noise: Mapping[str, float], tolerance: float
    ) -> tuple[FloatArray, bool]:
        """Return the best values for the times before `until`, and whether they were found."""
        sigma, data = self.sigma(noise), self.data.value[:until]
        present = np.isfinite(data)
        low, high = self.limits / self.problem.size
        start = self.problem.start / self.problem.size
        slopes = (self.evaluate(start, until)[1] / sigma[:, None])[present]
        pull = PULL * float(np.linalg.norm(slopes, axis=0).max(initial=0.0))
        self.best = None  # sums for another noise or time are not to be compared

        def find_residuals(x: FloatArray) -> FloatArray:
            try:
                left = ((self.evaluate(x, until)[0] - data) / sigma)[present]
            except (ConvergenceError, InvalidValueError):
                left = np.full(int(present.sum()), 1e6)  # what fails is far from all that was measured
            cost = float(left @ left)
            if self.best is None or cost < self.best[0]:
                self.best = cost, x.copy()
            return np.concatenate([left, pull * (x - start)])

        def find_slopes(x: FloatArray) -> FloatArray:
            own = (self.evaluate(x, until)[1] / sigma[:, None])[present]
            return np.vstack([own, pull * np.eye(len(x))])

        found = scipy.optimize.least_squares(
            find_residuals,
            np.clip(scaled, low, high),
            find_slopes,
            bounds=(low, high),
            x_scale="jac",
            ftol=tolerance,
            xtol=1e-3 * tolerance**0.5,
            gtol=tolerance,
            max_nfev=MAX_RUNS,
        )
        if self.progress is not None:
            self.progress(min(0.95, self.n_motions / MAX_RUNS))
        return np.asarray(found.x), bool(found.status > 0)

    def evaluate(self, scaled: FloatArray, until: int) -> tuple[FloatArray, FloatArray]:
        """Return values (until, n_channels) and their derivatives (..., n_keys) along the motion."""
        key = scaled.tobytes() + until.to_bytes(8, "little")
        if key not in self.known:
            while len(self.known) >= MAX_KNOWN:
                self.known.pop(next(iter(self.known)))
            self.n_motions += 1
            self.known[key] = self.problem.observe(scaled * self.problem.size, self.data, until)
        return self.known[key]


@dataclass(frozen=True)
class Fitted:
    """The end of a search: values over their sizes at the start, how many times were used, noise, status."""

    fit: Fit
    scaled: FloatArray
    used: int
    noise: Mapping[str, float]
    status: str
