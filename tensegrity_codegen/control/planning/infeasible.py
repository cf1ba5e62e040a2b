"""Proofs that no plan exists, whatever the path.

By targets that limits of one member contradict, and by shapes at which no tensions balance as limits want.
"""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.control.planning.step_problem import PlanLimits
from tensegrity_codegen.control.planning.target_text import parse_shape
from tensegrity_codegen.control.planning.targets import Targets
from tensegrity_codegen.runtime.analysis.certificate import Certificate, find_certificate
from tensegrity_codegen.runtime.analysis.rank import find_rank
from tensegrity_codegen.runtime.records.plan_result import Contradiction
from tensegrity_codegen.runtime.statics.static_problem import EPSILON, StaticProblem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

Excess = tuple[str, float, float, str]  # limit, necessary value, allowed value, unit

MEMBER_TARGET = re.compile(
    r"(member_length|member_tension|rest_length|bar_distance)\s*[(\[]\s*[\"']?([^\"'\])]+)[\"']?\s*[)\]]"
)
NODE_TARGET = re.compile(r"(\w+)\s*\.\s*([xyz])")
CONTRADICTION_TOLERANCE = 1e-9  # of the size of a limit: a contradiction by less is left to the path
# Times the length of a member, and part of its rest length, that plans are expected to reach.
MAX_CHANGE = 5.0
LIMIT_DESCRIPTIONS = {
    "least_value": "the least value that it can have",
    "balance": f"the most that members beside it balance, {MAX_CHANGE:g} times as long as at the start,",
}
# Part of the largest shortening, or of the work that loads could do: a proof by less is none.
MIN_PROOF = 1e-6
LINEAR_TOLERANCE = 1e-5  # change of the targets' slopes, over the largest, that counts as none
MAX_ITERATIONS = 30
CONVERGED = 1e-10  # of the structure's size
RANK = 1e-8  # of the largest singular value
STEP = 1e-6  # of the structure's size


def find_contradiction(
    plan_model: PlanModel, limits: PlanLimits, targets: Targets, start: PlanPoint
) -> Contradiction | None:
    """Return a target that limits of one member contradict, whatever the path; None without one."""
    manifest, members = plan_model.model.manifest, _MemberLimits(plan_model, limits, start)
    for target in targets.parts:
        expression, value = target.text.strip(), float(target.goal[0])
        match, name = MEMBER_TARGET.fullmatch(expression), "the top"
        call = None if target.shape is None else parse_shape(expression)
        if call is not None and call.name == "height":
            excess = _below("least_value", value, 0.0, "m")
        elif match is None or target.expression is None:
            continue
        else:
            quantity, member = match[1], match[2].strip()
            names = manifest.member_name if quantity != "bar_distance" else manifest.bar_pair_name
            index = int(member) % len(names) if re.fullmatch(r"-?\d+", member) else names.index(member)
            excess, name = members.compare(quantity, index, value), names[index]
        if excess is not None:
            return _describe(expression, f"{expression} = {value:.6g}", name, excess)
    return None


def find_unreachable_place(
    plan_model: PlanModel, limits: PlanLimits, targets: Targets, start: PlanPoint
) -> Contradiction | None:
    """Return a member whose length targets of node positions make impossible; None without one."""
    structure = plan_model.structure
    if not isinstance(structure, Structure):
        return None
    position = np.where(structure.node_anchored, start.position, np.nan)
    other_axes = [axis for axis in range(3) if axis not in structure.axes]
    position[:, other_axes] = start.position[:, other_axes]
    goals: dict[int, list[str]] = {}
    for target in targets.parts:
        match = NODE_TARGET.fullmatch(target.text.strip())
        if match is not None and match[1] in structure.node_name:
            node, value = structure.node_name.index(match[1]), float(target.goal[0])
            position[node, "xyz".index(match[2])] = value
            goals.setdefault(node, []).append(f"{target.text.strip()} = {value:.6g}")
    members = _MemberLimits(plan_model, limits, start)
    for index, ends in enumerate(structure.connectivity.tolist()):
        requested = ", ".join(goal for node in ends for goal in goals.get(node, []))
        between = position[ends[1]] - position[ends[0]]
        length, is_exact = float(np.linalg.norm(np.nan_to_num(between))), bool(np.isfinite(between).all())
        if not requested or structure.passes_rings[index]:
            continue
        excess = members.compare_length(index, length, is_exact)
        if excess is not None:
            return _describe(requested, requested, structure.member_name[index], excess, length, is_exact)
    return None


def _describe(
    target: str, requested: str, name: str, excess: Excess, length: float = math.nan, is_exact: bool = True
) -> Contradiction:
    limit, necessary, allowed, unit = excess
    how = "" if math.isnan(length) else f" at a length of {length:.6g} m{'' if is_exact else ' or more'}"
    limit_name = LIMIT_DESCRIPTIONS.get(limit, f"the limit {limit}")
    message = (
        f"the target {requested} needs {necessary:.6g} {unit} of {name}{how}, and {limit_name} is "
        f"{allowed:.6g} {unit}: off by {abs(necessary - allowed):.3g} {unit}"
    )
    return Contradiction(target, name, limit, float(necessary), float(allowed), unit, message)


