"""Import of models of MuJoCo (MJCF): nodes, rigid bars and bodies, members of spatial tendons.

A body with slide joints along the axes of the world is a node; a free body (or one on a ball joint at the
world) that is a rod whose spin moves nothing is a rigid bar with masses at its ends; any other free body is
a rigid body; sites of the world are anchored. A plane is the ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.describe import describe_part, find_quaternion
from tensegrity_codegen.scene.formats.files.documents import find_root, read_numbers
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, Network, NetworkMember, build_result
from tensegrity_codegen.scene.formats.mjcf.actuators import read_actuators
from tensegrity_codegen.scene.formats.mjcf.contacts import Ball, read_ground
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED, Defaults, read_defaults
from tensegrity_codegen.scene.formats.mjcf.frames import read_compiler
from tensegrity_codegen.scene.formats.mjcf.include import read_model
from tensegrity_codegen.scene.formats.mjcf.links import Link, read_links
from tensegrity_codegen.scene.formats.mjcf.sensors import list_sites, read_sensors
from tensegrity_codegen.scene.formats.mjcf.tendons import read_coupled_masses, read_tendons
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, name_list

WHAT = "a model of MuJoCo (MJCF)"
GRAVITY = "0 0 -9.81"  # of MuJoCo where a model gives none
UNREAD = ("contact/exclude", "asset/hfield", "custom")  # sections that are named where a model has them
RELATIVE_TOLERANCE = 1e-9  # of lengths, and of masses
MAX_OFFSET = 0.1  # of a thin rod's length, by which its centre may be off the line between its sites
THIN = 2e-5  # inertia of a thin rod about itself over that across it, at most: its spin is left out
EXPORTED = ".body"  # at the end of the names of bodies that are bars without spin, as `export` writes them
PRECESSION = 1e-3  # rad/s, of the axis of a rod by its own spin, at most: its spin is left out
STRAIGHT = 1e-5  # of a rod's length and inertia, by which a thicker one may differ from one without spin


def import_mjcf(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of a model of MuJoCo, and notes on parts that are not read."""
    path, file = Path(path), str(path)
    root = read_model(path, WHAT)
    defaults = read_defaults(root, file)
    down = _read_gravity(root, defaults, file)
    network = Network(gravity=down if any(down) else None, parallel=True)
    speeds, controls = _read_start(root, defaults, network, file)
    links = read_links(root, defaults, read_compiler(root, defaults, file), speeds, file)
    places = {site: link.locate(site) for link in links for site in link.sites}
    tendons = read_tendons(root, defaults, network, places, file)
    ground, balls, notes = read_ground(root, defaults, links, down if gravity is None else gravity)
    used = {end for member in tendons for end in member.ends}
    acting = [element.get("site", "") for element in root.iterfind("actuator/*")]
    seen = used | {*acting, *list_sites(root)}
    touching: list[Any] = []
    added = [_add_link(network, link, used, seen, balls.get(link.name, []), touching, file) for link in links]
    bars = [bar for bar in added if bar is not None]
    network.members = [*bars, *tendons]
    _couple(network, read_coupled_masses(root, defaults, file), down)
    servos = read_actuators(root, defaults, network, links, controls, file)
    _drop_loose(network, {element.get("tendon", "") for element in root.iterfind("actuator/*")}, file)
    if touching and ground is not None:
        network.ground = {**ground, "contacts": [place for place, _ in touching]}
        radii = {radius for place, radius in touching if isinstance(place, str)}
        network.ground |= {"radius": max(radii)} if any(radii) else {}
        note = "nodes touch the ground with different radii: all have the largest"
        network.notes += [*notes, note] if len(radii) > 1 else notes
    read_sensors(root, network, links, servos, file)
    values = [m.values for m in network.members if "damping" in m.values and "tension_only" not in m.values]
    if any(value["kind"] == "cable" for value in values):
        network.notes.append("in MuJoCo tendons keep their damping while slack, cables do not")
    network.notes += [
        f"{attribute} is not read, though it acts in MuJoCo: {name_list(names, MAX_NAMED)}"
        for attribute, names in defaults.unread.items()
    ]
    unread = [tag for tag in UNREAD if next(root.iterfind(tag), None) is not None]
    network.notes += [f"sections that are not read: {', '.join(unread)}"] if unread else []
    _note_geoms(network, links)
    return build_result(network, path, name, gravity)


