"""Gradients of losses of motions to all run-time parameters at once, backwards over the steps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.integrate.adjoint import TAPE_BYTES, TapedRun, directed_shapes
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import Stepping, read_stepping
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.runtime.profiles.profile import BUILD, Profile
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, check_instance
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, NonFiniteError

# What a loss may depend on: the state and quantities of a motion at its samples.
OBSERVED = ("node_position", "node_velocity", "member_length", "member_tension")
Loss = Callable[[Trajectory], tuple[float, Mapping[str, FloatArray]]]
START = ("coordinate", "velocity", "internal")  # the state, at samples too
# Differences that a gradient is compared with: their steps as a part of each number, of which the second is
# for motions that bend within the first, with the error from which on it is tried; how much tighter the steps
# of their motions are, and the least tolerance of these; the size of inputs that are all zero.
STEPS, BENT = (1e-5, 1e-6), 1e-5
TIGHTER, MIN_RTOL, INPUT_SIZE = 100.0, 1e-13, 0.01


@dataclass(frozen=True)
class MotionGradient:
    """A loss of a motion, and its derivatives.

    Attributes
    ----------
    loss : float
        The loss.
    motion : Trajectory
        The motion.
    by : mapping of str to ndarray
        Derivatives of the loss to every run-time parameter and to the inputs, each in the shape of its
        argument, and to ``"coordinate"``, ``"velocity"`` and ``"internal"`` at the start. Numbers that follow
        the schedule have those of a constant that is added to them.
    knots : mapping of str to ndarray
        Derivatives to the knots of the schedule, by the names there, in the shape of its values.
    parts : mapping of str to ndarray
        Derivatives of the loss to quantities at the samples, as it returns them.
    error : float or None
        Part by which the derivative along a change of all numbers, each by a part of its size in the
        direction of the gradient, is apart from that of differences of nearby motions, which share nothing
        with it. Some of it is their own error: about 1e-6 is the best to expect. None if a nearby motion
        fails, or `check` is false.
    """

    loss: float
    motion: Trajectory
    by: Mapping[str, FloatArray]
    knots: Mapping[str, FloatArray]
    parts: Mapping[str, FloatArray]
    error: float | None = None


def motion_gradient(
    model: CompiledModel,
    loss: Loss,
    t_end: float,
    *,
    samples: int | ArrayLike = 101,
    method: str = "rk853",
    rtol: float = 1e-8,
    coordinate: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    schedule: Profile | None = None,
    memory: int = TAPE_BYTES,
    check: bool = True,
) -> MotionGradient:
    """Return the gradient of a loss of a motion to all run-time parameters, inputs and the start.

    Parameters
    ----------
    model : CompiledModel
        A library with the quantities ``"adjoint_rate"`` and, for losses of tensions, ``"adjoint_tension"``.
    loss : callable
        Trajectory -> value, and its derivatives to quantities at the samples: a mapping from
        ``"node_position"`` (n_t, n_nodes, 3), ``"node_velocity"``, ``"member_length"`` (n_t, n_members),
        ``"member_tension"``, ``"coordinate"``, ``"velocity"`` or ``"internal"`` to arrays of their shape.
    t_end, samples, method, rtol, coordinate, velocity, arguments, schedule
        As of `simulate`; method: ``"rk54"``, ``"tsit5"`` or ``"rk853"``.
    memory : int
        Bytes that the steps of the motion may take. A longer motion is integrated twice, piece by piece.
    check : bool
        Whether the gradient is compared with differences, by four to eight motions with tighter steps.

    Returns
    -------
    MotionGradient
        Loss, motion and derivatives.

    Raises
    ------
    FormulationError
        The library has no gradients of motions.
    ConvergenceError
        The motion fails.
    InvalidValueError, NonFiniteError
        The loss has another form, or is not finite; otherwise as `simulate`.

    Notes
    -----
    The exact transpose of the steps (Hairer, Norsett and Wanner 1993, II.15), of their dense output, and of
    the jumps of derivatives where damped cables are pulled taut (docs/derivatives.md). It costs 2 to 3
    motions, whatever the number of parameters. Steps are controlled by the motion alone: on stiff ground they
    may be too long for derivatives. A library with `directions` controls the derivatives along these too: one
    along all numbers is enough, and shows in `motion.columns` whether both ways give the same.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import build_library, ModelRequest, load_scene, motion_gradient
    >>> structure, _ = load_scene("two_nodes.toml")
    >>> request = ModelRequest(
    ...     ("member_tension", "acceleration", "kinetic_energy", "total_energy", "adjoint_rate"),
    ...     integrators=("rk853",), parameters={"rest_length": (0,)})
    >>> model = build_library(structure, request).load()
    >>> def depth(motion):
    ...     at = np.zeros_like(motion.node_position)
    ...     at[-1, 1, 2] = 1.0
    ...     return motion.node_position[-1, 1, 2], {"node_position": at}
    >>> found = motion_gradient(model, depth, 0.5)
    >>> found.by["rest_length"].shape, found.error < 1e-4
    ((1,), True)
    """
    check_callback(loss, "loss")
    options = read_stepping(Stepping(control="steps")).with_method(method, rtol)
    motion = read_motion(model, options, t_end, samples, arguments, schedule, coordinate, velocity)
    # The motion forwards, and its loss.
    run = TapedRun(motion, options, memory)
    raw = run.finish()
    trajectory = evaluate_trajectory(model, raw, motion.arguments, motion.schedule)
    if trajectory.status != "ok":
        raise ConvergenceError(f"the motion fails: {trajectory.message}", where=model.manifest.name)
    value, derivatives = read_loss(loss, trajectory)
    # Backwards over the steps, from weights of the states at the samples.
    weights = _Weights(model, trajectory, motion.arguments, motion.schedule)
    for name, derivative in derivatives.items():
        if name in START:
            weights.add_state(name, derivative)
        else:
            getattr(weights, f"add_{name}")(derivative)
    back = run.go_back(weights.state)
    by = {name: array + weights.number.get(name, 0.0) for name, array in back.number.items()}
    n = len(model.manifest.coordinate_name)
    by |= dict(zip(START, np.split(back.state, (n, 2 * n)), strict=True))
    if not all(np.isfinite(array).all() for array in by.values()):
        raise NonFiniteError("the gradient of the loss is not finite", where="loss", given=value)
    knots = {}
    if back.coefficient is not None:
        assert isinstance(motion.schedule, DrivenArguments)
        assert schedule is not None
        knots = _to_knots(schedule, back.coefficient + weights.driven(motion.schedule))
    gradient = MotionGradient(value, trajectory, by, knots, derivatives)
    if not check:
        return gradient
    # Compare with differences of motions nearby.
    nearby = _Nearby(gradient, motion, arguments, schedule)

    def compute_loss(step: float) -> float:
        inputs = nearby.move(step)
        options: dict[str, Any] = {
            "method": method,
            "rtol": max(rtol / TIGHTER, MIN_RTOL),
            "stepping": Stepping(control="steps"),
        }
        moved = simulate(model, t_end, samples=samples, **options, **inputs)
        if moved.status != "ok":
            raise ConvergenceError("a motion nearby fails", where=model.manifest.name)
        return read_loss(loss, moved)[0]

    return replace(gradient, error=compare_with_differences(compute_loss, nearby.slope))


def compare_with_differences(compute_loss: Callable[[float], float], slope: float) -> float | None:
    """Return the part by which a derivative is apart from that of differences, None without motions nearby.

    compute_loss: the loss at a step along a direction; slope: its derivative. Where events coincide, central
    differences have errors of first order, which the second one takes away.
    """
    errors: list[float] = []
    for step in STEPS:
        try:
            first_difference, second_difference = (
                (compute_loss(k * step) - compute_loss(-k * step)) / (2 * k * step) for k in (1, 2)
            )
        except (ConvergenceError, InvalidValueError):
            break
        error = abs(2.0 * first_difference - second_difference - slope)
        errors.append(error / abs(slope) if slope else (float("inf") if error else 0.0))
        if errors[0] <= BENT:
            break
    return min(errors, default=None)


class _Nearby:
    """Motions with all numbers changed by parts of their sizes, so that the loss rises."""

    def __init__(
        self,
        gradient: MotionGradient,
        motion: Motion,
        inputs: Mapping[str, Any] | None,
        schedule: Profile | None,
    ) -> None:
        n = len(gradient.by["coordinate"])
        start = dict(zip(START[:2], (motion.state[:n], motion.state[n : 2 * n]), strict=True))
        reach = float(np.abs(start["coordinate"]).max(initial=0.0))
        size = {"coordinate": reach, "velocity": reach / motion.t_end}
        driven = {} if schedule is None else dict(schedule.values)
        self.schedule, self.slope, self.start = schedule, 0.0, dict(start)
        self.given = dict(motion.arguments) if schedule is None else dict(inputs or {})
        self.value: dict[str, FloatArray] = (
            {} if motion.model.manifest.rigid_bar else start
        )  # bars keep lengths
        left_out = (*START, *driven, *(("input",) if driven else ()))
        for name in gradient.by:
            if name not in left_out:
                self.value[name] = np.asarray(motion.arguments.get(name, motion.model.nominal(name)))
        self.way: dict[str, FloatArray] = {}
        for name, value, slope in (
            *((name, value, gradient.by[name]) for name, value in self.value.items()),
            *(
                (name, value, gradient.knots[name])
                for name, value in driven.items()
                if name in gradient.knots
            ),
        ):
            sizes = np.abs(np.asarray(value, dtype=np.float64)).reshape(np.shape(slope))
            if name in (*START, "input", *driven):  # zero is as good a value as any other
                default_size = size.get(name, INPUT_SIZE)
                sizes = np.full(sizes.shape, sizes.max(initial=0.0) or default_size)
            self.way[name] = sizes * np.sign(slope)
            self.slope += float(np.sum(sizes * np.abs(slope)))

    def move(self, step: float) -> dict[str, Any]:
        """Return arguments of `simulate` with all numbers moved."""
        moved = {
            name: self.value[name] + step * self.way[name].reshape(np.shape(self.value[name]))
            for name in self.value
        }
        inputs: dict[str, Any] = {name: moved.pop(name, value) for name, value in self.start.items()}
        if self.schedule is not None:
            values = {
                name: value + step * self.way.get(name, 0.0) for name, value in self.schedule.values.items()
            }
            inputs["schedule"] = Profile(self.schedule.time, values, self.schedule.kind)
        return {"arguments": {**self.given, **moved}, **inputs}


def read_loss(loss: Loss, motion: Trajectory) -> tuple[float, dict[str, FloatArray]]:
    """Return a loss of a motion, and its derivatives to quantities at the samples, all checked."""
    check_instance(loss, Callable, "loss", "a function of a motion")  # type: ignore[arg-type]
    answer = loss(motion)
    if not (isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], Mapping)):
        raise InvalidValueError(
            "a loss returns its value and a mapping of its derivatives",
            where="loss",
            given=type(answer).__name__,
            allowed=f"(value, {{name: array}}) with the names {', '.join(OBSERVED)}",
        )
    value, derivatives = float(answer[0]), {}
    for name, derivative in answer[1].items():
        if name not in (*OBSERVED, *START):
            allowed = ", ".join((*OBSERVED, *START))
            raise InvalidValueError(
                "a loss has no derivative to this", where="loss", given=name, allowed=allowed
            )
        shape = find_observed(motion, name).shape
        derivatives[name] = np.asarray(derivative, dtype=np.float64)
        if derivatives[name].shape != shape:
            raise InvalidValueError(
                "a derivative of the loss has another shape",
                where=f"loss: {name}",
                given=derivatives[name].shape,
                allowed=str(shape),
            )
    if not (np.isfinite(value) and all(np.isfinite(derivative).all() for derivative in derivatives.values())):
        raise NonFiniteError("the loss or its derivatives are not finite", where="loss", given=value)
    return value, derivatives


def find_observed(motion: Trajectory, name: str) -> FloatArray:
    """Return a quantity of OBSERVED, at the samples."""
    return motion.member_tension if name == "member_length" else np.asarray(getattr(motion, name))


class _Weights:
    """Weights of the states at the samples, and of run-time parameters that a loss depends on directly."""

    def __init__(
        self,
        model: CompiledModel,
        motion: Trajectory,
        arguments: Mapping[str, Any],
        schedule: Schedule | None,
    ) -> None:
        self.model, self.motion, self.manifest = model, motion, model.manifest
        self.arguments, self.schedule = arguments, schedule
        self.n = len(self.manifest.coordinate_name)
        self.state = np.zeros((len(motion.time), 2 * self.n + len(self.manifest.internal_name)))
        self.number: dict[str, FloatArray] = {}
        self.node, self.axis = np.array(self.manifest.coordinate_node_axis, dtype=np.int64).reshape(-1, 2).T
        self.followed: list[tuple[float, dict[str, FloatArray]]] = []  # times, weights of numbers there

    def add_state(self, name: str, weight: FloatArray) -> None:
        """Add weights of coordinates, velocities or internal states (n_t, n)."""
        first = START.index(name) * self.n
        self.state[:, first : first + weight.shape[1]] += weight

    def add_node_position(self, weight: FloatArray) -> None:
        """Add weights of positions (n_t, n_nodes, 3), of anchored nodes too."""
        self.state[:, : self.n] += self._carry(weight)
        anchors = self.manifest.find_argument("anchor_position")
        if anchors is None:
            return
        held = weight.sum(axis=0)
        held[self.node, self.axis] = 0.0
        rows = [self.manifest.node_name.index(name) for name in anchors.over]
        self._add_number("anchor_position", held[rows][:, list(self.manifest.axes)])

    def add_node_velocity(self, weight: FloatArray) -> None:
        """Add weights of velocities (n_t, n_nodes, 3)."""
        self.state[:, self.n : 2 * self.n] += self._carry(weight)

    def _carry(self, weight: FloatArray) -> FloatArray:
        """Return weights of nodes (n_t, n_nodes, 3) as those of coordinates, (n_t, n_coordinates)."""
        if self.manifest.body_places:
            weight = weight.copy()
            for body in self.manifest.body_places:
                body.gather(weight)
        return np.asarray(weight[:, self.node, self.axis])

    def add_member_length(self, weight: FloatArray) -> None:
        """Add weights of lengths (n_t, n_members)."""
        strands = self.manifest.strands
        span = strands.vectors(self.motion.node_position)
        along = strands.spread(weight)[..., None] * span / np.linalg.norm(span, axis=-1, keepdims=True)
        node_weight = np.zeros_like(self.motion.node_position)
        for k, (start, end) in enumerate(strands.ends):
            node_weight[:, start] += along[:, k]
            node_weight[:, end] -= along[:, k]
        self.add_node_position(node_weight)

    def add_member_tension(self, weight: FloatArray) -> None:
        """Add weights of tensions (n_t, n_members), which depend on run-time parameters too."""
        require_quantities(self.model, ("adjoint_tension",), "a loss of tensions")
        moved = self.state.shape[1]
        shapes = directed_shapes(self.manifest)
        edges = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])[:-1]
        needed = self.model.function("adjoint_tension").spec.arguments
        for k in np.flatnonzero(weight.any(axis=1)):
            time = float(self.motion.time[k])
            values = {**self.arguments, **(self.schedule(time) if self.schedule else {})}
            values |= {"coordinate": self.motion.coordinate[k], "velocity": self.motion.velocity[k]}
            values |= {"tension_weight": weight[k]}
            if self.motion.internal is not None:
                values["internal"] = self.motion.internal[k]
            values = {name: value for name, value in values.items() if name in needed}
            derivative = np.asarray(self.model.compute("adjoint_tension", **values))
            self.state[k] += derivative[:moved]
            numbers = dict(zip(shapes, np.split(derivative[moved:], edges), strict=True))
            self.followed.append((time, numbers))
            for name, number_weight in numbers.items():
                self._add_number(name, number_weight.reshape(shapes[name]))

    def driven(self, schedule: DrivenArguments) -> FloatArray:
        """Return weights of the coefficients of a schedule that a loss depends on directly."""
        pieces = schedule.pieces
        weights = np.zeros_like(pieces.coefficient)
        for time, numbers in self.followed:
            piece = int(np.searchsorted(pieces.time[1:-1], time, side="right"))
            powers = (time - pieces.time[piece]) ** np.arange(weights.shape[1])
            # What a column is along is in a profile too, and nothing that a loss depends on
            row = [numbers[name][k] if name in numbers else 0.0 for name, k in schedule.place]
            weights[piece] += np.outer(powers, row)
        return weights

    def _add_number(self, name: str, part: FloatArray) -> None:
        self.number[name] = self.number.get(name, 0.0) + part


def _to_knots(profile: Profile, coefficient: FloatArray) -> dict[str, FloatArray]:
    """Return derivatives to the knots of a profile, of which its coefficients are sums."""
    basis = BUILD[profile.kind](profile.time, np.eye(len(profile.time))).coefficient
    derivative = np.einsum("pdk,pdv->kv", basis, coefficient)
    edges = np.cumsum([array[0].size for array in profile.values.values()])[:-1]
    pieces = np.split(derivative, edges, axis=1)
    return {
        name: piece.reshape(value.shape)
        for (name, value), piece in zip(profile.values.items(), pieces, strict=True)
    }
