"""Proofs that few motors reach no target: cells of their inputs that cover all equilibria of any plan.

With coordinates, force densities q and lengths l of all members for unknowns x, equilibria are the zeros of
polynomials F(x, u) of the inputs u. In a cell of inputs v about a centre let A = (dF/dx)^-1, X = -A dF/du
and x = centre + X v + z. Zeros are the fixed points of z -> -A N(X v + z, v), N the terms of F of higher
order. If this maps a box of z into itself and contracts it, each input of the cell has one equilibrium in
the box (R. Krawczyk, Computing 4, 1969). Cells grow from that of the start until a limit is broken in the
whole of each outer one: plans are continuous, so none leaves them. If no cell has the values of the
targets within the limits, there is no plan.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.control.planning.infeasible import MEMBER_TARGET, NODE_TARGET
from tensegrity_codegen.control.planning.plan_point import PlanModel, PlanPoint
from tensegrity_codegen.control.planning.shape_targets import find_nodes, find_rings
from tensegrity_codegen.control.planning.step_problem import MIN_SIZE, PlanLimits
from tensegrity_codegen.control.planning.target_text import parse_shape
from tensegrity_codegen.control.planning.targets import BoundTarget, Targets
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.records.plan_result import Cover
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length, find_input_force
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray

FIRST_HALF = 0.02  # of the longest member: half of the width of a cell, which is halved until the proof holds
MIN_HALF = 1e-5  # the same: smaller ones are not tried
DEPTH = 3  # how often cells are halved to compare targets
START_RESIDUAL = 1e-8  # of the largest force: the residual of F allowed at the start
N_ITERATIONS = 3  # of Newton, from the centre of another cell
ENLARGED = 4.0  # the box that holds one equilibrium only, over the one that is in it
ROUNDING, INFLATION = 1e-12, 1e-6  # by which bounds are enlarged: absolute, relative
TOLERANCE = 1e-6  # of the size of a limit: it is broken beyond that


@dataclass(frozen=True)
class Cell:
    """Equilibria x + slope v + z of inputs change + v, |v| <= half, |z| <= error; no others in |z| <= box."""

    change: FloatArray
    half: float
    x: FloatArray
    slope: FloatArray
    error: FloatArray
    box: FloatArray

    def bound(self, rows: FloatArray) -> FloatArray:
        """Return the largest changes in the cell of linear functions, rows (n, n_unknowns) of unknowns."""
        return np.asarray(np.abs(rows @ self.slope).sum(axis=1) * self.half + np.abs(rows) @ self.error)


class Equations:
    """The polynomials F of a structure of linear members under constant loads, with its limits."""

    def __init__(
        self, plan_model: PlanModel, structure: Structure, limits: PlanLimits, at: PlanPoint
    ) -> None:
        self.plan_model, self.structure, self.limits, self.start = plan_model, structure, limits, at
        names = plan_model.model.manifest.input_name
        values = dict(zip(names, plan_model.inputs(at.change).tolist(), strict=True))
        self.pull, self.rest = plan_model.incidence, add_inputs_to_rest_length(structure, values)
        self.is_spring = structure.spring_constant > 0.0
        self.stiffness = np.where(self.is_spring, structure.spring_constant, structure.axial_stiffness)
        # The coordinates, but as many as there are motions that cost no force: these are held.
        self.coordinate = structure.coordinate_node_axis @ np.array([3, 1])
        count = at.neutral.shape[1]
        held = scipy.linalg.qr(at.neutral.T, mode="r", pivoting=True)[1] if count else np.zeros(0, dtype=int)
        self.free = np.delete(self.coordinate, held[:count])
        load = structure.node_load + structure.lumped_mass[:, None] * structure.gravity
        self.load = (load + find_input_force(structure, values)).ravel()[self.free]
        node = np.eye(structure.n_nodes)
        self.ends = node[structure.connectivity[:, 0]] - node[structure.connectivity[:, 1]]
        self.moved = np.kron(self.ends, np.eye(3))[:, self.free]
        self.stated = np.concatenate([at.position.ravel()[self.free], at.tension / at.length, at.length])

    def split(self, x: FloatArray) -> list[FloatArray]:
        """Return coordinates, force densities and lengths of unknowns."""
        return np.split(x, [len(self.free), len(self.free) + len(self.rest)])

    def place(self, x: FloatArray, held: FloatArray | float) -> FloatArray:
        """Return coordinates of unknowns as rows of nodes, (n_nodes, 3), with these values of held ones."""
        position = np.zeros(self.start.position.shape) + held
        position.ravel()[self.free] = x[: len(self.free)]
        return position

    def compute(self, x: FloatArray, change: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return F (n,), and its derivatives by unknowns (n, n) and inputs (n, n_actuators)."""
        (_, q, length), k, count = self.split(x), self.stiffness, len(self.rest)
        rest_length = self.rest + self.pull @ (change - self.start.change)
        vector = self.ends @ self.place(x, self.start.position)
        factor = np.where(self.is_spring, 1.0, rest_length) / k
        value = [
            self.moved.T @ (q[:, None] * vector).ravel() - self.load,
            length**2 - (vector**2).sum(axis=1),
            factor * q * length - (length - rest_length),
        ]
        along = (vector.ravel()[:, None] * self.moved).reshape(count, 3, -1).sum(axis=1)
        none = np.zeros((count, count))
        by_x = [
            [self.moved.T @ (np.repeat(q, 3)[:, None] * self.moved), along.T, 0.0 * along.T],
            [-2.0 * along, none, np.diag(2.0 * length)],
            [0.0 * along, np.diag(factor * length), np.diag(factor * q - 1.0)],
        ]
        by_rest = np.where(self.is_spring, 1.0, q * length / k + 1.0)[:, None]
        by_u = np.concatenate([np.zeros((len(x) - count, len(change))), by_rest * self.pull])
        return np.concatenate(value), np.block(by_x), by_u

    def find_cell(self, x: FloatArray, change: FloatArray, half: float) -> Cell | None:
        """Return the cell about the equilibrium near `x`; None if the proof does not hold."""
        try:
            for _ in range(N_ITERATIONS):
                value, by_x, _ = self.compute(x, change)
                x = x - np.linalg.solve(by_x, value)
            value, by_x, by_u = self.compute(x, change)
            inverse = np.linalg.inv(by_x)
        except np.linalg.LinAlgError:  # a shape that gives way
            return None
        free, count = len(self.free), len(self.rest)
        slope = -inverse @ by_u
        rest_length = self.rest + self.pull @ (change - self.start.change)
        width, ends = np.abs(self.pull).sum(axis=1) * half, [3 * count, 4 * count]
        if np.any(rest_length <= width):
            return None
        # The residual to first order; |A|, as forces and lengths of members act; their changes by the inputs.
        error = np.abs(inverse @ value) + np.abs(inverse @ (by_x @ slope + by_u)).sum(axis=1) * half
        drift = np.abs(np.eye(len(x)) - inverse @ by_x)
        act = np.abs(np.hstack([inverse[:, :free] @ self.moved.T, inverse[:, free:]]))
        travel = np.abs(np.concatenate([self.moved @ slope[:free], slope[free:]])).sum(axis=1) * half
        factor = np.where(self.is_spring, 1.0, rest_length) / self.stiffness
        varied = np.where(self.is_spring, 0.0, width) / self.stiffness

        def bound(a: FloatArray, b: FloatArray, linear: FloatArray, z: FloatArray) -> FloatArray:
            """Return bounds of the terms of second order, B(a, b) + B(b, a), and of the others in z."""
            (d, q, length), (e, r, other), (_, s, t) = (np.split(part, ends) for part in (a, b, linear))
            force = np.repeat(q, 3) * e + np.repeat(r, 3) * d
            square = 2.0 * np.maximum(length * other, (d * e).reshape(-1, 3).sum(axis=1))
            law = (factor + varied) * (q * other + r * length)
            law = law + varied * (np.abs(x[free:-count]) * t + x[-count:] * s)
            terms = act @ np.concatenate([force, square, law]) + drift @ z
            return np.asarray(terms * (1.0 + INFLATION) + ROUNDING / 10.0)

        # The box of z: large enough to be mapped into itself, then enlarged.
        z = box = np.zeros(len(x))
        for factor_of_box in (1.0, 1.0, 1.0, 1.0, ENLARGED):
            box = factor_of_box * z + ROUNDING
            small = np.concatenate([np.abs(self.moved) @ box[:free], box[free:]])
            z = bound(travel + small, (travel + small) / 2.0, travel + small, box) + error
            if not np.all(z < 10.0 * np.abs(x).max()):
                return None
        holds = np.all(z < box) and np.all(bound(travel + small, small, small, box) < 0.99 * box)
        return Cell(change, half, x, slope, z, box) if holds else None

    def find_broken(self, cell: Cell) -> str:
        """Return a limit that is broken in the whole cell, "" if there is none."""
        limits, at, ranges, half = self.limits, self.start, self.limits.ranges, cell.half
        (_, q, length), (_, by_q, by_length) = self.split(cell.x), self.split(cell.slope)
        _, error_q, error = self.split(cell.error)
        motion = np.abs(cell.slope).sum(axis=1) * half + cell.error
        width = np.abs(length[:, None] * by_q + q[:, None] * by_length).sum(axis=1) * half
        node, most_q, most_length = self.split(motion)
        width, tension = width + length * error_q + np.abs(q) * error + most_q * most_length, q * length
        rest_length = ranges.rest_length + ranges.pull @ cell.change
        reach = np.abs(ranges.pull).sum(axis=1) * half
        force, small = MIN_SIZE * np.max(np.abs(tension) + width), MIN_SIZE * np.max(length + most_length)
        load = limits.buckling / (length - most_length) ** 2
        rows = [
            ("least tension", limits.least_tension - tension - width, limits.least_tension, force),
            ("largest tension", tension - width - limits.most_tension, limits.most_tension, force),
            ("yield stress", np.abs(tension) - width - limits.yield_force, limits.yield_force, force),
            ("buckling", -load - tension - width, load, force),
            ("range", ranges.least - rest_length - reach, ranges.least, small),
            ("range", rest_length - reach - ranges.most, ranges.most, small),
        ]
        if self.plan_model.has_pairs:
            coordinate = self.place(cell.x, at.position).ravel()[self.coordinate]
            distance = np.asarray(self.plan_model.problem(cell.change).compute("bar_distance", coordinate))
            moved = np.linalg.norm(self.place(node, 0.0), axis=1)[self.structure.connectivity].max(axis=1)
            distance = distance + moved[self.structure.bar_pairs].sum(axis=1)
            rows.append(("clearance", limits.clearance - distance, np.full(1, limits.clearance), small))
        broken = (
            name
            for name, excess, limit, smallest in rows
            if np.any(excess > TOLERANCE * (abs(limit) + smallest))
        )
        return next(broken, "")

    def misses(self, target: BoundTarget, cell: Cell) -> bool:
        """Return whether no shape of the cell has the value of a target; False if it cannot say so."""
        structure, position = self.structure, self.place(cell.x, self.start.position)
        node, expression, goal = np.eye(structure.n_nodes), target.text.strip(), target.goal

        def find(weight: FloatArray) -> tuple[FloatArray, float]:
            """Return the sum of weighted node positions, (3,), and how far it moves in the cell."""
            rows = np.zeros((3, len(cell.x)))
            rows[:, : len(self.free)] = (weight[:, None, None] * np.eye(3)).reshape(-1, 3).T[:, self.free]
            return weight @ position, float(np.linalg.norm(cell.bound(rows)))

        def find_normal(nodes: IntArray) -> tuple[FloatArray, float]:
            """Return the unit normal of three nodes, and how far it moves; infinity for more nodes."""
            (a, r), (b, s) = (find(node[nodes[k]] - node[nodes[0]]) for k in (1, 2))
            normal, size = np.cross(a, b), float(np.linalg.norm(np.cross(a, b)))
            turn = 2.0 * float(np.linalg.norm(a) * s + np.linalg.norm(b) * r + r * s) / size
            return normal / size, turn if len(nodes) == 3 else math.inf

        # A length or a coordinate; else the shape parameters of rings, their normals with either sign.
        match = MEMBER_TARGET.fullmatch(expression) or NODE_TARGET.fullmatch(expression)
        call = None if target.shape is None else parse_shape(expression)
        if match is not None and match[1] == "member_length" and match[2] in structure.member_name:
            row = np.eye(len(cell.x))[[structure.member_name.index(match[2]) - structure.n_members]]
            return bool(np.abs(row @ cell.x - goal)[0] > cell.bound(row)[0])
        if match is not None and match[1] in structure.node_name:
            coordinate, reach = find(node[structure.node_name.index(match[1])])
            return bool(abs(coordinate["xyz".index(match[2])] - goal[0]) > reach)
        if call is None or call.name not in ("height", "twist", "tilt"):
            return False
        rings: Any = find_rings(structure.node_name)
        sets = [find_nodes(names, structure.node_name, expression) for names in call.arguments]
        top, base = sets or rings
        upper, lower = node[top].mean(axis=0), node[base].mean(axis=0)
        normal, turn = find_normal(base)
        if call.name == "height":
            line, reach = find(upper - lower)
            off = reach + turn * (float(np.linalg.norm(line)) + reach)
            return bool(abs(abs(normal @ line) - goal[0]) > off)
        if call.name == "twist":
            component, off = np.zeros(2), 0.0
            for base_node, top_node in zip(base, top, strict=True):
                (a, r), (b, s) = find(node[base_node] - lower), find(node[top_node] - upper)
                component += [a @ b - (a @ normal) * (b @ normal), np.cross(a, b) @ normal]
                a_size, b_size = float(np.linalg.norm(a)), float(np.linalg.norm(b))
                off += 1.5 * (a_size * s + b_size * r + r * s + 2.0 * turn * (a_size + r) * (b_size + s))
            angle = math.degrees(math.atan2(component[1], component[0]))
            gap = min(abs(math.remainder(sign * angle - goal[0], 360.0)) for sign in (1, -1))
            return off < math.sin(math.radians(min(gap, 90.0))) * float(np.linalg.norm(component))
        leaning, lean = find_normal(top)
        base_node, reach = find(node[base[0]] - lower)
        size, angle = float(np.linalg.norm(base_node)), float(np.linalg.norm(np.radians(goal)))
        base_node, reach = base_node / size, 2.0 * reach / size
        component = np.array([leaning @ base_node, leaning @ np.cross(normal, base_node), leaning @ normal])
        goal_component = np.append(np.sinc(angle / np.pi) * np.radians(goal), np.cos(angle))
        signs = (s * np.array([1, t, t]) for s, t in product((1, -1), repeat=2))
        off = math.sqrt(3.0) * (lean + turn + reach)
        return all(float(np.linalg.norm(sign * component - goal_component)) > off for sign in signs)

    def misses_all(self, targets: Targets, cell: Cell, depth: int) -> bool:
        """Return whether all parts of a cell, halved `depth` times, miss a target or break a limit."""
        if any(self.misses(target, cell) for target in targets.parts) or self.find_broken(cell):
            return True
        half = cell.half / 2.0
        corners = (half * np.array(signs) for signs in product((-1, 1), repeat=len(cell.change)))
        cells = (replace(cell, change=cell.change + v, half=half, x=cell.x + cell.slope @ v) for v in corners)
        return depth > 0 and all(self.misses_all(targets, smaller_cell, depth - 1) for smaller_cell in cells)

    def grow(self, targets: Targets, half: float, most: int) -> list[tuple[Cell, str]]:
        """Return the cells of a width, and the limits that end outer ones; none without a proof."""
        start_cell = self.find_cell(self.stated, self.start.change, half)
        if start_cell is None or not np.all(np.abs(start_cell.x - self.stated) <= start_cell.box):
            return []
        cells, ended = {(0,) * len(start_cell.change): start_cell}, []
        waiting = list(cells)
        for index in waiting:
            cell = cells[index]
            ended.append((cell, self.find_broken(cell)))
            if ended[-1][1]:
                continue
            if not self.misses_all(targets, cell, DEPTH):
                return []
            for axis, sign in product(range(len(index)), (1, -1)):
                step = sign * np.eye(len(index), dtype=int)[axis]
                neighbour_index = tuple((np.array(index) + step).tolist())
                if neighbour_index not in cells:
                    change = self.start.change + 2.0 * half * np.array(neighbour_index)
                    new_cell = self.find_cell(cell.x + 2.0 * half * cell.slope @ step, change, half)
                    if new_cell is None or len(cells) == most:
                        return []
                    cells[neighbour_index] = new_cell
                    waiting.append(neighbour_index)
                # At the middle of the side between the two, both have the same equilibrium.
                neighbour = cells[neighbour_index]
                gap = np.abs(cell.x - neighbour.x + half * (cell.slope + neighbour.slope) @ step)
                if not np.all(gap + cell.error <= neighbour.box):
                    return []
        return ended


