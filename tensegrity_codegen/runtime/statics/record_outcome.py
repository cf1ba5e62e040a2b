"""The record of a search for an equilibrium, made from its outcome."""

from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.model.arguments import apply_loads
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.neutral_motion import find_neutral
from tensegrity_codegen.runtime.statics.newton import Outcome, find_stability
from tensegrity_codegen.runtime.statics.on_ground import describe_feet
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

# Residual over largest force up to which a start counts as an equilibrium that is left.
START_RESIDUAL_TOLERANCE = 1e-3


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
    farthest = int(moved.argmax())
    motions = None
    if stability is not None:
        # Far from balance, mechanisms are those without any stiffness.
        if point.node_force > START_RESIDUAL_TOLERANCE * point.largest_force:
            stability = replace(stability, rounding=stability.rounding - stability.unbalanced)
        motions = find_neutral(problem, point.coordinate, stability)
    change = moved if motions is None else motions.distance(begun, position)
    node_name = problem.model.manifest.node_name
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
        displaced_node=node_name[farthest],
        message=message,
        change=float(change.max()),
        changed_node=node_name[int(change.argmax())],
        neutral_motion_names=() if motions is None else motions.names,
        extent=float(np.ptp(begun, axis=0).max()),
        is_start_unstable=_is_unstable(problem, start),
        saddles_left=outcome.saddles_left,
        motions=motions,
        node_name=node_name,
        member_name=problem.model.manifest.member_name,
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
