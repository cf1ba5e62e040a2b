"""Identification: numbers of a scene from measured motions or states at rest, by least squares."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.fit import Fit
from tensegrity_codegen.sweeps.fitting.identification import Identification
from tensegrity_codegen.sweeps.fitting.judge_fit import judge_fit
from tensegrity_codegen.sweeps.fitting.keyed_motion import METHOD, KeyedMotion, RunSettings
from tensegrity_codegen.sweeps.fitting.keyed_scene import read_bounds, require_nodes
from tensegrity_codegen.sweeps.fitting.keyed_statics import KeyedStatics
from tensegrity_codegen.sweeps.fitting.measurements import KINDS, Measurements, read_measurements
from tensegrity_codegen.system.checks import check_names, check_positive, is_number
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
        Inputs over time.
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
    subject, _ = load_scene(scene)
    data = read_measurements(measured, require_nodes(subject, subject.name))
    problem: KeyedMotion | KeyedStatics
    if data.is_static:
        problem = KeyedStatics(scene, names, data, compiler)
    else:
        problem = KeyedMotion(scene, names, RunSettings(method, rtol, schedule), compiler)
    limits = read_bounds(problem, bounds or {})
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