def find_cover(
    plan_model: PlanModel, limits: PlanLimits, targets: Targets, path: Sequence[PlanPoint], most: int
) -> Cover | None:
    """Return at most `most` cells of the inputs that cover all that a plan can reach, none with the targets.

    The path is blocked. None without a proof, which needs linear elastic members, constant loads, and cables
    with a least tension above 0.
    """
    structure, at = plan_model.structure, path[0]
    if (
        not isinstance(structure, Structure)
        or bool(structure.law_parameter or structure.sliding or structure.ground or structure.collision)
        or np.any(structure.is_rigid | structure.passes_rings)
        or set(plan_model.arguments) - {INPUT}
        or np.any(structure.tension_only & ~(limits.least_tension > 0.0))
    ):
        return None
    # Cells of half the width, until all outer ones break a limit and none has the target.
    equations = Equations(plan_model, structure, limits, at)
    residual = float(np.abs(equations.compute(equations.stated, at.change)[0]).max())
    extent, half = np.ptp([point.change for point in path], axis=0), FIRST_HALF * at.point.longest
    cells: list[tuple[Cell, str]] = []
    while residual <= START_RESIDUAL * at.point.largest_force and not cells:
        if np.prod(1.0 + extent / (2.0 * half)) > most or half < MIN_HALF * at.point.longest:
            break
        cells, half = equations.grow(targets, half, most), half / 2.0
    if not cells:
        return None
    proved, ends = zip(*cells, strict=True)
    message = (
        f"{len(proved)} cells of the inputs, {2.0 * proved[0].half:.3g} m wide, cover all equilibria that a "
        f"plan can reach within the limits ({', '.join(sorted(set(ends) - {''}))}), and none has the target"
    )
    position = np.array([equations.place(cell.x, at.position) for cell in proved])
    return Cover(proved[0].half, np.array([cell.change for cell in proved]), position, ends, message)
