"""Tendons of MJCF: spatial ones between two sites as members, fixed ones that couple masses."""

import math
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.files.xml_file import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.defaults import Defaults
from tensegrity_codegen.scene.formats.network import NetworkMember
from tensegrity_codegen.system.errors import InvalidValueError


def read_tendons(
    root: Element, defaults: Defaults, sites: Mapping[str, NDArray[np.float64]], file: str
) -> list[NetworkMember]:
    """Return the spatial tendons as members; sites: positions [m] by name."""
    members = []
    for number, element in enumerate(root.iterfind("tendon/spatial")):
        where = f"{file}: tendon.spatial[{number}]"
        values = defaults.complete(element, "tendon")
        path = [item for item in element if isinstance(item.tag, str)]
        if [item.tag for item in path] != ["site", "site"]:
            raise InvalidValueError(
                "a tendon that is no straight line between two sites is not read",
                where=where,
                given=", ".join(item.tag for item in path)[:80],
                allowed="two elements <site>",
                hint="split the tendon, or scenes of bodies",
            )
        first, second = (item.get("site", "") for item in path)
        member = _read_values(values, element.get("class", ""), where)
        if "rest_length" not in member and first in sites and second in sites:
            member["rest_length"] = math.dist(sites[first], sites[second])
        name = element.get("name", f"tendon{number}")
        members.append(NetworkMember(name, (first, second), member, where))
    return members


def _read_values(values: Mapping[str, str], group: str, where: str) -> dict[str, Any]:
    """Return the values of a tendon by the keys of a scene."""
    stiffness = read_numbers(values.get("stiffness", "0"), f"{where}.stiffness")
    damping = read_numbers(values.get("damping", "0"), f"{where}.damping")
    if any(stiffness[1:]) or any(damping[1:]):
        raise InvalidValueError("stiffness and damping that are polynomials are not read", where=where)
    member: dict[str, Any] = {"kind": "bar" if group == "bar" else "cable"}
    if stiffness[0]:
        member["spring_constant"] = stiffness[0]
    if damping[0]:
        member["damping"] = damping[0]
    rest = read_numbers(values.get("springlength", "-1"), f"{where}.springlength", (1, 2))
    if len(rest) == 2 and rest[0] != rest[1]:
        if rest[0] != 0:
            raise InvalidValueError(
                "a dead band that does not begin at 0 is not read",
                where=f"{where}.springlength",
                given=values["springlength"],
                allowed='"0 length" of a cable, or one length',
            )
    elif member["kind"] == "cable":
        member["tension_only"] = False
    if rest[-1] != -1:
        member["rest_length"] = rest[-1]
    return member


def read_coupled_masses(root: Element, file: str) -> dict[str, float]:
    """Return the own masses [kg] that fixed tendons BAR.mass.AXIS of an exported scene give to bars.

    Fixed tendons of other names are there with 0.
    """
    masses: dict[str, float] = {}
    for number, element in enumerate(root.iterfind("tendon/fixed")):
        name = element.get("name", f"fixed{number}")
        bar, mark, axis = name.rpartition(".mass.")
        if mark and axis in ("x", "y", "z"):
            armature = element.get("armature", "0")
            masses[bar] = 6 * read_number(armature, f"{file}: tendon.fixed[{number}].armature")
        else:
            masses[name] = 0.0
    return masses
