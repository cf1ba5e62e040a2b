"""From bodies of a scene to the bodies, points and coordinates of a body system."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.free_bodies import read_inertia
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.refuse import require
from tensegrity_codegen.scene.schema.body_schema import BarBody, FixedPart, PointTable, RigidPart
from tensegrity_codegen.structure.bodies import Bar, Body, Chart, FixedBody, RigidBody
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import DuplicateNameError, StructureError

Table: TypeAlias = FixedPart | BarBody | RigidPart

# Sine of the angle to the pole of its chart below which a body cannot start (about 0.06 deg).
MIN_MARGIN = 1e-3
# Keys of rigid bodies beside nodes and members.
OF_FREE_BODIES = (
    *("centre_of_mass", "parts", "position", "quaternion", "axis", "angle_deg", "from_", "to", "matrix"),
    "angular_velocity",
)
CENTRE = "centre"


@dataclass(frozen=True)
class BuiltBodies:
    """Bodies, their points and their start; `node` finds a point by "body.point"."""

    bodies: tuple[Body, ...]
    node: Mapping[str, int]
    node_name: tuple[str, ...]
    node_body: NDArray[np.int64]
    node_local: FloatArray
    coordinate: FloatArray
    velocity: FloatArray


def build_bodies_of_scene(tables: Mapping[str, Table], where: str) -> BuiltBodies:
    """Return the bodies that the scene states."""
    names, owners, locals_ = _points(tables, where)
    node = {name: row for row, name in enumerate(names)}
    bodies: list[Body] = []
    q: list[float] = []
    v: list[float] = []
    for name, table in tables.items():
        location = key_path(where, "bodies", name)
        if isinstance(table, BarBody):
            bar, angles, rates = _bar(name, table, node, location)
            bodies.append(bar)
            q += [*(() if bar.held else table.centre or ()), *angles]
            v += [*(() if bar.held else table.centre_velocity or (0.0, 0.0, 0.0)), *rates]
        elif isinstance(table, RigidPart):
            bodies.append(_rigid(name, table, location))
            q += [*_radians(table.psi_deg, table.phi_deg, table.theta_deg), *(table.centre or ())]
            v += [
                *_radians(table.psi_rate_deg, table.phi_rate_deg, table.theta_rate_deg),
                *(table.centre_velocity or (0.0, 0.0, 0.0)),
            ]
        else:
            bodies.append(FixedBody(name))
    _check_circle(bodies, owners, where)
    return BuiltBodies(
        tuple(bodies),
        node,
        tuple(name.replace(".", "_") for name in names),
        np.array(owners, dtype=np.int64),
        np.array(locals_, dtype=float).reshape(-1, 3),
        np.array(q, dtype=float),
        np.array(v, dtype=float),
    )


def _radians(*degrees: float) -> list[float]:
    return [math.radians(angle) for angle in degrees]


def _points(tables: Mapping[str, Table], where: str) -> tuple[list[str], list[int], list[tuple[float, ...]]]:
    """Return names "body.point", bodies and places of all points."""
    names: list[str] = []
    owners: list[int] = []
    positions: list[tuple[float, ...]] = []
    for row, (body, table) in enumerate(tables.items()):
        points: dict[str, tuple[float, ...]]
        if isinstance(table, BarBody):
            points = {"A": (-table.length / 2, 0.0, 0.0), "B": (table.length / 2, 0.0, 0.0)}
        elif isinstance(table, RigidPart):
            if CENTRE in table.points:
                problem = "the centre of mass has this name already"
                location, allowed = key_path(where, "bodies", body, "points", CENTRE), "other names"
                hint = "rename the point"
                raise DuplicateNameError(problem, where=location, given=CENTRE, allowed=allowed, hint=hint)
            points = {
                name: entry.position if isinstance(entry, PointTable) else entry
                for name, entry in table.points.items()
            }
            points[CENTRE] = (0.0, 0.0, 0.0)
        else:
            points = dict(table.points)
        names += [f"{body}.{point}" for point in points]
        owners += [row] * len(points)
        positions += points.values()
    _check_c_names(names, where)
    return names, owners, positions


def _check_c_names(names: Sequence[str], where: str) -> None:
    """Raise DuplicateNameError if two points have one name in C, as "a_b.c" and "a.b_c"."""
    seen: dict[str, str] = {}
    for name in names:
        earlier = seen.setdefault(name.replace(".", "_"), name)
        if earlier != name:
            problem = f"the point has the same name in C as {earlier}"
            location = key_path(where, "bodies", *name.split("."))
            allowed, hint = "bodies and points whose names joined by _ differ", "rename one of the two"
            value = name.replace(".", "_")
            raise DuplicateNameError(problem, where=location, given=value, allowed=allowed, hint=hint)


def _bar(
    name: str, table: BarBody, node: Mapping[str, int], place: str
) -> tuple[Bar, list[float], list[float]]:
    """Return the bar, its two angles and their rates."""
    mass = _bar_mass(table, place)
    inertia = table.inertia
    if inertia is None:  # of a hollow cylinder about an axis across its middle
        across = (table.radius or 0.0) ** 2 + (table.inner_radius or 0.0) ** 2
        inertia = mass * (table.length**2 + 3 * across) / 12
    if table.anchor is None:
        is_met, allowed = table.centre is not None, "centre = [x, y, z] [m], or anchor"
        hint = "give the position of its middle, or hold one end"
        require(is_met, "a free bar without a position", f"{place}.centre", None, allowed, hint)
        is_met, hint = inertia > 0, "omit it for the inertia of a uniform bar"
        require(
            is_met, "a free bar without inertia", f"{place}.inertia", inertia, "more than 0 [kg m2]", hint
        )
    else:
        position = table.centre or table.centre_velocity
        is_met, allowed = position is None, "anchor or centre, not both"
        hint = "remove it"
        require(is_met, "a held bar has no position of its own", f"{place}.centre", position, allowed, hint)
        points = [point for point in node if not point.startswith(f"{name}.") or point == table.anchor]
        problem = "the bar is held at a point that does not exist"
        check_known(table.anchor, points, problem, '"body.point"', f"{place}.anchor")
    chart, polar, azimuth = _chart(table, place)
    bar = Bar(
        name,
        table.length,
        mass,
        inertia,
        chart,
        table.end if table.anchor else "",
        node[table.anchor] if table.anchor else -1,
        table.spin,
        table.radius or 0.0,
    )
    return bar, [polar, azimuth], _radians(table.polar_rate_deg, table.azimuth_rate_deg)


def _bar_mass(table: BarBody, place: str) -> float:
    stated = {"mass": table.mass, "density": table.density}
    is_met = sum(value is not None for value in stated.values()) == 1
    problem = "a body without mass" if table.mass is None else "mass and density cannot be given together"
    allowed = "one of mass [kg], density [kg/m3] with radius"
    require(is_met, problem, f"{place}.mass", table.mass, allowed, "every body that moves needs a mass")
    if table.mass is not None:
        return table.mass
    radius, inner = table.radius or 0.0, table.inner_radius or 0.0
    allowed, hint = "a radius greater than inner_radius", "give radius, or mass in place of density"
    require(radius > inner, "a density needs a section", f"{place}.radius", table.radius, allowed, hint)
    return float(table.density or 0.0) * math.pi * (radius**2 - inner**2) * table.length


def _chart(table: BarBody, place: str) -> tuple[Chart, float, float]:
    """Return the chart of a bar's direction, the polar angle and the azimuth [rad]."""
    angles = [table.azimuth_deg, table.declination_deg, table.elevation_deg]
    offset = math.radians(table.azimuth_offset_deg)
    if table.direction is not None:
        is_met, problem = not any(angle is not None for angle in angles), "a direction and angles"
        allowed = "either direction or angles"
        require(is_met, problem, f"{place}.direction", table.direction, allowed, "leave one of the two out")
        return _chart_of_direction(table.direction, table.polar_axis, offset, place)
    is_met = (table.declination_deg is None) != (
        table.elevation_deg is None
    ) and table.azimuth_deg is not None
    allowed = "direction, or azimuth_deg with one of declination_deg, elevation_deg"
    hint = "azimuth_deg = 0, declination_deg = 90 lies along the axis after the polar one"
    require(is_met, "a bar needs a direction", place, None, allowed, hint)
    axis = 2 if table.polar_axis == "auto" else "xyz".index(table.polar_axis)
    azimuth = math.radians(table.azimuth_deg or 0.0)
    if table.declination_deg is not None:
        polar, margin = (
            math.radians(table.declination_deg),
            abs(math.sin(math.radians(table.declination_deg))),
        )
        chart = Chart(axis, "declination", offset)
    else:
        polar = math.radians(table.elevation_deg or 0.0)
        chart, margin = Chart(axis, "elevation", offset), abs(math.cos(polar))
    _check_margin(margin, place, "another polar_axis, or direction in place of angles")
    return chart, polar, azimuth


