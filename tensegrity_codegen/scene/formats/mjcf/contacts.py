"""The ground of a model of MuJoCo: a plane, and the balls of moving bodies that can touch it.

MuJoCo's reference acceleration of a contact of depth r is -b r' - K d r, for each kilogram of effective mass,
with the impedance d(r) from dmin to dmax; solref = (-k, -c) gives K = k / dmax^2 and b = c / dmax, positive
solref = (time constant T, damping ratio z) K = 1 / (dmax T z)^2 and b = 2 / (dmax T). A mass at rest has the
depth g (1 - d) / (d^2 K), and the restitution follows from the damping ratio, whatever the mass.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from tensegrity_codegen.scene.formats.files.documents import read_number, read_numbers
from tensegrity_codegen.scene.formats.mjcf.defaults import MAX_NAMED, Defaults
from tensegrity_codegen.scene.formats.mjcf.geoms import Geom
from tensegrity_codegen.scene.formats.mjcf.links import Link
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, name_list

SPEED = 1.0  # m/s, of the impact for which the restitution is stated
FEET, DEEPEST = 3, 0.2  # on as many contacts balls may sink in by this part of their radius
OUTER = 12  # of a link's largest balls may have others inside
INSIDE = 1e-9  # m, by which a ball may stand out of others and be left out
SOLREF, SOLIMP, FRICTION = "0.02 1", "0.9 0.95 0.001 0.5 2", "1 0.005 0.0001"


@dataclass(frozen=True)
class Ball:
    """A ball of a link that can touch the ground; position (3,): of its centre in the link's frame [m]."""

    name: str
    position: FloatArray
    radius: float


@dataclass(frozen=True)
class _Contact:
    """Values of a contact of a geom with the plane."""

    friction: float
    solref: tuple[float, float]
    solimp: tuple[float, ...]
    condim: int


def read_ground(
    root: Element, defaults: Defaults, links: Sequence[Link], gravity: Sequence[float]
) -> tuple[dict[str, Any] | None, dict[str, list[Ball]], list[str]]:
    """Return the values of the ground, None without one; the balls by link; and notes."""
    planes = [geom for geom in links[0].geoms if geom.kind == "plane"]
    moving = [(link, geom) for link in links[1:] for geom in link.geoms]
    flags = root.iterfind("option/flag")
    if any("disable" in (flag.get("contact"), flag.get("constraint")) for flag in flags):
        return None, {}, []
    pairs = {
        frozenset((pair.get("geom1", ""), pair.get("geom2", ""))): defaults.complete(pair, "pair")
        for pair in root.iterfind("contact/pair")
    }
    only_pairs = any(option.get("collision") == "predefined" for option in root.iterfind("option"))
    for geom in links[0].geoms:
        if geom.kind == "hfield" and not only_pairs and any(_collide(geom, other) for _, other in moving):
            problem, allowed = "a height field is not read", "a plane as the ground"
            hint = "replace the height field by a plane, or give it contype and conaffinity 0"
            raise InvalidValueError(problem, where=geom.where, given=geom.name, allowed=allowed, hint=hint)
    for plane in planes:
        touching = [
            (link, geom, _mix(plane, geom, pairs.get(frozenset((plane.name, geom.name)), {})))
            for link, geom in moving
            if frozenset((plane.name, geom.name)) in pairs or (not only_pairs and _collide(plane, geom))
        ]
        if touching:
            return _build(plane, touching, links, gravity)
    return None, {}, []


def _collide(one: Geom, other: Geom) -> bool:
    def bits(geom: Geom, key: str) -> int:
        return int(read_number(geom.values.get(key, "1"), f"{geom.where}.{key}"))

    affine = bits(one, "contype") & bits(other, "conaffinity")
    return bool(affine or bits(other, "contype") & bits(one, "conaffinity"))


def _read_values(values: Mapping[str, str], where: str) -> _Contact:
    solref = (*read_numbers(values.get("solref", SOLREF), f"{where}.solref"), 1.0)[:2]
    given = read_numbers(values.get("solimp", SOLIMP), f"{where}.solimp")
    solimp = (*given, *read_numbers(SOLIMP, "solimp")[len(given) :])
    friction = read_numbers(values.get("friction", FRICTION), f"{where}.friction")[0]
    condim = int(read_number(values.get("condim", "3"), f"{where}.condim"))
    return _Contact(friction, (solref[0], solref[1]), tuple(solimp), condim)


