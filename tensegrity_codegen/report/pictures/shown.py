"""The content of a picture: positions, tensions, loads and bodies over samples, colours of members."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.report.loads import compute_loads
from tensegrity_codegen.report.pictures.drawing import BodyParts
from tensegrity_codegen.report.pictures.view import check_array, check_tension
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.checks.plausible_sizes import find_unbalanced
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

# Member tensions at the stated positions, those of rigid bars solved for where statics determines them.
#
# The tension of a rigid bar does not follow from its length. It follows from the balance of its nodes, if the
# stated positions are in equilibrium and the bars are statically determined; else it is unknown here.


UNBALANCED = 0.01  # part of the largest force that nodes may lack where they count as balanced
DEPENDENT = 1e-9  # singular values below count as none, as the bars have unit directions
MAX_BARS = 1000  # rigid bars up to which their tensions are solved for


def find_rest_tension(subject: Structure | BodySystem, rigid: BoolArray | None = None) -> FloatArray:
    """Return the tensions of the drawn structure, (n_members,) [N]: without damping, NaN if unknown.

    Unknown are rigid bars of a structure that is out of balance by more than 1 % of its largest force, bars
    that other bars make redundant, and the bars and edges of bodies. The rows are those of outline_bodies.
    rigid (n_members of subject,): which members the formulation keeps rigid, by default those without any
    stiffness; the option `bars = "all"` makes bars rigid that have one.
    """
    structure = outline_bodies(subject)
    tension = structure.static_tension()
    omitted = structure.n_members - subject.n_members
    rigid = structure.is_rigid if rigid is None else structure.is_rigid | np.pad(rigid, (0, omitted))
    if not rigid.any():
        return tension
    tension[rigid] = np.nan
    if isinstance(subject, Structure) and not subject.bodies and rigid.sum() <= MAX_BARS:
        tension[rigid] = _solve(structure, np.where(rigid, 0.0, tension), rigid)
    return tension


def _solve(structure: Structure, tension: FloatArray, rigid: BoolArray) -> FloatArray:
    """Return the tensions of the rigid bars (n_rigid,) [N], NaN if statics does not tell them."""
    ends, strands = structure.connectivity, structure.strands
    vector = strands.vectors(structure.node_position)
    unit = vector / np.linalg.norm(vector, axis=1)[:, None]
    # Forces on nodes without the rigid bars: load, weight and the pulls of all others
    force = np.array(structure.node_load, dtype=float)
    mass = np.array(structure.node_mass, dtype=float)
    np.add.at(mass, ends.ravel(), np.repeat(structure.member_mass / 2, 2))
    force += mass[:, None] * structure.gravity
    pull = strands.spread(tension)[:, None] * unit
    np.add.at(force, strands.ends[:, 0], -pull)
    np.add.at(force, strands.ends[:, 1], pull)
    free = np.zeros_like(structure.node_anchored)
    free[:, list(structure.axes)] = ~structure.node_anchored[:, list(structure.axes)]
    # Directions of the rigid bars, A t = f in least squares by singular values
    rows = np.flatnonzero(rigid)
    matrix = np.zeros((*force.shape, len(rows)))
    columns = np.arange(len(rows))
    along = unit[np.isin(strands.member, rows)]
    matrix[ends[rows, 0], :, columns] += along
    matrix[ends[rows, 1], :, columns] -= along
    left_vectors, size, right = np.linalg.svd(matrix[free], full_matrices=True)
    rank = int((size > DEPENDENT).sum())
    solution = right[:rank].T @ ((left_vectors[:, :rank].T @ force[free]) / size[:rank])
    # Unknown where the balance misses, or where a self-stress of rigid bars may be added
    missing = float(np.abs(force[free] - matrix[free] @ solution).max(initial=0.0))
    largest = max(float(np.abs(tension).max(initial=0.0)), float(np.abs(solution).max(initial=0.0)))
    undetermined = (np.abs(right[rank:]) > DEPENDENT).any(axis=0)
    balanced = missing <= UNBALANCED * largest
    result: FloatArray = np.where(undetermined | (not balanced), np.nan, solution)
    return result


def find_imbalance(subject: Structure | BodySystem) -> tuple[str, float] | None:
    """Return the node that lacks the largest force to be in balance as stated, and this force [N].

    None where no node lacks UNBALANCED of the largest tension, and on a ground, whose forces are not known.
    """
    if not isinstance(subject, Structure) or subject.ground is not None:
        return None
    force = np.linalg.norm(find_unbalanced(subject), axis=1)
    worst, pull = int(force.argmax()), float(np.abs(subject.static_tension()).max(initial=0.0))
    is_balanced = not pull > 0.0 or force[worst] <= UNBALANCED * pull
    return None if is_balanced else (subject.node_label[worst], float(force[worst]))


COLOR_NAMES = {
    "tension": ("member tension [N]", "tension unknown"),
    "force_density": ("force density [N/m]", "force density unknown"),
    "stress": ("stress [MPa]", "stress unknown"),
}


@dataclass(frozen=True)
class Shown:
    """The content of a picture or film.

    structure: the structure, of bodies their outline.
    position (n_t, n_nodes, 3) [m]: positions.
    tension (n_t, n_members) [N]: tensions, NaN if unknown; None: members are coloured by kind.
    load (n_t, n_nodes, 3) [N]: loads.
    parts: the members of rigid bodies.
    contact (n_t, n_contacts, 3) [N]: forces of the ground; None if they are not known.
    """

    structure: Structure
    position: FloatArray
    tension: FloatArray | None
    load: FloatArray
    parts: BodyParts
    contact: FloatArray | None = None

    def __post_init__(self) -> None:
        check_array("node_position", self.position, self.position.shape, "samples, nodes, axes")
        check_array("node_load", self.load, self.position.shape, "samples, nodes, axes")
        if self.tension is not None:
            check_tension(self.tension, self.tension.shape, self.structure, "samples, members")


def show_structure(
    structure: Structure,
    position: FloatArray,
    tension: FloatArray | None,
    *,
    load: FloatArray | None = None,
    bodies: BodyParts | None = None,
) -> Shown:
    """Return the content of a picture of one configuration: position (n_nodes, 3), tension (n_members,)."""
    loads = structure.node_load if load is None else load
    return Shown(
        structure,
        position[None],
        None if tension is None else tension[None],
        np.asarray(loads, dtype=float)[None],
        BodyParts.of(structure) if bodies is None else bodies,
    )


def show_motion(
    structure: Structure, motion: Trajectory, subject: Structure | BodySystem | None = None
) -> Shown:
    """Return the content of pictures of a motion of a structure, which is the outline of `subject`."""
    source = structure if subject is None else subject
    return Shown(
        structure, motion.node_position, motion.member_tension, compute_loads(source, motion),
        BodyParts.of(source), None if motion.contacts is None else motion.contacts.force,
    )  # fmt: skip


def compute_colors(shown: Shown, name: str) -> FloatArray | None:
    """Return the values (n_t, n_members) that colours show, NaN if unknown; None for colours by kind."""
    structure, tension = shown.structure, shown.tension
    if tension is None or name == "kind":
        return None
    if name == "tension":
        return tension
    if name == "force_density":
        return _divide(tension, structure.strands.lengths(shown.position))
    area = np.asarray(structure.section_area, dtype=float)
    if not (area[~shown.parts.edge] > 0).any():
        raise InvalidValueError(
            "stresses are not known, since no member has a radius",
            where="color",
            given=name,
            allowed="members with a radius",
            hint="radius = 0.004 in a class of the scene, or the colours `tension`",
        )
    return _divide(tension, area) / 1e6


def _divide(tension: FloatArray, by: Any) -> FloatArray:
    """Return tension over something positive, NaN elsewhere."""
    wide = np.broadcast_to(by, tension.shape)
    ratio: FloatArray = np.divide(tension, wide, out=np.full(tension.shape, np.nan), where=wide > 0)
    return ratio
