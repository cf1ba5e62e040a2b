"""One roll over an edge: winches over time, by the gradient of a motion through its contacts and slips."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.fitting.optimise import LossGradient, optimise
from tensegrity_codegen.system.arrays import FloatArray, IntArray

TOLERANCE = 0.1  # of the size: how far nodes of a structure that its weight deforms are from symmetric
LEVEL = 0.02  # of the size: largest difference of heights of the nodes that it stands on
Facet = tuple[int, ...]
Step = tuple[Facet, Facet]  # from one facet to the next


class Facets:
    """Triangles of the convex hull; symmetry (n_nodes,): node k takes the place of node symmetry[s][k].

    With rigid bodies the hull is that of the contacts, and corners and edges of bodies have no symmetry.
    """

    def __init__(self, structure: Structure, winches: list[int]) -> None:
        """winches: members that have one; symmetries leave them among each other."""
        shown = hide_bodies(structure)
        self.position, self._ends = shown.node_position, shown.connectivity
        self.size = float(np.ptp(self.position, axis=0).max())
        self._hull, self._radius = np.arange(len(self.position)), np.zeros(structure.n_nodes)
        if structure.bodies and structure.ground is not None:
            self._hull, self._radius[structure.ground.node] = structure.ground.node, structure.ground.radius
        hull = scipy.spatial.ConvexHull(self.position[self._hull])
        self.facet = tuple(_sort(self._hull[row]) for row in hull.simplices)
        self._member = {frozenset(ends): e for e, ends in enumerate(self._ends.tolist())}
        is_wound = np.isin(np.arange(len(self._ends)), winches)
        self._kind = np.stack([shown.mu, shown.rest_length, shown.tension_only, is_wound], axis=1)
        self.symmetry = tuple(self._find_symmetries())

    def find_standing(self, position: FloatArray) -> Facet | None:
        """Return the facet of the three lowest of the nodes (n_nodes, 3), None where it leans on others."""
        height = position[:, 2] - self._radius
        lowest = _sort(self._hull[height[self._hull].argsort()[:3]])
        is_level = np.ptp(height[list(lowest)]) < LEVEL * self.size
        return lowest if lowest in self.facet and is_level else None

    def list_next(self, facet: Facet) -> list[Facet]:
        """Return the facets beyond the three edges of a facet."""
        return [candidate for candidate in self.facet if len(set(candidate) & set(facet)) == 2]

    def turn_over(self, position: FloatArray, step: Step) -> FloatArray:
        """Return the positions (n_nodes, 3) after a rigid roll from one facet over an edge to the next."""
        facet, target = map(set, step)
        pivot, second = sorted(facet & target)
        (back_node,), (front_node,) = facet - target, target - facet
        origin, axis = position[pivot], position[second] - position[pivot]
        axis = axis / np.linalg.norm(axis)
        back, front = (_find_across(position[k] - origin, axis) for k in (back_node, front_node))
        # The angle from the node ahead to where the ground goes on beyond the edge
        angle = np.arctan2(np.cross(front, -back) @ axis, -(front @ back))
        turn = scipy.spatial.transform.Rotation.from_rotvec(angle * axis)
        turned: FloatArray = origin + turn.apply(position - origin)
        return turned

    def find_symmetry(self, step: Step, other: Step) -> IntArray | None:
        """Return a symmetry that takes one roll into another, None where there is none."""
        for row in self.symmetry:
            if all(_sort(row[list(facet)]) == target for facet, target in zip(step, other, strict=True)):
                return row
        return None

    def map_members(self, symmetry: IntArray) -> list[int]:
        """Return the member whose place each member takes."""
        return [self._member[frozenset(ends)] for ends in symmetry[self._ends].tolist()]

    def _find_symmetries(self) -> list[IntArray]:
        """Lay the structure with its first facet on each facet in six ways; keep those that fit."""
        symmetries = [np.arange(len(self.position))]
        origin, axes = self._find_frame(self.facet[0])
        local = (self.position - origin) @ axes.T
        for nodes in (order for facet in self.facet for order in permutations(facet)):
            origin, axes = self._find_frame(nodes)
            distance = np.linalg.norm((local @ axes + origin)[:, None] - self.position, axis=2)
            row = distance.argmin(axis=1)
            is_near = distance.min(axis=1).max() < TOLERANCE * self.size and len(set(row)) == len(row)
            ends = [frozenset(pair) for pair in row[self._ends].tolist()]
            if not is_near or (row == symmetries[0]).all() or not all(pair in self._member for pair in ends):
                continue
            if np.allclose(self._kind[self.map_members(row)], self._kind, rtol=1e-3):
                symmetries.append(row)
        return symmetries

    def _find_frame(self, nodes: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
        """Return centre and axes (3, 3), one a row: along the first edge, to the third node, outwards."""
        a, b, c = self.position[list(nodes)]
        along = (b - a) / np.linalg.norm(b - a)
        aside = _find_across(c - a, along)
        aside = aside / np.linalg.norm(aside)
        outwards = np.cross(along, aside)
        outwards = outwards * np.sign(outwards @ (a - self.position.mean(axis=0)))
        return (a + b + c) / 3, np.stack([along, aside, outwards])


def _sort(nodes: Any) -> Facet:
    return tuple(sorted(int(k) for k in nodes))


def _find_across(vector: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the part of a vector across a unit vector."""
    return vector - (vector @ axis) * axis


