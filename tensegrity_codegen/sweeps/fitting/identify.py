"""Identification: numbers of a scene from measured motions or states at rest, by least squares.

The search is judged: standard errors, what the data do not show, what readers should know.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.identification import NAMED, Identification, Undetermined
from tensegrity_codegen.sweeps.fitting.keyed_motion import METHOD, KeyedMotion, RunSettings
from tensegrity_codegen.sweeps.fitting.keyed_scene import KeyedStatics, read_bounds, require_nodes
from tensegrity_codegen.sweeps.fitting.measurements import KINDS, Measurements, read_measurements
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, check_names, check_positive, is_number
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, check_choice

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
    """One search: the problem, what was measured, and the noise, None if it is to be estimated."""

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
        """Fit short times, then all, and the noise unless it is given; return the result."""
        n_times = len(self.data.time)
        used = max(1, n_times - round(self.hold_out * n_times))
        count = int(np.isfinite(self.data.value[:used]).sum())
        n_keys = len(self.problem.keys)
        if count <= n_keys:
            problem, location = "there are too few measured values", self.data.source
            value = f"{count} values for {n_keys} numbers"
            raise InvalidValueError(problem, where=location, given=value, allowed="more values than numbers")
        is_given, noise = self.noise is not None, self.noise or self._guess_noise()
        scaled, status = self.problem.start / self.problem.size, "ok"
        self.evaluate(scaled, used)
        try:
            # Short times first, then all of them with the noise that the residuals show.
            for fraction in () if self.data.is_static else HORIZONS:
                until = int(fraction * used)
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

    def sigma(self, noise: Mapping[str, float]) -> FloatArray:
        """Return the noise of each channel, (n_channels,)."""
        return np.array([noise[channel.kind] for channel in self.data.channels])

    def _guess_noise(self) -> dict[str, float]:
        """Return sizes that weigh kinds of measurements against each other: a thousandth of their spread."""
        noise = {}
        for kind in dict.fromkeys(channel.kind for channel in self.data.channels):
            values = self._of_kind(self.data.value, kind)
            spread = np.sqrt(np.nanmean((values - np.nanmean(values, axis=0)) ** 2))
            noise[kind] = max(1e-3 * float(spread), self.floor(kind))
        return noise

    def _of_kind(self, values: FloatArray, kind: str) -> FloatArray:
        chosen = [k for k, channel in enumerate(self.data.channels) if channel.kind == kind]
        return values[:, [k for k in chosen if np.isfinite(self.data.value[:, k]).any()]]

    def floor(self, kind: str) -> float:
        """Return the least noise of a kind that counts, by its largest value."""
        return LEAST_NOISE * max(float(np.nanmax(np.abs(self._of_kind(self.data.value, kind)))), 1e-300)

    def _estimate_noise(self, scaled: FloatArray, used: int) -> dict[str, float]:
        """Return the standard deviation of each kind, by its residuals and its part of the numbers found."""
        residuals = self.evaluate(scaled, used)[0] - self.data.value[:used]
        total, noise = int(np.isfinite(residuals).sum()), {}
        for kind in dict.fromkeys(channel.kind for channel in self.data.channels):
            of_kind = self._of_kind(residuals, kind)
            count = int(np.isfinite(of_kind).sum())
            if not count:
                noise[kind] = self.floor(kind)
                continue
            free = count * (1.0 - len(self.problem.keys) / total)
            noise[kind] = max(float(np.sqrt(np.nansum(of_kind**2) / free)), self.floor(kind))
        return noise

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
                residuals = ((self.evaluate(x, until)[0] - data) / sigma)[present]
            except (ConvergenceError, InvalidValueError):
                residuals = np.full(
                    int(present.sum()), 1e6
                )  # a motion that fails is far from all measurements
            cost = float(residuals @ residuals)
            if self.best is None or cost < self.best[0]:
                self.best = cost, x.copy()
            return np.concatenate([residuals, pull * (x - start)])

        def find_slopes(x: FloatArray) -> FloatArray:
            scaled_slopes = (self.evaluate(x, until)[1] / sigma[:, None])[present]
            return np.vstack([scaled_slopes, pull * np.eye(len(x))])

        solution = scipy.optimize.least_squares(
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
        return np.asarray(solution.x), bool(solution.status > 0)

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


def identify(
    scene: str | Path | Mapping[str, Any] | Scene,
    measured: str | Path | Mapping[str, ArrayLike] | Measurements,
    keys: Sequence[str],
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    noise: float | Mapping[str, float] | None = None,
    hold_out: float = 0.0,
    method: str = METHOD,
    rtol: float = 1e-8,
    schedule: Profile | None = None,
    compiler: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> Identification:
    """Find numbers of a scene so that its motion, or its equilibria, are the measured ones.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        Scene file, or the scene as for `read_scene`; the values that it states are where the search starts.
    measured : str, Path, mapping or Measurements
        What was measured: a CSV file or arrays by name, see `read_measurements`.
    keys : sequence of str
        Numbers of the scene by their paths: ``classes.cable.spring_constant`` (one number for all cables of
        the class), ``members.s1.rest_length``, ``nodes.t1.velocity[2]``, ``ground.friction``.
    bounds : mapping of str to (float, float), optional
        Least and largest value of keys; by default what the scene allows.
    noise : float or mapping of str to float, optional
        Standard deviation of the measurements: one number for all, or by kind (``position`` and ``length``
        [m], ``velocity`` [m/s], ``tension`` [N], ``frequency`` [Hz]). By default it is estimated from the
        residuals.
    hold_out : float
        Part of the times or states, the last ones, that is predicted instead of fitted.
    method, rtol : str and float
        Of motions: integrator with error control, and the relative tolerance of its steps.
    schedule : Profile, optional
        Inputs over time; by default those of the measurements, if these have any, linear between the times.
    compiler : str, optional
        C compiler.
    progress : callable, optional
        Called with the part of the work that is done, 0 to 1.

    Returns
    -------
    Identification
        Values, standard errors, intervals, and what the data do not show.

    Raises
    ------
    SceneError
        The scene or the file of measurements has an error.
    UnknownKeyError, UnknownNameError
        A key, channel or kind that does not exist.
    InvalidValueError
        Fewer measured values than keys, bounds that exclude the start, keys that change the code.
    FormulationError
        Motions of the scene have no derivatives.
    ConvergenceError
        The motion, or an equilibrium, at the start of the search fails.

    Notes
    -----
    Weighted least squares by `scipy.optimize.least_squares` with the derivatives that are integrated beside
    the motion (docs/derivatives.md), short times first; those of equilibria are central differences.
    Covariance (J^T J)^-1.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, identify, simulate
    >>> motion = simulate(compile_scene("two_nodes.toml", for_="simulate"), 1.0)
    >>> measured = {"time": motion.time, "n2.z": motion.node_position[:, 1, 2]}
    >>> found = identify("two_nodes.toml", measured, ["classes.cord.spring_constant"])
    >>> found.status, round(float(found.value[0]), 6)
    ('ok', 80.0)
    """
    names = check_names(keys, "keys")
    if not names:
        raise InvalidValueError("no keys are given", where="keys", allowed="one or more numbers of the scene")
    if not (is_number(hold_out) and 0.0 <= hold_out < 1.0):
        raise InvalidValueError("not a part", where="hold_out", given=hold_out, allowed="0 or more, below 1")
    check_positive(rtol, "rtol", "")
    check_callback(progress, "progress")
    subject, _ = load_scene(scene)
    data = read_measurements(measured, require_nodes(subject, subject.name))
    problem: KeyedMotion | KeyedStatics
    if data.is_static:
        problem = KeyedStatics(scene, names, data, compiler)
    else:
        if schedule is None and data.conditions:
            courses = {name.removeprefix("input."): course for name, course in data.conditions.items()}
            schedule = Profile(data.time, courses)
        problem = KeyedMotion(scene, names, RunSettings(method, rtol, schedule), compiler)
    limits = read_bounds(problem, bounds)
    return judge_fit(Fit(problem, data, limits, _read_noise(noise, data), hold_out, progress).run())


def _read_noise(noise: float | Mapping[str, float] | None, data: Measurements) -> dict[str, float] | None:
    """Return the stated noise of each kind that was measured, None if it is to be estimated."""
    if noise is None:
        return None
    kinds = dict.fromkeys(channel.kind for channel in data.channels)
    sizes = dict.fromkeys(kinds, noise) if not isinstance(noise, Mapping) else dict(noise)
    for kind, size in sizes.items():
        check_choice(kind, KINDS, "kind of measurement", "noise")
        check_positive(size, f"noise of {kind}", f"[{KINDS[kind][0]}]")
    lacking = [kind for kind in kinds if kind not in sizes]
    if lacking:
        problem = "the noise of some measurements is not given"
        allowed = f"one number, or also {', '.join(lacking)}"
        raise InvalidValueError(problem, where="noise", given=", ".join(sizes), allowed=allowed)
    return {kind: float(sizes[kind]) for kind in kinds}


EXACT = 1e-7  # of the largest value of a kind: residuals below are errors of the integration
POOR, HOPELESS = 2.0, 10.0  # residuals over the stated noise: a warning, and a status of its own
WRONG_UNITS = 1000.0
NOT_WHITE = 1e-3
MIN_FOR_WHITENESS = 20
CONFIDENCE = 0.95
NO_INFLUENCE = 1e-9  # of the largest derivative
SLOWEST, LEAST_SLOPE = 1e-14, 1e-100  # singular values, as a part of the largest one, and at all


def judge_fit(end: Fitted) -> Identification:
    """Return the record: values with their errors, and directions that the data do not show."""
    fit, used, noise, status = end.fit, end.used, end.noise, end.status
    problem, sigma, is_given = fit.problem, fit.sigma(noise), fit.noise is not None
    values, slopes = fit.evaluate(end.scaled, len(fit.data.time))
    residuals = (values - fit.data.value) / sigma
    fitted = residuals[:used]
    present = np.isfinite(fitted)
    n_values, n_keys = int(present.sum()), len(problem.keys)
    matrix = (slopes[:used] / sigma[:, None])[present]
    free = n_values - n_keys
    size = float(np.sqrt(np.sum(fitted[present] ** 2) / free))
    # Covariance (J^T J)^-1 by singular values, each direction in parts of the sizes of the values.
    _, singular, ways = np.linalg.svd(matrix, full_matrices=False)
    smallest = max(SLOWEST * float(singular[0]), LEAST_SLOPE)
    errors = (1.0 if is_given else size) / np.maximum(singular, smallest)
    covariance = (ways.T * errors**2) @ ways * np.outer(problem.size, problem.size)
    error = np.sqrt(np.diag(covariance))
    solution, quantile = end.scaled * problem.size, float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2.0, free))
    influence = np.linalg.norm(matrix, axis=0)
    idle = tuple(
        key
        for key, part in zip(problem.keys, influence, strict=True)
        if part <= NO_INFLUENCE * influence.max(initial=0.0) or part == 0.0
    )
    part = problem.size / np.where(solution == 0, 1.0, np.abs(solution))
    directions = [
        _name_direction(problem.keys, way, direction_error, part)
        for way, direction_error in zip(ways, errors.tolist(), strict=True)
        if direction_error > 1.0
    ]
    undetermined = tuple(direction for direction in directions if not set(direction.part) <= set(idle))
    # Residuals as small as the error of the integration are no noise.
    is_noise = any(size > EXACT * fit.floor(kind) / LEAST_NOISE for kind, size in noise.items())
    whiteness = _find_whiteness(fitted) if is_noise and not fit.data.is_static else float("nan")
    held = residuals[used:][np.isfinite(residuals[used:])]
    held_out = float(np.sqrt(np.mean(held**2))) if held.size else float("nan")
    warnings = _find_warnings(size if is_given else 1.0, whiteness, held_out, undetermined, idle)
    lost = None
    if isinstance(problem, KeyedMotion):
        lost = problem.find_loss_of_meaning(solution, fit.data, slopes)
    if lost is not None and status == "ok":
        status = "sensitive"
    if is_given and size >= HOPELESS and status == "ok":
        status = "not_explained"
    runs = f"{fit.n_motions} {'sets of equilibria' if fit.data.is_static else 'motions'}"
    messages = {
        "ok": f"{n_values} values, {runs}, residual {size:.3g} times the noise",
        "not_converged": f"the search has not converged after {runs}",
        "interrupted": f"interrupted after {runs}; these are the best values so far",
        "sensitive": f"from {lost} s on the motion depends on its numbers so strongly that no derivative "
        "is right: fit a shorter time",
        "not_explained": f"the best that was found is {size:.3g} times the stated noise off",
    }
    return Identification(
        status=status,
        message=messages[status],
        key=problem.keys,
        value=solution,
        start=problem.start,
        standard_error=error,
        interval=np.stack([solution - quantile * error, solution + quantile * error], axis=1),
        covariance=covariance,
        noise=dict(noise),
        residual=size,
        whiteness=whiteness,
        held_out=held_out,
        undetermined=undetermined,
        without_influence=idle,
        n_values=n_values,
        n_motions=fit.n_motions,
        warnings=warnings,
        document=problem.write(solution),
    )


def _name_direction(keys: Sequence[str], way: FloatArray, error: float, part: FloatArray) -> Undetermined:
    """Return a direction with the keys that matter in it, the largest first; part: size over value."""
    way = way * part
    length = float(np.linalg.norm(way))
    way, error = way / length, error * length
    order = np.argsort(-np.abs(way), kind="stable")
    sign = np.sign(way[order[0]]) or 1.0
    named = [int(k) for k in order if abs(way[k]) >= NAMED]
    return Undetermined({keys[k]: float(sign * way[k]) for k in named}, float(error))


def _find_whiteness(left: FloatArray) -> float:
    """Return the probability that noise alone has larger correlations between neighbours in time."""
    total, channels = 0.0, 0
    for column in left.T:
        finite = column[np.isfinite(column)]
        if len(finite) < MIN_FOR_WHITENESS or not finite.any():
            continue
        total += len(finite) * float(finite[1:] @ finite[:-1] / (finite @ finite)) ** 2
        channels += 1
    return float(scipy.stats.chi2.sf(total, channels)) if channels else float("nan")


def _find_warnings(
    size: float, whiteness: float, held_out: float, unknown: Sequence[Undetermined], idle: Sequence[str]
) -> tuple[str, ...]:
    """Return the warnings for a careful reader; size: residual over the stated noise."""
    warnings = []
    if size >= WRONG_UNITS:
        warnings.append(
            f"the residual is {size:.3g} times the stated noise: are units of the table or the scene wrong?"
        )
    elif size >= POOR:
        warnings.append(
            f"the residual is {size:.3g} times the stated noise: the model leaves something out, or the "
            "noise is larger; the standard errors are too small"
        )
    if whiteness < NOT_WHITE:
        warnings.append(
            f"residuals follow each other in time (probability {whiteness:.1g} for noise alone): the model "
            "leaves something out, and the standard errors are too small"
        )
    if held_out > POOR:
        warnings.append(f"the times held out are predicted to {held_out:.3g} times the noise only")
    warnings += [f"the data do not determine {direction.describe()}" for direction in unknown]
    if idle:
        warnings.append(f"without influence on what was measured: {', '.join(idle)}")
    return tuple(warnings)
