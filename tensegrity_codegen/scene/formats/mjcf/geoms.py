"""Geoms of MJCF: shape, place, mass and inertia, as MuJoCo has them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.scene.assemble.free_bodies import compute_unit_inertia, compute_volume
from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.frames import Compiler, read_pose
from tensegrity_codegen.structure.free_bodies import BodyPart
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

    def to_part(self) -> BodyPart | None:
        """Return the geom as a shape of a body, None where a scene has no such shape."""
        x, y, z = self.size.tolist()
        shapes = {
            "sphere": ("ball", (x,)),
            "capsule": ("capsule", (x, 2 * y)),
            "cylinder": ("cylinder", (x, 2 * y)),
            "box": ("box", (2 * x, 2 * y, 2 * z)),
        }
        known = shapes.get(self.kind)
        return None if known is None else BodyPart(*known, self.position, self.rotation)

    def compute_inertia(self) -> tuple[float, FloatArray]:
        """Return the mass [kg] and the inertia about the own centre (3, 3), in the axes of the link [kg m2].

        Raises InvalidValueError where the shape is not known and its mass counts.
        """
        mass, density = (
            read_number(self.values.get(key, default), f"{self.where}.{key}")
            for key, default in (("mass", "-1"), ("density", str(WATER)))
        )
        for key, value in (("mass", mass), ("density", density)):
            if key in self.values and value < 0:
                problem = f"a negative {key}"
                raise InvalidValueError(
                    problem, where=f"{self.where}.{key}", given=value, allowed="0 or more"
                )
        part, square, is_egg = self.to_part(), self.size**2, self.kind == "ellipsoid"
        if not (part or is_egg or self.kind in MASSLESS) and (mass > 0 or (mass < 0 and density)):
            problem, allowed = "mass and inertia of this geom are not known", "other shapes"
            hint = "give its body an element inertial, or the geom no mass: it is a picture then"
            raise InvalidValueError(problem, where=self.where, given=self.kind, allowed=allowed, hint=hint)
        volume = 4 / 3 * math.pi * float(self.size.prod()) * is_egg
        volume = compute_volume(part) if part else volume
        mass = mass if mass >= 0 else density * volume
        moments = compute_unit_inertia(part) if part and volume else (square.sum() - square) / 5
        inertia: FloatArray = mass * (self.rotation * moments) @ self.rotation.T
        return float(mass), inertia

    def find_ends(self) -> list[FloatArray]:
        """Return the two ends of the axis of a capsule or cylinder [m], in the order of the file."""
        half = self.rotation[:, 2] * self.size[1]
        ends = [(self.position + sign * half).round(15) + 0.0 for sign in (1, -1)]
        return ends if "fromto" in self.values else ends[::-1]


def read_geom(compiler: Compiler, values: Mapping[str, str], name: str, where: str) -> Geom:
    """Return a geom in the frame of the element around it."""
    position, rotation, length = read_pose(compiler, values, where)
    kind = "mesh" if "mesh" in values else values.get("type", "sphere")
    size = read_numbers(values.get("size", "0"), f"{where}.size", (1, 2, 3))
    size = [*size, *[0.0] * (3 - len(size))]
    if length:  # between two points: the first size is that across
        size = [size[0], length / 2, 0.0] if kind in ("capsule", "cylinder") else [*size[:1] * 2, length / 2]
    return Geom(name, kind, np.array(size), position, rotation, values, where)
