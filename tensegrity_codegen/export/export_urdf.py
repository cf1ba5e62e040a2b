"""Export to URDF: the rigid parts of a structure as links and joints; tendons have no place in the format."""

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Comment, Element

import numpy as np

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tensegrity_codegen.export.rigid_parts import (
    WORLD,
    RigidPart,
    add,
    find_parts,
    number,
    numbers,
    write_elements,
)
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.free_bodies import BodyPart
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray

THIN = 0.01  # radius of a drawn bar without one, over its length
NEXT_TO_NOTHING = 1e-6  # of a part's mass, for links between its joints: simulators require one
TURNS = ("0 0 1", "0 1 0", "1 0 0")  # axes of the three joints in place of a ball joint


def build_urdf(subject: Subject) -> tuple[Element, list[str]]:
    """Return the robot of a structure, and notes on its limits; raises as find_parts."""
    rigid_parts, fixed = find_parts(subject)
    root = Element("robot", name=subject.name)
    root.append(Comment(" written by tensegrity_codegen; SI units "))
    add(root, "link", name=WORLD)
    poses = {WORLD: (np.zeros(3), np.eye(3))}
    for name, position in fixed.items():
        _add_frame(root, WORLD, name, position)
    for rigid_part in rigid_parts:
        _add_part(root, rigid_part, *poses[rigid_part.parent])
        poses[rigid_part.name] = (rigid_part.origin, rigid_part.rotation)
    return root, _list_losses(subject)


def _add_part(root: Element, part: RigidPart, origin: FloatArray, rotation: FloatArray) -> None:
    """Add the link of a part, its joint to the frame of its parent, and a link for each of its nodes."""
    link = add(root, "link", name=part.name)
    _add_inertial(link, part)
    if part.bar:
        low, high, radius = part.bar
        visual = add(link, "visual")
        add(visual, "origin", xyz=f"0 0 {number((low + high) / 2)}", rpy="0 0 0")
        size = {"length": number(high - low), "radius": number(radius or THIN * (high - low))}
        add(add(visual, "geometry"), "cylinder", **size)
    for shape in part.shapes:
        _add_shape(link, shape)
    pose = {
        "xyz": numbers(rotation.T @ (part.origin - origin)),
        "rpy": numbers(_compute_angles(rotation.T @ part.rotation)),
    }
    # The joint: one of six axes, or three in place of a ball joint with links next to nothing between.
    if part.joint == "floating":
        _add_joint(root, part.name, "floating", part.parent, part.name, pose)
    else:
        links = [part.parent, f"{part.name}.turn1", f"{part.name}.turn2", part.name]
        unit = NEXT_TO_NOTHING * float(part.inertia.max()) * np.eye(3)
        small = replace(part, mass=NEXT_TO_NOTHING * part.mass, centre=np.zeros(3), inertia=unit)
        for k, axis in enumerate(TURNS):
            if k:
                _add_inertial(add(root, "link", name=links[k]), small)
            joint = _add_joint(
                root, f"{part.name}.{k + 1}", "continuous", links[k], links[k + 1], pose if k == 0 else {}
            )
            add(joint, "axis", xyz=axis)
    for name, position in part.points.items():
        _add_frame(root, part.name, name, position)


def _add_shape(link: Element, shape: BodyPart) -> None:
    """Add the picture of a part of a body; a capsule as a cylinder with two balls."""
    kind, size = {"ball": "sphere", "box": "box"}.get(shape.kind, "cylinder"), shape.size
    geometry = {"radius": number(size[0])}
    if kind == "box":
        geometry = {"size": numbers(size)}
    elif kind == "cylinder":
        geometry["length"] = number(size[-1])
    ends = [-size[-1] / 2, size[-1] / 2] if shape.kind == "capsule" else []
    balls = [("sphere", {"radius": number(size[0])}, shape.position + z * shape.axes[:, 2]) for z in ends]
    for name, sizes, place in [(kind, geometry, shape.position), *balls]:
        visual = add(link, "visual")
        add(visual, "origin", xyz=numbers(place), rpy=numbers(_compute_angles(shape.axes)))
        add(add(visual, "geometry"), name, **sizes)


def _add_inertial(link: Element, part: RigidPart) -> None:
    """Add mass and inertia of a part to a link."""
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=numbers(part.centre), rpy="0 0 0")
    add(inertial, "mass", value=number(part.mass))
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": number(part.inertia[i, j]) for i in range(3) for j in range(i, 3)}
    add(inertial, "inertia", **entries)


def _add_joint(root: Element, name: str, kind: str, parent: str, child: str, pose: dict[str, str]) -> Element:
    joint = add(root, "joint", name=f"{name}.joint", type=kind)
    add(joint, "origin", **(pose or {"xyz": "0 0 0", "rpy": "0 0 0"}))
    add(joint, "parent", link=parent)
    add(joint, "child", link=child)
    return joint


def _add_frame(root: Element, parent: str, name: str, place: FloatArray) -> None:
    """Add an empty link for a node, fixed to its part."""
    add(root, "link", name=f"{name}.node")
    _add_joint(root, f"{name}.node", "fixed", parent, f"{name}.node", {"xyz": numbers(place), "rpy": "0 0 0"})


def _compute_angles(rotation: FloatArray) -> FloatArray:
    """Return roll, pitch and yaw [rad] of a rotation: about fixed x, then y, then z."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:  # x points up or down: one angle of two is free
        return np.array([0.0, pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _list_losses(subject: Subject) -> list[str]:
    """Return a sentence for each fact of the structure that the format cannot state."""
    springs, is_hollow = subject.n_members, False
    if isinstance(subject, Structure):
        springs -= int(subject.is_rigid.sum())
        is_hollow = any(part.kind == "tube" for body in subject.bodies for part in body.parts)
    facts = [
        (springs > 0, f"the format has no springs: {springs} tendons are not in the file"),
        (subject.ground is not None, "the ground is a property of the simulator, not of the file"),
        (bool(np.any(subject.gravity)), "gravity is a property of the simulator, not of the file"),
        (bool(subject.node_load.any()), "loads are not in the file"),
        (bool(subject.inputs), "inputs and actuators are not in the file"),
        (bool(subject.sensors) or subject.limits.is_stated, "sensors and limits are not in the file"),
        (is_hollow, "tubes are drawn as cylinders"),
        (True, "velocities are not in the file"),
    ]
    return [sentence for is_lost, sentence in facts if is_lost]


def write_urdf(source: ExportSource, path: Path) -> Exported:
    """Write the rigid parts of a scene as URDF; raises as find_parts."""
    root, notes = build_urdf(source.structure)
    links, joints = len(root.findall("link")), len(root.findall("joint"))
    write_elements(root, path)
    return Exported({"n_links": links, "n_joints": joints}, tuple(notes))


EXPORTER = Exporter(
    name="urdf",
    title="rigid parts as links and joints (URDF)",
    endings=(".urdf",),
    write=write_urdf,
    order=40,
)