@dataclass(frozen=True)
class _MemberLimits:
    """The limits of the members of a plan, with the ranges of their rest lengths and the start."""

    plan_model: PlanModel
    limits: PlanLimits
    start: PlanPoint

    def compare(self, quantity: str, index: int, value: float) -> Excess | None:
        """Return limit, necessary value, allowed value, and the unit, if the two exclude each other."""
        if quantity == "bar_distance":
            return _below("clearance", value, self.limits.clearance, "m")
        if quantity == "member_tension":
            lower = 0.0 if self.plan_model.structure.tension_only[index] else -math.inf
            return _below("least_value", value, lower, "N") or self.compare_tension(index, value, value)
        low, high = self.rest_lengths(index)
        if quantity == "rest_length":
            return _below("range", value, low, "m") or _above("range", value, high, "m")
        return _below("least_value", value, 0.0, "m") or self.compare_length(index, value, True)

    def compare_length(self, index: int, length: float, is_exact: bool) -> Excess | None:
        """Return the limit that a member of a length exceeds, or of this length at least."""
        low, high = self.rest_lengths(index)
        if self.plan_model.structure.mu[index] == 0.0:  # a rigid bar
            below = _below("range", length, low, "m") if is_exact else None
            return _above("range", length, high, "m") or below
        lowest, highest = self.tension(index, length, high), self.tension(index, length, low)
        highest = highest if is_exact else math.inf
        load = self.limits.buckling[index] / length / length if length > 0 else math.inf
        excess = self.compare_tension(index, lowest, highest, load)
        if excess is not None and excess[0] == "least_tension" and length < low:
            return "range", length, low, "m"  # too short for every rest length of the range
        balance = self.find_balance(index)
        pull = _above("balance", lowest, balance, "N")
        return excess or pull or _below("balance", highest, -balance, "N")

    def compare_tension(
        self, index: int, lowest: float, highest: float, load: float = math.inf
    ) -> Excess | None:
        """Return the limit that all tensions from `lowest` to `highest` exceed; load: of buckling [N]."""
        return (
            _below("least_tension", highest, self.limits.least_tension[index], "N")
            or _above("most_tension", lowest, self.limits.most_tension[index], "N")
            or _above("yield_stress", lowest, self.limits.yield_force[index], "N")
            or _below("yield_stress", highest, -self.limits.yield_force[index], "N")
            or _below("buckling", highest, -load, "N")
        )

    def find_balance(self, index: int) -> float:
        """Return the largest force of a member that others balance at a free end [N]; infinite at supports.

        Loads are at most the sum of the forces at the start. Actuators may shorten members to a fifth.
        """
        structure = self.plan_model.structure
        if not isinstance(structure, Structure):
            return math.inf
        ends = structure.connectivity[index].tolist()
        free = [node for node in ends if not structure.node_anchored[node, list(structure.axes)].any()]
        return min((self._sum_largest_forces(structure, index, node) for node in free), default=math.inf)

    def _sum_largest_forces(self, structure: Structure, index: int, node: int) -> float:
        """Return the sum of the largest forces of the other members at a node, and of the loads on it [N]."""
        strands = structure.strands
        length = strands.lengths(self.start.position)
        # The members at the node; twice where a cable passes a ring.
        adjacent = strands.member[(strands.ends == node).any(axis=1)].tolist()
        total = float(np.abs(self.start.tension)[adjacent].sum())
        for member in adjacent:
            if structure.is_rigid[member]:
                return math.inf
            rest_length = float(structure.rest_length[member])
            longest = MAX_CHANGE * max(rest_length, float(length[member]))
            least_rest = max(rest_length / MAX_CHANGE, self.rest_lengths(member)[0])
            force = self.tension(member, longest, least_rest) if member != index else 0.0
            largest = float(self.limits.most_tension[member])
            total += force if structure.is_bar[member] else min(force, largest)
        return total

    def rest_lengths(self, index: int) -> tuple[float, float]:
        """Return the least and the largest rest length that the actuators of a plan give a member [m]."""
        plan_model, limits = self.plan_model, self.limits
        moving = np.flatnonzero(plan_model.incidence[index])
        rest_length = float(plan_model.structure.rest_length[index])
        for scene_input in plan_model.structure.inputs:  # those that the plan holds
            if scene_input.name not in plan_model.columns:
                value = plan_model.base[plan_model.model.manifest.input_name.index(scene_input.name)]
                rest_length += scene_input.rest_length_gain.get(index, 0.0) * float(value)
        low, high = limits.ranges.of_member(index)
        return (
            max(rest_length + float(limits.least_change[moving].sum()), low),
            min(rest_length + float(limits.most_change[moving].sum()), high),
        )

    def tension(self, index: int, length: float, rest_length: float) -> float:
        """Return the tension of a member of a length and rest length [N]; infinite without a rest length."""
        structure = self.plan_model.structure
        if not math.isfinite(rest_length):
            return 0.0 if structure.tension_only[index] else -math.inf
        if rest_length <= 0.0:
            return math.inf
        lengths = np.array(structure.rest_length)
        lengths[index] = rest_length
        changed = structure.with_changes(rest_length=lengths)
        return float(changed.compute_static_tension(np.full(len(lengths), length))[index])


