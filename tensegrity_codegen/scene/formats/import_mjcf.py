"""Import of models of MuJoCo (MJCF): nodes and rigid bars of bodies, members of spatial tendons.

A body with slide joints along the axes of the world is a node; a free body (or one on a ball joint at the
world) with two sites that tendons use is a rigid bar with masses at its ends; sites of the world are
anchored.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.formats.files.documents import find_root, read_numbers, read_xml
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, Network, NetworkMember, build_result
from tensegrity_codegen.scene.formats.mjcf.defaults import Defaults, read_defaults
from tensegrity_codegen.scene.formats.mjcf.links import Link, read_links
from tensegrity_codegen.scene.formats.mjcf.tendons import read_actuators, read_coupled_masses, read_tendons
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.system.errors import InvalidValueError, name_list

WHAT = "a model of MuJoCo (MJCF)"
GRAVITY = "0 0 -9.81"  # of MuJoCo where a model gives none
RELATIVE_TOLERANCE = 1e-9  # of lengths, and of masses
MAX_OFFSET = 0.1  # of a rod's length, by which its centre may be off the line between its sites


def import_mjcf(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of a model of MuJoCo, and notes on parts that are not read."""
    path = Path(path)
    root, file = read_xml(path, WHAT), str(path)
    if root.tag != "mujoco":
        raise InvalidValueError("not a model of MuJoCo", where=file, given=root.tag[:80], allowed="<mujoco>")
    defaults = read_defaults(root, file)
    down = _read_gravity(root, defaults, file)
    network = Network(gravity=down if any(down) else None)
    links = read_links(root, defaults, _read_speeds(root, network, file), file)
    sites = {site: link for link in links for site in link.sites}
    members = read_tendons(root, defaults, {site: link.sites[site] for site, link in sites.items()}, file)
    used = list(dict.fromkeys(end for member in members for end in member.ends))
    for end in used:
        check_known(end, sites, "unknown site", "a site", file)
    bars = [bar for link in links if (bar := _add_link(network, link, set(used), file)) is not None]
    network.members = [*bars, *members]
    _couple(network, read_coupled_masses(root, defaults, file), down)
    values = {member.name: member.values for member in members}
    read_actuators(root, defaults, network, values, links[0].frames, file)
    damped = [m.values for m in members if "damping" in m.values and "tension_only" not in m.values]
    if any(damped_values["kind"] == "cable" for damped_values in damped):
        network.notes.append("in MuJoCo tendons keep their damping while slack, cables do not")
    network.notes += defaults.describe_unread()
    sections = ("equality", "contact", "sensor", "deformable", "asset", "custom")
    unread = [tag for tag in sections if any(True for section in root.iterfind(tag) for _ in section)]
    if unread:
        network.notes.append(f"sections that are not read: {', '.join(unread)}")
    if next(root.iter("geom"), None) is not None:
        network.notes.append("geoms are read for their masses only: there are no contacts")
    return build_result(network, path, name, gravity)


def _read_gravity(root: Element, defaults: Defaults, file: str) -> list[float]:
    """Return the gravity that the options of a model state [m/s2]."""
    options, flags = (
        {key: value for node in root.iterfind(path) for key, value in defaults.complete(node, tag).items()}
        for path, tag in (("option", "option"), ("option/flag", "flag"))
    )
    gravity = read_numbers(options.get("gravity", GRAVITY), f"{file}: option.gravity", (3,))
    return gravity if flags.get("gravity", "enable") == "enable" else [0.0] * 3


def _read_speeds(root: Element, network: Network, file: str) -> list[float] | None:
    """Return the speeds of the keyframe `start`, or else of the first one."""
    frames = list(root.iterfind("keyframe/key"))
    chosen = next((frame for frame in frames if frame.get("name") == "start"), frames[0] if frames else None)
    if chosen is None or not {"qpos", "qvel"} & chosen.attrib.keys():
        return None
    network.notes.append(
        f"velocities are those of the keyframe {chosen.get('name', '0')!r}, positions those of the model"
    )
    speeds = chosen.get("qvel")
    return None if speeds is None else read_numbers(speeds, f"{file}: keyframe.key.qvel")


def _add_link(network: Network, link: Link, used: set[str], file: str) -> NetworkMember | None:
    """Add the nodes of a link; return the rigid bar that it is, None of others."""
    chosen = [site for site in link.sites if site in used]
    where = f"{file}: body {link.name}"
    if link.kind == "static":
        for site in chosen:
            network.nodes[site] = {"position": link.sites[site].tolist(), "anchored": True}
        return None
    if not chosen:
        if link.mass > 0:
            network.notes.append(f"the body {link.name} is left out: no tendon acts on it")
        return None
    if link.kind == "sliding":
        _add_point(network, link, chosen, where)
        return None
    if len(chosen) == 1 and link.kind == "free":
        centre = np.linalg.norm(link.sites[chosen[0]] - link.centre)
        if centre > RELATIVE_TOLERANCE * (1 + float(np.linalg.norm(link.centre))):
            _refuse_sites(where, "one site away from the centre of mass")
        link.free[:] = True
        link.speed = link.speed + np.cross(link.spin, link.sites[chosen[0]] - link.position)
        _add_point(network, link, chosen, where)
        return None
    if link.kind == "ball" and len(chosen) == 1:
        chosen = [f"{link.name}_pivot", *chosen]
        link.sites[chosen[0]] = link.position
    if len(chosen) != 2:
        _refuse_sites(where, f"{len(chosen)} sites that tendons use")
    return _add_bar(network, link, chosen, where)


