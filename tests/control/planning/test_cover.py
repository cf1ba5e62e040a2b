"""Proofs that few motors reach no target, checked in exact rational arithmetic on a sample of their cells.

The test has its own equations and its own bounds. A cell is checked by the theorem of Krawczyk: with numbers
as they are (doubles are rational), the map of the residual moves a box of unknowns into itself and contracts
it for all inputs of the cell. No roots appear, as lengths are unknowns of the equations l^2 = |p_i - p_j|^2.
"""

from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.pages.plans import describe_plan, describe_plan_finding
from tensegrity_codegen.control.planning.cover import Equations, find_cover
from tensegrity_codegen.control.planning.path import Walk
from tensegrity_codegen.control.planning.plan import find_start, plan
from tensegrity_codegen.control.planning.plan_point import PlanModel, find_actuation
from tensegrity_codegen.control.planning.step_problem import build_limits
from tensegrity_codegen.control.planning.target_text import read_targets
from tensegrity_codegen.control.planning.targets import Targets, bind_targets
from tensegrity_codegen.runtime.records.plan_result import Cover
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.control.planning.structures import assemble, build_prism, compile_plan, gang, limit

Row = list[Fraction]


@cache
def build_small() -> Structure:
    """Return a bar on a fixed end that three cables hold, one of them with the motor."""
    nodes: dict[str, Any] = {"foot": {"position": [0.0, 0.0, 0.0], "anchored": True}}
    members: dict[str, Any] = {"post": {"class": "bar", "nodes": ["foot", "top"]}}
    for k in range(3):
        angle = 2 * np.pi * k / 3 + 0.3
        place = [float(np.cos(angle)), float(np.sin(angle)), 0.0]
        nodes[f"anchor{k}"] = {"position": place, "anchored": True}
        members[f"stay{k}"] = {"class": "cable", "nodes": [f"anchor{k}", "top"]}
    nodes["top"] = {"position": [0.0, 0.0, 1.0]}
    classes = {
        "bar": {"kind": "bar", "axial_stiffness": 1e5},
        "cable": {"kind": "cable", "axial_stiffness": 1000.0, "prestress": 20.0},
    }
    structure = assemble({"name": "mast", "classes": classes, "nodes": nodes, "members": members})
    rest = structure.rest_length.copy()
    rest[0] = 1.0 / (1.0 - 3 * 20.0 / np.sqrt(2.0) / 1e5)
    return limit(gang(structure.with_changes(rest_length=rest), "stay0", range=(1.3, 2.0)), 1.0)


# A check in fractions.


def check_exactly(structure: Structure, proof: Cover, goals: dict[str, float], cells: list[int]) -> None:
    """Check cells of a proof: one equilibrium near a centre for all inputs; a limit broken, or no target."""
    for cell in cells:
        enclosure = Enclosure(structure, proof, cell)
        enclosure.check()
        if proof.end[cell] == "range":
            assert enclosure.is_out_of_range()
        elif proof.end[cell]:
            assert enclosure.is_slack(), proof.end[cell]
        elif all(not enclosure.misses(text, value) for text, value in goals.items()):
            # The parts of the cell, halved as often as in the proof.
            for part in enclosure.split(3):
                assert part.is_slack() or any(part.misses(text, value) for text, value in goals.items())


