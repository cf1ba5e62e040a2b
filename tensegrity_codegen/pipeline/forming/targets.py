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
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    DuplicateNameError,
    InvalidValueError,
    check_choice,
)
from tensegrity_codegen.system.summaries import count_names

KINDS = {"bars": True, "cables": False}


def read_statements(
    structure: Structure,
    density: Mapping[str, float],
    force: Mapping[str, float],
    length: Mapping[str, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return density, force and length of each member, nan where another one is stated."""
    values = np.full((3, structure.n_members), np.nan)
    rank = np.full(structure.n_members, 9)  # behind all that can be stated
    kinds = [""] * structure.n_members
    for index, (kind, stated) in enumerate((("density", density), ("force", force), ("length", length))):
        for name, value in stated.items():
            members, order = find_members(structure, name, kind)
            _check_value(structure, kind, name, value, members)
            for e in members:
                if rank[e] == order:
                    raise DuplicateNameError(
                        "two statements of one member",
                        where=f"{structure.name}: {kind}",
                        given=f"{kinds[e]} and {kind} {name}, of {structure.member_name[e]}",
                        allowed="one, or another one of fewer members",
                    )
                if order < rank[e]:
                    values[:, e], rank[e], kinds[e] = np.nan, order, f"{kind} {name}"
                    values[index, e] = value
    bare = np.isnan(values).all(axis=0)
    if (bare & ~structure.is_bar).any():
        names = [structure.member_name[e] for e in np.flatnonzero(bare & ~structure.is_bar)]
        problem, location = "nothing is stated of some cables", structure.name
        allowed = "a force density, force or length of each cable"
        hint = (
            'density={"cables": 100} [N/m]; a prestress that keeps the stated positions is found by '
            "`analyse SCENE --prestress 100 --scene-out FILE`"
        )
        raise InvalidValueError(problem, where=location, given=count_names(names), allowed=allowed, hint=hint)
    values[2, bare] = structure.member_length()[bare]
    return values[0], values[1], values[2]


def find_members(structure: Structure, name: str, word: str) -> tuple[list[int], int]:
    """Return the members of a name, and how far it comes behind: of a member, group, class or kind."""
    if name in structure.member_name:
        return [structure.member_name.index(name)], 0
    if name in structure.groups:
        return list(structure.groups[name]), 1
    if name in structure.member_class:
        return [e for e, member_class in enumerate(structure.member_class) if member_class == name], 2
    valid_names = (
        *KINDS,
        *structure.groups,
        *dict.fromkeys(filter(None, structure.member_class)),
        *structure.member_name,
    )
    check_choice(name, valid_names, "member, group, class or kind", f"{structure.name}: {word}")
    return np.flatnonzero(structure.is_bar == KINDS[name]).tolist(), 3


def _check_value(structure: Structure, word: str, name: str, value: Any, members: list[int]) -> None:
    """Raise InvalidValueError for a value that these members cannot have."""
    cables = structure.tension_only[members].any()
    is_good = is_number(value) and value != 0 and (value > 0 or (word != "length" and not cables))
    if not is_good:
        problem, location = f"not a {word} that these members can have", f"{structure.name}: {word}"
        allowed = "above 0" + ("" if cables or word == "length" else ", or below 0 for bars that push")
        raise InvalidValueError(problem, where=location, given=f"{name} = {value!r}", allowed=allowed)


Numbers = Mapping[str, float | Sequence[float]]

STARTS, SPREAD = 5, 0.1  # the stated densities, and those with random changes of this size
MOST_ITERATIONS, TOLERANCE = 1000, 1e-13
LARGEST_EXCESS = 1e-7  # of a length, beyond its range
LEAST_DENSITY = 1e-6  # of the stated one: densities keep their sign
MOST_MEMBERS = 1000  # whose derivatives by all densities are held, members times members


@dataclass(frozen=True)
class Targets:
    """Targets of members, (n_members, 2) each, nan where there is none.

    length, force: value [m, N] and weight.
    """

    length: FloatArray
    force: FloatArray
    length_range: FloatArray  # least and largest length [m]
    load_path: bool  # whether sum |t| l is minimised [N m]

    @property
    def is_stated(self) -> bool:
        """Whether there is any target."""
        targets = (self.length, self.force, self.length_range)
        return self.load_path or any(np.isfinite(target).any() for target in targets)


def read_targets(
    structure: Structure, length: Numbers, force: Numbers, length_range: Numbers, load_path: bool
) -> Targets:
    """Return the targets of members; raises UnknownNameError and InvalidValueError."""
    targets = []
    stated = (("target_length", length), ("target_force", force), ("length_range", length_range))
    for kind, given in stated:
        values, rank = np.full((structure.n_members, 2), np.nan), np.full(structure.n_members, 9)
        for name, numbers in given.items():
            pair: list[Any] = list(numbers) if isinstance(numbers, list | tuple | np.ndarray) else [numbers]
            pair = [*pair, 1.0] if len(pair) == 1 and kind != "length_range" else pair
            is_good = len(pair) == 2 and all(map(is_number, pair)) and pair[1] > 0
            if kind == "length_range":
                is_good = is_good and 0 <= pair[0] <= pair[1]
            if not is_good or (kind == "target_length" and pair[0] <= 0):
                raise InvalidValueError(
                    f"not a {kind.replace('_', ' ')}",
                    where=f"{structure.name}: {kind}",
                    given=f"{name} = {numbers!r}",
                    allowed="least and largest length"
                    if kind == "length_range"
                    else "value, or value and weight",
                )
            members, order = find_members(structure, name, kind)
            for e in (e for e in members if order < rank[e]):
                values[e], rank[e] = pair, order
        targets.append(values)
    return Targets(length=targets[0], force=targets[1], length_range=targets[2], load_path=load_path)


def find_nearest_shape(structure: Structure, density: FloatArray, targets: Targets) -> DensityShape:
    """Return the shape nearest to targets of lengths and forces within ranges, from densities [N/m]."""
    if structure.n_members > MOST_MEMBERS:
        value, allowed = f"{structure.n_members} members", f"up to {MOST_MEMBERS}"
        hint = "state force densities, forces and lengths, which have no such limit"
        raise InvalidValueError(
            "too many members for targets", where=structure.name, given=value, allowed=allowed, hint=hint
        )
    problem = _Problem(structure, density, targets)
    # The goal has local minima: the first start is that of the densities, the others are spread about it.
    random, best, reason = np.random.default_rng(0), None, ""
    for trial in range(STARTS):
        change = random.uniform(-SPREAD, SPREAD, len(density)) if trial else np.zeros(len(density))
        try:
            minimum = problem.minimise(1.0 + change)
        except ConvergenceError:
            if trial == 0:
                raise
            continue
        reason = reason or str(minimum.message)
        if problem.find_excess(minimum.x) <= LARGEST_EXCESS and minimum.success:
            best = minimum if best is None or minimum.fun < best.fun else best
    if best is None:
        raise ConvergenceError(
            "no shape nearest to the targets was found",
            evidence={"starts": STARTS, "reason": reason, "beyond_range": problem.find_excess(minimum.x)},
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
            fixed = self.difference[:, ~structure.node_anchored[:, axis]]
            if fixed.shape[1]:
                moved = np.linalg.solve(fixed.T @ (q[:, None] * fixed), fixed.T * span[:, axis])
                slope -= (span[:, axis] / length)[:, None] * (fixed @ moved)
        return length, slope * self.density

    def find_goal(self, z: FloatArray) -> tuple[float, FloatArray]:
        """Return the minimised goal and its derivatives by z."""
        targets, q = self.targets, z * self.density
        length, slope = self.find_lengths(z)
        force = q * length
        force_slope = q[:, None] * slope + np.diag(self.density * length)
        value, by_z = 0.0, np.zeros(len(q))
        for target, now, change in ((targets.length, length, slope), (targets.force, force, force_slope)):
            off = np.nan_to_num(now - target[:, 0])
            weight = np.nan_to_num(target[:, 1])
            value += float(weight @ off**2)
            by_z += 2.0 * (weight * off) @ change
        if targets.load_path:
            value += float(np.abs(force) @ length)
            by_z += np.sign(q) @ (force_slope * length[:, None] + force[:, None] * slope)
        return value / self.scale, by_z / self.scale

    def find_margins(self, z: FloatArray) -> FloatArray:
        """Return how far lengths are within their ranges, below 0 where they are not."""
        length, (lower, upper) = self.find_lengths(z)[0], self.targets.length_range.T
        return np.concatenate([(length - lower)[self.limited[:, 0]], (upper - length)[self.limited[:, 1]]])

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