def _drop_loose(network: Network, pulled: set[str], file: str) -> None:
    """Leave out tendons without stiffness, which a note lists, and anchors that nothing joins then.

    pulled: tendons of actuators. Raises InvalidValueError where these are all that hold the model together.
    """
    loose = [m for m in network.members if m.values["kind"] != "bar" and "spring_constant" not in m.values]
    network.members = [member for member in network.members if not any(member is other for other in loose)]
    others = any("spring_constant" in member.values for member in network.members)
    if not others and (acted := [member.name for member in loose if member.name in pulled]):
        problem, given = "tendons that have a force and no stiffness are not read", acted[0][:80]
        hint = "give them the stiffness of the cables; their motors change rest lengths then"
        raise InvalidValueError(problem, where=f"{file}: tendon", given=given, allowed="stiffness", hint=hint)
    joined = {end for member in network.members for end in member.ends}
    for node in [node for node in network.nodes if network.nodes[node].get("anchored") is True]:
        if node not in joined:
            del network.nodes[node]
    listed = name_list([member.name for member in loose], MAX_NAMED)
    note = f"tendons without stiffness are left out, with their forces: {listed}"
    network.notes += [note] if loose else []


def _note_geoms(network: Network, links: Sequence[Link]) -> None:
    """Add the notes on meshes and contacts that are not read."""
    geoms = [(geom, link) for link in links for geom in link.geoms]
    for kind, title in (("mesh", "meshes"), ("ellipsoid", "pictures of ellipsoids")):
        names = [geom.name or link.name for geom, link in geoms if geom.kind == kind]
        network.notes += [f"{title} are left out: {name_list(names, MAX_NAMED)}"] if names else []
    note = "contacts are those with the ground: bodies do not touch each other"
    note = note if network.ground else "geoms are read for their masses only: there are no contacts"
    network.notes += [note] if geoms else []


def _read_gravity(root: Element, defaults: Defaults, file: str) -> list[float]:
    """Return the gravity that the options of a model state [m/s2]."""
    options, flags = (
        {key: value for node in root.iterfind(path) for key, value in defaults.complete(node, tag).items()}
        for path, tag in (("option", "option"), ("option/flag", "flag"))
    )
    gravity = read_numbers(options.get("gravity", GRAVITY), f"{file}: option.gravity", (3,))
    return gravity if flags.get("gravity", "enable") == "enable" else [0.0] * 3


def _read_start(
    root: Element, defaults: Defaults, network: Network, file: str
) -> tuple[list[float] | None, list[float]]:
    """Return the speeds of the keyframe `start`, or else of the first one, and its controls, 0 without."""
    frames = list(root.iterfind("keyframe/key"))
    chosen = next((frame for frame in frames if frame.get("name") == "start"), frames[0] if frames else None)
    count = sum(len(section) for section in root.iterfind("actuator"))
    if chosen is None:
        return None, [0.0] * count
    values = defaults.complete(chosen, "key", owner="0")
    name = values.get("name", "0")
    if {"qpos", "qvel"} & values.keys():
        network.notes.append(f"velocities are those of the keyframe {name!r}, positions those of the model")
    controls = [0.0] * count
    if "ctrl" in values:
        controls = read_numbers(values["ctrl"], f"{file}: keyframe.key.ctrl", (count,))
        network.notes.append(f"rest lengths at the start are those of the ctrl of the keyframe {name!r}")
    speeds = values.get("qvel")
    return None if speeds is None else read_numbers(speeds, f"{file}: keyframe.key.qvel"), controls


