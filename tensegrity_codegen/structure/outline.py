"""A body system as nodes and members, for tables and pictures; distances between bars in closed form."""

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import Bar, BodySystem, FixedBody, RigidBody
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.limits import MEMBER_LIMITS, Limits
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.body_places import CORNERS

MAX_CORNERS = 4  # of a rigid body whose points are joined pair by pair; more are joined in a ring


def outline_tendons(subject: Structure | BodySystem) -> Structure:
    """Return the nodes and tendons of a body system as a structure without masses; a structure as it is."""
    if isinstance(subject, Structure):
        return subject
    position = compute_node_position(subject)
    held = np.array([isinstance(subject.bodies[int(k)], FixedBody) for k in subject.node_body])
    return Structure(
        name=subject.name,
        axes=(0, 1, 2),
        node_name=subject.node_name,
        node_position=position,
        node_velocity=np.zeros_like(position),
        node_mass=np.zeros(len(position)),
        node_anchored=np.repeat(held[:, None], 3, axis=1),
        node_load=subject.node_load,
        gravity=subject.gravity,
        member_name=subject.member_name,
        member_class=subject.member_class,
        connectivity=subject.connectivity,
        is_bar=subject.is_bar,
        tension_only=subject.tension_only,
        rest_length=subject.rest_length,
        spring_constant=subject.spring_constant,
        axial_stiffness=subject.axial_stiffness,
        damping=subject.damping,
        member_mass=np.zeros(subject.n_members),
        radius=subject.radius,
        law_parameter=dict(subject.law_parameter),
        groups=subject.groups,
        limits=subject.limits,
    )


NODE_FIELDS = ("node_name", "node_position", "node_velocity", "node_mass", "node_anchored", "node_load")
MEMBER_FIELDS = (
    *("member_name", "member_class", "connectivity", "is_bar", "tension_only", "rest_length", "damping"),
    *("spring_constant", "axial_stiffness", "member_mass", "radius", "inner_radius", "thermal_expansion"),
    "ring_nodes",
)


def hide_bodies(structure: Structure) -> Structure:
    """Return a structure without corners and edges of bodies, its last nodes and members, for texts."""
    n_nodes = structure.n_nodes - CORNERS * len(structure.bodies)
    shown = {name: getattr(structure, name)[:n_nodes] for name in NODE_FIELDS}
    return hide_edges(structure).with_changes(**shown, bodies=()) if structure.bodies else structure


def hide_edges(structure: Structure) -> Structure:
    """Return a structure without the edges of bodies, its last members."""
    if not structure.bodies:
        return structure
    n_members = structure.n_members - int(structure.is_edge.sum())
    members = {name: getattr(structure, name) for name in MEMBER_FIELDS}
    shown = {name: values if values is None else values[:n_members] for name, values in members.items()}
    limits = {name: getattr(structure.limits, name)[:n_members] for name in MEMBER_LIMITS}
    return structure.with_changes(
        **shown,
        law_parameter={name: values[:n_members] for name, values in structure.law_parameter.items()},
        limits=replace(structure.limits, **limits),
    )


def outline_bodies(subject: Structure | BodySystem) -> Structure:
    """Return the structure of `outline_tendons` with bars and the edges of rigid bodies after the tendons."""
    structure = outline_tendons(subject)
    if isinstance(subject, Structure):
        return structure
    edges, names, radii = _edges(subject)
    ends = np.array(edges, dtype=np.int64).reshape(-1, 2)
    count = len(edges)
    length = np.linalg.norm(structure.node_position[ends[:, 0]] - structure.node_position[ends[:, 1]], axis=1)

    def extend(values: NDArray[Any], more: Any) -> NDArray[Any]:
        return np.concatenate([values, np.broadcast_to(np.asarray(more, dtype=values.dtype), count)])

    return structure.with_changes(
        member_name=(*structure.member_name, *names),
        member_class=(*structure.member_class, *("" for _ in names)),
        connectivity=np.vstack([structure.connectivity, ends]),
        is_bar=extend(structure.is_bar, True),
        tension_only=extend(structure.tension_only, False),
        rest_length=extend(structure.rest_length, length),
        spring_constant=extend(structure.spring_constant, 0.0),
        axial_stiffness=extend(structure.axial_stiffness, 0.0),
        damping=extend(structure.damping, 0.0),
        member_mass=extend(structure.member_mass, 0.0),
        radius=extend(structure.radius, radii),
        inner_radius=None if structure.inner_radius is None else extend(structure.inner_radius, 0.0),
        thermal_expansion=None,
        limits=Limits(),
        law_parameter={name: extend(values, 0.0) for name, values in structure.law_parameter.items()},
    )


def split_at_rings(structure: Structure) -> Structure:
    """Return a structure whose members are the strands of all members, for pages that draw straight lines.

    Strands of one cable share its rest length in proportion to their lengths, and are called by its name and
    a number. Groups, inputs, limits and thermal expansion are left out.
    """
    strands = structure.strands
    if strands.is_plain:
        return structure
    e = strands.member
    number = np.arange(len(e)) - np.searchsorted(e, e) + 1
    passes = strands.passes_rings[e]
    fraction = strands.strand_lengths(structure.node_position) / structure.member_length()[e]
    columns = ("is_bar", "tension_only", "damping", "member_mass", "radius")
    stiffness = {
        "spring_constant": structure.spring_constant[e],
        "axial_stiffness": structure.axial_stiffness[e],
    }
    return structure.with_changes(
        member_name=tuple(
            f"{structure.member_name[k]}.{n}" if is_split else structure.member_name[k]
            for k, n, is_split in zip(e.tolist(), number.tolist(), passes.tolist(), strict=True)
        ),
        member_class=tuple(structure.member_class[k] for k in e),
        connectivity=strands.ends,
        ring_nodes=(),
        rest_length=structure.rest_length[e] * fraction,
        **stiffness,
        **{name: getattr(structure, name)[e] for name in columns},
        inner_radius=None if structure.inner_radius is None else structure.inner_radius[e],
        thermal_expansion=None,
        law_parameter={name: values[e] for name, values in structure.law_parameter.items()},
        groups={},
        inputs=(),
        actuators=(),
        sensors=(),
        limits=Limits(),
        interference=None,
    )


