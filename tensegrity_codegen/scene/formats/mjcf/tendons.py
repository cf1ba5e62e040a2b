"""Tendons of MJCF: spatial ones along sites are members, fixed ones couple masses."""

import math
from collections.abc import Mapping
from functools import partial
from itertools import pairwise
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.imported import Network, NetworkMember
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED, Defaults
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.system.errors import InvalidValueError, name_list


def read_tendons(
    root: Element, defaults: Defaults, network: Network, sites: Mapping[str, NDArray[np.float64]], file: str
) -> list[NetworkMember]:
    """Return the spatial tendons as members; sites: positions [m] by name.

    A tendon along more than two sites is a cable through rings. Values of a tendon without stiffness have no
    spring constant.
    """
    members, pushing, rings = [], [], []
    for number, element in enumerate(root.iterfind("tendon/spatial")):
        name = element.get("name", f"tendon{number}")
        where = f"{file}: tendon.spatial[{number}] {name[:60]}"
        values = defaults.complete(element, "tendon")
        path = [site for site in element if isinstance(site.tag, str)]
        if len(path) < 2 or any(site.tag != "site" for site in path):
            problem = "a tendon around geoms or over pulleys is not read"
            value, allowed = ", ".join(site.tag for site in path)[:80], "two elements <site>, or more"
            hint = "lead it through sites, which are rings without friction"
            raise InvalidValueError(problem, where=where, given=value, allowed=allowed, hint=hint)
        ends = tuple(site.get("site", "") for site in path)
        for end in ends:
            check_known(end, sites, "unknown site", "a site", file)
        member, pushes_below = _read_values(values, element.get("class", ""), where)
        pushing += [f"{name} ({pushes_below:g} m)"] if pushes_below else []
        if "rest_length" not in member:
            member["rest_length"] = sum(math.dist(sites[a], sites[b]) for a, b in pairwise(ends))
        if len(ends) > 2:
            rings += [name] if member.pop("tension_only", None) is False else []
            member["kind"] = "cable"
        members.append(NetworkMember(name, ends, member, where, partial(_find_place, where)))
    for what, names in (("below a length", pushing), ("though they run through rings", rings)):
        listed = name_list(names, MAX_NAMED)
        network.notes += [f"tendons that push {what} in MuJoCo and not here: {listed}"] if names else []
    return members


def _find_place(where: str, key: str) -> str:
    """Return the place of a value by its key, which has another name in MuJoCo."""
    return key_path(where, {"spring_constant": "stiffness", "rest_length": "springlength"}.get(key, key))


def _read_values(values: Mapping[str, str], group: str, where: str) -> tuple[dict[str, Any], float]:
    """Return the values of a tendon by the keys of a scene, and the length below which it pushes [m]."""
    stiffness = read_numbers(values.get("stiffness", "0"), f"{where}.stiffness")
    damping = read_numbers(values.get("damping", "0"), f"{where}.damping")
    if any(stiffness[1:]) or any(damping[1:]):
        problem = "stiffness and damping that are polynomials are not read"
        raise InvalidValueError(problem, where=where, hint="give one number")
    member: dict[str, Any] = {"kind": "bar" if group == "bar" else "cable"}
    if stiffness[0]:
        member["spring_constant"] = stiffness[0]
    if damping[0]:
        member["damping"] = damping[0]
    lengths = read_numbers(values.get("springlength", "-1"), f"{where}.springlength", (1, 2))
    below = lengths[0] if len(lengths) == 2 and lengths[0] != lengths[1] else 0.0
    if (len(lengths) == 1 or lengths[0] == lengths[1]) and member["kind"] == "cable":
        member["tension_only"] = False
    if lengths[-1] != -1:
        member["rest_length"] = lengths[-1]
    return member, below


def read_coupled_masses(root: Element, defaults: Defaults, file: str) -> dict[str, float]:
    """Return the own masses [kg] of bars by fixed tendons BAR.mass.AXIS, 0 of other fixed tendons."""
    masses: dict[str, float] = {}
    for number, element in enumerate(root.iterfind("tendon/fixed")):
        name = element.get("name", f"fixed{number}")
        bar, mark, axis = name.rpartition(".mass.")
        if mark and axis in ("x", "y", "z"):
            armature = defaults.complete(element, "tendon").get("armature", "0")
            masses[bar] = 6 * read_number(armature, f"{file}: tendon.fixed[{number}].armature")
        else:
            masses[name] = 0.0
    return masses
