"""One roll over an edge: winches over time, by the gradient of a motion through its contacts and slips."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.optimise import LossGradient, optimise
from tensegrity_codegen.system.arrays import FloatArray

SceneLike = str | Path | Mapping[str, Any] | Scene
MISS_WEIGHT = 10.0  # of half the squared distance to the goal, in parts of the way, beside a cost
CHANGE_WEIGHT = 5.0  # of half the squared changes of lengths [1/m2]: of equal rolls that of small ones
SAMPLES = 41  # of a roll, over which the work of winches is summed
KNOTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.4, 2.0])  # times of a roll [s]
FREE = slice(1, 5)  # knots at which winches are at lengths of their own; at the others at those of the scene


@dataclass(frozen=True)
class Winches:
    """Inputs that change the rest length of one member each.

    name, member: one an input; low, high: bounds of each (n_winches,) [m]; share (n_nodes,): parts of the
    mass; weight: of the structure [N].
    """

    name: tuple[str, ...]
    member: list[int]
    low: FloatArray
    high: FloatArray
    share: FloatArray
    weight: float

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
    """Return the changes of rest lengths of the roll of least loss, (n_winches, n_knots) [m].

    First without the cost of transport: winches that stand still cost less than those that pull too little.
    """
    winches, n_free = loss.winches, len(KNOTS[FREE])
    pairs = zip(winches.low.repeat(n_free).tolist(), winches.high.repeat(n_free).tolist(), strict=True)
    bounds = dict(zip(loss.problem.keys, pairs, strict=True))
    for loss.has_cost in (False, True):
        found = optimise(loss, bounds=bounds, max_iterations=max_iterations, tolerance=1e-4)
        loss.problem.start = found.value
    values = np.zeros((len(winches.name), len(KNOTS)))
    values[:, FREE] = found.value.reshape(-1, n_free)
    return values
