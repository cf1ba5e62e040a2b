"""Identification: numbers of a scene from measured motions or states at rest, by least squares.

The search is judged: standard errors, what the data do not show, what readers should know.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.fit import LEAST_NOISE, Fit, Fitted
from tensegrity_codegen.sweeps.fitting.identification import NAMED, Identification, Undetermined
from tensegrity_codegen.sweeps.fitting.keyed_motion import METHOD, KeyedMotion, RunSettings
from tensegrity_codegen.sweeps.fitting.keyed_scene import read_bounds, require_nodes
from tensegrity_codegen.sweeps.fitting.keyed_statics import KeyedStatics
from tensegrity_codegen.sweeps.fitting.measurements import KINDS, Measurements, read_measurements
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, check_names, check_positive, is_number
from tensegrity_codegen.system.errors import InvalidValueError, check_choice


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
    the motion (docs/model.md), short times first; those of equilibria are central differences. Covariance
    (J^T J)^-1.

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
    """Return the stated noise of each kind that was measured, None where it is to be estimated."""
    if noise is None:
        return None
    kinds = dict.fromkeys(item.kind for item in data.channels)
    given = dict.fromkeys(kinds, noise) if not isinstance(noise, Mapping) else dict(noise)
    for kind, size in given.items():
        check_choice(kind, KINDS, "kind of measurement", "noise")
        check_positive(size, f"noise of {kind}", f"[{KINDS[kind][0]}]")
    lacking = [kind for kind in kinds if kind not in given]
    if lacking:
        raise InvalidValueError(
            "the noise of some measurements is not given",
            where="noise",
            given=", ".join(given),
            allowed=f"one number, or also {', '.join(lacking)}",
        )
    return {kind: float(given[kind]) for kind in kinds}


EXACT = 1e-7  # of the largest value of a kind: residuals below are errors of the integration
POOR, HOPELESS = 2.0, 10.0  # residuals over the stated noise: a warning, and a status of its own
WRONG_UNITS = 1000.0
NOT_WHITE = 1e-3
MIN_FOR_WHITENESS = 20
CONFIDENCE = 0.95
NO_INFLUENCE = 1e-9  # of the largest derivative
SLOWEST, LEAST_SLOPE = 1e-14, 1e-100  # singular values, as a part of the largest one, and at all


def judge_fit(end: Fitted) -> Identification:
    """Return the record: how sure the values are, and what the data do not show."""
    fit, used, noise, status = end.fit, end.used, end.noise, end.status
    problem, sigma, is_given = fit.problem, fit.sigma(noise), fit.noise is not None
    values, slopes = fit.evaluate(end.scaled, len(fit.data.time))
    left = (values - fit.data.value) / sigma
    fitted = left[:used]
    present = np.isfinite(fitted)
    n_values, n_keys = int(present.sum()), len(problem.keys)
    matrix = (slopes[:used] / sigma[:, None])[present]
    free = n_values - n_keys
    size = float(np.sqrt(np.sum(fitted[present] ** 2) / free))
    _, singular, ways = np.linalg.svd(matrix, full_matrices=False)
    least = max(SLOWEST * float(singular[0]), LEAST_SLOPE)
    errors = (1.0 if is_given else size) / np.maximum(singular, least)
    covariance = (ways.T * errors**2) @ ways * np.outer(problem.size, problem.size)
    error = np.sqrt(np.diag(covariance))
    found, quantile = end.scaled * problem.size, float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2.0, free))
    influence = np.linalg.norm(matrix, axis=0)
    idle = tuple(
        key
        for key, part in zip(problem.keys, influence, strict=True)
        if part <= NO_INFLUENCE * influence.max(initial=0.0) or part == 0.0
    )
    part = problem.size / np.where(found == 0, 1.0, np.abs(found))
    directions = [
        _name_direction(problem.keys, way, own, part)
        for way, own in zip(ways, errors.tolist(), strict=True)
        if own > 1.0
    ]
    unknown = tuple(item for item in directions if not set(item.part) <= set(idle))
    # Residuals as small as the error of the integration are no noise.
    is_noise = any(size > EXACT * fit.floor(kind) / LEAST_NOISE for kind, size in noise.items())
    whiteness = _find_whiteness(fitted) if is_noise and not fit.data.is_static else float("nan")
    held = left[used:][np.isfinite(left[used:])]
    held_out = float(np.sqrt(np.mean(held**2))) if held.size else float("nan")
    warnings = _find_warnings(size if is_given else 1.0, whiteness, held_out, unknown, idle)
    lost = None
    if isinstance(problem, KeyedMotion):
        lost = problem.find_loss_of_meaning(found, fit.data, slopes)
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
        value=found,
        start=problem.start,
        standard_error=error,
        interval=np.stack([found - quantile * error, found + quantile * error], axis=1),
        covariance=covariance,
        noise=dict(noise),
        residual=size,
        whiteness=whiteness,
        held_out=held_out,
        undetermined=unknown,
        without_influence=idle,
        n_values=n_values,
        n_motions=fit.n_motions,
        warnings=warnings,
        document=problem.write(found),
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
        own = column[np.isfinite(column)]
        if len(own) < MIN_FOR_WHITENESS or not own.any():
            continue
        total += len(own) * float(own[1:] @ own[:-1] / (own @ own)) ** 2
        channels += 1
    return float(scipy.stats.chi2.sf(total, channels)) if channels else float("nan")


def _find_warnings(
    size: float,
    whiteness: float,
    held_out: float,
    unknown: Sequence[Undetermined],
    idle: Sequence[str],
) -> tuple[str, ...]:
    """Return what a careful reader should know; size: residual over the stated noise."""
    found = []
    if size >= WRONG_UNITS:
        found.append(
            f"the residual is {size:.3g} times the stated noise: are units of the table or the scene wrong?"
        )
    elif size >= POOR:
        found.append(
            f"the residual is {size:.3g} times the stated noise: the model leaves something out, or the "
            "noise is larger; the standard errors are too small"
        )
    if whiteness < NOT_WHITE:
        found.append(
            f"residuals follow each other in time (probability {whiteness:.1g} for noise alone): the model "
            "leaves something out, and the standard errors are too small"
        )
    if held_out > POOR:
        found.append(f"the times held out are predicted to {held_out:.3g} times the noise only")
    found += [f"the data do not determine {item.describe()}" for item in unknown]
    if idle:
        found.append(f"without influence on what was measured: {', '.join(idle)}")
    return tuple(found)