def _refuse_sites(where: str, given: str) -> None:
    problem = "a turning body that is no rod is not read"
    allowed = "two sites that tendons use, or one at the centre of mass"
    hint = "write the structure as a scene of bodies"
    raise InvalidValueError(problem, where=where, given=given, allowed=allowed, hint=hint)


def _add_point(network: Network, link: Link, chosen: Sequence[str], where: str) -> None:
    if len(chosen) > 1:
        problem = "a sliding body with several sites that tendons use is not read"
        allowed = "one site for each such body"
        raise InvalidValueError(problem, where=where, given=", ".join(chosen)[:80], allowed=allowed)
    node: dict[str, Any] = {"position": link.sites[chosen[0]].tolist()}
    if link.mass > 0:
        node["mass"] = link.mass
    held = "".join(letter for letter, free in zip("xyz", link.free, strict=True) if not free)
    node |= {"anchored": held} if held else {}
    node |= {"velocity": link.speed.tolist()} if link.speed.any() else {}
    network.nodes[chosen[0]] = node


def _add_bar(network: Network, link: Link, chosen: Sequence[str], where: str) -> NetworkMember:
    """Add the two ends of a rod with the masses that give its mass, centre and inertia; return the bar."""
    tips = np.array([link.sites[site] for site in chosen])
    length = float(np.linalg.norm(tips[1] - tips[0]))
    if not length or not link.mass > 0:
        problem = "the rod has no length or no mass"
        raise InvalidValueError(problem, where=where, allowed="two sites apart, and a mass")
    axis = (tips[1] - tips[0]) / length
    aside = float(np.linalg.norm(np.cross(link.centre - tips[0], axis)))
    if aside > MAX_OFFSET * length:
        _refuse_sites(where, f"a centre of mass {aside:.3g} m off the line between its two sites")
    if aside > RELATIVE_TOLERANCE * length:
        network.notes.append(
            f"the centre of mass of {link.name} is {aside:.3g} m off the line between its sites "
            f"{chosen[0]} and {chosen[1]}; the bar has it on that line"
        )
    bar_mass, ends = link.mass, np.zeros(2)
    if link.across is None:
        network.notes.append(f"the mass of {link.name} is spread evenly between {chosen[0]} and {chosen[1]}")
    else:
        s = float((link.centre - tips[0]) @ axis)
        bar_mass = 6 * (link.mass * s * (length - s) - link.across) / length**2
        ends[1] = (link.mass * s - bar_mass * length / 2) / length
        ends[0] = link.mass - bar_mass - ends[1]
        if min(bar_mass, *ends) < -RELATIVE_TOLERANCE * link.mass:
            network.notes.append(
                f"the inertia of {link.name} is not that of a rod: its mass is spread evenly"
            )
            bar_mass, ends = link.mass, np.zeros(2)
    for site, tip, mass in zip(chosen, tips, ends, strict=True):
        node: dict[str, Any] = {"position": tip.tolist()}
        node |= {"mass": float(mass)} if mass > RELATIVE_TOLERANCE * link.mass else {}
        speed = link.speed + np.cross(link.spin, tip - link.position)
        pivot = link.kind == "ball" and np.linalg.norm(tip - link.position) <= RELATIVE_TOLERANCE * length
        node |= {"anchored": True} if pivot else {}
        node |= {"velocity": speed.tolist()} if speed.any() and not pivot else {}
        network.nodes[site] = node
    if link.kind == "ball" and not any(network.nodes[site].get("anchored") for site in chosen):
        raise InvalidValueError("no site of the rod is at its ball joint", where=where)
    values: dict[str, Any] = {"kind": "bar"}
    values |= {"mass": float(bar_mass)} if bar_mass > RELATIVE_TOLERANCE * link.mass else {}
    name = link.name.removesuffix(".body")
    return NetworkMember(name, (chosen[0], chosen[1]), values, where)


def _couple(network: Network, masses: dict[str, float], gravity: Sequence[float]) -> None:
    """Give bars the own masses that fixed tendons couple, and take their shares off nodes and forces."""
    for position, member in enumerate(network.members):
        mass = masses.pop(member.name, 0.0)
        if not mass:
            continue
        values = {**member.values, "mass": mass, "kind": "bar"}
        values.pop("tension_only", None)
        network.members[position] = NetworkMember(member.name, member.ends, values, member.where)
        for end in member.ends:
            node = network.nodes[end]
            if node.get("anchored") is True:
                continue
            remaining_mass = node.get("mass", 0.0) - mass / 6
            if "mass" in node:
                node["mass"] = remaining_mass
                if remaining_mass <= RELATIVE_TOLERANCE * mass:
                    del node["mass"]
            if any(gravity):
                network.loads.append((end, [-mass / 3 * value for value in gravity]))
    if masses:
        network.notes.append(f"fixed tendons that are not read: {name_list(masses)}")


FORMAT = Format(
    title="models of MuJoCo (MJCF, XML)", sources=("model.xml",), endings=(".xml", ".mjcf"), read=import_mjcf,
    order=7, recognises=lambda path: find_root(path) == "mujoco",
)  # fmt: skip
