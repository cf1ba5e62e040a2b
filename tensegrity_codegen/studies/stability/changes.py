"""What cases do to a structure: stiffer bars, rigid bars, a node moved or pushed, all of it consistent."""

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision.problem import without_stretch
from tensegrity_codegen.system.arrays import FloatArray

USUAL_RATIO = 1e3  # stiffness of bars that had none, over that of the median cable


def as_springs(structure: Structure) -> Structure:
    """Return the structure with spring constants in place of axial stiffnesses; rigid bars stay rigid."""
    return structure.with_changes(spring_constant=structure.mu, axial_stiffness=np.zeros(structure.n_members))


def with_springs(structure: Structure) -> Structure:
    """Return the structure with springs for all members; rigid bars get 1,000 times the median cable's."""
    mu, rigid = structure.mu, structure.is_rigid
    soft = float(np.median(mu[~structure.is_bar])) if (~structure.is_bar).any() else 1.0
    return structure.with_changes(
        spring_constant=np.where(rigid, USUAL_RATIO * soft, mu), axial_stiffness=np.zeros(structure.n_members)
    )


def put_at_ratio(structure: Structure, ratio: float) -> Structure | None:
    """Return the structure of springs with bars `ratio` times as stiff as the median cable, if it exists.

    Every bar keeps its tension, l0 = l - t / mu, which soft ones cannot.
    """
    bar = structure.is_bar
    stiff = ratio * float(np.median(structure.spring_constant[~bar]))
    rest = structure.member_length() - structure.static_tension() / stiff
    if (rest[bar] <= 0).any():
        return None
    return structure.with_changes(
        spring_constant=np.where(bar, stiff, structure.spring_constant),
        rest_length=np.where(bar, rest, structure.rest_length),
    )


def with_rigid_bars(structure: Structure) -> Structure:
    """Return the structure with all bars rigid, as long as they are, and without damping."""
    bar = structure.is_bar
    return settle_bars(
        structure.with_changes(
            **{
                name: np.where(bar, 0.0, getattr(structure, name))
                for name in ("spring_constant", "axial_stiffness", "damping")
            }
        )
    )


def settle_bars(structure: Structure) -> Structure:
    """Return the structure with rigid bars as long as their nodes are apart, at speeds that stretch none."""
    rigid = np.flatnonzero(structure.is_rigid)
    if not rigid.size or not np.isfinite(structure.node_position).all():
        return structure
    rest = structure.rest_length.copy()
    rest[rigid] = structure.member_length()[rigid]
    velocity = without_stretch(structure, structure.node_velocity, rigid)
    return structure.with_changes(rest_length=rest, node_velocity=velocity)


def move_node(structure: Structure, node: int, place: FloatArray, *, refit: bool = False) -> Structure:
    """Return the structure with one node elsewhere; refit: its bars keep their tension, not their length."""
    position = structure.node_position.copy()
    position[node] = place
    moved = structure.with_changes(node_position=position)
    if refit:
        stretch = structure.member_length() - structure.rest_length
        rest = np.where(structure.is_bar, moved.member_length() - stretch, moved.rest_length)
        moved = moved.with_changes(rest_length=rest)
    return settle_bars(moved)


def push_node(structure: Structure, node: int, axis: int, speed: float) -> Structure:
    """Return the structure with one node faster by `speed` [m/s] along an axis; rigid bars go along."""
    velocity = structure.node_velocity.copy()
    velocity[node, axis] += speed
    return settle_bars(structure.with_changes(node_velocity=velocity))