def _below(limit: str, necessary: float, allowed: float, unit: str) -> Excess | None:
    short = necessary < allowed - CONTRADICTION_TOLERANCE * abs(allowed) if math.isfinite(allowed) else False
    return (limit, necessary, allowed, unit) if short else None


def _above(limit: str, necessary: float, allowed: float, unit: str) -> Excess | None:
    over = necessary > allowed + CONTRADICTION_TOLERANCE * abs(allowed) if math.isfinite(allowed) else False
    return (limit, necessary, allowed, unit) if over else None


# Proofs that no plan exists by the shape: no tensions are in balance there as the limits want them.


def find_shape_certificate(
    plan_model: PlanModel, problem: StaticProblem, coordinate: FloatArray, required: NDArray[np.bool_]
) -> tuple[Certificate | None, bool]:
    """Return the proof that no tensions with some cables in tension, and no others in compression, balance.

    Required members must be in tension; other cables may be slack, and other bars have either sign. None
    where such tensions exist, where the proof is not verified, and for scenes of bodies. And whether there
    are loads.
    """
    model = plan_model.model
    structure = model.structure
    if structure is None or not model.has("equilibrium_matrix"):
        return None, False
    matrix = problem.compute("equilibrium_matrix", coordinate).toarray()
    _, tension = problem.forces(coordinate)
    force = matrix @ tension
    load = problem.residual(coordinate) + force
    noise = 1e-9 * (float(np.abs(matrix).max(initial=0.0)) * float(np.abs(tension).max(initial=0.0)))
    loaded = bool(np.abs(load).max(initial=0.0) > noise)
    length = np.asarray(problem.compute("member_length", coordinate))
    distance = float(np.abs(problem.node_position(coordinate)).max(initial=0.0))
    rank = find_rank(matrix, rounding=EPSILON * max(distance / float(length.min()), 1.0))
    pulled = np.asarray(structure.tension_only) | required
    proof = find_certificate(matrix, pulled, load=load if loaded else None, rank=rank, required=required)
    return (proof if proof is not None and _is_sure(proof, required, load) else None), loaded


def _is_sure(proof: Certificate, required: NDArray[np.bool_], load: FloatArray) -> bool:
    """Return whether a proof holds beyond the error of the shape."""
    shortening = float(-proof.elongation[required].min(initial=0.0))
    most_work = float(np.linalg.norm(load) * np.linalg.norm(proof.displacement))
    return proof.is_verified and (shortening > MIN_PROOF or proof.load_work > MIN_PROOF * most_work)


def find_fixed_shape(
    problem: StaticProblem, targets: Targets, start: FloatArray, neutral: FloatArray
) -> FloatArray | None:
    """Return the coordinates that targets fix but for neutral rigid motions, found from the start.

    None if the targets leave the shape free, if no shape near the start has their values, and where
    they are not linear in the coordinates, as then other shapes may have their values too.
    """
    goal = targets.goal
    free = len(start) - neutral.shape[1]
    if len(goal) < free or len(neutral) != len(start):
        return None
    shape, size = start.copy(), problem.extent(start, np.asarray(problem.compute("member_length", start)))
    try:
        if not _is_linear(problem, targets, start, size):
            return None
        for _ in range(MAX_ITERATIONS):
            slope = _compute_slope(problem, targets, shape, size)
            if np.linalg.matrix_rank(slope, tol=RANK * float(np.linalg.norm(slope, 2))) < free:
                return None
            gap = goal - targets.evaluate(problem, shape)
            step = np.linalg.lstsq(slope, gap, rcond=RANK)[0]
            shape = shape + step
            if np.abs(step).max(initial=0.0) <= CONVERGED * size:
                error = np.abs(goal - targets.evaluate(problem, shape)).max()
                return shape if error <= 1e-6 * max(float(np.abs(goal).max()), size) else None
    except (NonFiniteError, np.linalg.LinAlgError):
        return None
    return None


def _is_linear(problem: StaticProblem, targets: Targets, start: FloatArray, size: float) -> bool:
    """Return whether the slopes of the targets are the same at the start and at two shapes far from it."""
    start_slope = _compute_slope(problem, targets, start, size)
    largest = float(np.abs(start_slope).max(initial=0.0))
    draw = np.random.default_rng(0)
    for _ in range(2):
        shape = start + 0.3 * size * draw.uniform(-1.0, 1.0, len(start))
        bend = np.abs(_compute_slope(problem, targets, shape, size) - start_slope).max(initial=0.0)
        if not bend <= LINEAR_TOLERANCE * largest:
            return False
    return True


def _compute_slope(problem: StaticProblem, targets: Targets, shape: FloatArray, size: float) -> FloatArray:
    """Return the derivatives of the targets, (n_targets, n_coordinates)."""
    step, columns = STEP * size, []
    for unit in np.eye(len(shape)):
        ends = [targets.evaluate(problem, shape + sign * step * unit) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.array(columns).T
