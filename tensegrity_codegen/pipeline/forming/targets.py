"""Shapes in balance nearest to targets: lengths, forces and the load path as functions of force densities.

D(q) x = p gives the shape of the force densities q, so that dx/dq_e = -D^-1 C_e^T (C x)_e exactly, with the
differences C of the ends of members: every target has exact derivatives (R. M. O. Pastrana, D. Oktay,
R. P. Adams and S. Adriaenssens, "JAX FDM", 2023, take them by automatic differentiation).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.pipeline.forming.force_density import DensityShape, check_lengths, find_density_shape
from tensegrity_codegen.pipeline.forming.statements import find_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError

Numbers = Mapping[str, float | Sequence[float]]

STARTS, SPREAD = 5, 0.1  # the stated densities, and those with random changes of this size
MOST_ITERATIONS, TOLERANCE = 1000, 1e-13
LARGEST_EXCESS = 1e-7  # of a length, beyond its range
LEAST_DENSITY = 1e-6  # of the stated one: densities keep their sign
MOST_MEMBERS = 1000  # whose derivatives by all densities are held, members times members


@dataclass(frozen=True)
class Targets:
    """Targets of members, (n_members, 2) each, nan where there is none.

    length, force: value [m, N] and weight; length_range: least and largest length [m]. load_path: whether
    sum |t| l is minimised [N m].
    """

    length: FloatArray
    force: FloatArray
    length_range: FloatArray
    load_path: bool

    @property
    def is_stated(self) -> bool:
        """Whether there is any target."""
        parts = (self.length, self.force, self.length_range)
        return self.load_path or any(np.isfinite(part).any() for part in parts)


def read_targets(
    structure: Structure, length: Numbers, force: Numbers, length_range: Numbers, load_path: bool
) -> Targets:
    """Return the targets of members; raises UnknownNameError and InvalidValueError."""
    found = []
    stated = (("target_length", length), ("target_force", force), ("length_range", length_range))
    for word, given in stated:
        values, rank = np.full((structure.n_members, 2), np.nan), np.full(structure.n_members, 9)
        for name, numbers in given.items():
            pair: list[Any] = list(numbers) if isinstance(numbers, list | tuple | np.ndarray) else [numbers]
            pair = [*pair, 1.0] if len(pair) == 1 and word != "length_range" else pair
            is_good = len(pair) == 2 and all(map(is_number, pair)) and pair[1] > 0
            if word == "length_range":
                is_good = is_good and 0 <= pair[0] <= pair[1]
            if not is_good or (word == "target_length" and pair[0] <= 0):
                raise InvalidValueError(
                    f"not a {word.replace('_', ' ')}",
                    where=f"{structure.name}: {word}",
                    given=f"{name} = {numbers!r}",
                    allowed="least and largest length"
                    if word == "length_range"
                    else "value, or value and weight",
                )
            members, order = find_members(structure, name, word)
            for e in (e for e in members if order < rank[e]):
                values[e], rank[e] = pair, order
        found.append(values)
    return Targets(length=found[0], force=found[1], length_range=found[2], load_path=load_path)


def find_nearest_shape(structure: Structure, density: FloatArray, targets: Targets) -> DensityShape:
    """Return the shape whose lengths and forces are nearest to targets, within ranges of lengths.

    structure: nodes, anchors, loads.
    density (n_members,) [N/m]: force densities where the search begins; each keeps its sign.
    targets: what is minimised: sum of weight (l - target)^2, of weight (t - target)^2, and the load path.
    Raises InvalidValueError: more than MOST_MEMBERS members; ConvergenceError: no start reached ranges and a
    stationary point; densities of both signs cancel.
    """
    if structure.n_members > MOST_MEMBERS:
        raise InvalidValueError(
            "too many members for targets",
            where=structure.name,
            given=f"{structure.n_members} members",
            allowed=f"up to {MOST_MEMBERS}",
            hint="state force densities, forces and lengths, which have no such limit",
        )
    problem = _Problem(structure, density, targets)
    random, best, reason = np.random.default_rng(0), None, ""
    for trial in range(STARTS):
        change = random.uniform(-SPREAD, SPREAD, len(density)) if trial else np.zeros(len(density))
        try:
            found = problem.minimise(1.0 + change)
        except ConvergenceError:
            if trial == 0:
                raise
            continue
        reason = reason or str(found.message)
        if problem.find_excess(found.x) <= LARGEST_EXCESS and found.success:
            best = found if best is None or found.fun < best.fun else best
    if best is None:
        raise ConvergenceError(
            "no shape nearest to the targets was found",
            evidence={"starts": STARTS, "reason": reason, "beyond_range": problem.find_excess(found.x)},
            where=structure.name,
            hint="widen ranges, choose targets within reach, or begin from other force densities",
        )
    return find_density_shape(structure, density * best.x, np.full(len(density), np.nan))


class _Problem:
    """Targets as functions of z, with the force densities z times the stated ones."""

    def __init__(self, structure: Structure, density: FloatArray, targets: Targets) -> None:
        self.structure, self.density, self.targets = structure, density, targets
        n, members = structure.n_nodes, np.arange(structure.n_members)
        self.difference = np.zeros((structure.n_members, n))
        for column, sign in zip(structure.connectivity.T, (1.0, -1.0), strict=True):
            self.difference[members, column] = sign
        self.scale = 1.0
        self.scale = abs(self.find_goal(np.ones(len(density)))[0]) or 1.0
        self.limited = np.isfinite(targets.length_range)

    def find_lengths(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lengths (n_members,) and their derivatives by z, (n_members, n_members)."""
        structure, q = self.structure, z * self.density
        position = find_density_shape(structure, q, np.full(len(q), np.nan)).node_position
        span = self.difference @ position
        length = check_lengths(structure, position, float(np.ptp(position, axis=0).max()))
        slope = np.zeros((len(q), len(q)))
        for axis in structure.axes:
            own = self.difference[:, ~structure.node_anchored[:, axis]]
            if own.shape[1]:
                moved = np.linalg.solve(own.T @ (q[:, None] * own), own.T * span[:, axis])
                slope -= (span[:, axis] / length)[:, None] * (own @ moved)
        return length, slope * self.density

    def find_goal(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Return what is minimised and its derivatives by z."""
        targets, q = self.targets, z * self.density
        length, slope = self.find_lengths(z)
        force = q * length
        force_slope = q[:, None] * slope + np.diag(self.density * length)
        value, by_z = 0.0, np.zeros(len(q))
        for part, now, change in ((targets.length, length, slope), (targets.force, force, force_slope)):
            off = np.nan_to_num(now - part[:, 0])
            weight = np.nan_to_num(part[:, 1])
            value += float(weight @ off**2)
            by_z += 2.0 * (weight * off) @ change
        if targets.load_path:
            value += float(np.abs(force) @ length)
            by_z += np.sign(q) @ (force_slope * length[:, None] + force[:, None] * slope)
        return value / self.scale, by_z / self.scale

    def find_margins(self, z: FloatArray) -> FloatArray:
        """Return how far lengths are within their ranges, below 0 where they are not."""
        length, (least, most) = self.find_lengths(z)[0], self.targets.length_range.T
        return np.concatenate([(length - least)[self.limited[:, 0]], (most - length)[self.limited[:, 1]]])

    def find_excess(self, z: FloatArray) -> float:
        """Return the largest length beyond a range [m]."""
        return float(np.abs(self.find_margins(z).min(initial=0.0)))

    def differentiate_margins(self, z: FloatArray) -> FloatArray:
        """Return the derivatives of the margins by z."""
        slope = self.find_lengths(z)[1]
        return np.concatenate([slope[self.limited[:, 0]], -slope[self.limited[:, 1]]])

    def minimise(self, start: FloatArray) -> Any:
        """Return the result of SLSQP."""
        within: Any = {"type": "ineq", "fun": self.find_margins, "jac": self.differentiate_margins}
        return scipy.optimize.minimize(
            self.find_goal, start, jac=True, method="SLSQP",
            bounds=[(LEAST_DENSITY, None)] * len(start), constraints=[within] if self.limited.any() else [],
            options={"maxiter": MOST_ITERATIONS, "ftol": TOLERANCE},
        )  # fmt: skip