def _chart_of_direction(
    direction: tuple[float, ...], polar_axis: str, offset: float, place: str
) -> tuple[Chart, float, float]:
    vector = np.array(direction, dtype=float)
    size = float(np.linalg.norm(vector))
    is_met, problem = math.isfinite(size) and size > 0, "a direction of length zero"
    allowed = "a vector that is not zero"
    require(
        is_met, problem, f"{place}.direction", direction, allowed, "take the difference of the ends, B - A"
    )
    unit = vector / size
    axis = int(np.argmin(np.abs(unit))) if polar_axis == "auto" else "xyz".index(polar_axis)
    chart = Chart(axis, "declination", offset)
    e1, e2, e3 = chart.axes
    across = math.hypot(unit[e1], unit[e2])
    _check_margin(across, place, "another polar_axis")
    return chart, math.atan2(across, unit[e3]), math.atan2(unit[e2], unit[e1]) - offset


def _check_margin(margin: float, place: str, hint: str) -> None:
    problem = "the body starts at the pole of its angles, where they have no meaning"
    allowed = f"a sine of the angle to the pole of at least {MIN_MARGIN:g}"
    require(margin >= MIN_MARGIN, problem, place, margin, allowed, hint)


def _rigid(name: str, table: RigidPart, place: str) -> RigidBody:
    new = [key for key in OF_FREE_BODIES if key in table.model_fields_set]
    problem, allowed = (
        "this belongs to bodies beside nodes and members",
        "mass, inertia, centre, Euler angles",
    )
    hint = "write the tendons as members"
    require(not new, problem, f"{place}.{new[0] if new else ''}", new, allowed, hint)
    for key in ("mass", "inertia", "centre"):
        is_met, problem = getattr(table, key) is not None, "a needed key is missing"
        require(is_met, problem, f"{place}.{key}", None, f"the key {key!r}", f"add {key!r}")
    assert table.mass is not None
    assert table.inertia is not None
    require(table.mass > 0, "a body needs a mass above 0", f"{place}.mass", table.mass, "mass > 0 [kg]", "")
    inertia = read_inertia(table.inertia, place)
    _check_margin(abs(math.cos(math.radians(table.phi_deg))), f"{place}.phi_deg", "turn the body's frame")
    a, b, c = ((float(x), float(y), float(z)) for x, y, z in inertia)
    return RigidBody(name, table.mass, (a, b, c))


def _check_circle(bodies: Sequence[Body], owners: Sequence[int], where: str) -> None:
    """Raise StructureError if bars hold on to each other in a circle."""
    for start, body in enumerate(bodies):
        path, here = [start], body
        while isinstance(here, Bar) and here.held:
            path.append(owners[here.anchor])
            if path[-1] == start:
                chain = " on ".join(bodies[k].name for k in path)
                problem = "bodies hold each other in a circle"
                location = key_path(where, "bodies", body.name, "anchor")
                allowed = "bars held at points of bodies that do not depend on them"
                hint = "let one of them be free and join it by a short tendon"
                raise StructureError(problem, where=location, given=chain, allowed=allowed, hint=hint)
            if len(path) > len(bodies) + 1:  # a circle further on, reported from there
                break
            here = bodies[path[-1]]