def _add_link(
    network: Network, link: Link, used: set[str], seen: set[str],
    balls: Sequence[Ball], touching: list[Any], file: str,
) -> NetworkMember | None:  # fmt: skip
    """Add the nodes or the body of a link; return the rigid bar that it is, None of others.

    used: sites of tendons; seen: those of sensors and actuators too; balls: that touch the ground; touching
    gets the contacts, nodes or bodies with points, and their radii.
    """
    chosen = [site for site in link.sites if site in used]
    where = f"{file}: body {link.name}"
    if link.kind == "static":
        for site in chosen:
            network.nodes[site] = {"position": link.sites[site].tolist(), "anchored": True}
        return None
    if link.kind == "sliding" and not chosen:
        if link.mass > 0:
            network.notes.append(f"the body {link.name} is left out: no tendon acts on it")
        return None
    if link.kind == "ball" and len(chosen) == 1:
        chosen = [f"{link.name}_pivot", *chosen]
        link.sites[chosen[0]] = np.zeros(3)
    if link.kind == "ball" and len(chosen) != 2:
        problem, allowed = (
            "a body on a ball joint that is no rod is not read",
            "two sites, or the joint and one",
        )
        raise InvalidValueError(problem, where=where, given=f"{len(chosen)} sites", allowed=allowed)
    is_centred = len(chosen) == 1 and np.linalg.norm(link.sites[chosen[0]] - link.centre) <= (
        RELATIVE_TOLERANCE * (1 + float(np.linalg.norm(link.centre)))
    )
    if link.kind == "free" and not _is_bar(link, chosen, balls) and (balls or not is_centred):
        _add_body(network, link, [site for site in link.sites if site in seen], balls, touching, where)
        return None
    for ball in balls:
        ends = [site for site in chosen if np.allclose(link.sites[site], ball.position, atol=1e-9)]
        touching += [(site, ball.radius) for site in ends]
        if not ends:
            network.notes.append(f"a contact of {link.name} away from its nodes is left out: {ball.name}")
    if len(chosen) == 2:
        return _add_bar(network, link, chosen, where)
    if link.kind == "free":
        link.free[:] = True
        link.speed = link.move(link.locate(chosen[0]))
    _add_point(network, link, chosen, where)
    return None


@dataclass(frozen=True)
class _Rod:
    """A link as a rod between two of its sites.

    aside: of its centre from the line between them [m]; about, across: inertia about that line and across it
    [kg m2]; skew: by how much its inertia is not that of a round rod; masses: of a bar and of its two ends
    that have its mass, centre and inertia together [kg].
    """

    length: float
    axis: FloatArray
    aside: float
    about: float
    across: float
    skew: float
    masses: list[float]


def _measure(link: Link, chosen: Sequence[str]) -> _Rod:
    """Return a link as a rod; of length 0 where its sites are one point."""
    start, end = (link.sites[site] for site in chosen)
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / (length or 1.0)
    about = float(axis @ link.inertia @ axis)
    across = (float(np.trace(link.inertia)) - about) / 2
    skew = np.abs(link.inertia - across * np.eye(3) - (about - across) * np.outer(axis, axis)).max()
    s = float((link.centre - start) @ axis)
    bar = 6 * (link.mass * s * (length - s) - across) / (length or 1.0) ** 2
    far = (link.mass * s - bar * length / 2) / (length or 1.0)
    aside = float(np.linalg.norm(np.cross(link.centre - start, axis)))
    return _Rod(length, axis, aside, about, across, float(skew), [bar, link.mass - bar - far, far])


def _is_bar(link: Link, chosen: Sequence[str], balls: Sequence[Ball]) -> bool:
    """Return whether a free body moves as a rigid bar between its two sites, whatever its spin."""
    if len(chosen) != 2 or link.name.endswith(EXPORTED):
        return len(chosen) == 2
    rod = _measure(link, chosen)
    if balls or not rod.length:
        return False
    if rod.about <= THIN * rod.across and rod.aside <= MAX_OFFSET * rod.length:
        return True
    spin = abs(float(link.rotation.T @ link.spin @ rod.axis))
    return (
        rod.aside <= STRAIGHT * rod.length
        and rod.skew <= STRAIGHT * rod.across
        and rod.about * spin <= PRECESSION * rod.across
        and min(rod.masses) >= -RELATIVE_TOLERANCE * link.mass
    )


