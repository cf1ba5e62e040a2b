"""Static equilibrium: the search for a minimum of the potential energy.

With friction at rings material slips until the capstan holds it everywhere. s_k, what slips through ring k,
stays at its start where 1 / E <= T_(k+1) / T_k <= E, and else goes so far that the ratio of the tensions is
at that limit: no farther than it has to, on a straight way from the start. For given s the strands are plain
members, and the equilibrium of these is sought. With f and b, what the tensions exceed the limit by to either
side, and any a > 0, s is a zero of

s - max(0, s + a f) - min(0, s - a b)

(B. Alart and A. Curnier, Computer Methods in Applied Mechanics and Engineering 92, 1991, for contacts), found
by Newton's method, with differences of equilibria for derivatives.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import apply_loads
from tensegrity_codegen.runtime.model.arrays import check_tolerance, to_array
from tensegrity_codegen.runtime.model.interface import Model, require_double, require_model
from tensegrity_codegen.runtime.statics.constrained_problems import BarProblem, BodyProblem
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import (
    Outcome,
    Progress,
    find_minimum,
    find_relaxed,
    find_stability,
    follow_residual,
)
from tensegrity_codegen.runtime.statics.on_ground import describe_feet, find_on_ground
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, check_switch, check_whole
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    InvalidValueError,
    NonFiniteError,
    UnstableError,
    check_choice,
)
from tensegrity_codegen.system.progress import SETTLING, work_pass
from tensegrity_codegen.tables.body_places import find_shown, label_nodes
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import SLID_END
from tensegrity_codegen.tables.precision import PRECISIONS
from tensegrity_codegen.tables.static_methods import FOUND, METHODS, Method

ACCURACY = 2e-11  # of the largest tension: how near to the capstan's limit rings come
PROBE = 1e-6  # of the longest member: slip by which derivatives are found
MAX_ITERATIONS = 40
MIN_PART = 1 / 64  # of a step of Newton's method
MAX_WAITED = 4  # iterations in a row without an excess that is less by a tenth
NO_RESISTANCE = 1e-3  # of what is beyond the limit: change of that by a slip as long as the longest member
LARGEST_SLIP = 0.2  # of the longest member, in one step
# By the kind of static problem of the formulation.
PROBLEMS: Mapping[str, type[StaticProblem]] = {
    "nodes": StaticProblem,
    "bars": BarProblem,
    "bodies": BodyProblem,
}
RING_TOLERANCE = 1e-12  # of equilibria with friction at rings, between slips
START_RESIDUAL_TOLERANCE = 1e-3  # over the largest force: a start below counts as an equilibrium that is left
RELAXATION_TOLERANCE = 1e-4  # tolerance at which relaxation hands over to Newton's method
RELAXATION_STEPS = 40  # relaxation steps allowed for each allowed iteration


@dataclass(frozen=True)
class _State:
    """An equilibrium with so much slip."""

    slid: FloatArray  # (n_rings,) [m]
    outcome: Outcome
    excess: FloatArray  # (n_rings, 2) [N], tensions beyond the limit, behind each ring and before it

    def find_gap(self, slope: float) -> tuple[FloatArray, Any]:
        """Return the gap to be closed, (n_rings,) [m], and directions of slip, 0 if a ring sticks."""
        forth, back = self.slid + self.excess[:, 0] * slope, self.slid - self.excess[:, 1] * slope
        side = np.where(forth > 0, 1, np.where(back < 0, -1, 0))
        return self.slid - np.maximum(0.0, forth) - np.minimum(0.0, back), side

    def pull(self, side: Any) -> FloatArray:
        """Return the excess on the side to which each ring slips, against the slip [N]."""
        return np.where(side >= 0, -self.excess[:, 0], self.excess[:, 1])


def slip_until_held(problem: StaticProblem, start: Point, search: Callable[[Point], Outcome]) -> Outcome:
    """Return the equilibrium from a start, its cables held by friction at all rings; slips are kept."""
    names = problem.model.manifest.internal_name
    row = np.array([k for k, name in enumerate(names) if name.endswith(SLID_END)])
    begun = problem.internal
    unslipped = search(start)
    spent = unslipped.iterations
    if unslipped.status not in FOUND:
        return unslipped

    def put(slid: FloatArray) -> None:
        states = begun.copy()
        states[row] += slid
        problem.put_internal(states)

    def measure(slid: FloatArray, outcome: Outcome) -> _State:
        excess = np.array(problem.compute("ring_excess", outcome.point.coordinate)).reshape(-1, 2)
        return _State(slid, outcome, excess)

    def settle(slid: FloatArray, near: Point) -> _State | None:
        """Return the equilibrium with so much slip, None if none is found."""
        nonlocal spent
        put(slid)
        point = problem.find_point(near.coordinate)
        outcome = None if point is None else search(point)
        if outcome is None:
            return None
        spent += outcome.iterations
        return measure(slid, outcome) if outcome.status in FOUND else None

    # Newton's method on the gap, with the step halved until the gap falls.
    state = measure(np.zeros(len(row)), unslipped)
    size = float(np.max(problem.compute("member_length", state.outcome.point.coordinate)))
    slope = first_slope = PROBE * size / max(state.outcome.point.largest_force, 1e-300)
    best, least_gap, waited = state, np.inf, 0
    for _ in range(MAX_ITERATIONS):
        point = state.outcome.point
        largest = float(np.abs(state.find_gap(first_slope)[0]).max())
        waited = 0 if largest < 0.9 * least_gap else waited + 1
        if largest < least_gap:
            best, least_gap = state, largest
        if waited > MAX_WAITED:
            break
        gap, side = state.find_gap(slope)
        rounding = problem.rounding_floor(problem.stiffness(point.coordinate), point)
        if np.abs(gap).max() <= slope * max(ACCURACY * point.largest_force, rounding):
            put(state.slid)
            return replace(state.outcome, iterations=spent)
        # The step, no longer than LARGEST_SLIP.
        step, compliance = _find_step(state, side, PROBE * size, settle)
        if step is None:
            break
        if compliance:
            slope = compliance
            gap = state.find_gap(slope)[0]
        fraction, largest, bound = 1.0, float(np.abs(step).max()), np.abs(gap).max()
        step = step * min(1.0, LARGEST_SLIP * size / largest) if largest > 0 else step
        while fraction >= MIN_PART:
            trial = settle(state.slid + fraction * step, point)
            if trial is not None and np.abs(trial.find_gap(slope)[0]).max() < (1 - 0.1 * fraction) * bound:
                break
            fraction /= 2
        if trial is None:
            break
        state = trial
    put(best.slid)
    message = "material slips through rings, and no state was found in which friction holds it"
    point = _drop_slipping_tensions(problem, best.outcome.point)
    return replace(best.outcome, point=point, status="stalled", iterations=spent, message=message)


def _drop_slipping_tensions(problem: StaticProblem, point: Point) -> Point:
    """Return a point without the tensions of strands at rings: those that balance cannot be held there."""
    tension = point.tension.copy()
    before = [problem.model.manifest.member_name.index(name) for name in problem.model.manifest.ring_name]
    tension[[row + side for row in before for side in (0, 1)]] = np.nan
    return replace(point, tension=tension)


def _find_step(
    state: _State, side: Any, probe: float, settle: Callable[..., _State | None]
) -> tuple[Any, float]:
    """Return Newton's step of all rings [m], None if none is found, and a compliance, else 0 [m/N]."""
    step, slips = np.where(side == 0, -state.slid, 0.0), np.flatnonzero(side)
    pull = state.pull(side)
    target = -pull[slips]
    matrix = np.zeros((len(slips), len(side)))
    for k in np.flatnonzero((side != 0) | (step != 0)):
        direction = np.zeros(len(side))
        direction[k] = probe if side[k] >= 0 else -probe
        displaced = settle(state.slid + direction, state.outcome.point)
        if displaced is None:
            return None, 0.0
        matrix[:, k] = (displaced.pull(side) - pull)[slips] / direction[k]
    target = target - matrix @ step
    if slips.size and np.abs(matrix).max() * state.outcome.point.longest < NO_RESISTANCE * np.abs(pull).max():
        return None, 0.0
    step[slips] = np.linalg.lstsq(matrix[:, slips], target, rcond=None)[0]
    stiffest = float(np.abs(matrix[np.arange(len(slips)), slips]).max(initial=0.0))
    return step, 1.0 / stiffest if stiffest > 0 else 0.0


