"""Round sections of members: tubes, rods, and hollow sections by the names of their catalogue."""

import re
from dataclasses import dataclass
from typing import TypeVar

from tensegrity_codegen.scene.schema.part_schema import Member, MemberClass
from tensegrity_codegen.scene.schema.schema_types import SectionTable
from tensegrity_codegen.system.errors import InvalidValueError, suggest

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
    """Return the radii of a section of a scene.

    section: a name of the catalogue, or a tube or rod; place: file and key, for errors. Returns outer and
    inner radius [m]. Raises InvalidValueError: a name that the catalogue does not have, or a wall as thick as
    the radius.
    """
    if isinstance(section, str):
        known, match = list_catalogue(), _NAME.fullmatch(section)
        name = f"CHS {float(match[1]):g}x{float(match[2]):g}" if match else section
        if name not in known:
            problem = "the catalogue has no section of that name"
            allowed = f"{len(known)} hollow sections of EN 10210-2, {known[0]} to {known[-1]} [mm]"
            hint = suggest(name, known) or "{ tube = [outer diameter, wall] } or { rod = diameter } [m]"
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
        raise InvalidValueError(
            "section and radius cannot be given together",
            where=f"{place}.section",
            given=row.section if isinstance(row.section, str) else row.section.model_dump(exclude_none=True),
            allowed="section, or radius with or without inner_radius",
        )
    found = find_section(row.section, f"{place}.section")
    return row.model_copy(update={"section": None, **vars(found)})
