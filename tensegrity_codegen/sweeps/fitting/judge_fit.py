"""The judgement of a search: standard errors, what the data do not show, what readers should know."""

from collections.abc import Sequence

import numpy as np
import scipy

from tensegrity_codegen.sweeps.fitting.fit import LEAST_NOISE, Fitted
from tensegrity_codegen.sweeps.fitting.identification import NAMED, Identification, Undetermined
from tensegrity_codegen.sweeps.fitting.keyed_motion import KeyedMotion
from tensegrity_codegen.system.arrays import FloatArray

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
