"""From rigid bodies of a scene of nodes and members to their nodes, rigid bars, masses and points."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.refuse import require
from tensegrity_codegen.scene.schema.body_schema import BodyTable, PartTable, PointTable, RigidPart
from tensegrity_codegen.structure.free_bodies import (
    EDGE_CORNERS,
    THINNEST,
    BodyPart,
    FreeBody,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

INERTIA_TOLERANCE = 1e-9  # by which rounded inertias of a flat body may break the triangle's inequality
UNIT_TOLERANCE = 1e-6  # by which rounded matrices may miss right angles, and quaternions the length 1
ORIENTATIONS = ("quaternion", "axis", "from", "matrix")
EULER = ("psi_deg", "phi_deg", "theta_deg", "psi_rate_deg", "phi_rate_deg", "theta_rate_deg")


@dataclass(frozen=True)
class PlacedBody:
    """A body of a scene: its mass, its parts, and where it is at the start.

    centre: of mass, in the frame (3,) [m]; origin: of the frame in the world (3,) [m]; axes: from the frame
    to the world (3, 3); velocity: of the centre of mass [m/s]; spin: in the frame [rad/s]; point: places by
    name; note: what was changed in its numbers.
    """

    name: str
    mass: float
    inertia: FloatArray
    centre: FloatArray
    origin: FloatArray
    axes: FloatArray
    velocity: FloatArray
    spin: FloatArray
    point: Mapping[str, FloatArray]
    radius: Mapping[str, float]
    parts: tuple[BodyPart, ...]
    note: str = ""

    def at(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions [m] and velocities [m/s] of places in the frame, (n, 3) each."""
        arm = np.cross(self.spin, local - self.centre) @ self.axes.T
        return self.origin + local @ self.axes.T, self.velocity + arm


def place_free_bodies(tables: Mapping[str, BodyTable], axes: tuple[int, ...], where: str) -> list[PlacedBody]:
    """Return the bodies of a scene with nodes and members, all of kind rigid."""
    if tables and len(axes) < 3:
        problem, location = "bodies move in all three axes", key_path(where, "axes")
        given = "".join("xyz"[axis] for axis in axes)
        raise InvalidValueError(problem, where=location, given=given, allowed="xyz", hint="remove the key")
    return [_place(name, table, key_path(where, "bodies", name)) for name, table in tables.items()]


def add_points(node: dict[str, Any], bodies: Sequence[PlacedBody], where: str) -> dict[str, Any]:
    """Return the arrays of nodes with the points of bodies behind them, by the names "body.point"."""
    if not bodies:
        return node
    taken = set(node["node_name"])
    for body in bodies:
        for point in body.point:
            plain = f"{body.name}_{point}"
            if plain in taken:
                problem = "the point has the same name in C as another point or node"
                location = key_path(where, "bodies", body.name, "points", point)
                allowed, hint = (
                    "points whose names joined to their body's by _ differ",
                    "rename one of the two",
                )
                raise DuplicateNameError(problem, where=location, given=plain, allowed=allowed, hint=hint)
            taken.add(plain)
    names = [f"{body.name}.{point}" for body in bodies for point in body.point]
    local = [np.array(list(body.point.values())).reshape(-1, 3) for body in bodies]
    return _with_nodes(node, names, [body.at(x) for body, x in zip(bodies, local, strict=True)], 0.0)