SceneLike = str | Path | Mapping[str, Any] | Scene
MISS_WEIGHT = 10.0  # of half the squared distance to the goal, in parts of the way, beside a cost
CHANGE_WEIGHT = 5.0  # of half the squared changes of lengths [1/m2]: of equal rolls that of small ones
SAMPLES = 41  # of a roll, over which the work of winches is summed
KNOTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.4, 2.0])  # times of a roll [s]
FREE = slice(1, 5)  # knots at which winches are at lengths of their own; at the others at those of the scene


@dataclass(frozen=True)
class Winches:
    """Inputs that change the rest length of one member each.

    name, member: one an input; low, high: bounds of each (n_winches,) [m].
    """

    name: tuple[str, ...]
    member: list[int]
    low: FloatArray
    high: FloatArray
    share: FloatArray  # (n_nodes,) parts of the mass
    weight: float  # of the structure [N]

    def find_centre(self, motion: Trajectory) -> FloatArray:
        """Return the path of the centre of mass seen from above, (n_t, 2) [m]."""
        path: FloatArray = np.einsum("n,tna->ta", self.share, motion.node_position)[:, :2]
        return path

    def find_work(self, motion: Trajectory, schedule: Profile) -> FloatArray:
        """Return the work of each winch between samples, (n_t - 1, n_winches) [J]."""
        rows = [schedule(float(time)) for time in motion.time]
        length = np.array([[row[name] for name in self.name] for row in rows])
        tension = motion.member_tension[:, self.member]
        return np.asarray(-np.diff(length, axis=0) * (tension[1:] + tension[:-1]) / 2)


class RollLoss(LossGradient):
    """The loss of a roll, with its gradient to the free knots of all winches.

    The loss is the distance of the centre of mass from the goal (2,), from the last free knot on, and the
    work of winches that pull over weight and way: the cost of transport, unless `has_cost` is False.
    """

    check = False  # the loss is that of the knots of the last call

    def __init__(
        self, scene: SceneLike, winches: Winches, goal: FloatArray, start: Mapping[str, ArrayLike]
    ) -> None:
        self.winches, self.goal, self.has_cost = winches, goal, False
        free, times = range(len(KNOTS))[FREE], np.linspace(0.0, KNOTS[-1], SAMPLES)
        keys = [f"profile.{name}[{k}]" for name in winches.name for k in free]
        schedule = Profile(KNOTS, {name: np.zeros(len(KNOTS)) for name in winches.name})
        super().__init__(
            scene, keys, self._find_loss, KNOTS[-1], samples=times, rtol=1e-6, schedule=schedule,
            arguments=start, backwards=True,
        )  # fmt: skip
        self.settled = (times >= KNOTS[free[-1]]) / (times >= KNOTS[free[-1]]).sum()
        # What winches take in between samples, from values of the knots, between which lengths are linear
        spread = [np.interp(times, KNOTS, row) for row in np.eye(len(KNOTS))[FREE]]
        self.intake = -np.diff(spread, axis=1).T
        self._taken = self._by_taken = np.zeros((SAMPLES - 1, len(winches.name)))

    def __call__(self, values: ArrayLike) -> tuple[float, FloatArray]:
        """Return the loss and its gradient (n_keys,) at values of the knots (n_keys,)."""
        knots = np.asarray(values, dtype=np.float64).reshape(len(self.winches.name), -1)
        self._taken = self.intake @ knots.T
        loss, slope = super().__call__(values)
        loss += CHANGE_WEIGHT * float((knots**2).sum()) / 2
        return loss, slope + (CHANGE_WEIGHT * knots + self._by_taken.T @ self.intake).ravel()

    def _find_loss(self, motion: Trajectory) -> tuple[float, dict[str, FloatArray]]:
        winches, centre = self.winches, self.winches.find_centre(motion)
        way = float(np.linalg.norm(self.goal - centre[0]))
        away = (centre - self.goal) / way
        at_position, at_tension = np.zeros_like(motion.node_position), np.zeros_like(motion.member_tension)
        pull = MISS_WEIGHT * self.settled[:, None] * away
        at_position[:, :, :2] = pull[:, None] * winches.share[:, None] / way
        loss = float((pull * away).sum()) / 2
        # Work of winches that pull. It depends on tensions, and by the knots on what is taken in
        tension = motion.member_tension[:, winches.member]
        mean = (tension[1:] + tension[:-1]) / 2
        cost = self.has_cost * (self._taken * mean > 0.0) / (winches.weight * way)
        self._by_taken = cost * mean
        at_tension[1:, winches.member] += cost * self._taken / 2
        at_tension[:-1, winches.member] += cost * self._taken / 2
        loss += float((self._by_taken * self._taken).sum())
        return loss, {"node_position": at_position, "member_tension": at_tension}


def find_roll(loss: RollLoss, max_iterations: int) -> FloatArray:
    """Return the changes of rest lengths of the roll of least loss, (n_winches, n_knots) [m]."""
    winches, n_free = loss.winches, len(KNOTS[FREE])
    pairs = zip(winches.low.repeat(n_free).tolist(), winches.high.repeat(n_free).tolist(), strict=True)
    bounds = dict(zip(loss.problem.keys, pairs, strict=True))
    for loss.has_cost in (False, True):
        design = optimise(loss, bounds=bounds, max_iterations=max_iterations, tolerance=1e-4)
        loss.problem.start = np.clip(design.value, *np.transpose(list(bounds.values())))  # to rounding
    values = np.zeros((len(winches.name), len(KNOTS)))
    values[:, FREE] = design.value.reshape(-1, n_free)
    return values