class Enclosure:
    """Equilibria of a cell: centre + slope v + z for |v| <= half, |z| <= radius, all rational numbers."""

    def __init__(self, structure: Structure, proof: Cover, cell: int) -> None:
        self.structure = structure
        gain = np.zeros((structure.n_members, len(structure.actuators)))
        for column, item in enumerate(structure.actuators):
            gain[list(item.members), column] = 1.0
        self.gain = to_fractions(gain)
        self.half = Fraction(proof.half)
        self.change = to_fractions(proof.change[cell] - proof.change[0])
        self.rest = [
            Fraction(rest) + dot(row, self.change)
            for rest, row in zip(structure.rest_length.tolist(), self.gain, strict=True)
        ]
        # Coordinates that the proof holds are the same at the centres of all cells.
        moves = np.ptp(proof.node_position, axis=0).ravel() > 0.0
        self.free = np.flatnonzero(moves & ~structure.node_anchored.ravel())
        position = proof.node_position[cell]
        vector = position[structure.connectivity[:, 0]] - position[structure.connectivity[:, 1]]
        length = np.linalg.norm(vector, axis=1)
        rest = np.array([float(value) for value in self.rest])
        stiff, spring = structure.axial_stiffness, structure.spring_constant
        density = np.where(spring > 0, spring, stiff / rest) * (length - rest) / length
        self.position = to_fractions(position.ravel())
        x = np.concatenate([position.ravel()[self.free], density, length])
        # Newton steps in doubles improve what the positions state of stiff bars.
        for _ in range(3):
            matrix = to_doubles(self.jacobian(to_fractions(x)))
            x = x - np.linalg.solve(matrix, to_doubles(self.residual(to_fractions(x))))
        self.centre = to_fractions(x)
        jacobian = self.jacobian(self.centre)
        inverse = np.linalg.inv(to_doubles(jacobian))
        self.inverse = to_fractions(inverse)
        by_input = [[Fraction(0)] * len(self.change) for _ in range(len(x) - len(rest))]
        q, n = self.centre[len(self.free) : -len(rest)], self.centre[-len(rest) :]
        for e, row in enumerate(self.gain):
            factor = Fraction(1) if spring[e] > 0 else q[e] * n[e] / Fraction(stiff[e]) + 1
            by_input.append([factor * entry for entry in row])
        self.by_input = by_input
        self.slope = to_fractions(-inverse @ to_doubles(by_input))
        self.slope_of_start, self.radius = self.slope, [Fraction(0)] * len(x)

    def place(self, x: Row) -> Row:
        position = list(self.position)
        for value, where in zip(x, self.free, strict=False):
            position[where] = value
        return position

    def members(self, x: Row) -> list[tuple[Row, Fraction, Fraction]]:
        """Return the difference of the ends, the force density and the length of each member."""
        count, position = self.structure.n_members, self.place(x)
        ends = self.structure.connectivity.tolist()
        return [
            ([position[3 * i + a] - position[3 * j + a] for a in range(3)], x[e - 2 * count], x[e - count])
            for e, (i, j) in enumerate(ends)
        ]

    def law(self, e: int) -> tuple[Fraction, Fraction]:
        """Return the factor of q l in the law of a member, and its stiffness."""
        spring = float(self.structure.spring_constant[e])
        if spring > 0:
            return 1 / Fraction(spring), Fraction(spring)
        stiff = Fraction(float(self.structure.axial_stiffness[e]))
        return self.rest[e] / stiff, stiff

    def to_nodes(self, forces: list[Row]) -> Row:
        total = [Fraction(0)] * len(self.position)
        for (i, j), force in zip(self.structure.connectivity.tolist(), forces, strict=True):
            for a in range(3):
                total[3 * i + a] += force[a]
                total[3 * j + a] -= force[a]
        return [total[k] for k in self.free]

    def residual(self, x: Row) -> Row:
        members = self.members(x)
        forces = self.to_nodes([[q * part for part in vector] for vector, q, _ in members])
        squares = [n * n - dot(vector, vector) for vector, _, n in members]
        laws = [self.law(e)[0] * q * n - (n - self.rest[e]) for e, (_, q, n) in enumerate(members)]
        return [*forces, *squares, *laws]

    def jacobian(self, x: Row) -> list[Row]:
        """Return the exact derivatives: F is of second order in x, so that differences are exact."""
        columns = []
        for k in range(len(x)):
            plus, minus = list(x), list(x)
            plus[k] += 1
            minus[k] -= 1
            ends = zip(self.residual(plus), self.residual(minus), strict=True)
            columns.append([(a - b) / 2 for a, b in ends])
        return [list(row) for row in zip(*columns, strict=True)]

    def check(self) -> None:
        """Find a box that the map takes into itself and contracts; all numbers from here on are exact."""
        size, jacobian = len(self.centre), self.jacobian(self.centre)
        product = multiply(self.inverse, jacobian)
        drift = [[abs(entry - (k == j)) for j, entry in enumerate(row)] for k, row in enumerate(product)]
        first = multiply(jacobian, self.slope)
        left = multiply(
            self.inverse,
            [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(first, self.by_input, strict=True)],
        )
        fault = [abs(dot(row, self.residual(self.centre))) for row in self.inverse]
        fixed = [a + self.half * sum(map(abs, row)) for a, row in zip(fault, left, strict=True)]
        # Terms of second order act as forces of members, so the inverse is multiplied by these first.
        act = [self.act(row) for row in self.inverse]
        drifts = self.widths([Fraction(0)] * size)

        def bound(z: Row, *, of_change: bool) -> Row:
            whole, part = self.widths(z), self.widths(z, with_inputs=False)
            terms: Row = []
            for (d, _, _), (s, _, _), (_, q, _), (_, r, _) in zip(whole, part, whole, part, strict=True):
                terms += [q * t + r * v if of_change else q * v for v, t in zip(d, s, strict=True)]
            for (d, _, n), (s, _, m) in zip(whole, part, strict=True):
                terms.append(2 * max(n * m, dot(d, s)) if of_change else max(n * n, dot(d, d)))
            for e, ((_, q, n), (_, r, m)) in enumerate(zip(whole, part, strict=True)):
                factor, stiff = self.law(e)
                varied = self.half * sum(map(abs, self.gain[e])) / stiff
                varied = Fraction(0) if self.structure.spring_constant[e] > 0 else varied
                at_q, at_n = abs(self.centre[e + len(self.free)]), self.centre[e - len(whole)]
                if of_change:
                    terms.append((factor + varied) * (q * m + r * n) + varied * (at_q * m + at_n * r))
                else:
                    terms.append((factor + varied) * q * n + varied * (at_q * n + at_n * q))
            rows = zip(act, drift, fixed, strict=True)
            return [dot(a, terms) + dot(d, z) + (0 if of_change else f) for a, d, f in rows]

        assert len(drifts) == self.structure.n_members
        radius = [Fraction(0)] * size
        for _ in range(3):
            radius = [round_up(value) for value in bound(radius, of_change=False)]
        box = [4 * value + Fraction(1, 10**12) for value in radius]
        self.radius = bound(box, of_change=False)
        assert all(a < b for a, b in zip(self.radius, box, strict=True))
        assert all(a < b for a, b in zip(bound(box, of_change=True), box, strict=True))

    def act(self, row: Row) -> Row:
        """Return how terms of members act on an unknown: forces, squares of lengths, laws."""
        full = dict(zip(self.free.tolist(), row, strict=False))
        terms = [
            abs(full.get(3 * i + a, Fraction(0)) - full.get(3 * j + a, Fraction(0)))
            for i, j in self.structure.connectivity.tolist()
            for a in range(3)
        ]
        return terms + [abs(entry) for entry in row[len(self.free) :]]

    def widths(self, z: Row, *, with_inputs: bool = True) -> list[tuple[Row, Fraction, Fraction]]:
        """Return bounds of the changes of end differences, force densities and lengths."""
        none = [Fraction(0)] * len(self.change)
        motion = dict(zip(self.free.tolist(), self.slope, strict=False))
        error = dict(zip(self.free.tolist(), z, strict=False))
        count, found = self.structure.n_members, []

        def sum_up(row: Row) -> Fraction:
            return self.half * sum(map(abs, row)) if with_inputs else Fraction(0)

        for e, (i, j) in enumerate(self.structure.connectivity.tolist()):
            vector = []
            for a in range(3):
                ends = zip(motion.get(3 * i + a, none), motion.get(3 * j + a, none), strict=True)
                parts = error.get(3 * i + a, 0) + error.get(3 * j + a, 0)
                vector.append(sum_up([b - c for b, c in ends]) + parts)
            q, n = (sum_up(self.slope[k]) + z[k] for k in (e - 2 * count, e - count))
            found.append((vector, q, n))
        return found

    def split(self, depth: int) -> "list[Enclosure]":
        """Return the parts of the cell, halved in each direction."""
        if not depth:
            return [self]
        parts = []
        for corner in np.ndindex(*(2,) * len(self.change)):
            part = object.__new__(Enclosure)
            part.__dict__ |= self.__dict__
            move = [(2 * sign - 1) * self.half / 2 for sign in corner]
            part.centre = [x + dot(row, move) for x, row in zip(self.centre, self.slope, strict=True)]
            part.half = self.half / 2
            parts += part.split(depth - 1)
        return parts

    def is_out_of_range(self) -> bool:
        """Return whether the rest length of a motor's member is out of its range in the whole cell."""
        for item, change in zip(self.structure.actuators, self.change, strict=True):
            rest = Fraction(float(self.structure.rest_length[item.members[0]])) + change
            if rest + self.half < Fraction(item.range[0]) or rest - self.half > Fraction(item.range[1]):
                return True
        return False

    def is_slack(self) -> bool:
        """Return whether the tension of a cable is below its least one in the whole cell."""
        for e in np.flatnonzero(~self.structure.is_bar).tolist():
            q, n = e - 2 * self.structure.n_members, e - self.structure.n_members
            tension = self.centre[q] * self.centre[n]
            by_inputs = zip(self.slope[q], self.slope[n], strict=True)
            first = [a * self.centre[n] + b * self.centre[q] for a, b in by_inputs]
            most = [self.half * sum(map(abs, self.slope[k])) + self.radius[k] for k in (q, n)]
            second = (
                most[0] * most[1] + self.centre[n] * self.radius[q] + abs(self.centre[q]) * self.radius[n]
            )
            if tension + self.half * sum(map(abs, first)) + second < Fraction(
                float(self.structure.limits.least_tension[e])
            ):
                return True
        return False

    def misses(self, text: str, value: float) -> bool:
        """Return whether a coordinate, or the tangent of the twist, differs from the target's."""
        names, position = self.structure.node_name, self.place(self.centre)
        width = [Fraction(0)] * len(position)
        for k, row, radius in zip(self.free, self.slope, self.radius, strict=False):
            width[k] = self.half * sum(map(abs, row)) + radius
        if text.endswith(("x", "y", "z")):
            k = 3 * names.index(text[:-2]) + "xyz".index(text[-1])
            return abs(position[k] - Fraction(value)) > width[k]
        # The twist is the angle of two sums over pairs of nodes.
        zero = [(Fraction(0), Fraction(0))] * 3
        nodes = {
            name: [(position[3 * k + a], width[3 * k + a]) for a in range(3)] for k, name in enumerate(names)
        }
        centre = dict.fromkeys("bt", zero)
        for ring in "bt":
            sums = [add(*(nodes[f"{ring}{k}"][a] for k in (1, 2, 3))) for a in range(3)]
            centre[ring] = [(-c / 3, r / 3) for c, r in sums]
        edges = [[add(nodes[f"b{k}"][a], negate(nodes["b1"][a])) for a in range(3)] for k in (2, 3)]
        normal = cross(*edges)
        along, turned = (Fraction(0), Fraction(0)), (Fraction(0), Fraction(0))
        square = scalar(normal, normal)
        for k in (1, 2, 3):
            low, high = ([add(nodes[f"{ring}{k}"][a], centre[ring][a]) for a in range(3)] for ring in "bt")
            along = add(along, scalar(low, high))  # the base is perpendicular to its normal
            turned = add(turned, scalar(cross(low, high), normal))
        # turned / |normal| over along is the tangent: compare squares, with signs.
        tangent = Fraction(float(np.tan(np.radians(value))))
        assert 90 < value < 180
        if along[0] - along[1] > 0:
            return True
        left, right = times(turned, turned), times(times(along, along), square)
        gap = add(left, negate((right[0] * tangent**2, right[1] * tangent**2)))
        return abs(gap[0]) > gap[1] + abs(right[0]) * Fraction(1, 10**9)


