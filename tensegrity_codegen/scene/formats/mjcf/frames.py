"""Places and rotations of MJCF elements in the frame around them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.assemble.free_bodies import turn_about, turn_by_quaternion, turn_to
from tensegrity_codegen.scene.formats.files.documents import read_numbers
from tensegrity_codegen.scene.formats.mjcf.defaults import Defaults
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError


@dataclass(frozen=True)
class Compiler:
    """Options of the compiler: angles, coordinates, and which masses count.

    is_global: all elements are in the frame of the world; inertia: inertiafromgeom; groups: those of the
    geoms that have mass.
    """

    in_degrees: bool = True
    sequence: str = "xyz"
    is_global: bool = False
    inertia: str = "auto"
    groups: tuple[float, float] = (0.0, 5.0)


def read_compiler(root: Element, defaults: Defaults, file: str) -> Compiler:
    """Return the options of the compiler; those that are not read and act are recorded."""
    options: dict[str, str] = {}
    for element in root.iterfind("compiler"):
        options |= defaults.complete(element, "compiler")
    sequence = options.get("eulerseq", "xyz")
    if sorted(sequence.lower()) != ["x", "y", "z"]:
        location = f"{file}: compiler.eulerseq"
        raise InvalidValueError("not a sequence of axes", where=location, given=sequence[:20], allowed="xyz")
    low, high = read_numbers(options.get("inertiagrouprange", "0 5"), f"{file}: inertiagrouprange", (2,))
    return Compiler(
        in_degrees=options.get("angle") != "radian",
        sequence=sequence,
        is_global=options.get("coordinate") == "global",
        inertia=options.get("inertiafromgeom", "auto"),
        groups=(low, high),
    )


def read_vector(values: Mapping[str, str], key: str, where: str, default: str = "0 0 0") -> FloatArray:
    """Return an attribute of three numbers."""
    return np.array(read_numbers(values.get(key, default), f"{where}.{key}", (3,)))


def read_pose(
    compiler: Compiler, values: Mapping[str, str], where: str
) -> tuple[FloatArray, FloatArray, float]:
    """Return place and rotation of an element, and its length, 0 where it does not go from point to point."""
    if "fromto" not in values:
        return read_vector(values, "pos", where), read_rotation(compiler, values, where), 0.0
    ends = np.array(read_numbers(values["fromto"], f"{where}.fromto", (6,))).reshape(2, 3)
    return ends.mean(axis=0), _turn_to(ends[0] - ends[1]), float(np.linalg.norm(ends[1] - ends[0]))


def read_rotation(compiler: Compiler, values: Mapping[str, str], where: str) -> FloatArray:
    """Return the rotation matrix of an element in the frame around it."""
    unit = math.pi / 180 if compiler.in_degrees else 1.0
    if "quat" in values:
        quaternion = read_numbers(values["quat"], f"{where}.quat", (4,))
        if not any(quaternion):
            allowed = "four numbers w x y z, not all 0"
            raise InvalidValueError("a quaternion of length 0", where=f"{where}.quat", allowed=allowed)
        return turn_by_quaternion(quaternion)
    if "axisangle" in values:
        numbers = read_numbers(values["axisangle"], f"{where}.axisangle", (4,))
        return turn_about(np.array(numbers[:3]), numbers[3] * unit)
    if "zaxis" in values:
        return _turn_to(read_vector(values, "zaxis", where))
    if "xyaxes" in values:
        x, y = np.array(read_numbers(values["xyaxes"], f"{where}.xyaxes", (6,))).reshape(2, 3)
        x = x / (np.linalg.norm(x) or 1.0)
        y = y - (x @ y) * x
        y = y / (np.linalg.norm(y) or 1.0)
        return np.stack([x, y, np.cross(x, y)], axis=1)
    total = np.eye(3)
    if "euler" in values:
        angles = read_numbers(values["euler"], f"{where}.euler", (3,))
        for letter, value in zip(compiler.sequence, angles, strict=True):
            turn = turn_about(np.eye(3)["xyz".index(letter.lower())], value * unit)
            total = total @ turn if letter.islower() else turn @ total
    return total


def _turn_to(direction: FloatArray) -> FloatArray:
    return turn_to(direction / (np.linalg.norm(direction) or 1.0))