def _add_body(
    network: Network, link: Link, sites: Sequence[str], balls: Sequence[Ball], touching: list[Any], where: str
) -> None:
    """Add a rigid body with the points that something names, and those that touch the ground."""
    if not link.mass > 0:
        problem = "the body has no mass"
        raise InvalidValueError(problem, where=where, allowed="geoms with a mass, or an element inertial")
    inertia = (link.inertia + link.inertia.T) / 2
    is_diagonal = np.abs(inertia - np.diag(np.diag(inertia))).max() <= 1e-15 * np.abs(inertia).max()
    body: dict[str, Any] = {
        "kind": "rigid",
        "mass": float(link.mass),
        "inertia": (np.diag(inertia) if is_diagonal else inertia).tolist(),
    }
    body |= {"centre_of_mass": link.centre.tolist()} if link.centre.any() else {}
    parts = [describe_part(part) for geom in link.geoms if (part := geom.to_part()) and part.size[0] > 0]
    body |= {"parts": parts} if parts else {}
    names = {site: site.removeprefix(f"{link.name}_") for site in link.sites}
    names = {
        site: name if list(names.values()).count(name) == 1 and name else site for site, name in names.items()
    }
    points: dict[str, Any] = {names[site]: link.sites[site].tolist() for site in sites}
    for ball in balls:
        beside = [site for site in link.sites if np.allclose(link.sites[site], ball.position, atol=1e-9)]
        name = names[beside[0]] if beside else ball.name
        while isinstance(points.get(name), dict) or (name in points and not beside):
            name += "_"
        points[name] = {"position": ball.position.tolist(), "radius": ball.radius}
        touching.append(((link.name, name), ball.radius))
    body |= {"points": points, "position": link.position.tolist()}
    if not np.array_equal(link.rotation, np.eye(3)):
        body["quaternion"] = find_quaternion(link.rotation)
    speed = link.move(link.place(link.centre))
    body |= {"centre_velocity": speed.tolist()} if speed.any() else {}
    body |= {"angular_velocity": (link.rotation.T @ link.spin).tolist()} if link.spin.any() else {}
    network.bodies[link.name] = body
    network.points |= {site: (link.name, names[site]) for site in sites}


def _add_point(network: Network, link: Link, chosen: Sequence[str], where: str) -> None:
    if len(chosen) > 1:
        problem = "a sliding body with several sites that tendons use is not read"
        allowed = "one site for each such body"
        raise InvalidValueError(problem, where=where, given=", ".join(chosen)[:80], allowed=allowed)
    node: dict[str, Any] = {"position": link.locate(chosen[0]).tolist()}
    if link.mass > 0:
        node["mass"] = link.mass
    held = "".join(letter for letter, free in zip("xyz", link.free, strict=True) if not free)
    node |= {"anchored": held} if held else {}
    node |= {"velocity": link.speed.tolist()} if link.speed.any() else {}
    network.nodes[chosen[0]] = node


def _add_bar(network: Network, link: Link, chosen: Sequence[str], where: str) -> NetworkMember:
    """Add the two ends of a rod with the masses that give its mass, centre and inertia; return the bar."""
    rod = _measure(link, chosen)
    if not rod.length or not link.mass > 0:
        problem = "the rod has no length or no mass"
        raise InvalidValueError(problem, where=where, allowed="two sites apart, and a mass")
    if rod.aside > RELATIVE_TOLERANCE * rod.length:
        network.notes.append(
            f"the centre of mass of {link.name} is {rod.aside:.3g} m off the line between its sites "
            f"{chosen[0]} and {chosen[1]}; the bar has it on that line"
        )
    bar_mass, *ends = rod.masses
    if min(rod.masses) < -RELATIVE_TOLERANCE * link.mass:
        network.notes.append(f"the inertia of {link.name} is not that of a rod: its mass is spread evenly")
        bar_mass, ends = link.mass, [0.0, 0.0]
    for site, mass in zip(chosen, ends, strict=True):
        tip = link.locate(site)
        node: dict[str, Any] = {"position": tip.tolist()}
        node |= {"mass": float(mass)} if mass > RELATIVE_TOLERANCE * link.mass else {}
        speed = link.move(tip)
        pivot = link.kind == "ball" and np.linalg.norm(tip - link.position) <= RELATIVE_TOLERANCE * rod.length
        node |= {"anchored": True} if pivot else {}
        node |= {"velocity": speed.tolist()} if speed.any() and not pivot else {}
        network.nodes[site] = node
    if link.kind == "ball" and not any(network.nodes[site].get("anchored") for site in chosen):
        raise InvalidValueError("no site of the rod is at its ball joint", where=where)
    values: dict[str, Any] = {"kind": "bar"}
    values |= {"mass": float(bar_mass)} if bar_mass > RELATIVE_TOLERANCE * link.mass else {}
    name = link.name.removesuffix(EXPORTED)
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
            node = network.nodes.get(end, {"anchored": True})
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