def to_fractions(values: Any) -> Any:
    return [
        to_fractions(row) if isinstance(row, list) else Fraction(row) for row in np.asarray(values).tolist()
    ]


def to_doubles(values: Any) -> np.ndarray:
    return np.array([[float(x) for x in row] if isinstance(row, list) else float(row) for row in values])


def dot(a: Row, b: Row) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Fraction(0))


def multiply(a: list[Row], b: list[Row]) -> list[Row]:
    columns = list(zip(*b, strict=True))
    return [[dot(row, list(column)) for column in columns] for row in a]


def round_up(value: Fraction) -> Fraction:
    """Return a number not below, with few digits."""
    return Fraction(float(value) * (1 + 1e-9))


# Intervals: centre and radius.

Ball = tuple[Fraction, Fraction]


def add(*terms: Ball) -> Ball:
    return sum((c for c, _ in terms), Fraction(0)), sum((r for _, r in terms), Fraction(0))


def negate(a: Ball) -> Ball:
    return -a[0], a[1]


def times(a: Ball, b: Ball) -> Ball:
    return a[0] * b[0], abs(a[0]) * b[1] + abs(b[0]) * a[1] + a[1] * b[1]


def scalar(a: list[Ball], b: list[Ball]) -> Ball:
    return add(*(times(x, y) for x, y in zip(a, b, strict=True)))