def equilibrium_quantities(formulation: str) -> tuple[str, ...]:
    """Return the quantities that find_equilibrium needs in a formulation."""
    return PROBLEMS[find_formulation(formulation).statics].quantities


def build_problem(model: Model, arguments: Mapping[str, Any] | None = None) -> StaticProblem:
    """Return the static problem of a model, for its formulation, with arguments unlike the scene's."""
    require_double(model.manifest, "the search for an equilibrium")
    return PROBLEMS[find_formulation(model.manifest.formulation).statics](model, arguments)


def find_equilibrium(
    model: Model,
    *,
    coordinate: ArrayLike | None = None,
    arguments: Mapping[str, Any] | None = None,
    tolerance: float = 1e-9,
    max_iterations: int = 500,
    method: Method = "auto",
    frictionless: bool = False,
    progress: Progress | None = None,
    raise_on_failure: bool = True,
) -> Equilibrium:
    """Find a stable equilibrium, as `find_equilibrium` of the paths does without its check for snapping."""
    require_model(model)
    check_search_options(tolerance, max_iterations, method)
    check_callback(progress, "progress")
    check_switch(raise_on_failure, "raise_on_failure")
    check_switch(frictionless, "frictionless")
    # The start, with stiff members to be kept.
    problem = build_problem(model, arguments)
    if problem.contacts is not None and frictionless:
        problem.contacts.friction = False
    start = problem.to_search_coordinate(_start(problem, coordinate))
    problem.watch_stiff_members(start)
    point = problem.find_point(start)
    if point is None:
        equilibrium = record_without_forces(problem, start, method)
    else:
        # The search: with rings, alone, or on the ground.
        with work_pass(SETTLING):
            follow = follow_residual(progress)

            def search(begin: Point, tolerance: float = tolerance) -> tuple[str, Outcome]:
                return _search(problem, begin, tolerance, max_iterations, method, follow)

            used: str = method
            if model.manifest.ring_name:
                closest = min(tolerance, RING_TOLERANCE)
                outcome = slip_until_held(problem, point, lambda begin: search(begin, closest)[1])
            elif problem.contacts is None:
                used, outcome = search(point)
            else:
                point, outcome = find_on_ground(
                    problem, start, lambda begin: search(begin)[1], tolerance=tolerance
                )
        equilibrium = record_outcome(problem, point, outcome, used)
    if raise_on_failure and not equilibrium.is_found:
        raise _failure(model, equilibrium)
    return equilibrium


