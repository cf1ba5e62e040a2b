"""The bodies of a model as links that move as one, with their sites, mass and speed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.defaults import MAIN, Defaults
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

WATER = 1000.0  # kg/m3, density of geoms in MuJoCo where none is given
ALIGNMENT_TOLERANCE = 1e-9  # of a direction along an axis
INSTEAD = "write the structure as a scene of bodies"


@dataclass
class Link:
    """What moves as one.

    kind: "static", "sliding" (without rotation), "free" or "ball"; position [m], rotation (3, 3): frame at
    the start; free (3,): axes along which a sliding link moves; sites: positions [m] by name; frames (3, 3):
    rotations of the sites of a static link; mass [kg], centre [m], across [kg m2]: inertia about the centre
    across its longest axis, None if only geoms give the mass; speed, spin: velocity of the origin [m/s]
    and angular velocity [rad/s] at the start.
    """

    name: str
    kind: str
    position: FloatArray
    rotation: FloatArray
    free: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, dtype=bool))
    sites: dict[str, FloatArray] = field(default_factory=dict)
    frames: dict[str, FloatArray] = field(default_factory=dict)
    mass: float = 0.0
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    across: float | None = None
    speed: FloatArray = field(default_factory=lambda: np.zeros(3))
    spin: FloatArray = field(default_factory=lambda: np.zeros(3))


@dataclass
class _Walk:
    file: str
    defaults: Defaults
    in_degrees: bool
    sequence: str
    speeds: list[float] | None
    links: list[Link] = field(default_factory=list)
    used: int = 0  # numbers of `speeds` that joints have taken

    def where(self, element: Element) -> str:
        return f"{self.file}: {element.tag} {element.get('name', '')[:60]}".rstrip()

    def take(self, count: int) -> list[float]:
        """Return the next speeds of the keyframe, 0 without one."""
        start, self.used = self.used, self.used + count
        if self.speeds is None:
            return [0.0] * count
        return (self.speeds[start : self.used] + [0.0] * count)[:count]


def read_links(root: Element, defaults: Defaults, speeds: list[float] | None, file: str) -> list[Link]:
    """Return the links of a model, the world first; speeds: those of the joints at the start."""
    angle, sequence = "degree", "xyz"
    for element in root.iterfind("compiler"):
        defaults.complete(element, "compiler")
        angle, sequence = element.get("angle", angle), element.get("eulerseq", sequence)
    if sorted(sequence.lower()) != ["x", "y", "z"]:
        location = f"{file}: compiler.eulerseq"
        raise InvalidValueError("not a sequence of axes", where=location, given=sequence[:20], allowed="xyz")
    walk = _Walk(file, defaults, angle != "radian", sequence, speeds)
    world = Link("world", "static", np.zeros(3), np.eye(3))
    walk.links.append(world)
    for body in root.iterfind("worldbody"):
        _fill(walk, body, world, np.zeros(3), np.eye(3), MAIN)
    return walk.links


def _fill(
    walk: _Walk, element: Element, link: Link, position: FloatArray, rotation: FloatArray, around: str
) -> None:
    """Add sites, masses and bodies of an element, whose frame is given, to its link."""
    around = element.get("childclass", around)
    inertial = element.find("inertial")
    for site in element.iterfind("site"):
        values = walk.defaults.complete(site, "site", around)
        if name := site.get("name"):
            link.sites[name] = position + rotation @ _read_place(values, walk.where(site))[0]
            if link.kind == "static":
                link.frames[name] = rotation @ _read_rotation(walk, values, walk.where(site))
    if inertial is not None and link.kind != "static":
        _add_inertia(walk, inertial, link, position, rotation)
    elif link.kind != "static":
        for geom in element.iterfind("geom"):
            values = walk.defaults.complete(geom, "geom", around, element.get("name", ""))
            mass, centre = _read_geom(values, walk.where(geom))
            _add_mass(link, mass, position + rotation @ centre, None)
    for body in element.iterfind("body"):
        _add_body(walk, body, link, position, rotation, around)


def _add_body(
    walk: _Walk, body: Element, above: Link, position: FloatArray, rotation: FloatArray, around: str
) -> None:
    around = body.get("childclass", around)
    where = walk.where(body)
    origin = position + rotation @ _vector(body.attrib, "pos", where)
    turned = rotation @ _read_rotation(walk, body.attrib, where)
    name = body.get("name", f"body{len(walk.links)}")
    walk.defaults.complete(body, "body", owner=name)
    tags = [child for child in body if child.tag in ("joint", "freejoint")]
    joints = [walk.defaults.complete(child, child.tag, around, name) for child in tags]
    kinds = [
        "free" if child.tag == "freejoint" else values.get("type", "hinge")
        for child, values in zip(tags, joints, strict=True)
    ]
    if not joints:
        _fill(walk, body, above, origin, turned, around)
        return
    if set(kinds) == {"slide"}:
        link = _slide(walk, joints, above, Link(name, "sliding", origin, turned))
    elif kinds == ["free"] or (kinds == ["ball"] and above.kind == "static"):
        pivot = _vector(joints[0], "pos", where) if kinds == ["ball"] else np.zeros(3)
        link = Link(name, kinds[0], origin + turned @ pivot, turned)
        numbers = walk.take(6 if kinds == ["free"] else 3)
        link.speed = np.array(numbers[:3]) if kinds == ["free"] else np.zeros(3)
        link.spin = turned @ np.array(numbers[-3:])
    else:
        allowed = "slide joints, one free joint, or one ball joint at the world"
        raise _refuse("these joints are not read", where, allowed, ", ".join(kinds))
    walk.links.append(link)
    _fill(walk, body, link, origin, turned, around)


def _slide(walk: _Walk, joints: list[dict[str, str]], above: Link, link: Link) -> Link:
    """Complete a link that only slides, along axes of the world; raises InvalidValueError for others."""
    body_path = f"{walk.file}: body {link.name}"
    if above.kind not in ("static", "sliding"):
        allowed = "bodies that slide in the world, or on others that slide"
        hint = "put both sites on one body, which is a rigid bar; an elastic one is a bar of the scene"
        raise _refuse("a body that slides on a turning one is not read", body_path, allowed, hint=hint)
    link.speed = above.speed.copy()
    for values, speed in zip(joints, walk.take(len(joints)), strict=True):
        where = f"{body_path}: joint {values.get('name', '')[:60]}".rstrip()
        axis = link.rotation @ _vector(values, "axis", where, "0 0 1")
        axis = axis / (np.linalg.norm(axis) or 1.0)
        main = int(np.abs(axis).argmax())
        if abs(abs(axis[main]) - 1.0) > ALIGNMENT_TOLERANCE or link.free[main]:
            problem = "a slide joint that is not along an axis of the world, or along one twice"
            shown = " ".join(f"{value:.6g}" for value in axis)
            raise _refuse(problem, where, "1 0 0, 0 1 0 and 0 0 1, each once", shown)
        link.free[main] = True
        link.speed[main] += math.copysign(speed, axis[main] * speed)
    if (above.free & ~link.free).any():
        problem = "a body without a joint along an axis along which the body that carries it slides"
        raise _refuse(problem, body_path, "slide joints along the same axes at least")
    return link


def _refuse(
    problem: str, where: str, allowed: str, given: str | None = None, hint: str = INSTEAD
) -> InvalidValueError:
    return InvalidValueError(problem, where=where, given=given, allowed=allowed, hint=hint)


def _add_inertia(
    walk: _Walk, element: Element, link: Link, position: FloatArray, rotation: FloatArray
) -> None:
    where = walk.where(element)
    mass = read_number(element.get("mass", ""), f"{where}.mass")
    centre = position + rotation @ _vector(element.attrib, "pos", where)
    if element.get("fullinertia"):
        xx, yy, zz, xy, xz, yz = read_numbers(element.get("fullinertia", ""), f"{where}.fullinertia", (6,))
        moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    else:
        moments = np.sort(read_numbers(element.get("diaginertia", "0 0 0"), f"{where}.diaginertia", (3,)))
    _add_mass(link, mass, centre, float(moments[1:].mean()))


def _add_mass(link: Link, mass: float, centre: FloatArray, across: float | None) -> None:
    total = link.mass + mass
    if total > 0:
        link.centre = (link.mass * link.centre + mass * centre) / total
    link.across = across if link.mass == 0 else None
    link.mass = total


def _read_geom(values: Mapping[str, str], where: str) -> tuple[float, FloatArray]:
    """Return mass and centre of a geom in the frame of its body."""
    centre, length = _read_place(values, where)
    if "mass" in values:
        return read_number(values["mass"], f"{where}.mass"), centre
    kind = values.get("type", "sphere")
    size = read_numbers(values.get("size", "0"), f"{where}.size", (1, 2, 3))
    size = [*size, *[0.0] * (3 - len(size))]
    if length:  # between two points: the first size is that across
        size = [size[0], length / 2, 0.0] if kind in ("capsule", "cylinder") else [*size[:1] * 2, length / 2]
    radius, half = size[0], size[1]
    volumes = {
        "sphere": 4 / 3 * math.pi * radius**3,
        "capsule": math.pi * radius**2 * (2 * half + 4 / 3 * radius),
        "cylinder": math.pi * radius**2 * 2 * half,
        "box": 8 * size[0] * size[1] * size[2],
        "ellipsoid": 4 / 3 * math.pi * size[0] * size[1] * size[2],
        "plane": 0.0,
    }
    if kind not in volumes:
        problem = "the mass of this geom is not known"
        hint = "give it the attribute mass, or its body an element inertial"
        raise InvalidValueError(problem, where=where, given=kind, allowed=", ".join(volumes), hint=hint)
    return volumes[kind] * read_number(values.get("density", str(WATER)), f"{where}.density"), centre


def _read_place(values: Mapping[str, str], where: str) -> tuple[FloatArray, float]:
    """Return the centre of a geom or site in the frame of its body, and its length where it has two ends."""
    if "fromto" not in values:
        return _vector(values, "pos", where), 0.0
    ends = np.array(read_numbers(values["fromto"], f"{where}.fromto", (6,))).reshape(2, 3)
    return ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0]))


def _vector(values: Mapping[str, str], key: str, where: str, default: str = "0 0 0") -> FloatArray:
    return np.array(read_numbers(values.get(key, default), f"{where}.{key}", (3,)))


def _read_rotation(walk: _Walk, values: Mapping[str, str], where: str) -> FloatArray:
    """Return the rotation matrix of a body in the frame around it."""
    unit = math.pi / 180 if walk.in_degrees else 1.0
    if "quat" in values:
        quaternion = np.array(read_numbers(values["quat"], f"{where}.quat", (4,)))
        return _rotate(quaternion[1:], 2 * math.atan2(float(np.linalg.norm(quaternion[1:])), quaternion[0]))
    if "axisangle" in values:
        numbers = read_numbers(values["axisangle"], f"{where}.axisangle", (4,))
        return _rotate(np.array(numbers[:3]), numbers[3] * unit)
    if "zaxis" in values:
        z = _vector(values, "zaxis", where)
        z = z / (np.linalg.norm(z) or 1.0)
        across = np.cross([0.0, 0.0, 1.0], z)
        if not np.linalg.norm(across):
            across = np.array([1.0, 0.0, 0.0])
        return _rotate(across, math.atan2(float(np.hypot(z[0], z[1])), float(z[2])))
    if "xyaxes" in values:
        x, y = np.array(read_numbers(values["xyaxes"], f"{where}.xyaxes", (6,))).reshape(2, 3)
        x = x / (np.linalg.norm(x) or 1.0)
        y = y - (x @ y) * x
        y = y / (np.linalg.norm(y) or 1.0)
        return np.stack([x, y, np.cross(x, y)], axis=1)
    total = np.eye(3)
    if "euler" in values:
        for letter, value in zip(
            walk.sequence, read_numbers(values["euler"], f"{where}.euler", (3,)), strict=True
        ):
            turn = _rotate(np.eye(3)["xyz".index(letter.lower())], value * unit)
            total = total @ turn if letter.islower() else turn @ total
    return total


def _rotate(axis: FloatArray, angle: float) -> FloatArray:
    """Return the matrix of a rotation about an axis by an angle [rad]."""
    size = float(np.linalg.norm(axis))
    if not size:
        return np.eye(3)
    x, y, z = axis / size
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: FloatArray = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return matrix