def is_edge(subject: Structure | BodySystem) -> NDArray[np.bool_]:
    """Return which members of `outline_bodies` are edges of rigid bodies, (n_members,)."""
    if isinstance(subject, Structure):
        return subject.is_edge
    edges: list[bool] = []
    for body, solid in enumerate(subject.bodies):
        edges += [isinstance(solid, RigidBody)] * len(_find_pairs(subject, body))
    return np.array([False] * subject.n_members + edges, dtype=np.bool_)


def find_joints(subject: Structure | BodySystem) -> NDArray[np.int64]:
    """Return the nodes of other bodies that hold a bar, whose force no member of the outline shows."""
    bodies = () if isinstance(subject, Structure) else subject.bodies
    return np.array([body.anchor for body in bodies if isinstance(body, Bar) and body.held], dtype=np.int64)


def find_faces(subject: Structure | BodySystem) -> list[tuple[int, ...]]:
    """Return triangles of nodes on the surface of rigid bodies, for pictures.

    Bodies of up to MAX_CORNERS points have all triangles of these, others those of their convex hull, none
    where all points lie in a plane.
    """
    if isinstance(subject, Structure):
        return []
    faces: list[tuple[int, ...]] = []
    for body, solid in enumerate(subject.bodies):
        corners = _find_corners(subject, body) if isinstance(solid, RigidBody) else []
        if len(corners) <= MAX_CORNERS:
            faces += combinations(corners, 3)
        else:
            faces += _find_hull(subject, corners)
    return faces


def _find_hull(system: BodySystem, corners: list[int]) -> list[tuple[int, ...]]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(system.node_local[corners])
    except QhullError:
        return []
    return [tuple(corners[int(k)] for k in triangle) for triangle in hull.simplices]


def _find_corners(system: BodySystem, body: int) -> list[int]:
    """Return the points of a body without its centre."""
    return [int(node) for node in np.flatnonzero(system.node_body == body) if np.any(system.node_local[node])]


def _find_pairs(system: BodySystem, body: int) -> list[tuple[int, int]]:
    """Return the pairs of nodes that are drawn as lines of a body."""
    solid = system.bodies[body]
    if isinstance(solid, Bar):
        return [system.bar_ends(body)]
    if not isinstance(solid, RigidBody):
        return []
    corners = _find_corners(system, body)
    if len(corners) <= MAX_CORNERS:
        return list(combinations(corners, 2))
    return [(corners[k - 1], corners[k]) for k in range(len(corners))]


def _edges(system: BodySystem) -> tuple[list[tuple[int, int]], list[str], list[float]]:
    """Return node pairs, names that no tendon has, and radii of bars and edges."""
    edges: list[tuple[int, int]] = []
    names: list[str] = []
    radii: list[float] = []
    for body, solid in enumerate(system.bodies):
        pairs = _find_pairs(system, body)
        for number, pair in enumerate(pairs):
            name = solid.name if len(pairs) == 1 else f"{solid.name}_edge{number + 1}"
            while name in system.member_name:
                name += "_"
            edges.append(pair)
            names.append(name)
            radii.append(solid.radius if isinstance(solid, Bar) else 0.0)
    return edges, names, radii


PARALLEL = 1e-12  # of the product of squared lengths, below which two lines count as parallel


def compute_bar_distance(subject: Structure | BodySystem) -> tuple[tuple[tuple[str, str], ...], FloatArray]:
    """Return the names of `bar_pairs` and the distances [m] of their round surfaces, negative in overlap."""
    pairs = subject.bar_pairs
    if isinstance(subject, Structure):
        name, position = subject.member_name, subject.node_position
        ends, radius = subject.connectivity[pairs], subject.radius[pairs]
    else:
        position = compute_node_position(subject)
        name = tuple(body.name for body in subject.bodies)
        radii = [body.radius if isinstance(body, Bar) else 0.0 for body in subject.bodies]
        ends = np.array([[subject.bar_ends(int(k)) for k in pair] for pair in pairs], dtype=np.int64)
        ends, radius = ends.reshape(-1, 2, 2), np.array(radii)[pairs]
    end = position[ends]
    distance = compute_segment_distance(end[:, 0, 0], end[:, 0, 1], end[:, 1, 0], end[:, 1, 1])
    return tuple((name[i], name[j]) for i, j in pairs.tolist()), distance - radius.sum(axis=1)


def compute_segment_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances of segments a-b and c-d, each (n, 3) [m], (n,) [m].

    The least of the distances of each end to the other segment, and of the two lines where the feet of their
    common perpendicular are inside both segments.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    to_other = [_to_segment(point, c, d) for point in (a, b)] + [_to_segment(point, a, b) for point in (c, d)]
    distance: FloatArray = np.min(to_other, axis=0)
    determinant = uu * vv - uv * uv
    crossing = determinant > PARALLEL * uu * vv
    safe = np.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = crossing & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    gap = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.where(inside, np.minimum(gap, distance), distance)


def _to_segment(point: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distances of points to segments, (n,)."""
    along = end - start
    square = np.einsum("ij,ij->i", along, along)
    fraction = np.einsum("ij,ij->i", point - start, along) / np.where(square > 0, square, 1.0)
    nearest = start + np.clip(fraction, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))