def _search(
    problem: StaticProblem,
    start: Point,
    tolerance: float,
    max_iterations: int,
    method: Method,
    progress: Progress | None,
) -> tuple[str, Outcome]:
    """Return the method that had the last word, and its outcome."""
    problem.check_start(start)
    unheld = _find_unheld(problem, start)
    if unheld is not None:
        return method, unheld
    max_steps = RELAXATION_STEPS * max_iterations
    if method == "relaxation":
        relaxed = find_relaxed(
            problem, start, tolerance=tolerance, max_iterations=max_steps, progress=progress
        )
        return method, relaxed
    # Newton's method; where it stalls, relaxation and then Newton's method from there.
    newton = find_minimum(
        problem, start, tolerance=tolerance, max_iterations=max_iterations, progress=progress
    )
    if method == "newton" or newton.status not in ("stalled", "iteration_limit"):
        return "newton", newton
    relaxed = find_relaxed(
        problem, start, tolerance=RELAXATION_TOLERANCE, max_iterations=max_steps, progress=progress
    )
    polished = find_minimum(
        problem, relaxed.point, tolerance=tolerance, max_iterations=max_iterations, progress=progress
    )
    spent = newton.iterations + relaxed.iterations + polished.iterations
    saddles = newton.saddles_left + polished.saddles_left
    return "relaxation", Outcome(
        polished.status, polished.point, spent, polished.message, saddles, polished.stability
    )


