"""Actuators of MJCF: constant forces are loads, forces at sites inputs, forces on tendons rest lengths.

The force of an actuator on a tendon of length L is gain u + b0 - K L - C L', that of the tendon of stiffness
k and rest length r is -k (L - r). Both together are a spring of stiffness k + K and rest length
(k r + gain u + b0) / (k + K): exactly while the tendon is taut, with K = 0 or for a tendon that pushes too.
A servo (K > 0) on a tendon that only pulls is a spring of its own beside it, of stiffness K, damping C and
rest length (gain u + b0) / K.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.formats.files.documents import read_numbers
from tensegrity_codegen.scene.formats.imported import NameBook, Network, NetworkMember
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED, Defaults, list_unread
from tensegrity_codegen.scene.formats.mjcf.links import Link
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, name_list

RELATIVE_TOLERANCE = 1e-9
# Attributes of `general` that other actuators have fixed values of, whatever their class says.
_OWN = ("dyntype", "dynprm", "gaintype", "gainprm", "biastype", "biasprm")
_OF_TENDONS = ("ctrlrange", "dyntype", "dynprm", "forcerange", "kp", "kv", "timeconst")


@dataclass(frozen=True)
class _Actuator:
    """An actuator of force gear (gain u + bias0 + bias1 L + bias2 L') with a lag of a time constant [s]."""

    tag: str
    name: str
    values: Mapping[str, str]
    gear: list[float]
    gain: float
    bias: list[float]
    time_constant: float

    def is_plain(self, read: Sequence[str] = ()) -> bool:
        """Return whether all attributes that act are read, in `read` too, or ranges, which are named."""
        others = {key: value for key, value in self.values.items() if key not in read}
        return all(key.endswith("range") for key in list_unread(self.tag, others, by_range=True))


@dataclass
class _Found:
    """What the actuators of a model became.

    servos: members by the actuators whose forces they have; scaled: actuators by what their values are.
    """

    defaults: Defaults
    network: Network
    inputs: dict[str, dict[str, Any]] = field(default_factory=dict)
    actuators: list[dict[str, Any]] = field(default_factory=list)
    forces: dict[str, FloatArray] = field(default_factory=dict)
    servos: dict[str, str] = field(default_factory=dict)
    scaled: dict[str, list[str]] = field(default_factory=dict)


def read_actuators(
    root: Element,
    defaults: Defaults,
    network: Network,
    links: Sequence[Link],
    controls: Sequence[float],
    file: str,
) -> dict[str, str]:
    """Add loads, inputs, actuators and servos to a network; return members by the servos that they are.

    links: the world first; controls: at the start, of all actuators. Actuators INPUT.TARGET of one input are
    one input again; what is not read is listed in a note with the reason.
    """
    found = _Found(defaults, network)
    for node, force in network.loads:
        found.forces[node] = found.forces.get(node, np.zeros(3)) + force
    without_lag, forced = [], []
    unread: dict[str, list[str]] = {}
    targets = {"tendon": [element.get("name", "") for element in root.iterfind("tendon/*")]}
    targets["site"] = targets["refsite"] = [site for link in links for site in link.sites]
    for number, element in enumerate(child for section in root.iterfind("actuator") for child in section):
        where, name = f"{file}: actuator[{number}]", element.get("name", f"actuator{number}")
        values = defaults.inherit(element, "actuator")
        if element.tag != "general" and values.get("dyntype", "none") != "none":
            without_lag.append(name)
        for key, defined in targets.items():
            if key in values:
                check_known(values[key], defined, f"unknown {key}", f"a {key}", f"{where} {name[:60]}")
        control, actuator = controls[number], _read(element.tag, name, values, where)
        if actuator is None:
            unread.setdefault(f"the law of <{element.tag}>", []).append(name)
        elif _add_force(found, actuator, links[0].frames):
            forced += [name] if control and actuator.gain else []
        elif reason := _add_pull(found, actuator, where, control):
            unread.setdefault(reason, []).append(name)
    _close(network, found)
    for what, names in (
        ("servos are springs of their own on tendons that only pull, or have no stiffness; they push "
         "too where no force range forbids it, as in MuJoCo: ", list(found.servos)),
        *((f"actuators that are not read, for {reason}: ", names) for reason, names in unread.items()),
        ("the ctrl of the keyframe is not read of forces: ", forced),
        ("a default class gives a lag to actuators <general> only, as in MuJoCo, and not to ", without_lag),
    ):  # fmt: skip
        network.notes += [what + name_list(names, MAX_NAMED)] if names else []
    return found.servos


def _read(tag: str, name: str, values: Mapping[str, str], where: str) -> _Actuator | None:
    """Return an actuator, None if its law is not read."""

    def read(key: str, default: str) -> list[float]:
        return read_numbers(values.get(key, default), f"{where}.{key}")

    gain, bias, lag = read("gainprm", "1")[0], [0.0, 0.0, 0.0], 0.0
    if tag == "general":
        dynamics, kind = values.get("dyntype", "none"), values.get("biastype", "none")
        if dynamics not in ("none", "filter", "filterexact") or kind not in ("none", "affine"):
            return None
        bias = [*read("biasprm", "0"), 0.0, 0.0] if kind == "affine" else bias
        lag = read("dynprm", "1")[0] if dynamics != "none" else 0.0
    elif tag == "position":
        gain, lag = read("kp", str(gain))[0], read("timeconst", "0")[0]
        bias = [0.0, -gain, -read("kv", "0")[0]]
    elif tag == "velocity":
        gain = read("kv", str(gain))[0]
        bias = [0.0, 0.0, -gain]
    elif tag == "motor":
        gain = 1.0
    else:
        return None
    if tag != "general":
        values = {key: value for key, value in values.items() if key not in _OWN}
    return _Actuator(tag, name, values, read("gear", "1"), gain, bias, lag)


def _add_force(found: _Found, actuator: _Actuator, frames: Mapping[str, FloatArray]) -> bool:
    """Add the load or the input that an actuator at a site is; return whether it is one."""
    site, frame = actuator.values.get("site", ""), frames.get(actuator.values.get("refsite", ""))
    if frame is None or not found.network.has_node(site) or not actuator.is_plain():
        return False
    constant, gain = actuator.bias[0], actuator.gain
    pull = frame @ [*actuator.gear, 0.0, 0.0][:3]
    if any(actuator.bias[1:]) or any(actuator.gear[3:]) or (gain and (constant or not np.any(pull))):
        return False
    found.defaults.record(actuator.tag, actuator.values, actuator.name)
    if not gain:
        found.forces[site] = found.forces.get(site, np.zeros(3)) + constant * pull
        return True
    direction, stem = (gain * pull).tolist(), actuator.name.partition(".")[0]
    entry = {"name": stem, "kind": "force", "nodes": [], "direction": direction}
    found.inputs.setdefault(f"{stem} {direction}", entry)["nodes"].append(site)
    return True


def _add_pull(found: _Found, actuator: _Actuator, where: str, control: float) -> str:
    """Add what an actuator on a tendon is: a change of rest length, of the tendon or of a servo beside it.

    Return the reason why it is none, "" where it was added.
    """
    members, values, gear = found.network.members, actuator.values, actuator.gear[0]
    place = next((k for k, member in enumerate(members) if member.name == values.get("tendon", "")), None)
    stiffness, damping = (-gear * gear * bias for bias in actuator.bias[1:3])
    if place is None:
        return "on no spatial tendon, nor on a site with a fixed refsite"
    if not actuator.is_plain(_OF_TENDONS):
        return "attributes that are not read"
    if min(stiffness, damping) < 0:
        return "a stiffness or damping below 0, such as kp or kv"
    tendon, gain, constant = members[place], actuator.gain * gear, actuator.bias[0] * gear
    member = dict(tendon.values)
    own = member.get("spring_constant", 0.0)
    if not stiffness + own or not gain:
        return "a gain of 0" if not gain else "a tendon without stiffness"
    limits, forces = (
        read_numbers(values[f"{kind}range"], f"{where}.{kind}range", (2,))
        if found.defaults.is_limited(values, kind) else None
        for kind in ("ctrl", "force")
    )  # fmt: skip
    for kind, ends in (("ctrl", limits), ("force", forces)):
        if ends and ends[0] > ends[1]:
            problem, allowed = "the ends of the range are exchanged", "the lower end, then the upper one"
            raise InvalidValueError(
                problem, where=f"{where} {actuator.name[:60]}.{kind}range", given=ends, allowed=allowed
            )
    control = min(max(control, limits[0]), limits[1]) if limits else control
    is_servo = bool(stiffness) and not (own and member.get("tension_only") is False and forces is None)
    base = 0.0 if is_servo else own * member["rest_length"]
    total = stiffness if is_servo else own + stiffness
    rest = (base + gain * control + constant) / total
    if rest <= 0:
        if not stiffness:
            return "a rest length of 0 or less at the start"
        rest = member["rest_length"]
        control = (total * rest - base - constant) / gain
    target = tendon.name
    if is_servo and own:
        target = f"{tendon.name}_servo"
        while any(other.name == target for other in members):
            target += "_"
        member = {"kind": "cable"}
    if is_servo:
        member.pop("tension_only", None)
        pushes = forces is None or max(gear * force for force in forces) > 0
        member |= {"tension_only": False} if pushes and len(tendon.ends) == 2 else {}
        found.servos[actuator.name] = target
    member |= {"spring_constant": total, "rest_length": rest}
    member |= {"damping": member.get("damping", 0.0) + damping} if damping else {}
    changed = NetworkMember(target, tendon.ends, member, tendon.where, tendon.place_of)
    members[place : place + 1] = [changed] if target == tendon.name else [tendon, changed]
    unread = {key: value for key, value in values.items() if key not in _OF_TENDONS or key == "forcerange"}
    found.defaults.record(actuator.tag, unread, actuator.name)
    _command(found, actuator, target, rest, gain / total, control, limits)
    return ""


def _command(
    found: _Found, actuator: _Actuator, target: str, rest: float, gain: float, control: float,
    limits: list[float] | None,
) -> None:  # fmt: skip
    """Add the input or the actuator that changes the rest length of a member by its control."""
    entry: dict[str, Any] = {"name": actuator.name, "members": [target]}
    factor = "" if abs(gain - 1.0) <= RELATIVE_TOLERANCE else f"{gain:g} m times "
    less = f"(control - {control:g})" if control else "the control of the model"
    if limits is None and not actuator.time_constant:
        entry = {"name": actuator.name.partition(".")[0], "kind": "rest_length", "members": [], "gain": []}
        entry = found.inputs.setdefault(f"{entry['name']} rest_length", entry)
        entry["members"].append(target)
        entry["gain"].append(gain)
        factor = ""
    else:
        found.actuators.append(entry)
    if factor or control:
        found.scaled.setdefault(f"values of actuators are {factor}{less}: ", []).append(actuator.name)
    if limits is not None:
        ends = sorted(rest + gain * (limit - control) for limit in limits)
        if 0 < ends[0] < ends[1]:
            entry["range"] = ends
        else:
            note = "ranges that reach rest lengths of 0 are left out, of "
            found.scaled.setdefault(note, []).append(actuator.name)
    if actuator.time_constant:
        entry["time_constant"] = actuator.time_constant


def _close(network: Network, found: _Found) -> None:
    """Add loads, inputs, actuators and notes on them to the network."""
    all_forces: list[Any] = [*found.forces.values(), *(force for _, force in network.loads)]
    least = RELATIVE_TOLERANCE * max((float(np.abs(force).max()) for force in all_forces), default=0.0)
    network.loads = [(n, force.tolist()) for n, force in found.forces.items() if np.abs(force).max() > least]
    book = NameBook("u")
    for entry in [*found.inputs.values(), *found.actuators]:
        if all(abs(gain - 1.0) <= RELATIVE_TOLERANCE for gain in entry.get("gain", ())):
            entry.pop("gain", None)
        entry["name"] = book.add(entry["name"])
        size = float(np.linalg.norm(entry.get("direction", [1.0])))
        if abs(size - 1.0) > RELATIVE_TOLERANCE:
            network.notes.append(
                f"the input {entry['name']} is in newtons: {size:g} times the control of the model"
            )
    network.inputs += found.inputs.values()
    network.control |= {"actuators": found.actuators} if found.actuators else {}
    network.notes += book.notes("inputs were")
    network.notes += [note + name_list(names, MAX_NAMED) for note, names in found.scaled.items()]
