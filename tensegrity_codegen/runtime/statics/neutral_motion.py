"""Motions that cost no energy at an equilibrium: their names, and how far nodes moved apart from them.

A structure on a smooth table may slide and spin. How far its nodes went from the start then says little; what
counts is the distance that is left after the start has been moved along these motions as near as possible.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from tensegrity_codegen.runtime.statics.factors import DENSE_LIMIT
from tensegrity_codegen.runtime.statics.newton import Stability
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.system.arrays import FloatArray

AXIS_ANGLE_TOLERANCE = 1e-6  # sine of the angle up to which a direction counts as that of an axis
RANK_TOLERANCE = 1e-8  # part of a unit motion that counts as none
MAX_FITS = 60
LARGEST_TURN = 1.0  # [rad] of one step of the fit
START_TURN = 2.0  # [rad], turns from which the fit begins besides none


@dataclass(frozen=True)
class NeutralMotions:
    """Neutral motions at one configuration."""

    centre: FloatArray  # (3,) [m]
    twist: FloatArray  # (k, 6) of the rigid ones, turn and translation of the centre
    mechanism: FloatArray  # (n_nodes, 3, m), velocities of nodes in the others

    @property
    def names(self) -> tuple[str, ...]:
        """Return them in words: "slide along x", "turn about z", "mechanism"."""
        if not len(self.twist):
            slides, turns = np.zeros((0, 3)), np.zeros((0, 3))
        else:
            rotation, size, right = np.linalg.svd(self.twist[:, :3])
            rank = int((size > RANK_TOLERANCE).sum())
            turns, slides = right[:rank], (rotation.T @ self.twist[:, 3:])[rank:]
        names = [f"slide along {name}" for name in _name_directions(slides)]
        names += [f"turn about {name}" for name in _name_directions(turns)]
        return (*names, *("mechanism" for _ in range(self.mechanism.shape[2])))

    def distance(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return how far nodes are from the start moved along these motions, (n_nodes,) [m]."""
        remaining = end - self._fit(start, end)
        if self.mechanism.shape[2]:
            fields = self.mechanism.reshape(-1, self.mechanism.shape[2])
            rates = np.linalg.lstsq(fields, remaining.ravel(), rcond=None)[0]
            remaining = remaining - (fields @ rates).reshape(remaining.shape)
        distance: FloatArray = np.linalg.norm(remaining, axis=1)
        return distance

    def _fit(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the start moved as one rigid body along the neutral motions, nearest to the end."""
        if not len(self.twist):
            return start
        # Combined so that turns are apart from slides: a slide with a tiny turn would be carried far away.
        rotation, _, _ = np.linalg.svd(self.twist[:, :3])
        begins = [np.zeros(6)]
        for row in rotation.T @ self.twist:
            turn = float(np.linalg.norm(row[:3]))
            if turn > RANK_TOLERANCE:
                begins += [row * (START_TURN / turn), -row * (START_TURN / turn)]
        ends = [self._fit_from(_carry(start, twist, self.centre), end) for twist in begins]
        return min(ends, key=lambda candidate: float(np.linalg.norm(end - candidate)))

    def _fit_from(self, position: FloatArray, end: FloatArray) -> FloatArray:
        for _ in range(MAX_FITS):
            fields = _fields(self.twist, position - self.centre)
            rates = np.linalg.lstsq(fields, (end - position).ravel(), rcond=None)[0]
            twist = rates @ self.twist
            turn = float(np.linalg.norm(twist[:3]))
            twist *= min(1.0, LARGEST_TURN / turn) if turn else 1.0
            moved = _carry(position, twist, self.centre)
            step = float(np.abs(moved - position).max())
            position = moved
            if step <= 1e-14 * float(np.abs(end - self.centre).max()):
                break
        return position


def find_neutral(problem: StaticProblem, coordinate: FloatArray, stability: Stability) -> NeutralMotions:
    """Return the neutral motions at an equilibrium; of large structures at most one mechanism is found."""
    position = problem.node_position(coordinate)
    centre = position.mean(axis=0)
    rigid = problem.node_velocities(coordinate, stability.neutral)
    rigid_fields = _fields(np.eye(6), position - centre)
    twist: FloatArray = np.array(
        np.linalg.lstsq(rigid_fields, rigid.reshape(len(rigid_fields), -1), rcond=None)[0].T
    )
    loose = _find_mechanisms(problem, coordinate, stability)
    return NeutralMotions(centre, twist, problem.node_velocities(coordinate, loose))


def _find_mechanisms(problem: StaticProblem, coordinate: FloatArray, stability: Stability) -> FloatArray:
    """Return neutral directions that are no rigid motions, (n_directions, m)."""
    size = len(stability.direction)
    if not stability.is_neutral or size == 0:
        return np.zeros((size, 0))
    if size > DENSE_LIMIT:
        return stability.direction[:, None]
    stiffness = np.asarray(problem.stiffness(coordinate).toarray())
    neutral = stability.neutral
    basis = (
        np.linalg.qr(neutral, mode="complete")[0][:, neutral.shape[1] :] if neutral.shape[1] else np.eye(size)
    )
    values, vectors = np.linalg.eigh(basis.T @ (stiffness + stiffness.T) @ basis / 2)
    mechanisms: FloatArray = basis @ vectors[:, np.abs(values) <= stability.rounding]
    return mechanisms


def _fields(twist: FloatArray, local: FloatArray) -> FloatArray:
    """Return the velocities of points (n, 3) in each twist (k, 6), (3 n, k)."""
    (a, b, c), (x, y, z) = twist[:, :3].T[..., None], local.T
    turn = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)
    fields: FloatArray = (turn + twist[:, None, 3:]).reshape(len(twist), -1).T
    return fields


def _carry(position: FloatArray, twist: FloatArray, centre: FloatArray) -> FloatArray:
    """Return points (n, 3) after a unit of time along a constant twist about `centre`."""
    x, y, z = twist[:3]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    generator[:3, 3] = twist[3:]
    moved = scipy.linalg.expm(generator)
    carried: FloatArray = (position - centre) @ moved[:3, :3].T + moved[:3, 3] + centre
    return carried


def _name_directions(rows: FloatArray) -> list[str]:
    """Return the directions that rows (k, 3) span, by axes where axes are among them."""
    if not len(rows):
        return []
    _, size, right = np.linalg.svd(rows)
    basis = right[: int((size > RANK_TOLERANCE).sum())]
    names, projector = [], basis.T @ basis
    for axis in range(3):
        unit = np.eye(3)[axis]
        if np.linalg.norm(projector @ unit - unit) <= AXIS_ANGLE_TOLERANCE:
            names.append("xyz"[axis])
            projector = projector - np.outer(unit, unit)
    values, vectors = np.linalg.eigh(projector)
    for vector in vectors.T[values > 0.5]:
        names.append(
            "({:.3g}, {:.3g}, {:.3g})".format(*(vector * np.sign(vector[np.abs(vector).argmax()]) + 0.0))
        )
    return names
