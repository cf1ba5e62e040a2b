"""The values of every member: its own, or else those of its class.

Values that say the same thing in other words replace each other as one: {spring_constant, axial_stiffness,
youngs_modulus}, {rest_length, prestress, strain}, {mass, density, mass_per_length}, and those of laws
(`Law.keys`). So a member with a prestress of its own drops the rest length of its class. Round sections are
tubes, rods, and hollow sections by the names of their catalogue.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass
from tensegrity_codegen.scene.schema.schema_types import SectionTable
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, suggest
from tensegrity_codegen.tables.laws import LAWS

# Circular hollow sections of EN 10210-2: outer diameter and its thinnest and thickest wall [mm].
OUTER_DIAMETERS = {
    21.3: (2.3, 3.2), 26.9: (2.3, 3.2), 33.7: (2.6, 4), 42.4: (2.6, 4), 48.3: (2.6, 5), 60.3: (2.6, 5),
    76.1: (2.6, 5), 88.9: (3.2, 6.3), 101.6: (3.2, 10), 114.3: (3.2, 10), 139.7: (4, 12.5), 168.3: (4, 12.5),
    177.8: (5, 12.5), 193.7: (5, 16), 219.1: (5, 20), 244.5: (5, 25), 273.0: (5, 25), 323.9: (5, 25),
    355.6: (6.3, 25), 406.4: (6.3, 40), 457.0: (6.3, 40), 508.0: (6.3, 50),
}  # fmt: skip
WALLS = (2.3, 2.6, 3.2, 4, 5, 6.3, 8, 10, 12.5, 14.2, 16, 20, 25, 30, 40, 50)
_NAME = re.compile(r"CHS ?([0-9]{2,3}(?:[.][0-9])?)x([0-9]{1,2}(?:[.][0-9])?)")


@dataclass(frozen=True)
class RoundSection:
    """A round section: outer and inner radius [m], the latter 0 of a rod."""

    radius: float
    inner_radius: float


def list_catalogue() -> list[str]:
    """Return the names of all sections of the catalogue, "CHS 60.3x3.2": diameter and wall in mm."""
    return [
        f"CHS {diameter:g}x{wall:g}"
        for diameter, (thinnest, thickest) in OUTER_DIAMETERS.items()
        for wall in WALLS
        if thinnest <= wall <= thickest
    ]


def find_section(section: str | SectionTable, place: str) -> RoundSection:
    """Return outer and inner radius [m] of a section: a name of the catalogue, a tube or a rod."""
    if isinstance(section, str):
        catalogue, match = list_catalogue(), _NAME.fullmatch(section)
        name = f"CHS {float(match[1]):g}x{float(match[2]):g}" if match else section
        if name not in catalogue:
            problem = "the catalogue has no section of that name"
            allowed = (
                f"{len(catalogue)} hollow sections of EN 10210-2, {catalogue[0]} to {catalogue[-1]} [mm]"
            )
            hint = suggest(name, catalogue) or "{ tube = [outer diameter, wall] } or { rod = diameter } [m]"
            raise InvalidValueError(problem, where=place, given=section, allowed=allowed, hint=hint)
        diameter, wall = (float(number) / 1000 for number in name.removeprefix("CHS ").split("x"))
        return RoundSection(diameter / 2, diameter / 2 - wall)
    if section.tube is None:
        assert section.rod is not None
        return RoundSection(section.rod / 2, 0.0)
    diameter, wall = section.tube
    if not 2 * wall < diameter:
        problem = "the wall of the tube is as thick as its radius"
        allowed = "[outer diameter, wall] in metres, with a wall below half of the diameter"
        hint = "a solid section is { rod = diameter }"
        raise InvalidValueError(problem, where=place, given=list(section.tube), allowed=allowed, hint=hint)
    return RoundSection(diameter / 2, diameter / 2 - wall)


Row = TypeVar("Row", Member, MemberClass)


def put_radii(row: Row, place: str) -> Row:
    """Return a member or class with the radii of its section in place of that; raises InvalidValueError."""
    if row.section is None:
        return row
    if row.radius is not None or row.inner_radius is not None:
        problem = "section and radius cannot be given together"
        value = row.section if isinstance(row.section, str) else row.section.model_dump(exclude_none=True)
        allowed = "section, or radius with or without inner_radius"
        raise InvalidValueError(problem, where=f"{place}.section", given=value, allowed=allowed)
    radii = find_section(row.section, f"{place}.section")
    return row.model_copy(update={"section": None, **vars(radii)})


Columns = dict[str, FloatArray]  # one value a row, NaN if the scene gives none

STIFFNESS = ("spring_constant", "axial_stiffness")
LAW_KEYS = tuple(group for law in LAWS for group in (*law.keys, *law.optional_keys))
MODULUS = "youngs_modulus"
ALTERNATIVES = (
    (*STIFFNESS, MODULUS),
    ("rest_length", "prestress", "strain"),
    ("mass", "density", "mass_per_length"),
    *LAW_KEYS,
)
SINGLE = ("damping", "radius", "inner_radius", "thermal_expansion", "segments")
BAR_ONLY = ("density", "inner_radius")
CABLE_ONLY = ("mass_per_length", "segments")


def resolve_values(
    classes: Mapping[str, MemberClass], members: Mapping[str, Member], where: str
) -> tuple[Columns, BoolArray, BoolArray]:
    """Return (values, is_bar, tension_only), one entry a member; values hold NaN if nothing is given."""
    names, rows, shared = tuple(members), list(members.values()), list(classes.values())
    index = _class_index(classes, names, rows, where)
    kinds = [item.kind for item in shared]
    is_bar = np.array(
        [(row.kind if at < 0 else kinds[at]) == "bar" for row, at in zip(rows, index.tolist(), strict=True)],
        dtype=np.bool_,
    )
    class_is_bar = np.array([kind == "bar" for kind in kinds], dtype=np.bool_)
    shared = [put_radii(row, key_path(where, "classes", name)) for name, row in classes.items()]
    rows = [
        row if row.section is None else put_radii(row, key_path(where, "members", name))
        for name, row in members.items()
    ]
    class_values, member_values = _columns(shared), _columns(rows)
    class_slack, own_slack = _tension_only(shared), _tension_only(rows)
    _check_values(class_values, class_slack, class_is_bar, tuple(classes), "classes", where)
    _check_values(member_values, own_slack, is_bar, names, "members", where)
    chosen = np.where(np.isnan(own_slack), np.append(class_slack, np.nan)[index], own_slack)
    return (
        _put_stiffness(_inherit(member_values, class_values, index), names, where),
        is_bar,
        ~is_bar & (chosen != 0),
    )


def _put_stiffness(values: Columns, names: tuple[str, ...], where: str) -> Columns:
    """Return the values with EA = E A of members that state E; InvalidValueError without a radius."""
    modulus, radius = values.pop(MODULUS), values["radius"]
    refuse(
        ~np.isnan(modulus) & np.isnan(radius),
        InvalidValueError,
        "Young's modulus without a section",
        section="members",
        names=names,
        where=where,
        key=MODULUS,
        given=modulus,
        allowed="with section or radius; or axial_stiffness [N] in place of it",
    )
    area = np.pi * (radius**2 - np.nan_to_num(values["inner_radius"]) ** 2)
    axial = values["axial_stiffness"]
    return {**values, "axial_stiffness": np.where(np.isnan(modulus), axial, modulus * area)}


def _class_index(
    classes: Mapping[str, MemberClass], names: tuple[str, ...], rows: list[Member], where: str
) -> NDArray[np.int64]:
    """Return the class of each member, -1 for those that have none and name their kind themselves."""
    index = {name: row for row, name in enumerate(classes)}
    for name, row in zip(names, rows, strict=True):
        if (row.class_name is None) != (row.kind is None) and (row.kind or row.class_name in index):
            continue
        location = key_path(where, "members", name)
        if row.class_name is not None:
            problem, allowed = "the member class is not defined", "the name of a table [classes.<name>]"
            check_known(row.class_name, index, problem, allowed, f"{location}.class")
        has_kind = row.kind is not None
        raise InvalidValueError(
            "a member of a class takes its kind from the class" if has_kind else "neither a class nor a kind",
            where=f"{location}.kind" if has_kind else location,
            given=row.kind,
            allowed="either class or kind",
        )
    return np.array([-1 if row.class_name is None else index[row.class_name] for row in rows], dtype=np.int64)


def _columns(rows: Sequence[MemberClass] | Sequence[Member]) -> Columns:
    keys = [key for group in ALTERNATIVES for key in group] + list(SINGLE)
    return {key: np.array([getattr(row, key) for row in rows], dtype=np.float64) for key in keys}


def _tension_only(rows: Sequence[MemberClass] | Sequence[Member]) -> FloatArray:
    return np.array([row.tension_only for row in rows], dtype=np.float64)


def _inherit(own: Columns, shared: Columns, class_index: NDArray[np.int64]) -> Columns:
    """Return each row's own values, or else its class's, alternatives as one."""
    resolved: Columns = {}
    for group in (*ALTERNATIVES, *((key,) for key in SINGLE)):
        inherits = np.all([np.isnan(own[key]) for key in group], axis=0)
        for key in group:
            resolved[key] = np.where(inherits, np.append(shared[key], np.nan)[class_index], own[key])
    return resolved


def _check_values(
    values: Columns,
    tension_only: FloatArray,
    is_bar: BoolArray,
    names: tuple[str, ...],
    section: str,
    where: str,
) -> None:
    """Raise for values that the kind of member does not have, or that say one thing twice."""
    report = partial(refuse, section=section, names=names, where=where)
    for key in (*BAR_ONLY, *CABLE_ONLY):
        kind, owner_kind = ("cable", "bar") if key in BAR_ONLY else ("bar", "cable")
        is_bad = (~is_bar if key in BAR_ONLY else is_bar) & (values[key] > 0)
        problem, allowed = f"a {kind} has no {key}", f"only for {owner_kind}s"
        hint = "mass_per_length" if key == "density" else ""
        report(is_bad, InvalidValueError, problem, key=key, given=values[key], allowed=allowed, hint=hint)
    is_bad, problem = is_bar & (tension_only == 1), "a bar cannot be tension_only"
    value, allowed = [True] * len(names), "only for cables"
    hint = 'make it kind = "cable", or leave tension_only out'
    report(is_bad, InvalidValueError, problem, key="tension_only", given=value, allowed=allowed, hint=hint)
    for group in ALTERNATIVES:
        _check_alternatives(values, group, names, section, where)


def _check_alternatives(
    values: Columns, group: tuple[str, ...], names: tuple[str, ...], section: str, where: str
) -> None:
    present = np.array([~np.isnan(values[key]) for key in group])
    bad = present.sum(axis=0) > 1
    if not bad.any():
        return
    row = int(np.argmax(bad))
    stated = {key: float(values[key][row]) for key, here in zip(group, present, strict=True) if here[row]}
    refuse(
        bad,
        InvalidValueError,
        f"{' and '.join(stated)} cannot be given together",
        section=section,
        names=names,
        where=where,
        given={row: stated},
        allowed=f"at most one of {', '.join(group)}",
    )
