"""Sensors of MJCF: positions and velocities of sites, gyros, lengths and forces of tendons."""

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.formats.files.documents import read_number
from tensegrity_codegen.scene.formats.imported import NameBook, Network
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED
from tensegrity_codegen.scene.formats.mjcf.links import Link
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.system.errors import name_list

KINDS = {
    "framepos": "node_position", "framelinvel": "node_velocity", "velocimeter": "node_velocity",
    "gyro": "angular_velocity", "tendonpos": "member_length", "actuatorfrc": "member_tension",
}  # fmt: skip


def list_sites(root: Element) -> list[str]:
    """Return the sites that sensors of positions and velocities name."""
    elements = [child for section in root.iterfind("sensor") for child in section]
    return [_find_site(element) for element in elements if KINDS.get(element.tag, "").startswith("node")]


def _find_site(element: Element) -> str:
    by_name = element.get("objname", "") if element.get("objtype") == "site" else ""
    return element.get("site", by_name) if "refname" not in element.attrib else ""


def read_sensors(
    root: Element, network: Network, links: Sequence[Link], servos: Mapping[str, str], file: str
) -> None:
    """Add the sensors to a network; those that are not read are listed in a note.

    servos: members by the actuators whose forces they have.
    """
    tendons = [element.get("name", "") for element in root.iterfind("tendon/*")]
    owners = {site: link for link in links for site in link.sites}
    members = {member.name for member in network.members}
    book, sensors, turned = NameBook("s"), [], []
    unread: dict[str, list[str]] = {}
    for number, element in enumerate(child for section in root.iterfind("sensor") for child in section):
        kind, site = KINDS.get(element.tag, ""), _find_site(element)
        name = element.get("name", f"{element.tag}{number}")
        entry: dict[str, Any] = {"kind": kind, "name": name}
        targets = (("site", site, owners), ("tendon", element.get("tendon"), tendons))
        for target_kind, target_name, defined in targets:
            if target_name:
                problem, allowed = f"unknown {target_kind}", f"a {target_kind}"
                check_known(target_name, defined, problem, allowed, f"{file}: sensor {name[:60]}")
        servo = servos.get(element.get("actuator", ""), "")
        target = servo if kind == "member_tension" else element.get("tendon", "")
        if kind.startswith("node") and network.has_node(site):
            entry["nodes"] = [site]
            turned += [name] if element.tag == "velocimeter" else []
        elif kind == "angular_velocity" and (body := owners.get(site)) and body.name in network.bodies:
            entry["bodies"] = [body.name]
            turned += [name] if not np.allclose(body.frames[site], np.eye(3), atol=1e-9) else []
        elif kind.startswith("member") and target in members:
            entry["members"] = [target]
        else:
            reason = "a site or tendon that is not one of a body, a node or a member"
            if not kind:
                reason = f"the kind <{element.tag}>"
            elif kind == "member_tension":
                reason = "an actuator that is no servo"
            unread.setdefault(reason, []).append(name)
            continue
        entry["name"] = book.add(name)
        noise = read_number(element.get("noise", "0"), f"{file}: sensor[{number}].noise")
        sensors.append(entry | ({"noise": noise} if noise > 0 else {}))
    network.control |= {"sensors": sensors} if sensors else {}
    network.notes += book.notes("sensors were")
    for what, names in (
        ("sensors in the axes of their site in MuJoCo, here of the world, gyros of the body: ", turned),
        *((f"sensors that are not read, for {reason}: ", names) for reason, names in unread.items()),
    ):
        network.notes += [what + name_list(names, MAX_NAMED)] if names else []