def cross(a: list[Ball], b: list[Ball]) -> list[Ball]:
    return [add(times(a[i - 2], b[i - 1]), negate(times(a[i - 1], b[i - 2]))) for i in range(3)]


# Plans.


@pytest.mark.parametrize("seed", [0, *thorough(1, 2)])
def test_a_node_that_one_motor_moves_on_a_curve(seed: int) -> None:
    """Cells of the whole proof hold exactly; a target that a plan finds has no proof."""
    structure = build_small()
    model = compile_plan(structure)
    found = plan(model, "top.x=-0.3")
    assert found.status == "infeasible"
    proof = found.certificate
    assert isinstance(proof, Cover)
    assert set(proof.end) == {"", "least tension", "range"}
    draw = np.random.default_rng(seed)
    ends = [k for k, end in enumerate(proof.end) if end]
    check_exactly(structure, proof, {"top.x": -0.3}, [*ends, *draw.choice(len(proof.end), 3).tolist()])
    with pytest.raises(AssertionError):
        check_exactly(structure, proof, {"top.x": float(proof.node_position[0, -1, 0])}, [0])


def test_the_twist_of_a_prism_by_one_motor_on_its_verticals() -> None:
    structure = limit(gang(build_prism(155.0), "vertical"))
    model = compile_plan(structure)
    found = plan(model, "twist=165")
    assert found.status == "infeasible"
    proof = found.certificate
    assert isinstance(proof, Cover)
    # The record has the furthest path too.
    assert found.block is not None
    assert found.n_steps > 2
    assert "least tension" in found.message
    assert describe_plan(found)["certificate"]["kind"] == "cover"
    assert "No plan exists: blocked at 36" in describe_plan_finding(found, structure.limits)
    check_exactly(
        structure, proof, {"twist": 165.0}, [proof.end.index("least tension"), 0, len(proof.end) - 3]
    )


