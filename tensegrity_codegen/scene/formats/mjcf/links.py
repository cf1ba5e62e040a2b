"""The bodies of a model as links that move as one, with their sites, geoms, mass and speed."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.free_bodies import move_mass
from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.defaults import MAIN, Defaults
from tensegrity_codegen.scene.formats.mjcf.frames import Compiler, read_pose, read_rotation, read_vector
from tensegrity_codegen.scene.formats.mjcf.geoms import Geom, read_geom
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

ALIGNMENT_TOLERANCE = 1e-9  # of a direction along an axis
INSTEAD = "model what turns by cables and rods, or as free bodies"


@dataclass
class Link:
    """What moves as one.

    kind: "static", "sliding" (without rotation), "free" or "ball"; position [m], rotation (3, 3): its frame
    in the world at the start, in which all else is; free (3,): axes along which a sliding link moves; sites:
    positions [m], frames: rotations (3, 3) of the sites by name; mass [kg], centre (3,) [m], inertia (3, 3)
    about the centre [kg m2]; speed, spin: velocity of the origin [m/s] and angular velocity [rad/s] at the
    start, in the axes of the world.
    """

    name: str
    kind: str
    position: FloatArray
    rotation: FloatArray
    free: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, dtype=bool))
    sites: dict[str, FloatArray] = field(default_factory=dict)
    frames: dict[str, FloatArray] = field(default_factory=dict)
    geoms: list[Geom] = field(default_factory=list)
    mass: float = 0.0
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    speed: FloatArray = field(default_factory=lambda: np.zeros(3))
    spin: FloatArray = field(default_factory=lambda: np.zeros(3))

    def place(self, point: FloatArray) -> FloatArray:
        """Return the position in the world of a point of the link."""
        world: FloatArray = self.position + self.rotation @ point
        return world

    def locate(self, site: str) -> FloatArray:
        """Return the position of a site in the world."""
        return self.place(self.sites[site])

    def move(self, point: FloatArray) -> FloatArray:
        """Return the velocity of a point of the world that moves with the link [m/s]."""
        velocity: FloatArray = self.speed + np.cross(self.spin, point - self.position)
        return velocity

    def add_mass(self, mass: float, centre: FloatArray, inertia: FloatArray) -> None:
        """Add a mass with its inertia about its own centre."""
        total = self.mass + mass
        if total > 0:
            apart = centre - self.centre
            share = self.mass * mass / total
            self.inertia = self.inertia + inertia + move_mass(share, apart)
            self.centre = (self.mass * self.centre + mass * centre) / total
        self.mass = total


@dataclass
class _Walk:
    file: str
    defaults: Defaults
    compiler: Compiler
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


@dataclass(frozen=True)
class _Frame:
    """A frame of the file in that of a link; around: the class of its elements."""

    position: FloatArray
    rotation: FloatArray
    around: str


def read_links(
    root: Element, defaults: Defaults, compiler: Compiler, speeds: list[float] | None, file: str
) -> list[Link]:
    """Return the links of a model, the world first; speeds: those of the joints at the start."""
    walk = _Walk(file, defaults, compiler, speeds)
    world = Link("world", "static", np.zeros(3), np.eye(3))
    walk.links.append(world)
    for body in root.iterfind("worldbody"):
        _fill(walk, body, world, _Frame(np.zeros(3), np.eye(3), body.get("childclass", MAIN)))
    return walk.links


def _list_children(walk: _Walk, element: Element, frame: _Frame) -> Iterator[tuple[Element, _Frame]]:
    """Yield the children of an element, and those of elements `frame`, with the frame that they are in."""
    for child in element:
        if child.tag == "frame":
            yield from _list_children(walk, child, _enter(walk, child, frame))
        else:
            yield child, frame


def _enter(walk: _Walk, element: Element, frame: _Frame) -> _Frame:
    """Return the frame of an element that is in a frame."""
    position, rotation, _ = read_pose(walk.compiler, element.attrib, walk.where(element))
    around = element.get("childclass", frame.around)
    return _Frame(frame.position + frame.rotation @ position, frame.rotation @ rotation, around)


def _fill(walk: _Walk, element: Element, link: Link, frame: _Frame) -> None:
    """Add sites, geoms, masses and bodies of an element, whose frame is given, to its link."""
    children = list(_list_children(walk, element, frame))
    moves = link.kind != "static"
    inertial = [child for child, _ in children if child.tag == "inertial"]
    for child, inner in children:
        around = inner.around
        if walk.compiler.is_global:  # places are those of the world
            inner = _Frame(-link.rotation.T @ link.position, link.rotation.T, around)
        if child.tag == "site":
            values = walk.defaults.complete(child, "site", around)
            position, rotation, _ = read_pose(walk.compiler, values, walk.where(child))
            if name := child.get("name"):
                link.sites[name] = inner.position + inner.rotation @ position
                link.frames[name] = inner.rotation @ rotation
        elif child.tag == "geom":
            values = walk.defaults.complete(child, "geom", around, element.get("name", ""))
            geom = read_geom(walk.compiler, values, child.get("name", ""), walk.where(child))
            place = inner.position + inner.rotation @ geom.position
            geom = replace(geom, position=place, rotation=inner.rotation @ geom.rotation)
            link.geoms.append(geom)
            low, high = walk.compiler.groups
            counts = low <= read_number(values.get("group", "0"), f"{geom.where}.group") <= high
            if moves and counts and (not inertial or walk.compiler.inertia == "true"):
                mass, inertia = geom.compute_inertia()
                link.add_mass(mass, geom.position, inertia)
        elif child.tag == "inertial" and moves and walk.compiler.inertia != "true":
            _add_inertial(walk, child, link, inner)
        elif child.tag == "body":
            _add_body(walk, child, link, inner)


def _add_body(walk: _Walk, body: Element, above: Link, frame: _Frame) -> None:
    where, inner = walk.where(body), _enter(walk, body, frame)
    name = body.get("name", f"body{len(walk.links)}")
    walk.defaults.complete(body, "body", owner=name)
    if body.get("mocap") == "true":
        problem = "a body that motion capture moves is not read"
        raise _refuse(problem, where, "bodies that are fixed, or move by forces", hint="remove mocap")
    joints = [
        {"type": {"freejoint": "free"}.get(child.tag, "hinge")}
        | walk.defaults.complete(child, child.tag, at.around, name)
        for child, at in _list_children(walk, body, inner)
        if child.tag in ("joint", "freejoint")
    ]
    kinds = [values["type"] for values in joints]
    if not joints:
        _fill(walk, body, above, inner)
        return
    origin, turned, start = above.place(inner.position), above.rotation @ inner.rotation, np.zeros(3)
    if kinds == ["free"] and above is not walk.links[0]:
        problem, hint = "a free body within a body is not read", "MuJoCo refuses it too: move it to the world"
        raise _refuse(problem, where, "free bodies in the world", hint=hint)
    if set(kinds) == {"slide"}:
        link = _slide(walk, joints, above, Link(name, "sliding", origin, turned))
    elif kinds == ["free"] or (kinds == ["ball"] and above.kind == "static"):
        start = read_vector(joints[0], "pos", where) if kinds == ["ball"] else start
        link = Link(name, kinds[0], origin + turned @ start, turned)
        numbers = walk.take(6 if kinds == ["free"] else 3)
        link.speed = np.array(numbers[:3]) if kinds == ["free"] else np.zeros(3)
        link.spin = turned @ np.array(numbers[-3:])
    else:
        allowed = "a free joint, slide joints along axes of the world, a ball joint at the world"
        raise _refuse("these joints are not read", where, allowed, ", ".join(kinds))
    if any(other.name == name for other in walk.links):
        raise _refuse("two bodies with one name", where, "each name once", name, "rename one of them")
    walk.links.append(link)
    _fill(walk, body, link, _Frame(-start, np.eye(3), inner.around))


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
        axis = link.rotation @ read_vector(values, "axis", where, "0 0 1")
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


def _add_inertial(walk: _Walk, element: Element, link: Link, frame: _Frame) -> None:
    where = walk.where(element)
    mass = read_number(element.get("mass", ""), f"{where}.mass")
    centre = frame.position + frame.rotation @ read_vector(element.attrib, "pos", where)
    turned = frame.rotation @ read_rotation(walk.compiler, element.attrib, where)
    if element.get("fullinertia"):
        xx, yy, zz, xy, xz, yz = read_numbers(element.get("fullinertia", ""), f"{where}.fullinertia", (6,))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        inertia = np.diag(read_vector(element.attrib, "diaginertia", where))
    link.add_mass(mass, centre, turned @ inertia @ turned.T)
