"""What is integrated: one structure, one start, one span of time, the same for all contenders."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

# Where a scene starts at rest in equilibrium nothing would be measured: its nodes are given speeds of this
# part of the mean member length a second, that stretch no bar.
KICK = 0.1
STILL = 1e-6  # net acceleration times a second, over the mean length, that counts as rest


@dataclass(frozen=True)
class MotionProblem:
    """A structure with its initial state, and the times [s] at which positions are compared.

    is_kicked: whether the initial velocities are not the scene's own.
    """

    structure: Structure
    sample_time: FloatArray
    is_kicked: bool

    @property
    def t_end(self) -> float:
        """End of the motion [s]."""
        return float(self.sample_time[-1])


def set_problem(structure: Structure, t_end: float, samples: int) -> MotionProblem:
    """Return the motion of a structure over t_end [s]; given speeds if it would not move by itself."""
    kicked = bool(_is_at_rest(structure))
    if kicked:
        structure = structure.with_changes(node_velocity=_kick(structure))
    return MotionProblem(structure, np.linspace(0.0, t_end, samples), kicked)


def _is_at_rest(structure: Structure) -> bool:
    """Return whether no node moves and no free node feels a net force, to 1e-6 of the largest tension."""
    if structure.node_velocity.any():
        return False
    if structure.is_rigid.any():
        return False  # the forces of rigid bars are not known beforehand
    tension = structure.static_tension()
    ends = structure.node_position[structure.connectivity]
    vector = ends[:, 0] - ends[:, 1]
    pull = (tension / structure.member_length())[:, None] * vector
    weight = structure.node_mass.copy()
    np.add.at(weight, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    force = structure.node_load + weight[:, None] * structure.gravity
    np.add.at(force, structure.connectivity[:, 0], -pull)
    np.add.at(force, structure.connectivity[:, 1], pull)
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    scale = max(float(np.abs(tension).max()), 1e-300)
    return bool(np.abs(force[free]).max(initial=0.0) <= STILL * scale)


def _kick(structure: Structure) -> FloatArray:
    """Return (n_nodes, 3) velocities [m/s], always the same, that stretch no bar at first."""
    rng = np.random.default_rng(0)
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    length = float(structure.member_length().mean())
    velocity = np.where(free, rng.standard_normal(free.shape), 0.0) * KICK * length
    return without_stretch(structure, velocity, np.flatnonzero(structure.is_bar))


def without_stretch(structure: Structure, velocity: FloatArray, members: NDArray[np.int64]) -> FloatArray:
    """Return the nearest velocities (n_nodes, 3) [m/s] of free coordinates that stretch none of `members`."""
    free = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    ends = structure.node_position[structure.connectivity[members]]
    vector = ends[:, 0] - ends[:, 1]
    jacobian = np.zeros((len(members), *free.shape))
    jacobian[np.arange(len(members)), structure.connectivity[members, 0]] = vector
    jacobian[np.arange(len(members)), structure.connectivity[members, 1]] = -vector
    stretch = jacobian[:, free]
    change = np.linalg.lstsq(stretch, stretch @ velocity[free], rcond=None)[0]
    result: FloatArray = velocity.copy()
    result[free] -= change
    return result