def _mix(plane: Geom, geom: Geom, pair: Mapping[str, str]) -> _Contact:
    """Return the values of a contact, as MuJoCo combines those of two geoms; those of a pair go before."""
    stated = _read_values(pair, f"{geom.where}: contact.pair")
    own = {key: getattr(stated, key) for key in ("friction", "solref", "solimp", "condim") if key in pair}
    one, other = (_read_values(item.values, item.where) for item in (plane, geom))
    priorities, mixes = (
        [read_number(item.values.get(key, default), f"{item.where}.{key}") for item in (plane, geom)]
        for key, default in (("priority", "0"), ("solmix", "1"))
    )
    if priorities[0] != priorities[1]:
        return replace(one if priorities[0] > priorities[1] else other, **own)
    share = mixes[0] / sum(mixes) if sum(mixes) > 0 else 0.5

    def blend(first: Sequence[float], second: Sequence[float]) -> tuple[float, ...]:
        return tuple(share * a + (1 - share) * b if a != b else a for a, b in zip(first, second, strict=True))

    standard = one.solref[0] > 0 and other.solref[0] > 0
    solref = blend(one.solref, other.solref) if standard else tuple(map(min, one.solref, other.solref))
    friction, condim = max(one.friction, other.friction), max(one.condim, other.condim)
    mixed = _Contact(friction, (solref[0], solref[1]), blend(one.solimp, other.solimp), condim)
    return replace(mixed, **own)


def _build(
    plane: Geom, touching: Sequence[tuple[Link, Geom, _Contact]], links: Sequence[Link],
    gravity: Sequence[float],
) -> tuple[dict[str, Any], dict[str, list[Ball]], list[str]]:  # fmt: skip
    """Return what `read_ground` does, for the geoms that touch a plane and the values of their contacts."""
    normal = np.where(np.abs(plane.rotation[:, 2]) < 1e-15, 0.0, plane.rotation[:, 2])
    balls: dict[str, list[Ball]] = {}
    unknown: list[str] = []
    flat: set[int] = set()
    for link, geom, _ in touching:
        found = _find_balls(geom, f"contact{len(balls.get(link.name, [])) + 1}")
        balls.setdefault(link.name, []).extend(found)
        unknown += [] if found else [geom.name or geom.kind]
        flat |= {id(ball) for ball in found} if geom.kind == "cylinder" else set()
    balls = {name: kept for name, several in balls.items() if (kept := _drop_inner(several))}
    radii = [ball.radius for several in balls.values() for ball in several]
    counts = Counter(contact for _, _, contact in touching)
    contact = counts.most_common(1)[0][0]
    down = abs(float(np.asarray(gravity) @ normal)) or 9.81
    values, note = _read_stiffness(contact, down, sum(link.mass for link in links), radii)
    ground = {"normal": normal.tolist(), "offset": float(normal @ plane.position) + 0.0, **values}
    ground["friction"] = contact.friction if contact.condim > 1 else 0.0
    fixed = [geom for geom in links[0].geoms if geom is not plane and geom.kind != "hfield"]
    others = name_list([geom.name or geom.kind for geom in fixed], MAX_NAMED)
    left = {id(ball) for several in balls.values() for ball in several}
    notes = {
        note: True,
        "cylinders touch the ground by balls of their radius at their two ends": bool(flat & left),
        f"contacts have {len(counts)} different values: all have the most common": len(counts) > 1,
        f"friction against rolling and turning (condim {contact.condim}) is not read": contact.condim > 3,
        f"geoms whose contact with the ground is not read: {name_list(unknown, MAX_NAMED)}": bool(unknown),
        f"fixed geoms beside the ground, which nothing touches here: {others}": bool(fixed),
    }
    return ground, balls, [note for note, holds in notes.items() if holds]


def _find_balls(geom: Geom, fallback: str) -> list[Ball]:
    """Return the balls that touch as a geom does: of a box its corners, of a capsule or cylinder its ends."""
    name = geom.name or fallback
    if geom.kind == "sphere" or (geom.kind == "ellipsoid" and np.ptp(geom.size) == 0):
        return [Ball(name, geom.position, float(geom.size[0]))]
    if geom.kind in ("capsule", "cylinder"):
        return [
            Ball(f"{name}_{letter}", end, float(geom.size[0]))
            for letter, end in zip("ab", geom.find_ends(), strict=True)
        ]
    if geom.kind == "box":
        signs = product((-1.0, 1.0), repeat=3)
        corners = [geom.position + geom.rotation @ (np.array(sign) * geom.size) for sign in signs]
        return [Ball(f"{name}_{number}", corner, 0.0) for number, corner in enumerate(corners, 1)]
    return []


