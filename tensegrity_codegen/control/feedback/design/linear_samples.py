"""Linear models along a motion, sampled exactly: x[k+1] = A[k] x[k] + B[k] u[k] for constant inputs.

With actuators that answer late, and equilibria as motions that stay there. While a foot sticks on the ground
its bristle moves as its node does: s = F q - p is no state of its own. The point p where it sticks moves
where the contact slips or is open; inner forces do not bring it back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import expm

from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.runtime.linear.linearize import find_variations
from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_shape, to_sized
from tensegrity_codegen.runtime.model.interface import Described, require_double, require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import build_node_matrix, place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion, MotionPoint
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.checks import check_instance, check_positive
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.formulations import find_formulation

LINEAR_QUANTITIES = ("state_jacobian", "input_jacobian")
MAX_SAMPLES = 100_000  # of one motion
ROUNDING = 1e-9  # of a sample, by which delays and durations may differ from whole samples
FOUND_STATUSES = ("converged", "rounding_limited")

SLIPPED = 1e-5  # of the size of a structure: motion of the point where a foot sticks that is reported


def find_following(model: Described, coordinate: FloatArray) -> FloatArray:
    """Return F (n_internal, n_coordinates): derivatives of bristles by coordinates while contacts stick.

    Balls on bodies roll: their lowest points move with the bodies as they are at `coordinate`.
    """
    manifest, structure = model.manifest, model.structure
    n = len(manifest.coordinate_name)
    if not manifest.internal_name:
        return np.zeros((0, n))
    ground: Any = getattr(structure, "ground", None)
    nodes = build_node_matrix(manifest).toarray().reshape(-1, 3, n)
    moves, position = nodes[ground.node], place_nodes(model, coordinate)  # type: ignore[arg-type]
    for body in manifest.body_places:
        for c in np.flatnonzero(np.isin(ground.node, body.point) & (ground.radius > 0)):
            weights = body.touch(int(ground.node[c]), -ground.radius[c] * ground.normal, position)
            moves[c] = np.tensordot(weights, nodes[list(body.corner)], 1)
    return np.asarray(ground.tangents(tuple(manifest.axes)) @ moves).reshape(-1, n)


def find_bristles(model: Described, point: MotionPoint, coordinate: FloatArray) -> dict[str, FloatArray]:
    """Return the argument `internal` at coordinates near a point of a motion; {} without friction."""
    following = find_following(model, point.coordinate)
    moved = following @ (coordinate - point.coordinate)
    return {"internal": point.internal + moved} if len(following) else {}


def check_still_feet(model: Described, motion: Motion, design: str) -> None:
    """Raise FormulationError for a motion on which contacts do not stay as they are at its start."""
    if (motion.internal != motion.internal[:1]).any():
        raise FormulationError(
            f"{design} needs feet that stick where they stand",
            where=model.manifest.name,
            given=f"a motion of {motion.duration:g} s in which forces of the ground change",
            allowed="an Equilibrium, or a motion away from the ground",
            hint="follow this motion by the gains of design_lqr",
        )


def hold_feet(structure: Subject, model: Described, motion: Motion) -> Subject:
    """Return a structure whose contacts stick where they do at the start of a motion, without bristles."""
    if not model.manifest.internal_name:
        return structure
    start, ground = motion.at(0.0), getattr(structure, "ground", None)
    assert ground is not None
    stick_point = find_following(model, start.coordinate) @ start.coordinate - start.internal
    position, arm = place_nodes(model, start.coordinate), np.zeros((ground.n_contacts, 3))  # type: ignore[arg-type]
    for body in model.manifest.body_places:  # balls stick by the points of them that are lowest at the start
        at = np.isin(ground.node, body.point)
        arm[at] = -ground.radius[at, None] * (ground.normal @ body.frame(position))
    rolls = bool(model.manifest.body_places)
    stick = {"stick_point": stick_point.reshape(ground.n_contacts, -1), "stick_arm": arm if rolls else None}
    held = replace(ground, **stick)
    changed: Subject = structure.with_changes(ground=held)
    return changed


def measure_slip(model: CompiledModel, state: FloatArray) -> tuple[FloatArray | None, str]:
    """Return how far the points have moved where feet stick, and a sentence about feet that did not stay."""
    coordinate, bristle = np.split(state, [2 * (n := len(model.manifest.coordinate_name))], axis=1)
    coordinate = coordinate[:, :n]
    # Balls roll, so that their lowest points move by other combinations of coordinates from sample to sample.
    rows = coordinate if model.manifest.body_places else coordinate[:1]
    following = np.array([find_following(model, q) for q in rows])
    if not following.size:
        return None, ""
    structure: Any = model.structure
    depth = np.array([structure.ground.compute_depth(place_nodes(model, q)) for q in coordinate])
    middle = (following[:-1] + following[1:]) / 2 if len(following) > 1 else following
    ways = (middle @ np.diff(coordinate, axis=0)[:, :, None])[:, :, 0] - np.diff(bristle, axis=0)
    stuck = np.vstack([np.zeros_like(bristle[:1]), np.cumsum(ways, axis=0)])
    moved = np.linalg.norm(stuck.reshape(*depth.shape, -1), axis=2) * (depth[0] > 0.0)
    smallest = SLIPPED * float(np.ptp(place_nodes(model, state[0, :n]), axis=0).max())
    names, reports = model.manifest.contact_name, []
    for c in np.flatnonzero((moved > smallest).any(axis=0)).tolist():
        verb = "lifts" if (depth[:, c] <= 0.0).any() else "slips"
        reports.append(f"{names[c]} {verb}, {1000 * moved[-1, c]:.3g} mm at the end")
    return moved, f"feet do not stay where they stick: {'; '.join(reports)}" if reports else ""


# Linear models along a motion.


@dataclass(frozen=True)
class LinearSamples:
    """Linear models at sample times, of x = (q, q') and the actuators' inputs u minus those of the motion.

    time (n_t,) [s]: sample times; the last one is the end of the motion or just after it, at rest the second
        one.
    sample [s]: sample time.
    A, B (n_t, n_states, n_states) and (n_t, n_states, n_actuators): transition over the sample that starts
        there, for inputs held constant. Along a motion on the ground bristles are states behind (q, q'), but
        at its end feet stick, and what belongs to bristles is zero.
    past (n_t, n_states, n_past): effect of the commands that are on their way then, see
        `compute_delayed_hold`; without delays n_past = 0.
    state_matrix, input_matrix same shapes: continuous-time matrices x' = state_matrix x + input_matrix u.
    """

    time: FloatArray
    sample: float
    A: FloatArray
    B: FloatArray
    past: FloatArray
    state_matrix: FloatArray
    input_matrix: FloatArray


def sample_linear_models(
    model: CompiledModel,
    motion: Motion,
    sample: float,
    actuators: Sequence[str],
    arguments: Mapping[str, Any] | None = None,
    delay: FloatArray | None = None,
) -> LinearSamples:
    """Return the sampled linear models along a motion.

    expm([[A, B], [0, 0]] h) = [[A_h, B_h], [0, 1]] (Van Loan, IEEE Transactions on Automatic Control 23,
    1978), A and B at the state, inputs and time of the start of the sample.
    """
    require_double(model.manifest, "the design of feedback")
    check_independent(model)
    require_quantities(model, LINEAR_QUANTITIES, "the design of feedback needs")
    check_motion(model, motion)
    time = build_sample_time(motion, sample)
    if not (motion.velocity.any() or motion.acceleration.any() or np.ptp(motion.input, axis=0).any()):
        time = time[:2]  # at rest all models are the same
    merged = merge_inputs(model.manifest, arguments)
    n_bristles = motion.internal.shape[1] if len(time) > 2 else 0
    models = [
        linearise(model, motion, now, actuators, merged, with_bristles=n_bristles > 0)
        for now in time[:-1].tolist()
    ]
    end = linearise(model, motion, float(time[-1]), actuators, merged)
    models.append((np.pad(end[0], (0, n_bristles)), np.pad(end[1], ((0, n_bristles), (0, 0)))))
    state_matrix, input_matrix = (np.array(matrices) for matrices in zip(*models, strict=True))
    late = np.zeros(len(actuators)) if delay is None else delay
    hold = [compute_delayed_hold(a, b, sample, late) for a, b in zip(state_matrix, input_matrix, strict=True)]
    a, b, past = (np.array(matrices) for matrices in zip(*hold, strict=True))
    return LinearSamples(time, sample, a, b, past, state_matrix, input_matrix)


def to_dense(matrix: Any) -> FloatArray:
    """Return a matrix that a model computes, sparse or dense, as a dense array."""
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix)


def linearise(
    model: CompiledModel,
    motion: Motion,
    time: float,
    actuators: Sequence[str],
    arguments: Mapping[str, Any],
    *,
    with_bristles: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return state and input matrix of a model at a time [s] of a motion."""
    point = motion.at(time)
    at = {**arguments, "coordinate": point.coordinate, "velocity": point.velocity, INPUT: point.input}
    at |= find_bristles(model, point, point.coordinate)
    input_index = [model.manifest.input_name.index(name) for name in actuators]
    input_matrix = model.compute("input_jacobian", **at).toarray()[:, input_index]
    state_matrix, n = model.compute("state_jacobian", **at).toarray(), len(point.coordinate)
    if with_bristles:
        return _keep_bars(model, at, state_matrix), input_matrix
    state_matrix[:, :n] += state_matrix[:, 2 * n :] @ find_following(model, point.coordinate)
    return _keep_bars(model, at, state_matrix[: 2 * n, : 2 * n]), input_matrix[: 2 * n]


def find_allowed(model: CompiledModel, at: Mapping[str, Any]) -> FloatArray:
    """Return the projection of states (n_states, n_states) onto variations that rigid bars allow."""
    found = find_variations(model, at) if model.manifest.rigid_bar else None
    return np.eye(2 * len(at["coordinate"])) if found is None else found.projection


def invert_mass(model: CompiledModel, at: Mapping[str, Any]) -> FloatArray:
    """Return the accelerations by forces on each coordinate, (n, n), where rigid bars keep their lengths."""
    mass = to_dense(model.compute("mass_matrix", **at))
    if not model.manifest.rigid_bar:
        return np.asarray(np.linalg.inv(mass))
    along = find_variations(model, at).along.toarray()  # type: ignore[union-attr]
    return np.asarray(along @ np.linalg.solve(along.T @ mass @ along, along.T))


def require_no_rigid_bars(model: Described, what: str, hint: str) -> None:
    """Raise FormulationError for rigid bars or bodies; what: names what does not know them."""
    refuse_rigid_bars(len(model.manifest.rigid_bar), model.manifest.name, what, hint)


def refuse_rigid_bars(count: int, where: str, what: str, hint: str) -> None:
    """Raise the error of `require_no_rigid_bars` where the number of rigid bars is not 0."""
    if count:
        raise FormulationError(
            f"rigid bars and bodies are not supported here: {what}",
            where=where,
            given=f"{count} bars of constant length, those of bodies included",
            allowed='"node_position" with bars that have a stiffness',
            hint=hint,
        )


def _keep_bars(model: CompiledModel, at: Mapping[str, Any], state_matrix: FloatArray) -> FloatArray:
    """Return a state matrix in which what rigid bars do not allow decays as fast as the fastest motion.

    Variations T p of coordinates that rigid bars allow stay such variations, so that gains, estimates and
    predictions are those over p, written for all coordinates.
    """
    if not model.manifest.rigid_bar:
        return state_matrix
    allowed = find_allowed(model, at)[: len(state_matrix), : len(state_matrix)]
    moving = state_matrix @ allowed
    fastest = float(np.abs(np.linalg.eigvals(moving)).max(initial=0.0))
    return np.asarray(moving - (fastest or 1.0) * (np.eye(len(moving)) - allowed))


def build_sample_time(motion: Motion, sample: float) -> FloatArray:
    """Return the sample times of a motion, (n_t,) [s]; the last is at its end or just after."""
    check_positive(sample, "sample", "[s]")
    count = motion.duration / sample
    if count > MAX_SAMPLES or count < 1.0 - ROUNDING:
        raise InvalidValueError(
            "the sample time does not fit the motion",
            where="sample",
            given=f"{sample!r} s, motion of {motion.duration:g} s",
            allowed=f"{motion.duration / MAX_SAMPLES:.3g} to {motion.duration:g} s",
        )
    return sample * np.arange(int(np.ceil(count - ROUNDING)) + 1, dtype=float)


def check_independent(model: Described) -> None:
    """Raise FormulationError for coordinates that depend on each other, or contacts of another kind."""
    ground = getattr(model.structure, "ground", None)
    if model.manifest.has_contacts and (
        ground is None
        or getattr(model.structure, "collision", None) is not None
        or ground.velocity.any()
        or ground.has_static_friction
        or ground.balances_energy
    ):
        raise FormulationError(
            "feedback does not know belts, static friction, a balance of energy, or contacts between bars",
            where=model.manifest.name,
            allowed="a [ground] at rest with one coefficient of friction, no stiffness in [interference]",
            hint="design the feedback without them, and simulate with them",
        )
    formulation, manifest = find_formulation(model.manifest.formulation), model.manifest
    in_nodes = formulation.in_nodes and (bool(manifest.rigid_bar) or not formulation.has_rigid_bars)
    if not (formulation.of_bodies or in_nodes):
        raise FormulationError(
            "feedback needs coordinates that are independent of each other, or bars of constant length",
            where=model.manifest.name,
            given=f"formulation {model.manifest.formulation!r}",
            allowed='"node_position", "rigid_bar" with correction = "none", or "bodies"',
            hint="state the bars as [bodies], or give them a stiffness",
        )


def check_motion(model: Described, motion: Motion) -> None:
    """Raise InvalidValueError for a motion of another model."""
    check_instance(motion, Motion, "motion", "a Motion, as of time_motion")
    n, m = len(model.manifest.coordinate_name), len(model.manifest.input_name)
    names = ", ".join(motion.input_name) or "none"
    bristles = motion.internal.shape[1] == len(model.manifest.internal_name)
    if motion.coordinate.shape[1] != n or motion.input_name != model.manifest.input_name or not bristles:
        raise InvalidValueError(
            "the motion belongs to another model",
            where="motion",
            given=f"{motion.coordinate.shape[1]} coordinates, inputs {names}",
            allowed=f"{n} coordinates and the {m} inputs of {model.manifest.name}",
        )


# Delays of actuators in samples, and linear models in which commands arrive late.


def split_delays(delay: FloatArray, sample: float) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the whole samples of delays, their rests [s], and how many commands are on their way, (n,) each.

    The command of a sample acts from its rest in the sample that begins so many samples later.
    """
    in_samples = delay / sample
    complete = np.floor(in_samples + ROUNDING)
    remainder = np.where(in_samples - complete > ROUNDING, in_samples - complete, 0.0) * sample
    back = complete.astype(np.int64)
    return back, remainder, back + (remainder > 0.0)


def compute_hold(
    state_matrix: FloatArray, input_matrix: FloatArray, sample: float
) -> tuple[FloatArray, FloatArray]:
    """Return the transition over one sample of x' = state_matrix x + input_matrix u, for a constant input."""
    n, m = input_matrix.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = state_matrix, input_matrix
    exponential = expm(sample * block)
    return exponential[:n, :n], exponential[:n, n:]


def compute_delayed_hold(
    state_matrix: FloatArray, input_matrix: FloatArray, sample: float, delay: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the transition over one sample for commands that arrive after delays and are held.

    state_matrix, input_matrix (n, n) and (n, m): x' = state_matrix x + input_matrix u.
    sample [s]: sample time.
    delay (m,) [s]: delay of each input.
    Returns A, B, P (n, n), (n, m) and (n, n_past): x[k+1] = A x[k] + B c[k] + P p[k], with c[k] the commands
        of the sample and p[k] those that are on their way: of each input the latest first. Exact.
    """
    a, now = compute_hold(state_matrix, input_matrix, sample)
    back, remainder, count = split_delays(delay, sample)
    past = np.zeros((len(a), int(count.sum())))
    start = np.cumsum(count) - count
    for fraction in np.unique(remainder).tolist():
        chosen = np.flatnonzero((remainder == fraction) & (count > 0))
        late = (
            compute_hold(state_matrix, input_matrix[:, chosen], sample - fraction)[1]
            if fraction > 0.0
            else now[:, chosen]
        )
        early = now[:, chosen] - late
        for u, from_rest, to_rest in zip(chosen.tolist(), late.T, early.T, strict=True):
            now[:, u] = from_rest if back[u] == 0 else 0.0
            if back[u] > 0:
                past[:, start[u] + back[u] - 1] = from_rest
            if fraction > 0.0:
                past[:, start[u] + back[u]] = to_rest
    return a, now, past


def shift_commands(delay: FloatArray, sample: float) -> tuple[FloatArray, FloatArray]:
    """Return by which matrices commands on their way follow from those before and the new ones.

    Returns shift, enter (n_past, n_past) and (n_past, m): p[k+1] = shift p[k] + enter c[k].
    """
    count = split_delays(delay, sample)[2]
    size = int(count.sum())
    newest = (np.cumsum(count) - count)[count > 0]
    shift, enter = np.eye(size, k=-1), np.zeros((size, len(delay)))
    shift[newest] = 0.0
    enter[newest, np.flatnonzero(count)] = 1.0
    return shift, enter


# An equilibrium as a motion: at rest, with constant inputs.


def find_reference(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    duration: float = 1.0,
    arguments: Mapping[str, Any] | None = None,
) -> Motion:
    """Return the motion itself, or the one that stays at an equilibrium. Raises as `build_rest`."""
    return motion if isinstance(motion, Motion) else build_rest(model, motion, duration, arguments)


def build_rest(
    model: CompiledModel,
    equilibrium: Equilibrium,
    duration: float = 1.0,
    arguments: Mapping[str, Any] | None = None,
    actuators: Sequence[str] | None = None,
) -> Motion:
    """Return the motion that stays at an equilibrium."""
    check_instance(equilibrium, Equilibrium, "motion", "a Motion of time_motion, or an Equilibrium")
    if equilibrium.status not in FOUND_STATUSES:
        raise InvalidValueError(
            "not an equilibrium", where="motion", given=equilibrium.status, allowed=", ".join(FOUND_STATUSES)
        )
    feet = equilibrium.feet
    if feet is not None and "slip" in feet.state:
        raise InvalidValueError(
            "feedback about an equilibrium needs feet that stick",
            where="motion.feet",
            given=", ".join(f"{name} {how}" for name, how in zip(feet.node_name, feet.state, strict=True)),
            allowed="stick and open",
            hint="more friction, or other loads",
        )
    # Inputs and rest lengths at the equilibrium, which stay.
    check_positive(duration, "duration", "[s]")
    check_shape(equilibrium.coordinate, (len(model.manifest.coordinate_name),), "motion.coordinate")
    actuation = find_actuation(model, actuators)
    merged = merge_inputs(model.manifest, arguments)
    nominal = model.nominal(INPUT)
    value = to_sized(merged.get(INPUT, nominal), nominal.shape, f"arguments.{INPUT}").ravel()
    still = np.zeros((2, len(equilibrium.coordinate)))
    rest_length = PlanModel(model, actuation, arguments).rest_length(value[actuation.place])
    return Motion(
        time=np.array([0.0, duration]),
        coordinate=np.array([equilibrium.coordinate] * 2),
        velocity=still,
        acceleration=still,
        rest_length=np.array([rest_length] * 2),
        input=np.array([value] * 2),
        member_tension=np.array([equilibrium.member_tension] * 2),
        peak_rate=np.zeros(len(rest_length)),
        actuators=actuation.names,
        input_name=model.manifest.input_name,
        internal=np.array([equilibrium.internal_argument.get("internal", np.zeros(0))] * 2),
    )
