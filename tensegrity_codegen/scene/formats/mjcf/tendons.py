"""Tendons and actuators of MJCF.

Spatial tendons between two sites are members, fixed ones couple masses. Of actuators constant forces are
loads, forces at sites and on tendons inputs.
"""

import math
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.imported import Network, NetworkMember
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED, Defaults, list_unread
from tensegrity_codegen.system.errors import InvalidValueError, name_list


def read_tendons(
    root: Element, defaults: Defaults, sites: Mapping[str, NDArray[np.float64]], file: str
) -> list[NetworkMember]:
    """Return the spatial tendons as members; sites: positions [m] by name."""
    members = []
    for number, element in enumerate(root.iterfind("tendon/spatial")):
        where = f"{file}: tendon.spatial[{number}]"
        values = defaults.complete(element, "tendon")
        path = [site for site in element if isinstance(site.tag, str)]
        if [site.tag for site in path] != ["site", "site"]:
            problem = "a tendon that is no straight line between two sites is not read"
            value, allowed = ", ".join(site.tag for site in path)[:80], "two elements <site>"
            hint = "split the tendon, or scenes of bodies"
            raise InvalidValueError(problem, where=where, given=value, allowed=allowed, hint=hint)
        start, end = (site.get("site", "") for site in path)
        member = _read_values(values, element.get("class", ""), where)
        if "rest_length" not in member and start in sites and end in sites:
            member["rest_length"] = math.dist(sites[start], sites[end])
        name = element.get("name", f"tendon{number}")
        members.append(NetworkMember(name, (start, end), member, where))
    return members


def _read_values(values: Mapping[str, str], group: str, where: str) -> dict[str, Any]:
    """Return the values of a tendon by the keys of a scene."""
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
    if len(lengths) == 2 and lengths[0] != lengths[1]:
        if lengths[0] != 0:
            problem, location = "a dead band that does not begin at 0 is not read", f"{where}.springlength"
            allowed = '"0 length" of a cable, or one length'
            hint = "give 0 as the first number: the tendon does not push then"
            value = values["springlength"]
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
    elif member["kind"] == "cable":
        member["tension_only"] = False
    if lengths[-1] != -1:
        member["rest_length"] = lengths[-1]
    return member


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


RELATIVE_TOLERANCE = 1e-9


def read_actuators(
    root: Element,
    defaults: Defaults,
    network: Network,
    tendons: Mapping[str, Mapping[str, Any]],
    frames: Mapping[str, NDArray[np.float64]],
    file: str,
) -> None:
    """Add loads and inputs to a network; actuators that are not read are listed in a note.

    tendons: values of members by name; frames (3, 3): rotations of sites that do not move. Actuators
    INPUT.TARGET of one input are one input again.
    """
    forces: dict[str, np.ndarray[Any, np.dtype[np.float64]]] = {}
    for node, force in network.loads:
        forces[node] = forces.get(node, np.zeros(3)) + force
    inputs: dict[tuple[str, str, tuple[float, ...]], dict[str, Any]] = {}
    unread = []
    for number, element in enumerate(child for section in root.iterfind("actuator") for child in section):
        where = f"{file}: actuator[{number}]"
        name = element.get("name", f"actuator{number}")
        values = defaults.inherit(element, "actuator")
        if not _is_plain(element.tag, values):
            unread.append(name)
            continue
        gear = read_numbers(values.get("gear", "1"), f"{where}.gear")
        gain = read_numbers(values.get("gainprm", "1"), f"{where}.gainprm")[0]
        bias = read_numbers(values.get("biasprm", "0"), f"{where}.biasprm")
        constant = values.get("biastype") == "affine" and gain == 0 and not any(bias[1:])
        node, tendon = values.get("site", ""), values.get("tendon", "")
        frame = frames.get(values.get("refsite", ""))
        if node in network.nodes and frame is not None and not any(gear[3:]):
            pull = frame @ [*gear, 0.0, 0.0][:3]
            defaults.record(element.tag, values, name)
            if constant:
                forces[node] = forces.get(node, np.zeros(3)) + bias[0] * pull
                continue
            if not any(bias) and np.any(pull):
                key = (name.partition(".")[0], "force", tuple((gain * pull).tolist()))
                entry = inputs.setdefault(key, {"kind": "force", "nodes": [], "direction": list(key[2])})
                entry["nodes"].append(node)
                continue
        stiffness = tendons.get(tendon, {}).get("spring_constant", 0.0)
        if stiffness and not any(bias) and abs(gain * gear[0] - stiffness) <= RELATIVE_TOLERANCE * stiffness:
            defaults.record(element.tag, values, name)
            key = (name.partition(".")[0], "rest_length", ())
            inputs.setdefault(key, {"kind": "rest_length", "members": []})["members"].append(tendon)
            continue
        unread.append(name)
    weight = max((float(np.abs(force).max()) for _, force in network.loads), default=0.0)
    weights = (float(np.abs(force).max()) for force in forces.values())
    scale = max(weight, max(weights, default=0.0))
    network.loads = [
        (n, f.tolist()) for n, f in forces.items() if np.abs(f).max() > RELATIVE_TOLERANCE * scale
    ]
    for (name, _, direction), entry in inputs.items():
        network.inputs.append({"name": name, **entry})
        size = float(np.linalg.norm(direction)) if direction else 1.0
        if abs(size - 1.0) > RELATIVE_TOLERANCE:
            network.notes.append(f"the input {name} is in newtons: {size:g} times the control of the model")
    if unread:
        network.notes.append(f"actuators that are not read: {name_list(unread, MAX_NAMED)}")


def _is_plain(tag: str, values: Mapping[str, str]) -> bool:
    """Return whether the force of an actuator is a constant, or in proportion to its control."""
    unread = list_unread(tag, values, by_range=True) if tag in ("general", "motor") else [tag]
    is_plain = values.get("biastype", "none") in ("none", "affine")
    return is_plain and all(key.endswith("range") for key in unread)