def add_corners(
    node: dict[str, Any], member: dict[str, Any], bodies: Sequence[PlacedBody], where: str
) -> tuple[dict[str, Any], dict[str, Any], tuple[FreeBody, ...]]:
    """Return the arrays of nodes and members with the corners and edges of bodies, and the bodies."""
    if not bodies:
        return node, member, ()
    index = {name: row for row, name in enumerate(node["node_name"])}
    free: list[FreeBody] = []
    first = len(index)
    for k, body in enumerate(bodies):
        point = [index[f"{body.name}.{name}"] for name in body.point]
        places = np.array(list(body.point.values())).reshape(-1, 3)
        radius = np.array([body.radius.get(name, np.nan) for name in body.point])
        corner = tuple(range(first + 4 * k, first + 4 * k + 4))
        about = (body.name, body.mass, body.inertia, body.centre)
        free.append(FreeBody(*about, corner, tuple(point), places, radius, body.parts))
    names = [f"{body.name}.corner{i + 1}" for body in bodies for i in range(4)]
    mass = np.concatenate([entry.tetrahedron[2] for entry in free])
    motions = [body.at(entry.corner_local) for body, entry in zip(bodies, free, strict=True)]
    node = _with_nodes(node, names, motions, mass)
    plain = tuple(name.replace(".", "_") for name in node["node_name"])
    repeated = [name for name in plain[first:] if name in plain[:first]]
    edges = [f"{body.name}_edge{i + 1}{j + 1}" for body in bodies for i, j in EDGE_CORNERS]
    repeated += [name for name in edges if name in member["member_name"]]
    if repeated:
        problem, location = "a corner or an edge of a body has this name already", key_path(where, "bodies")
        allowed = "other names than BODY_corner1 and BODY_edge12, by which its corners and edges go"
        raise DuplicateNameError(
            problem, where=location, given=repeated[0], allowed=allowed, hint="rename it"
        )
    return {**node, "node_name": plain}, _with_edges(member, edges, free, node["node_position"]), tuple(free)


def _with_nodes(
    node: dict[str, Any], names: Sequence[str], motions: Sequence[tuple[FloatArray, FloatArray]], mass: Any
) -> dict[str, Any]:
    """Return the arrays of nodes with free ones behind them."""
    count = len(names)
    added = {
        "node_position": np.vstack([np.zeros((0, 3)), *[position for position, _ in motions]]),
        "node_velocity": np.vstack([np.zeros((0, 3)), *[velocity for _, velocity in motions]]),
        "node_mass": np.zeros(count) + mass,
        "node_anchored": np.zeros((count, 3), dtype=np.bool_),
    }
    joined = {key: np.concatenate([node[key], values]) for key, values in added.items()}
    return {**node, "node_name": (*node["node_name"], *names), **joined}


def _with_edges(
    member: dict[str, Any], names: list[str], bodies: Sequence[FreeBody], position: FloatArray
) -> dict[str, Any]:
    """Return the arrays of members with the six rigid bars of each body behind them."""
    ends = np.array([(body.corner[i], body.corner[j]) for body in bodies for i, j in EDGE_CORNERS]).reshape(
        -1, 2
    )
    length = np.linalg.norm(position[ends[:, 0]] - position[ends[:, 1]], axis=1)
    count = len(names)
    added = {
        "member_class": ("",) * count,
        "connectivity": ends,
        "ring_nodes": ((),) * count if member["ring_nodes"] else (),
        "is_bar": np.ones(count, dtype=np.bool_),
        "tension_only": np.zeros(count, dtype=np.bool_),
        "rest_length": length,
    }

    def join(key: str, values: Any) -> Any:
        if isinstance(values, Mapping):
            return {name: join(name, array) for name, array in values.items()}
        if values is None:
            return None
        new = added.get(key, np.zeros(count))
        return (*values, *new) if isinstance(values, tuple) else np.concatenate([values, new])

    joined = {key: join(key, values) for key, values in member.items() if key != "member_name"}
    return {"member_name": (*member["member_name"], *names), **joined}


def _place(name: str, table: BodyTable, place: str) -> PlacedBody:
    if not isinstance(table, RigidPart):
        raise InvalidValueError(
            "beside nodes and members a body is rigid",
            where=f"{place}.kind",
            given=table.kind,
            allowed='kind = "rigid"',
            hint="a fixed point is an anchored node, a bar is a member of kind bar or a rigid body",
        )
    for key in EULER:
        if key in table.model_fields_set:
            raise InvalidValueError(
                "a body beside nodes and members has no Euler angles",
                where=f"{place}.{key}",
                given=getattr(table, key),
                allowed="quaternion, axis with angle_deg, from with to, or matrix; angular_velocity [rad/s]",
                hint="bodies with tendons, in a scene without nodes and members, have these angles",
            )
    parts = tuple(_part(part, f"{place}.parts[{k}]") for k, part in enumerate(table.parts))
    mass, inertia, centre = _mass(table, parts, place)
    axes, origin = _orientation(table, place)
    if table.centre is not None:
        origin = np.array(table.centre) - axes @ centre
    point, radius = {}, {}
    for key, entry in table.points.items():
        point[key] = np.array(entry.position if isinstance(entry, PointTable) else entry)
        if isinstance(entry, PointTable) and entry.radius is not None:
            radius[key] = entry.radius
    return PlacedBody(
        name,
        mass,
        inertia,
        centre,
        origin,
        axes,
        np.array(table.centre_velocity or (0.0, 0.0, 0.0)),
        np.array(table.angular_velocity or (0.0, 0.0, 0.0)),
        point,
        radius,
        parts,
        _note(table.quaternion, f"bodies.{name}"),
    )


