"""Rigid parts of a structure with poses, masses and joints: rigid bars, bodies, point masses."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.structure.bodies import Bar, BodySystem, RigidBody
from tensegrity_codegen.structure.body_meshes import frame_along
from tensegrity_codegen.structure.collision import require_no_collision
from tensegrity_codegen.structure.free_bodies import BodyPart
from tensegrity_codegen.structure.kinematics import compute_node_position, euler_rotation
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import FormulationError, name_list
from tensegrity_codegen.tables.body_places import compute_spins, place_bodies


def add(above: Element, tag: str, **attributes: str) -> Element:
    """Return a new element below `above`."""
    return SubElement(above, tag, attributes)


def number(value: float) -> str:
    """Return the shortest text that reads back bit-equal; zero without a sign."""
    return repr(float(value) + 0.0)


def numbers(values: ArrayLike) -> str:
    """Return several numbers with spaces between them."""
    return " ".join(number(value) for value in np.asarray(values, dtype=np.float64).ravel())


def write_elements(root: Element, path: Path) -> None:
    """Write a document with line breaks, in UTF-8."""
    indent(root)
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


WORLD = "world"
# Inertia of thin bars about themselves over that across; of points over their mass [m2].
THIN_INERTIA_RATIO = 1e-6


@dataclass(frozen=True)
class RigidPart:
    """One rigid part."""

    name: str  # name of the body or bar, with an ending where it is that of a point mass
    joint: str  # ``"floating"`` (free) or ``"ball"`` (turns about its origin)
    parent: str  # part that carries it; WORLD for none
    origin: FloatArray  # (3,) [m]: origin of its frame in the world
    rotation: FloatArray  # (3, 3): axes of its frame; that of a bar has z along the bar
    mass: float  # [kg]: mass
    centre: FloatArray  # (3,) [m]: centre of mass in its frame
    inertia: FloatArray  # (3, 3) [kg m2]: about the centre, in its frame
    points: dict[str, FloatArray] = field(default_factory=dict)  # (3,) [m]: nodes in its frame
    # of a bar: its start and end on its z axis, and its radius [m]; empty for others
    bar: tuple[float, ...] = ()
    shapes: tuple[BodyPart, ...] = ()  # of a body beside nodes, for pictures
    # of such a body: velocity of its origin in the world [m/s], and angular velocity in its frame [rad/s]
    velocity: FloatArray = field(default_factory=lambda: np.zeros(3))
    spin: FloatArray = field(default_factory=lambda: np.zeros(3))


def find_parts(subject: Structure | BodySystem) -> tuple[list[RigidPart], dict[str, FloatArray]]:
    """Return the rigid parts, parents first, and the anchored nodes with their positions (3,) [m]."""
    if isinstance(subject, BodySystem):
        return _list_bodies(subject)
    structure = subject
    require_no_collision(structure, "URDF")
    _check(structure)
    rods = find_rods(structure)
    rigid_parts = find_free_bodies(structure)
    rigid_parts += [_build_rod(structure, int(member)) for member in np.flatnonzero(rods)]
    carried = set(structure.connectivity[structure.is_rigid].ravel().tolist()) | set(structure.attached)
    held: NDArray[np.bool_] = np.asarray(structure.node_anchored.all(axis=1))
    fixed: dict[str, FloatArray] = {}
    for node, name in enumerate(structure.node_name):
        position, mass = structure.node_position[node], float(structure.node_mass[node])
        if held[node]:
            fixed[name] = position
        elif node not in carried:
            # A point mass: a free part with an inertia that is next to none.
            unit, points = THIN_INERTIA_RATIO * mass * np.eye(3), {name: np.zeros(3)}
            frame = (position, np.eye(3), mass, np.zeros(3), unit, points)
            rigid_parts.append(RigidPart(f"{name}.body", "floating", WORLD, *frame))
    return [rigid_part for rigid_part in rigid_parts if rigid_part.joint], fixed


def _check(structure: Structure) -> None:
    elastic = structure.is_bar & ~structure.is_rigid
    if elastic.any():
        names = [structure.member_name[member] for member in np.flatnonzero(elastic)]
        raise FormulationError(
            "bars with stiffness change their length, which links of constant shape cannot",
            where=structure.name,
            given=name_list(names),
            allowed="rigid bars: bars without spring_constant and axial_stiffness",
            hint="remove the stiffness of the bars, or export to MJCF",
        )
    shared = find_shared_nodes(structure)
    if shared:
        raise FormulationError(
            "rigid bars that share a node form loops, or joints that no tree of links has",
            where=structure.name,
            given=name_list(shared),
            allowed="rigid bars that tendons alone connect",
        )
    partly = structure.node_anchored.any(axis=1) & ~structure.node_anchored.all(axis=1)
    if partly.any() or len(structure.axes) < 3:
        names = [structure.node_name[node] for node in np.flatnonzero(partly)]
        raise FormulationError(
            "nodes that are held on some axes have no joint of this kind",
            where=structure.name,
            given=name_list(names) or "a planar scene",
            allowed="nodes that are free, or anchored on all axes",
        )


def find_rods(structure: Structure) -> BoolArray:
    """Return the rigid bars that are no edges of bodies, (n_members,)."""
    rods: BoolArray = structure.is_rigid & ~structure.is_edge
    return rods


def find_shared_nodes(structure: Structure) -> list[str]:
    """Return the names of nodes at which two or more rigid bars end, or a rigid bar on a body."""
    nodes, counts = np.unique(structure.connectivity[find_rods(structure)], return_counts=True)
    return [structure.node_name[node] for node in nodes[(counts > 1) | structure.is_attached[nodes]]]


def find_free_bodies(structure: Structure) -> list[RigidPart]:
    """Return the rigid bodies beside nodes, with their own frames, and how they move at the start."""
    if not structure.bodies:
        return []
    at, rate = structure.node_position, structure.node_velocity
    places = structure.body_places
    centre, axes = place_bodies(places, at)
    (speed, _), spin = place_bodies(places, rate), compute_spins(places, at, rate)
    return [
        RigidPart(
            name=body.name if body.name not in structure.node_name else f"{body.name}.body",
            joint="floating",
            parent=WORLD,
            origin=centre[k] - axes[k] @ body.centre,
            rotation=axes[k],
            mass=body.mass,
            centre=body.centre,
            inertia=body.inertia,
            points={
                structure.node_name[n]: place for n, place in zip(body.point, body.point_local, strict=True)
            },
            shapes=body.parts,
            velocity=speed[k] - axes[k] @ np.cross(spin[k], body.centre),
            spin=spin[k],
        )
        for k, body in enumerate(structure.bodies)
    ]


def _build_rod(structure: Structure, member: int) -> RigidPart:
    """Return a rigid bar with the masses of its ends; without a joint where both are anchored."""
    ends = structure.connectivity[member]
    tips, held = structure.node_position[ends], structure.node_anchored[ends].all(axis=1)
    bar, point = float(structure.member_mass[member]), structure.node_mass[ends]
    mass = bar + float(point.sum())
    length = float(np.linalg.norm(tips[1] - tips[0]))
    direction = (tips[1] - tips[0]) / length
    middle = tips.mean(axis=0)
    origin = tips[int(held.argmax())] if held.any() else middle
    along = (tips - origin) @ direction
    # Centre of mass on the axis, and the inertia across it about the centre.
    centre = (bar * along.mean() + point @ along) / mass if mass > 0 else float(along.mean())
    across = bar * length**2 / 12 + bar * (along.mean() - centre) ** 2 + point @ (along - centre) ** 2
    names = [structure.node_name[node] for node in ends]
    return RigidPart(
        name=structure.member_name[member],
        joint="" if held.all() else "ball" if held.any() else "floating",
        parent=WORLD,
        origin=origin,
        rotation=frame_along(direction),
        mass=mass,
        centre=np.array([0.0, 0.0, centre]),
        inertia=np.diag([across, across, THIN_INERTIA_RATIO * across]),
        points={
            name: np.array([0.0, 0.0, distance])
            for name, distance, is_held in zip(names, along, held, strict=True)
            if not is_held
        },
        bar=(float(along.min()), float(along.max()), float(structure.radius[member])),
    )


def _list_bodies(system: BodySystem) -> tuple[list[RigidPart], dict[str, FloatArray]]:
    position = compute_node_position(system)
    rigid_parts: dict[int, RigidPart] = {}
    fixed: dict[str, FloatArray] = {}
    for number, body in enumerate(system.bodies):
        nodes = np.flatnonzero(system.node_body == number)
        if isinstance(body, Bar):
            rigid_parts[number] = _build_held_bar(system, body, nodes, position)
        elif isinstance(body, RigidBody):
            start = system.coordinate_start[number]
            angles = system.coordinate[start : start + 3]
            rotation = np.array(euler_rotation(*angles.tolist()), dtype=float)
            points = {system.node_name[node]: system.node_local[node].copy() for node in nodes}
            centre = system.coordinate[start + 3 : start + 6]
            inertia = np.array(body.inertia)
            rigid_parts[number] = RigidPart(
                body.name, "floating", WORLD, centre, rotation, body.mass, np.zeros(3), inertia, points
            )
        else:
            fixed |= {system.node_name[node]: position[node] for node in nodes}
    return _sort_parents(list(rigid_parts.values())), fixed


def _build_held_bar(
    system: BodySystem, body: Bar, nodes: NDArray[np.int64], position: FloatArray
) -> RigidPart:
    tips = position[nodes]
    direction = (tips[1] - tips[0]) / np.linalg.norm(tips[1] - tips[0])
    origin, parent = tips.mean(axis=0), WORLD
    if body.held:
        origin = position[body.anchor]
        carrier = system.bodies[int(system.node_body[body.anchor])]
        parent = carrier.name if isinstance(carrier, Bar | RigidBody) else WORLD
    along = (tips - origin) @ direction
    return RigidPart(
        name=body.name,
        joint="ball" if body.held else "floating",
        parent=parent,
        origin=origin,
        rotation=frame_along(direction),
        mass=body.mass,
        centre=np.array([0.0, 0.0, float(along.mean())]),
        inertia=np.diag([body.inertia, body.inertia, THIN_INERTIA_RATIO * body.inertia]),
        points={
            system.node_name[node]: np.array([0.0, 0.0, distance])
            for node, distance in zip(nodes, along, strict=True)
        },
        bar=(float(along.min()), float(along.max()), body.radius),
    )


def _sort_parents(parts: list[RigidPart]) -> list[RigidPart]:
    """Return the parts, each after the one that carries it."""
    done: list[RigidPart] = []
    placed = {WORLD}
    while parts:
        ready = [part for part in parts if part.parent in placed]
        done += ready
        placed |= {part.name for part in ready}
        parts = [part for part in parts if part not in ready]
    return done
