"""Timed motions: paths through equilibria, put in time by a time law, and simulated motions."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from tensegrity_codegen.control.feedback.design.linear_samples import check_motion
from tensegrity_codegen.control.feedback.equilibrium_path import (
    EquilibriumPath,
    PathKnots,
    SmoothPath,
    build_smooth_path,
    find_knots,
)
from tensegrity_codegen.control.feedback.inverse_dynamics import (
    DYNAMIC,
    STATIC,
    Driven,
    Feedforward,
    Timing,
    build_feedforward,
    describe_residual,
)
from tensegrity_codegen.control.feedback.time_law import QUINTIC, check_rates, find_shortest, read_law
from tensegrity_codegen.control.planning.plan import check_duration
from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.interface import require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_switch, check_whole
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

MIN_SAMPLES, MAX_SAMPLES = 5, 100_000
TOLERANCE = 1e-12


def time_motion(
    model: CompiledModel,
    path: PlanResult | EquilibriumPath,
    duration: float | None = None,
    law: str | ArrayLike = QUINTIC,
    *,
    feedforward: str = "dynamic",
    there_and_back: bool = False,
    arguments: Mapping[str, Any] | None = None,
    samples: int = 201,
) -> Motion:
    """Put a path through equilibria in time.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"time_motion"``, see compile_scene.
    path : PlanResult or EquilibriumPath
        A plan that was found, or equilibria one after the other.
    duration : float, optional
        Time of the motion [s]; by default that of the table, without one the shortest that the rates of the
        actuators permit.
    law : str or array_like, shape (n, 2)
        ``"quintic"``: progress s = 10 x^3 - 15 x^4 + 6 x^5 over x = t / duration; or a table of times [s] and
        progress, from (0, 0) to (end, 1).
    feedforward : str
        ``"dynamic"``: tensions and inputs that produce the accelerations of the motion, next to the tensions
        of the path; needs masses. ``"static"``: those of the path, which neglect inertia and damping.
    there_and_back : bool
        Go to the end of the path in the first half of the time, and back the same way in the second half. The
        duration is that of both, twice that of a table.
    arguments : mapping, optional
        Inputs and parameters by name, if they differ from the scene; those of the path.
    samples : int
        Number of equally spaced knots of the motion.

    Returns
    -------
    Motion
        Coordinates, inputs and tensions over time.

    Raises
    ------
    InvalidValueError
        A duration below the shortest (the message names the actuator, its cable, its rate and the time); a
        path that is none; points that are not in balance; a wrong table.
    StructureError
        The scene has no actuators.
    ConvergenceError, UnstableError
        No stable equilibrium between two points of the path.

    Notes
    -----
    docs/timing.md has the equations.

    Examples
    --------
    >>> from tensegrity_codegen import EquilibriumPath, compile_scene, time_motion
    >>> model = compile_scene("prism12.toml", for_="time_motion")
    >>> path = EquilibriumPath([[0, 0, 0, 0, 0, 0], [-0.005, -0.005, -0.005, 0, 0, 0]])
    >>> motion = time_motion(model, path, duration=1.0)
    >>> motion.input.shape, motion.shortest_duration < 1.0
    ((201, 6), True)
    """
    require_model(model)
    check_whole(samples, "samples", MIN_SAMPLES, MAX_SAMPLES)
    check_switch(there_and_back, "there_and_back")
    check_choice(feedforward, (DYNAMIC, STATIC), "feedforward", "feedforward")
    shape = read_law(law).returning() if there_and_back else read_law(law)
    check_duration(duration)
    requested = shape.own_duration if duration is None else float(duration)
    plan_model, knots = find_knots(model, path, arguments)
    smooth = remove_momentum(plan_model, knots, build_smooth_path(plan_model, knots))
    timing = Timing(smooth, shape, np.linspace(0.0, 1.0, samples))
    drive = build_feedforward(feedforward, plan_model, timing)
    shortest = _find_shortest(plan_model, timing, drive)
    length = _choose_duration(requested, shortest)
    driven = drive(length)
    check_rates(plan_model.actuation, driven.peaks, model.manifest.member_name, length, shortest)
    return _record(plan_model, timing, driven, shortest)


def _find_shortest(plan_model: PlanModel, timing: Timing, drive: Feedforward) -> float:
    """Return the shortest duration that the rates permit [s], 0 without rates."""
    rate = plan_model.actuation.rate

    def excess(duration: float) -> float:
        return float((drive(duration).peaks.rate / rate).max(initial=0.0))

    static = build_feedforward(STATIC, plan_model, timing)
    shortest = float((static(1.0).peaks.rate / rate).max(initial=0.0))
    return shortest if drive.is_static else find_shortest(shortest, excess)


def _record(plan_model: PlanModel, timing: Timing, driven: Driven, shortest: float) -> Motion:
    q, v, a = timing.states(driven.duration)
    manifest = plan_model.model.manifest
    return Motion(
        time=timing.part * driven.duration,
        coordinate=q,
        velocity=v,
        acceleration=a,
        rest_length=plan_model.rest_length(driven.change),
        input=np.array([plan_model.inputs(row) for row in driven.change]),
        member_tension=driven.tension,
        peak_rate=driven.peaks.rate,
        actuators=plan_model.actuation.names,
        input_name=manifest.input_name,
        shortest_duration=shortest,
        path_error=timing.path.error,
        residual=np.abs(driven.residual).max(axis=1) if driven.residual.size else np.zeros(0),
        warnings=describe_residual(manifest.coordinate_name, timing, driven),
    )


def _choose_duration(requested: float | None, shortest: float) -> float:
    if requested is not None:
        return requested
    if shortest > 0:
        return shortest
    raise InvalidValueError(
        "no rates limit the motion, so that no duration is the shortest",
        where="duration",
        given="no duration, actuators without `rate`",
        allowed="a duration [s], or actuators with a rate [m/s]",
    )


# Rigid motions of free structures: those in which momentum and angular momentum stay zero.
#
# Internal forces change no momentum. So a path through shapes fixes how a free structure turns and moves.


def remove_momentum(plan_model: PlanModel, knots: PathKnots, path: SmoothPath) -> SmoothPath:
    """Return the path with the rigid motions in which a free structure keeps zero momentum."""
    # With positions x_i (from the centre of mass) and masses m_ij of the path over progress, the angular
    # velocity W in the axes of the path follows from sum m_ij x_i x (x_j' + W x x_j) = 0; R' = R [W].
    structure, model = plan_model.structure, plan_model.model
    if not isinstance(structure, Structure) or not model.has("mass_matrix"):
        return path
    axes = list(structure.axes)
    rigid = {3: 6, 2: 3}.get(len(axes), 0)
    if structure.node_anchored[:, axes].any() or any(at.neutral.shape[1] != rigid for at in knots.point):
        return path
    count = len(axes)
    coordinate_place = model.manifest.coordinate_place
    order = np.lexsort((coordinate_place[:, 1], coordinate_place[:, 0]))  # node by node, axis by axis
    mass = model.compute("mass_matrix", **plan_model.arguments).toarray()[np.ix_(order, order)]
    turned = _turn(path, mass[::count, ::count], order, axes)
    result = np.empty_like(turned)
    result[:, order] = turned
    return replace(path, coordinate=CubicSpline(path.knots, result))


def _turn(path: SmoothPath, mass: FloatArray, order: NDArray[np.int64], axes: list[int]) -> FloatArray:
    """Return the coordinates at the knots (n, n_coordinates), node by node, without momentum on the way."""
    total = float(mass.sum())

    def nodes(s: float, derivative: int) -> FloatArray:
        """Return positions, or their derivatives, from the centre of mass, (n_nodes, 3)."""
        field = np.zeros((len(mass), 3))
        field[:, axes] = np.asarray(path.coordinate(s, derivative))[order].reshape(len(mass), -1)
        return np.asarray(field - mass.sum(axis=0) @ field / total)

    def spin(s: float, turn: FloatArray) -> FloatArray:
        x, rate = nodes(s, 0), nodes(s, 1)
        momentum = np.cross(x, mass @ rate).sum(axis=0)
        products = x.T @ mass @ x
        inertia = np.trace(products) * np.eye(3) - products
        w = -np.linalg.pinv(inertia, rcond=1e-12) @ momentum
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.asarray((turn.reshape(3, 3) @ cross).ravel())

    # The rotation over progress, and the nodes turned by it about their centre of mass.
    rotation = solve_ivp(
        spin,
        (0.0, 1.0),
        np.eye(3).ravel(),
        method="DOP853",
        t_eval=path.knots,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    start = np.zeros((len(mass), 3))
    start[:, axes] = np.asarray(path.coordinate(0.0))[order].reshape(len(mass), -1)
    centre = mass.sum(axis=0) @ start / total
    turns = [np.linalg.svd(row.reshape(3, 3)) for row in rotation.y.T]  # nearest rotations
    placed = [nodes(float(s), 0) @ (u @ v).T + centre for s, (u, _, v) in zip(path.knots, turns, strict=True)]
    return np.array([position[:, axes].ravel() for position in placed])


# Simulated motions as motions that feedback follows, through contacts with the ground too.


def record_motion(model: CompiledModel, run: Trajectory) -> Motion:
    """Return a simulated motion as one that `design_lqr` and `simulate_control` follow.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    run : Trajectory
        Motion of `simulate`, of the same scene, that ends at rest. Its samples become the knots: some at each
        command, and more where forces change fast.

    Returns
    -------
    Motion
        Coordinates, inputs, tensions and deflections of contacts at the samples.

    Raises
    ------
    InvalidValueError
        A motion that stopped early, begins after 0 s, or belongs to another model.
    StructureError
        The structure has no actuators.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import Profile, compile_scene, record_motion, simulate
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("simulate", "control"))
    >>> pull = Profile([0.0, 0.5, 1.0], {"winch": [0.0, -0.1, -0.1]})
    >>> record_motion(model, simulate(model, 1.0, samples=101, schedule=pull)).duration
    1.0
    """
    require_model(model)
    check_instance(run, Trajectory, "run", "a Trajectory of simulate")
    actuation = find_actuation(model)
    if run.status != "ok" or run.input is None or run.time[0] != 0.0:
        raise InvalidValueError(
            "not a motion from 0 s to its end",
            where="run",
            given=f"{run.status}, from {run.time[0]:g} s",
            allowed="status ok, from 0 s, with the inputs of the actuators",
        )
    # Accelerations at the samples, and the motion that has them.
    names = ("coordinate", "velocity", INPUT, *(() if run.internal is None else ("internal",)))
    internal = np.zeros((len(run.time), 0)) if run.internal is None else run.internal
    rows = zip(run.coordinate, run.velocity, run.input, internal, strict=True)
    accelerations = [model.compute("acceleration", **dict(zip(names, row, strict=False))) for row in rows]
    inputs = run.input[:, actuation.place]
    motion = Motion(
        time=run.time,
        coordinate=run.coordinate,
        velocity=run.velocity,
        acceleration=np.array(accelerations),
        rest_length=PlanModel(model, actuation).rest_length(inputs),
        input=run.input,
        member_tension=run.member_tension,
        peak_rate=np.abs(np.diff(inputs, axis=0) / np.diff(run.time)[:, None]).max(axis=0),
        actuators=actuation.names,
        input_name=run.input_name,
        internal=internal,
    )
    check_motion(model, motion)
    return motion