def _note(quaternion: Sequence[float] | None, place: str) -> str:
    """Return that a quaternion was normalised, if its length is not 1."""
    length = 1.0 if quaternion is None else float(np.linalg.norm(quaternion))
    is_unit = abs(length - 1.0) <= UNIT_TOLERANCE
    return "" if is_unit else f"{place}.quaternion has the length {length:.9g} and was normalised to 1"


def _mass(table: RigidPart, parts: Sequence[BodyPart], place: str) -> tuple[float, FloatArray, FloatArray]:
    """Return mass [kg], inertia about the centre of mass (3, 3) [kg m2] and that centre (3,) [m]."""
    heavy = [part for part in parts if part.mass > 0]
    allowed = "mass > 0 [kg] with inertia [kg m2], or parts with mass or density"
    need = _Need(place)
    need(not (heavy and table.mass is not None), "the mass is given twice", "mass", table.mass, allowed)
    need(
        not (heavy and table.inertia is not None),
        "the inertia is given twice",
        "inertia",
        table.inertia,
        allowed,
    )
    stated = table.centre_of_mass
    need(not (heavy and stated), "the centre of mass is given twice", "centre_of_mass", stated, allowed)
    if heavy:
        mass = sum(part.mass for part in heavy)
        centre = np.array(sum(part.mass * part.position for part in heavy)) / mass
        inertia = np.zeros((3, 3))
        for part in heavy:
            arm = part.position - centre
            own = part.axes @ np.diag(compute_unit_inertia(part)) @ part.axes.T
            inertia += own * part.mass + move_mass(part.mass, arm)
    else:
        need(table.mass is not None, "a body without mass", "mass", table.mass, allowed)
        need((table.mass or 0.0) > 0, "a body needs a mass above 0", "mass", table.mass, allowed)
        need(table.inertia is not None, "a body without inertia", "inertia", table.inertia, allowed)
        assert table.mass is not None
        assert table.inertia is not None
        mass, centre = table.mass, np.array(stated or (0.0, 0.0, 0.0))
        inertia = read_inertia(table.inertia, place)
    principal = np.linalg.eigvalsh(inertia)
    moments = np.sort(principal.sum() / 2.0 - principal)
    need(
        bool(moments[1] > THINNEST * moments[2]),
        "a body without inertia about an axis",
        "inertia",
        principal.tolist(),
        f"principal values a <= b <= c, where a is above {2 * THINNEST:g} c",
        "a thin bar is a member of kind bar; a body has a radius",
    )
    return mass, inertia, centre