def _drop_inner(balls: Sequence[Ball]) -> list[Ball]:
    """Return the balls without those inside another, or inside the hull of two others: they never touch."""
    kept = list(balls)
    for ball in sorted(balls, key=lambda item: item.radius):
        others = [other for other in kept if other is not ball]
        largest = sorted(others, key=lambda item: -item.radius)[:OUTER]
        if any(_is_inside(ball, one, other) for one in largest for other in largest):
            kept = others
    return kept


def _is_inside(ball: Ball, one: Ball, other: Ball) -> bool:
    """Return whether a ball is in the hull of two others: the least distance to it along their line."""
    axis = other.position - one.position
    length = float(np.linalg.norm(axis))
    apart = ball.position - one.position
    widening = other.radius - one.radius
    best = 0.0
    if length > abs(widening):
        along = float(apart @ axis) / length
        aside = math.sqrt(max(float(apart @ apart) - along**2, 0.0))
        # The distance less the radius of the hull is least where its slope is that of the cone.
        best = min(max((along + aside * widening / math.sqrt(length**2 - widening**2)) / length, 0.0), 1.0)
    distance = float(np.linalg.norm(apart - best * axis))
    return bool(distance + ball.radius <= one.radius + best * widening + INSIDE)


def _read_stiffness(
    contact: _Contact, gravity: float, mass: float, radii: Sequence[float]
) -> tuple[dict[str, Any], str]:
    """Return stiffness and restitution of the ground, and the note on what was made of solref.

    gravity: across the ground [m/s2]; mass: of all that moves [kg]; radii: of the balls [m].
    """
    first, second = contact.solref
    if not first or not second or (first > 0) != (second > 0):  # MuJoCo has its default then
        first, second = (float(word) for word in SOLREF.split())
    high = min(max(contact.solimp[1], 1e-4), 0.9999)
    direct = first < 0
    stiffness = -first / high**2 if direct else 1.0 / max(high * first * second, 1e-9) ** 2
    damping = -second / high if direct else 2.0 / (high * first)
    depth = _find_depth(contact.solimp, stiffness, gravity)
    feet, radius = min(FEET, len(radii)) or 1, min((radius for radius in radii if radius > 0), default=np.inf)
    # In newtons for a metre the numbers of heavy models would be too soft to stand on.
    as_stated = direct and mass * gravity / (feet * -first) <= DEEPEST * radius
    ratio = min(damping / (2 * math.sqrt(stiffness)), 1.0)  # beyond it impacts end nearly as they do at 1
    restitution = _find_restitution(ratio)
    values: dict[str, Any] = {"stiffness": -first if as_stated else mass * gravity / (feet * depth)}
    values["restitution"] = {"value": restitution, "speed": SPEED}
    made = f"stiffness {values['stiffness']:g} N/m"
    made += (
        f" (in MuJoCo it acts for each kilogram: {depth:.3g} m deep at rest)"
        if as_stated
        else (f", with which it rests on {feet} contacts as deep as each is in MuJoCo, {depth:.3g} m")
    )
    note = (
        f"solref {first:g} {second:g} of the ground is read as {made}, and as the restitution "
        f"{restitution:.3g} of its damping ratio {ratio:.3g}, here at {SPEED:g} m/s"
    )
    return values, note


def _find_depth(solimp: Sequence[float], stiffness: float, gravity: float) -> float:
    """Return the depth at which a mass rests in MuJoCo [m]; stiffness: K [1/s2]."""
    low, high = (min(max(value, 1e-4), 0.9999) for value in solimp[:2])
    width, middle, power = solimp[2], solimp[3], max(solimp[4], 1.0)

    def impedance(depth: float) -> float:
        x = min(depth / width, 1.0) if width > 0 else 1.0
        if power == 1 or not 0 < middle < 1:
            return low + x * (high - low)
        inner = x <= middle
        scaled = x / middle if inner else (1 - x) / (1 - middle)
        share = middle * scaled**power if inner else 1 - (1 - middle) * scaled**power
        return float(low + share * (high - low))

    shallow, deep = 0.0, gravity * (1 - min(low, high)) / (min(low, high) ** 2 * stiffness)
    for _ in range(100):
        depth = (shallow + deep) / 2
        share = impedance(depth)
        is_shallow = depth * share**2 * stiffness < gravity * (1 - share)
        shallow, deep = (depth, deep) if is_shallow else (shallow, depth)
    return depth


def _find_restitution(ratio: float) -> float:
    """Return the restitution of a mass on a spring and a damper of a damping ratio up to 1."""
    root = math.sqrt(1 - ratio**2)
    return math.exp(-2 * ratio * (math.acos(ratio) / root if root else 1.0))