def _find_unheld(problem: StaticProblem, start: Point) -> Outcome | None:
    """Return the outcome of loads along an axis on which nothing is anchored, None if they balance."""
    noise = problem.rounding_floor(problem.stiffness(start.coordinate), start) * np.sqrt(problem.size + 1)
    unheld = problem.find_unbalanced_axis(start.residual, float(noise))
    if unheld is None:
        return None
    axis, total = unheld
    return Outcome("no_equilibrium", start, 0, describe_unheld(axis, total))


def describe_unheld(axis: int, total: float) -> str:
    """Return why nothing balances a total load [N] along an axis."""
    return f"nothing is anchored along {'xyz'[axis]}, and the loads there add up to {total:.6g} N"


def _failure(model: Model, equilibrium: Equilibrium) -> ConvergenceError:
    kind = UnstableError if equilibrium.status == "unstable" else ConvergenceError
    hints = {
        "no_equilibrium": "anchor some nodes, or balance the loads",
        "slides": "more friction, or a smaller slope; `stand` says how much friction it takes",
        "tips": "start from the shape in which it rests, or widen its support; `stand` gives its margin",
        "lifts_off": "nothing holds it to the ground: check gravity, loads and the ground's normal",
        "unstable": "start from another coordinate",
        "at_pole": "give the body another polar_axis",
        "work_limit": "start nearer to it, simulate the motion with damping, or use the method relaxation",
        "not_finite": "move coincident nodes apart",
    }
    return kind(
        f"no equilibrium was found: {equilibrium.message}",
        evidence=equilibrium.as_evidence(),
        where=model.manifest.name,
        hint=hints.get(equilibrium.status, "raise max_iterations, or loosen the tolerance"),
    )


def _start(problem: StaticProblem, coordinate: ArrayLike | None) -> FloatArray:
    """Return a checked copy of the starting coordinates."""
    if coordinate is None:
        return problem.model.nominal("coordinate").ravel()
    start = to_array(coordinate, PRECISIONS["double"], "coordinate", f"({problem.size},)").copy()
    if start.shape != (problem.size,):
        raise InvalidValueError(
            "the starting coordinate has the wrong shape",
            where="coordinate",
            given=start.shape,
            allowed=f"({problem.size},)",
            hint="one number for each free coordinate, in the manifest's coordinate_node_axis order",
        )
    if not np.all(np.isfinite(start)):
        raise NonFiniteError(
            "the starting coordinate is not finite", where="coordinate", allowed="finite numbers"
        )
    return start


def choose_tolerance(subject: Any) -> float:
    """Return the tolerance of an equilibrium of a Structure or BodySystem about which it vibrates."""
    return 1e-12 if getattr(subject, "ground", None) is None else 1e-9


def check_search_options(tolerance: float, max_iterations: int, method: str) -> None:
    """Raise InvalidValueError for options of a search that are out of range, UnknownNameError for methods."""
    check_choice(method, METHODS, "method", "method")
    check_tolerance(tolerance, "tolerance", "1e-9 is the default")
    check_whole(
        max_iterations, "max_iterations", 1, problem="not a number of iterations", hint="500 is the default"
    )