def move_mass(mass: float, arm: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) of a mass at an arm (3,), which a body there has besides its own."""
    return np.asarray(mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


def read_inertia(stated: Any, place: str) -> FloatArray:
    """Return the inertia (3, 3) of 3 numbers or 3 rows; InvalidValueError if no body has it."""
    need, rows = _Need(place), [row for row in stated if isinstance(row, tuple)]
    problem, allowed = "neither 3 numbers nor 3 rows", "[Ixx, Iyy, Izz], or three rows of three numbers"
    need(len(rows) in (0, 3), problem, "inertia", stated, allowed, "do not mix the two")
    inertia = np.array(rows) if rows else np.diag(np.array(stated, dtype=float))
    symmetric = bool(np.abs(inertia - inertia.T).max() <= INERTIA_TOLERANCE * np.abs(inertia).max())
    is_met, problem = symmetric and bool(np.linalg.eigvalsh(inertia)[0] > 0), "an impossible inertia"
    allowed = "a symmetric matrix with principal values > 0"
    need(is_met, problem, "inertia", inertia.tolist(), allowed, "take it about the centre of mass")
    principal = np.linalg.eigvalsh(inertia)
    is_met = bool(principal[2] <= (principal[0] + principal[1]) * (1 + INERTIA_TOLERANCE))
    problem = "no body has this inertia: the largest principal value is above the sum of the others"
    allowed = f"principal values a <= b <= c with c <= a + b, here {', '.join(f'{x:.6g}' for x in principal)}"
    hint = "each is an integral of y^2 + z^2, z^2 + x^2 or x^2 + y^2 over the mass"
    need(is_met, problem, "inertia", inertia.tolist(), allowed, hint)
    return np.array(inertia + inertia.T) / 2.0


class _Need:
    """Raises InvalidValueError about a key of one table unless a condition is met."""

    def __init__(self, place: str) -> None:
        self.place = place

    def __call__(
        self, is_met: bool, problem: str, key: str, given: Any, allowed: str, hint: str = ""
    ) -> None:
        require(is_met, problem, f"{self.place}.{key}", given, allowed, hint)


# Orientation


def turn_by_quaternion(quaternion: Sequence[float]) -> FloatArray:
    """Return the rotation matrix of a quaternion w, x, y, z of any length above 0."""
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def turn_about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the matrix of a rotation about an axis by an angle [rad]."""
    size = float(np.linalg.norm(axis))
    if not size or not angle:
        return np.eye(3)
    x, y, z = axis / size
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: FloatArray = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix


def turn_to(direction: FloatArray) -> FloatArray:
    """Return the shortest turn of the z axis to a unit vector; about x where they are opposite."""
    x, y, z = direction
    if z <= -1.0 + 1e-15:
        return np.diag([1.0, -1.0, -1.0])
    return turn_by_quaternion([1.0 + z, -y, x, 0.0])


def _unit(vector: Any, key: str, place: str) -> FloatArray:
    array = np.array(vector, dtype=float)
    size, given = float(np.linalg.norm(array)), array.tolist()
    _Need(place)(0 < size < math.inf, "a vector of length zero", key, given, "a vector that is not zero")
    return np.array(array / size)


def _orientation(table: RigidPart, place: str) -> tuple[FloatArray, FloatArray]:
    """Return the rotation from the frame to the world (3, 3), and the origin of the frame (3,) [m]."""
    need = _Need(place)
    given = [key for key in ORIENTATIONS if getattr(table, key.replace("from", "from_")) is not None]
    allowed = "one of quaternion, axis with angle_deg, from with to, matrix"
    need(len(given) < 2, "the orientation is given twice", given[-1] if given else "", given, allowed)
    pairs = (("axis", "angle_deg", table.axis, table.angle_deg), ("from", "to", table.from_, table.to))
    for first, second, one, other in pairs:
        missing = second if other is None else first
        need((one is None) == (other is None), f"{first} and {second} belong together", missing, None, "both")
    places = [key for key in ("position", "centre") if getattr(table, key) is not None]
    places += ["from"] * (table.from_ is not None)
    allowed = "one of position (of the frame's origin), centre (of mass), from with to"
    need(len(places) == 1, "a body needs one position", places[-1] if places else "position", places, allowed)
    origin = np.array(table.position or (0.0, 0.0, 0.0))
    if table.quaternion is not None:
        _unit(table.quaternion, "quaternion", place)
        return turn_by_quaternion(table.quaternion), origin
    if table.axis is not None:
        return turn_about(_unit(table.axis, "axis", place), math.radians(table.angle_deg or 0.0)), origin
    if table.from_ is not None:
        start, end = np.array(table.from_), np.array(table.to)
        return turn_to(_unit(end - start, "to", place)), (start + end) / 2.0
    if table.matrix is not None:
        matrix = np.array(table.matrix)
        is_met = np.abs(matrix @ matrix.T - np.eye(3)).max() <= UNIT_TOLERANCE and np.linalg.det(matrix) > 0
        allowed, hint = "columns that are unit vectors at right angles, right-handed", "use quaternion"
        need(bool(is_met), "no rotation matrix", "matrix", matrix.tolist(), allowed, hint)
        u, _, v = np.linalg.svd(matrix)
        return np.array(u @ v), origin
    return np.eye(3), origin


