"""Geoms of MJCF: shape, place, mass and inertia, as MuJoCo has them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.frames import Compiler, compute_quaternion, read_pose
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

WATER = 1000.0  # kg/m3, density of geoms in MuJoCo where none is given
MASSLESS = ("plane", "hfield")


@dataclass(frozen=True)
class Geom:
    """A geom in the frame of its link.

    size (3,): as in MuJoCo, [m]; rotation (3, 3): turns its frame into that of the link; values: its
    attributes, those of its class too; where: its place in the file, for messages.
    """

    name: str
    kind: str
    size: FloatArray
    position: FloatArray
    rotation: FloatArray
    values: Mapping[str, str]
    where: str

    def compute_mass(self) -> float:
        """Return the mass [kg]; raises InvalidValueError where the shape is not known."""
        x, y, z = self.size
        volumes = {
            "sphere": 4 / 3 * math.pi * x**3,
            "capsule": math.pi * x**2 * (2 * y + 4 / 3 * x),
            "cylinder": math.pi * x**2 * 2 * y,
            "box": 8 * x * y * z,
            "ellipsoid": 4 / 3 * math.pi * x * y * z,
            **dict.fromkeys(MASSLESS, 0.0),
        }
        mass, density = (
            read_number(self.values.get(key, default), f"{self.where}.{key}")
            for key, default in (("mass", "-1"), ("density", str(WATER)))
        )
        if self.kind in volumes:
            return float(mass if mass >= 0 else density * volumes[self.kind])
        if mass == 0 or (mass < 0 and density == 0):
            return 0.0
        problem = "mass and inertia of this geom are not known"
        hint = "give its body an element inertial, or the geom no mass: it is a picture then"
        raise InvalidValueError(
            problem, where=self.where, given=self.kind, allowed=", ".join(volumes), hint=hint
        )

    def compute_inertia(self, mass: float) -> FloatArray:
        """Return the inertia about the own centre (3, 3), in the axes of the link [kg m2]."""
        x, y, z = self.size
        if self.kind == "sphere":
            moments = [0.4 * x**2] * 3
        elif self.kind == "cylinder":
            moments = [(3 * x**2 + 4 * y**2) / 12] * 2 + [x**2 / 2]
        elif self.kind == "capsule":
            ball = 4 * x / (4 * x + 6 * y) if x else 0.0  # share of the two half balls in the mass
            across = (1 - ball) * (3 * x**2 + 4 * y**2) / 12
            across += ball * (0.4 * x**2 + 2 * y * (3 * x + 4 * y) / 8)
            moments = [across] * 2 + [(1 - ball) * x**2 / 2 + ball * 0.4 * x**2]
        else:
            share = 1 / 3 if self.kind == "box" else 1 / 5
            moments = [share * (y**2 + z**2), share * (x**2 + z**2), share * (x**2 + y**2)]
        inertia: FloatArray = mass * (self.rotation * np.array(moments)) @ self.rotation.T
        return inertia

    def find_ends(self) -> list[FloatArray]:
        """Return the two ends of the axis of a capsule or cylinder [m], in the order of the file."""
        half = self.rotation[:, 2] * self.size[1]
        ends = [(self.position + sign * half).round(15) + 0.0 for sign in (1, -1)]
        return ends if "fromto" in self.values else ends[::-1]

    def describe(self) -> dict[str, Any] | None:
        """Return the part of a scene that is its picture, None without one."""
        position = self.position.tolist()
        if self.kind == "sphere":
            return {"kind": "ball", "radius": float(self.size[0]), "position": position}
        if self.kind in ("capsule", "cylinder"):
            start, end = (point.tolist() for point in self.find_ends())
            return {"kind": self.kind, "radius": float(self.size[0]), "from": start, "to": end}
        if self.kind != "box":
            return None
        box = {"kind": "box", "size": (2 * self.size).tolist(), "position": position}
        is_turned = not np.array_equal(self.rotation, np.eye(3))
        return box | ({"quaternion": compute_quaternion(self.rotation)} if is_turned else {})


def read_geom(compiler: Compiler, values: Mapping[str, str], name: str, where: str) -> Geom:
    """Return a geom in the frame of the element around it."""
    position, rotation, length = read_pose(compiler, values, where)
    kind = "mesh" if "mesh" in values else values.get("type", "sphere")
    size = read_numbers(values.get("size", "0"), f"{where}.size", (1, 2, 3))
    size = [*size, *[0.0] * (3 - len(size))]
    if length:  # between two points: the first size is that across
        size = [size[0], length / 2, 0.0] if kind in ("capsule", "cylinder") else [*size[:1] * 2, length / 2]
    return Geom(name, kind, np.array(size), position, rotation, values, where)