def test_a_shape_that_gives_way_has_no_cell() -> None:
    """Without lengths and forces the derivatives are singular."""
    model = compile_plan(build_small())
    plan_model = PlanModel(model, find_actuation(model))
    limits = build_limits(model, plan_model.ranges)
    start = find_start(plan_model, limits).at
    equations = Equations(plan_model, build_small(), limits, start)
    assert equations.find_cell(equations.stated, start.change, 1e-4) is not None
    assert equations.find_cell(0.0 * equations.stated, start.change, 1e-4) is None


SHAPES = ("height", "twist", "tilt", "t1.z", 'member_length["opposite1"]')


@pytest.mark.parametrize("seed", [*range(2), *thorough(*range(2, 30))])
def test_what_motors_reach_is_never_proved_to_be_out_of_reach(seed: int) -> None:
    """Of shapes that random walks within the limits lead to, no value has a proof."""
    draw = np.random.default_rng(seed)
    prism = build_prism(155.0) if seed % 2 else anchor(build_prism(155.0))
    names = [name for name, is_bar in zip(prism.member_name, prism.is_bar, strict=True) if not is_bar]
    chosen = draw.choice(names, int(draw.integers(1, 7)), replace=False).tolist()
    structure = limit(gang(prism, *chosen))
    model = compile_plan(structure)
    actuation = find_actuation(model)
    plan_model = PlanModel(model, actuation)
    limits = build_limits(model, plan_model.ranges)
    start = find_start(plan_model, limits).at
    walk = Walk(plan_model, limits, Targets(()), start, 80, 0.4)
    walk.go(draw.standard_normal(len(actuation.names)), 8)
    assert len(walk.points) > 1
    problem = plan_model.problem(walk.points[-1].at.change)
    for text in SHAPES:
        if text == "t1.z" and seed % 2:
            continue  # of a prism that moves as a whole
        zero = bind_targets(read_targets({text: 0.0}), model)
        value = zero.follow(start.position).evaluate(problem, walk.points[-1].at.coordinate)
        given: Any = value.tolist() if len(value) > 1 else float(value[0])
        targets = bind_targets(read_targets({text: given}), model)
        assert find_cover(plan_model, limits, targets, [start], 40) is None


def anchor(structure: Structure) -> Structure:
    """Return the prism on a fixed base."""
    held = np.array([[name.startswith("b")] * 3 for name in structure.node_name])
    return structure.with_changes(node_anchored=held)