def record_outcome(problem: StaticProblem, start: Point, outcome: Outcome, method: str) -> Equilibrium:
    """Return the whole record of a search that began at `start` and that `method` ended."""
    point = outcome.point
    eigenvalue, neutral, status, message = float("nan"), 0, outcome.status, outcome.message
    try:
        stability = outcome.stability or find_stability(problem, point)
    except NonFiniteError:
        stability = None
    if stability is not None:
        eigenvalue, neutral = stability.model_eigenvalue, stability.neutral_motions
        if status == "converged" and stability.is_unstable:
            status, message = "unstable", "an unstable equilibrium (a saddle of the energy)"
        elif status == "converged" and stability.is_neutral:
            message = "neutral: some motion besides rigid ones does not change the energy to second order"
    pole = problem.describe_pole(point.coordinate)
    if pole:
        status, message = "at_pole", pole
    if status == "unbounded":
        status = "no_equilibrium"
    position, begun = problem.node_position(point.coordinate), problem.node_position(start.coordinate)
    moved = np.linalg.norm(position - begun, axis=1)
    manifest = problem.model.manifest
    shown = find_shown(len(moved), manifest.body_places)
    farthest = int(np.where(shown, moved, 0.0).argmax())
    motions = None
    if stability is not None:
        # Far from balance, mechanisms are those without any stiffness.
        if point.node_force > START_RESIDUAL_TOLERANCE * point.largest_force:
            stability = replace(stability, rounding=stability.rounding - stability.unbalanced)
        motions = find_neutral(problem, point.coordinate, stability)
    change = moved if motions is None else motions.distance(begun, position)
    change = np.where(shown, change, 0.0)
    label = label_nodes(manifest.node_name, manifest.body_places)
    load, input_value = apply_loads(problem.model, problem.arguments), problem.arguments.get("input")
    return Equilibrium(
        status=status,
        method=method,
        coordinate=problem.to_model_coordinate(point.coordinate),
        node_position=position,
        member_length=np.array(problem.compute("member_length", point.coordinate)),
        member_tension=point.tension,
        residual=point.node_force,
        largest_force=point.largest_force,
        iterations=outcome.iterations,
        smallest_eigenvalue=eigenvalue,
        neutral_motions=neutral,
        energy=point.energy,
        energy_change=point.energy - start.energy,
        displacement=float(moved[farthest]),
        displaced_node=label[farthest],
        message=message,
        change=float(change.max()),
        changed_node=label[int(change.argmax())],
        neutral_motion_names=() if motions is None else motions.names,
        extent=float(np.ptp(begun, axis=0).max()),
        is_start_unstable=_is_unstable(problem, start),
        saddles_left=outcome.saddles_left,
        motions=motions,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        structure=getattr(problem.model, "structure", None),
        node_load=None if load is None else load[0],
        input=None if input_value is None else np.array(input_value, dtype=np.float64).reshape(-1),
        feet=None if problem.contacts is None else describe_feet(problem, point.coordinate),
        internal=problem.settle(point.coordinate),
        internal_name=problem.model.manifest.internal_name,
    )


def record_without_forces(problem: StaticProblem, start: FloatArray, method: str) -> Equilibrium:
    """Return the record of a start where energy or forces are not finite."""
    position, manifest = problem.node_position(start), problem.model.manifest
    nan, unknown = float("nan"), np.full(len(manifest.member_name), np.nan)
    length = manifest.strands.lengths(position)
    message = "the forces at the start are not finite"
    short = [name for name, value in zip(manifest.member_name, length, strict=True) if value == 0.0]
    if short:
        message += f": member {short[0]!r} has no length"
    return Equilibrium(
        "not_finite", method, problem.to_model_coordinate(start), position, length, unknown, nan, nan, 0, nan,
        0, nan, nan, 0.0, manifest.node_name[0], message, node_name=manifest.node_name,
        member_name=manifest.member_name, structure=getattr(problem.model, "structure", None),
    )  # fmt: skip


def _is_unstable(problem: StaticProblem, start: Point) -> bool:
    """Return whether the start is nearly in balance and the energy curves down there."""
    try:
        floor = problem.rounding_floor(problem.stiffness(start.coordinate), start)
        return (
            start.is_balanced(START_RESIDUAL_TOLERANCE, floor) and find_stability(problem, start).is_unstable
        )
    except NonFiniteError:
        return False