# Parts


def _part(part: PartTable, place: str) -> BodyPart:
    need = _Need(place)
    needed = {
        "ball": ("radius",),
        "box": ("size",),
        "tube": ("radius", "inner_radius", "from", "to"),
    }.get(part.kind, ("radius", "from", "to"))
    optional = {"ball": ("position",), "box": ("position", "quaternion")}.get(part.kind, ())
    for key in ("radius", "inner_radius", "from", "to", "size", "position", "quaternion"):
        value = getattr(part, key.replace("from", "from_"))
        allowed = f"{part.kind}: {', '.join((*needed, *optional))}; mass or density"
        need(value is not None or key not in needed, f"a {part.kind} needs {key}", key, value, allowed)
        known = key in (*needed, *optional)
        need(value is None or known, f"a {part.kind} has no such key", key, value, allowed)
    both = part.mass is not None and part.density is not None
    need(not both, "mass and density cannot be given together", "density", part.density, "one of the two")
    position, axes = np.array(part.position or (0.0, 0.0, 0.0)), np.eye(3)
    size: tuple[float, ...] = tuple(part.size or ())
    if part.kind == "ball":
        size = (part.radius or 0.0,)
    elif part.kind == "box":
        axes = (
            turn_by_quaternion(_unit(part.quaternion, "quaternion", place).tolist())
            if part.quaternion
            else axes
        )
    else:
        start, end = np.array(part.from_), np.array(part.to)
        position, axes = (start + end) / 2.0, turn_to(_unit(end - start, "to", place))
        inner = part.inner_radius or 0.0
        allowed = "less than radius"
        need(inner < (part.radius or 0.0), "no wall is left", "inner_radius", part.inner_radius, allowed)
        radii = (part.radius or 0.0, inner) if part.kind == "tube" else (part.radius or 0.0,)
        size = (*radii, float(np.linalg.norm(end - start)))
    shape = BodyPart(part.kind, size, position, axes)
    mass = part.mass if part.density is None else part.density * compute_volume(shape)
    return BodyPart(part.kind, size, position, axes, mass or 0.0)


def compute_volume(part: BodyPart) -> float:
    """Return the volume of a part [m3]."""
    return _VOLUME[part.kind](*part.size)


def compute_unit_inertia(part: BodyPart) -> FloatArray:
    """Return the principal inertia of a part of mass 1, about its axes (3,) [m2]."""
    if part.kind == "ball":
        return np.full(3, 0.4 * part.size[0] ** 2)
    if part.kind == "box":
        a, b, c = np.square(part.size) / 12.0
        return np.array([b + c, a + c, a + b])
    radius, length = part.size[0], part.size[-1]
    if part.kind == "capsule":
        rod, caps = math.pi * radius**2 * length, 4.0 / 3.0 * math.pi * radius**3
        along = rod * radius**2 / 2.0 + caps * 0.4 * radius**2
        across = rod * (3.0 * radius**2 + length**2) / 12.0
        across += caps * (0.4 * radius**2 + 0.375 * radius * length + length**2 / 4.0)
        return np.array([across, across, along]) / (rod + caps)
    square = radius**2 + (part.size[1] ** 2 if part.kind == "tube" else 0.0)
    across = (3.0 * square + length**2) / 12.0
    return np.array([across, across, square / 2.0])


_VOLUME: Mapping[str, Callable[..., float]] = {
    "ball": lambda radius: 4.0 / 3.0 * math.pi * radius**3,
    "box": lambda a, b, c: a * b * c,
    "cylinder": lambda radius, length: math.pi * radius**2 * length,
    "tube": lambda radius, inner, length: math.pi * (radius**2 - inner**2) * length,
    "capsule": lambda radius, length: math.pi * radius**2 * (length + 4.0 / 3.0 * radius),
}
