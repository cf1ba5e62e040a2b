"""Plans: rest lengths that move a structure through stable equilibria within limits to a target."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.cover import find_cover
from tensegrity_codegen.control.planning.infeasible import (
    find_contradiction,
    find_fixed_shape,
    find_shape_certificate,
    find_unreachable_place,
)
from tensegrity_codegen.control.planning.path import PlanPath, Progress, find_path
from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint, find_actuation
from tensegrity_codegen.control.planning.quadratic_program import require_solver
from tensegrity_codegen.control.planning.record_plan import (
    ANOTHER_PATH,
    describe_margin,
    record_infeasible,
    record_path,
)
from tensegrity_codegen.control.planning.step_problem import (
    LIMIT_TOLERANCE,
    PlanLimits,
    build_limits,
    compute_margins,
    keep_taut,
)
from tensegrity_codegen.control.planning.target_text import read_targets
from tensegrity_codegen.control.planning.targets import Targets, bind_targets
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.interface import require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import Cover, PlanResult
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import find_stability
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_callback, check_whole, is_number
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SingularStiffnessError,
    StructureError,
    UnstableError,
)

MAX_STEPS = 10**9
# Digits that order limits which are exceeded; equal ones stay in the order of the structure.
SORTED_DIGITS = 9
ROUNDING = 1e-9
CELLS_PER_ATTEMPT = 100  # of a proof that few motors reach no target

ZERO_EIGENVALUE = 1e-9  # of the stiffness: eigenvalues that count as zero
TAUT_TOLERANCE = 1e-9  # of the length: a cable as long as its rest length is not slack
N_NAMED = 3  # nodes that are named in a motion without resistance
SEARCH_RADIUS = 1e-3  # of the longest member: motion to the equilibrium that is not worth a warning


def plan(
    model: CompiledModel,
    targets: Mapping[str, float | Sequence[float]] | Sequence[str] | str,
    *,
    actuators: Sequence[str] | None = None,
    limits: Limits | None = None,
    arguments: Mapping[str, Any] | None = None,
    steps: int = 20,
    least_progress: float = 0.4,
    max_steps: int = 200,
    attempts: int = 2,
    seed: int = 0,
    duration: float | None = None,
    progress: Progress | None = None,
) -> PlanResult:
    """Plan changes of rest lengths that move a structure to a target through stable equilibria within limits.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"plan"``, see compile_scene.
    targets : mapping of str to float, or str, or sequence of str
        Target and value, or texts ``"TARGET=VALUE"``: an expression over quantities, such as ``top.z`` or
        ``member_length["c1"]``, or a shape parameter, such as ``twist`` [deg]; see docs/planning.md.
    actuators : sequence of str, optional
        Names of the actuators that move; by default all of the scene.
    limits : Limits, optional
        By default those of the scene.
    arguments : mapping, optional
        Inputs and parameters by name, if they differ from the scene.
    steps : int
        Number of steps if nothing limits them.
    least_progress : float
        The path ends where limits leave less progress than this part of 1/steps, in 8 steps in a row; 0:
        where they leave none.
    max_steps : int
        Largest number of steps and attempts of a path.
    attempts : int
        Largest number of other paths that are tried where limits block that of the smallest changes: two that
        begin with other changes of the inputs, then ways over shapes that random walks lead to.
    seed : int
        Of the random changes and walks; the same seed gives the same plan.
    duration : float, optional
        Time of the whole plan [s]; by default the shortest that the rates of the actuators permit.
    progress : callable, optional
        Called with the number of steps and the progress from 0 to 1.

    Returns
    -------
    PlanResult
        The path, and its status: found, infeasible or blocked. Proofs for few motors try up to 100 cells of
        their inputs for each of `attempts`.

    Raises
    ------
    StructureError
        No actuators.
    UnknownNameError, InvalidValueError, NonFiniteError
        A wrong target, actuator or argument; a start outside the limits.
    UnstableError, SingularStiffnessError, ConvergenceError
        No stable equilibrium to start from.
    MissingExtraError
        DAQP is not installed.

    Notes
    -----
    docs/planning.md has the equations. If limits block the path of the smallest changes, others are tried;
    `branches` of the result says how each ended.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, plan
    >>> model = compile_scene("prism12.toml", for_="plan")
    >>> found = plan(model, {"twist": 160.0})
    >>> found.status, found.n_steps
    ('found', 20)
    """
    require_model(model)
    _check_options(steps, max_steps, least_progress, duration, progress)
    for name, value in (("attempts", attempts), ("seed", seed)):
        check_whole(value, name, 0, MAX_STEPS)
    require_solver()
    texts = read_targets(targets)
    # The model with its actuators, the targets and the limits.
    actuation = find_actuation(model, actuators)
    bound = bind_targets(texts, model)
    plan_model = PlanModel(model, actuation, arguments)
    bounds = build_limits(model, plan_model.ranges, limits)
    # A start within all limits, or the proof that there is none.
    start = find_start(plan_model, bounds)
    if start.certificate is not None:
        return record_infeasible(plan_model, bound, start.at, start.certificate, start.message, start.shape)
    _check_start(plan_model, bounds, start.at)
    bounds = keep_taut(bounds, start.at, np.asarray(plan_model.structure.tension_only))
    _check_held(plan_model, bound, start.at)
    begun = bound.evaluate(plan_model.problem(start.at.change), start.at.coordinate)
    size = float(np.ptp(start.at.position, axis=0).max(initial=0.0))
    warnings = (*start.warnings, *bound.doubt_units(begun, size))
    # The proof that there is no plan, or a path and its times.
    proof = _find_proof(plan_model, bounds, bound, start.at)
    if proof is not None:
        return replace(record_infeasible(plan_model, bound, start.at, *proof), warnings=warnings)

    def build_path(
        targets: Targets = bound,
        start: PlanPoint = start.at,
        preferred: FloatArray | None = None,
        of: type[PlanPath] = PlanPath,
    ) -> PlanPath:
        return of(plan_model, bounds, targets, start, steps, least_progress, preferred)

    def prove(path: PlanPath) -> Cover | None:
        points = [point.at for point in path.points]
        return find_cover(plan_model, bounds, bound, points, CELLS_PER_ATTEMPT * attempts)

    path, branches, cover = find_path(build_path, max_steps, progress, attempts, seed, prove)
    change = np.array([point.at.change for point in path.points])
    time = compute_times(change, actuation.rate, duration, actuation.names)
    result = record_path(plan_model, path, time, warnings, branches)
    if cover is None:
        return result
    message = f"{cover.message}. The furthest path ends {result.message.removesuffix(ANOTHER_PATH)}"
    return replace(result, status="infeasible", message=message, certificate=cover)


def _find_proof(
    plan_model: PlanModel, limits: PlanLimits, targets: Targets, start: PlanPoint
) -> tuple[Any, str, FloatArray | None] | None:
    """Return the proof that no plan exists, and a sentence; None if there is none."""
    contradiction = find_contradiction(plan_model, limits, targets, start)
    if contradiction is not None:
        return contradiction, contradiction.message, None
    problem = plan_model.problem(start.change)
    shape = find_fixed_shape(problem, targets, start.coordinate, start.neutral)
    required = np.asarray(limits.least_tension > 0.0)
    certificate = None
    if shape is not None:
        certificate, _ = find_shape_certificate(plan_model, problem, shape, required)
    if certificate is None:
        unreachable = find_unreachable_place(plan_model, limits, targets, start)
        return None if unreachable is None else (unreachable, unreachable.message, None)
    condition = "the cables that have a least tension in tension, and " if required.any() else ""
    message = (
        f"the targets fix the whole shape, and at that shape no tensions are in balance with {condition}no "
        "cable in compression"
    )
    return certificate, message, shape


def _check_options(
    steps: int, max_steps: int, least_progress: float, duration: float | None, progress: Progress | None
) -> None:
    for name, value in (("steps", steps), ("max_steps", max_steps)):
        check_whole(value, name, 1, MAX_STEPS, problem="not a number of steps")
    if not (is_number(least_progress) and 0 <= least_progress < 1):
        raise InvalidValueError(
            "not a part of a step", where="least_progress", given=least_progress, allowed="from 0 to below 1"
        )
    check_callback(progress, "progress")
    check_duration(duration)


def _check_start(plan_model: PlanModel, limits: PlanLimits, at: PlanPoint) -> None:
    """Raise an error if the start violates limits, or is not stable."""
    margins = compute_margins(limits, at)
    order = np.argsort(-np.round(margins.excess, SORTED_DIGITS), kind="stable")
    stated = np.array([kind != "least_stiffness" or limits.least_stiffness > 0 for kind in margins.kind])
    outside = [int(k) for k in order if margins.excess[k] > LIMIT_TOLERANCE and stated[k]]
    if outside:
        shown = "; ".join(describe_margin(plan_model, margins, k) for k in outside[:3])
        remainder = f"; and {len(outside) - 3} more" if len(outside) > 3 else ""
        raise StructureError(
            f"the start is outside the limits: {shown}{remainder}",
            where=f"{plan_model.model.manifest.name}: limits",
            allowed="a start within all limits",
            hint="change the rest lengths or the prestress of the scene, or the limits",
        )
    check_stability(plan_model, at)


def _check_held(plan_model: PlanModel, targets: Targets, at: PlanPoint) -> None:
    """Raise InvalidValueError for targets that rigid motions of the whole structure change."""
    if at.neutral.shape[1] == 0:
        return
    problem, targets = plan_model.problem(at.change), targets.follow(at.position)
    motion = problem.node_velocities(at.coordinate, at.neutral)
    scale = plan_model.directions(at, at.neutral)

    def move(column: int, step: float) -> tuple[Any, FloatArray]:
        return problem, at.coordinate + step * scale[:, column]

    step = 1e-6 * at.point.longest
    slope = np.abs(targets.slopes(at.position, motion, move, step))
    size = np.abs(targets.evaluate(problem, at.coordinate)) / at.point.longest
    for name, unit, row, value in zip(targets.names, targets.units, slope, size, strict=True):
        per_length = 180 / np.pi / at.point.longest if unit == "deg" else 1.0
        if row.max() > 1e-5 * max(per_length, value):
            raise InvalidValueError(
                "the target changes when the structure moves as a whole, which nothing prevents",
                where=f"target {name}",
                given=f"{at.neutral.shape[1]} free rigid motions",
                allowed="targets that depend on the shape only, or a structure that is held",
                hint="anchor nodes, or use height, twist, tilt, lengths, distances or tensions",
            )


# Times of a plan: from the rates of the actuators, or from a duration.


def check_duration(duration: float | None) -> None:
    """Raise InvalidValueError for a duration [s] that is not a positive finite number."""
    if duration is not None and not (is_number(duration) and duration > 0):
        raise InvalidValueError(
            "the duration is not positive",
            where="duration",
            given=duration,
            allowed="a finite number above 0 [s]",
        )


def compute_times(
    change: FloatArray, rate: FloatArray, duration: float | None, names: Sequence[str]
) -> FloatArray | None:
    """Return the times at which the points of a plan are reached; None without rates and duration.

    Each step takes as long as its slowest actuator, with straight lines between the points. A longer duration
    stretches all steps alike; without rates it is shared by the largest changes of the steps.
    """
    moved = np.abs(np.diff(change, axis=0))
    step_time = (moved / rate).max(axis=1, initial=0.0)
    if not np.any(np.isfinite(rate)):
        if duration is None:
            return None
        step_time = moved.max(axis=1, initial=0.0)
    elif duration is not None and step_time.sum() > duration * (1 + ROUNDING):
        slowest = (moved / rate).sum(axis=0)
        raise InvalidValueError(
            "the rates of the actuators need more time",
            where="duration",
            given=f"{duration:g} s",
            allowed=f"at least {step_time.sum():.6g} s",
            hint=f"actuator {names[int(slowest.argmax())]!r} moves longest: {slowest.max():.6g} s",
        )
    total = float(step_time.sum())
    if duration is not None and total > 0:
        step_time = step_time * (duration / total)
    return np.concatenate([[0.0], np.cumsum(step_time)])


# The start of a plan: the scene's equilibrium, or the proof that there is none.


@dataclass(frozen=True)
class Start:
    """The equilibrium that a plan starts from; with a certificate, a point that no plan starts from."""

    at: PlanPoint
    certificate: Certificate | None = None
    message: str = ""
    shape: FloatArray | None = None
    warnings: tuple[str, ...] = ()


def find_start(plan_model: PlanModel, limits: PlanLimits) -> Start:
    """Return the equilibrium that a plan starts from."""
    model, change = plan_model.model, plan_model.start
    # The equilibrium near the stated positions.
    stated = plan_model.to_search_coordinate(model.nominal("coordinate").ravel())
    problem = plan_model.problem(change)
    point = problem.find_point(stated)
    longest = 1.0 if point is None else point.longest
    stated_point = None if point is None else plan_model.find_point(change, stated, SEARCH_RADIUS * longest)
    # Without one that is stable and taut: the proof that no tensions make them one.
    if point is not None and (stated_point is None or not _is_sound(stated_point, limits)):
        required = _select_required(plan_model, problem, stated, limits)
        certificate, loaded = find_shape_certificate(plan_model, problem, stated, required)
        if certificate is not None and (stated_point is not None or not loaded):
            beginning = stated_point or plan_model.complete(problem, change, point)
            return Start(beginning, certificate, _describe_stated(limits), stated)
    if stated_point is not None:
        return Start(stated_point)
    # The equilibrium that is found from there.
    arguments = {**plan_model.arguments, INPUT: plan_model.inputs(change)}
    state = find_equilibrium(model, arguments=arguments)
    settled = plan_model.find_point(
        change, plan_model.to_search_coordinate(state.coordinate), SEARCH_RADIUS * longest
    )
    if settled is None:
        raise StructureError(
            "the equilibrium to start from is not found exactly enough",
            where=model.manifest.name,
            given=f"residual {state.residual:.3g} N, smallest eigenvalue {state.smallest_eigenvalue:.3g} N/m",
            allowed="a stable equilibrium with a regular stiffness",
            hint="anchor nodes, or give the structure prestress",
        )
    warning = (
        "the stated positions are no equilibrium: the plan starts from the equilibrium that is found, where "
        f"node {state.changed_node} is {state.change:.3g} m away"
    )
    return Start(settled, warnings=(warning, *state.warnings))


def _select_required(
    plan_model: PlanModel, problem: StaticProblem, stated: FloatArray, limits: PlanLimits
) -> NDArray[np.bool_]:
    """Return which members must be in tension: with a least tension, or cables that are not slack."""
    structure = plan_model.structure
    length = np.asarray(problem.compute("member_length", stated)).ravel()
    _, tension = problem.forces(stated)
    inputs = zip(plan_model.model.manifest.input_name, plan_model.base.ravel().tolist(), strict=True)
    rest_length = add_inputs_to_rest_length(structure, dict(inputs))
    is_taut = (tension > 0.0) | (np.abs(length - rest_length) <= TAUT_TOLERANCE * length)
    return np.asarray((limits.least_tension > 0.0) | (structure.tension_only & is_taut))


def _describe_stated(limits: PlanLimits) -> str:
    """Return the proved fact about the stated shape, and a remedy."""
    limited = " or that have a least tension" if bool(np.any(limits.least_tension > 0.0)) else ""
    return (
        "at the stated shape no tensions, whatever the rest lengths, are in balance with the cables in "
        f"tension that are not slack there{limited}: no plan starts from the stated shape. A plan may exist "
        f"from another shape: settle the scene first "
        "(`equilibrium SCENE -o NEW.toml`) and plan from there"
    )


def _is_sound(at: PlanPoint, limits: PlanLimits) -> bool:
    """Return whether an equilibrium is stable, with all members in tension that have a least tension."""
    stiffest = float(abs(at.stiffness).max()) if at.stiffness.nnz else 0.0
    is_stable = len(at.eigenvalue) == 0 or float(at.eigenvalue[0]) > ZERO_EIGENVALUE * stiffest
    return is_stable and bool(np.all(at.tension[limits.least_tension > 0.0] > 0.0))


def check_stability(plan_model: PlanModel, at: PlanPoint) -> None:
    """Raise UnstableError, or SingularStiffnessError for a stiffness that is zero to rounding."""
    problem, name = plan_model.problem(at.change), plan_model.model.manifest.name
    stability = find_stability(problem, at.point)
    if stability.is_unstable:
        raise UnstableError(
            "the start is an unstable equilibrium",
            where=name,
            evidence={"smallest_eigenvalue": stability.model_eigenvalue},
            hint="start from a stable one: find it with `equilibrium`, or raise the prestress",
        )
    if not stability.is_neutral:
        return
    count = find_neutral(problem, at.coordinate, stability).mechanism.shape[2]
    field = problem.node_velocities(at.coordinate, stability.direction[:, None])[:, :, 0]
    size = np.linalg.norm(field, axis=1)
    nodes = [plan_model.model.manifest.node_name[k] for k in np.argsort(-size, kind="stable")[:N_NAMED]]
    many = f"{count} independent motions" if count > 1 else "a motion"
    besides = " besides rigid motions of the whole" if at.neutral.shape[1] else ""
    raise SingularStiffnessError(
        f"the start is neutral: nothing resists {many}{besides}, such as one of the nodes {', '.join(nodes)}",
        where=name,
        evidence={"smallest_eigenvalue": stability.model_eigenvalue, "rounding": stability.rounding},
        hint="prestress the structure, or anchor or join unconnected parts; `analyse` shows the motions",
    )
