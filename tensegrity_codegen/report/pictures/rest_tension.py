"""Member tensions at the stated positions, those of rigid bars solved for where statics determines them.

The tension of a rigid bar does not follow from its length. It follows from the balance of its nodes, if the
stated positions are in equilibrium and the bars are statically determined; else it is unknown here.
"""

import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray

UNBALANCED = 0.01  # part of the largest force that nodes may lack where they count as balanced
DEPENDENT = 1e-9  # singular values below count as none, as the bars have unit directions
MOST_BARS = 1000  # rigid bars up to which their tensions are solved for


def find_rest_tension(subject: Structure | BodySystem, rigid: BoolArray | None = None) -> FloatArray:
    """Return the tensions of what is drawn, (n_members,) [N]: without damping, NaN where unknown.

    Unknown are rigid bars of a structure that is out of balance by more than 1 % of its largest force, bars
    that other bars make redundant, and the bars and edges of bodies. The rows are those of outline_bodies.
    rigid (n_members of subject,): which members the formulation keeps rigid, by default those without any
    stiffness; the option `bars = "all"` makes bars rigid that have one.
    """
    structure = outline_bodies(subject)
    tension = structure.static_tension()
    more = structure.n_members - subject.n_members
    rigid = structure.is_rigid if rigid is None else structure.is_rigid | np.pad(rigid, (0, more))
    if not rigid.any():
        return tension
    tension[rigid] = np.nan
    if isinstance(subject, Structure) and rigid.sum() <= MOST_BARS:
        tension[rigid] = _solve(structure, np.where(rigid, 0.0, tension), rigid)
    return tension


def _solve(structure: Structure, tension: FloatArray, rigid: BoolArray) -> FloatArray:
    """Return the tensions of the rigid bars (n_rigid,) [N], NaN where statics does not tell them."""
    ends = structure.connectivity
    vector = structure.node_position[ends[:, 0]] - structure.node_position[ends[:, 1]]
    unit = vector / np.linalg.norm(vector, axis=1)[:, None]
    force = np.array(structure.node_load, dtype=float)
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, ends.ravel(), np.repeat(structure.member_mass / 2, 2))
    force += mass[:, None] * structure.gravity
    np.add.at(force, ends[:, 0], -tension[:, None] * unit)
    np.add.at(force, ends[:, 1], tension[:, None] * unit)
    free = np.zeros_like(structure.node_anchored)
    free[:, list(structure.axes)] = ~structure.node_anchored[:, list(structure.axes)]
    rows = np.flatnonzero(rigid)
    matrix = np.zeros((*force.shape, len(rows)))
    columns = np.arange(len(rows))
    matrix[ends[rows, 0], :, columns] += unit[rows]
    matrix[ends[rows, 1], :, columns] -= unit[rows]
    left, size, right = np.linalg.svd(matrix[free], full_matrices=True)
    rank = int((size > DEPENDENT).sum())
    found = right[:rank].T @ ((left[:, :rank].T @ force[free]) / size[:rank])
    missing = float(np.abs(force[free] - matrix[free] @ found).max(initial=0.0))
    largest = max(float(np.abs(tension).max(initial=0.0)), float(np.abs(found).max(initial=0.0)))
    undetermined = (np.abs(right[rank:]) > DEPENDENT).any(axis=0)
    balanced = missing <= UNBALANCED * largest
    result: FloatArray = np.where(undetermined | (not balanced), np.nan, found)
    return result
