"""Rules for the values of an imported member, whatever the format of its file.

In all checks `member` has the values by the names of a scene, and `where` returns the place of one of them in
the file, for messages.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from tensegrity_codegen.system.errors import InvalidValueError, StructureError

Where = Callable[[str], str]
STIFFNESSES = ("spring_constant", "axial_stiffness")
# Numbers of a member that must be above zero.
POSITIVE = ("rest_length", *STIFFNESSES, "mass", "density", "radius")


def check_ends(first: str, second: str, given: object, where: str) -> None:
    """Raise StructureError where a member joins a node to itself."""
    if first == second:
        raise StructureError(
            "the member joins a node to itself", where=where, given=given, allowed="two different nodes"
        )


def check_member(member: Mapping[str, Any], where: Where) -> None:
    """Raise InvalidValueError for values out of range, given twice, or that the member cannot have."""
    _check_ranges(member, where)
    _check_stiffness(member, where)
    for one, other in (("rest_length", "prestress"), ("mass", "density")):
        if one in member and other in member:
            raise InvalidValueError(
                f"the member has {one} and {other}, which define the same value",
                where=where(other),
                given=member[other],
                allowed=f"at most one of {one} and {other}",
            )
    _check_mass(member, where)
    if "prestress" in member:
        _check_prestress(member, where)


def _check_ranges(member: Mapping[str, Any], where: Where) -> None:
    for key in (*POSITIVE, "damping"):
        value = member.get(key)
        if value is not None and not (value >= 0 if key == "damping" else value > 0):
            allowed = "0 or more" if key == "damping" else "greater than 0, or no value"
            raise InvalidValueError(
                "the value is out of range", where=where(key), given=value, allowed=allowed
            )


def _check_stiffness(member: Mapping[str, Any], where: Where) -> None:
    stiffness = [key for key in STIFFNESSES if key in member]
    if len(stiffness) > 1:
        raise InvalidValueError(
            "the member has two stiffnesses",
            where=where("axial_stiffness"),
            given=f"spring_constant {member['spring_constant']}, axial_stiffness {member['axial_stiffness']}",
            allowed="at most one of spring_constant [N/m] and axial_stiffness [N]",
        )
    if member["kind"] == "cable" and not stiffness:
        raise InvalidValueError(
            "a cable without stiffness",
            where=where("spring_constant"),
            allowed="one of spring_constant [N/m] and axial_stiffness [N]",
        )


def _check_mass(member: Mapping[str, Any], where: Where) -> None:
    key = "density" if "density" in member else "mass"
    if member["kind"] == "cable" and key in member:
        raise InvalidValueError(
            "a cable has no mass",
            where=where(key),
            given=member[key],
            allowed=f"no {key}: only bars have a mass",
            hint="give the mass to the nodes",
        )
    if "density" in member and "radius" not in member:
        raise InvalidValueError(
            "a density without a radius",
            where=where("density"),
            given=member["density"],
            allowed="density [kg/m3] and radius [m], or mass [kg] alone",
        )


def _check_prestress(member: Mapping[str, Any], where: Where) -> None:
    """Check that a member of this kind and stiffness can have its prestress."""
    if not set(STIFFNESSES) & member.keys():
        raise InvalidValueError(
            "a rigid bar has no prestress",
            where=where("prestress"),
            given=member["prestress"],
            allowed="no prestress, or a bar with spring_constant [N/m] or axial_stiffness [N]",
        )
    if member["kind"] == "cable" and member["prestress"] < 0 and member.get("tension_only", True):
        raise InvalidValueError(
            "a cable cannot push",
            where=where("prestress"),
            given=member["prestress"],
            allowed="0 or more [N]; less with tension_only = no",
        )


def note_defaults(members: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return notes on what missing values of members were taken to mean."""
    members, notes = list(members), []
    present = sum(not {"rest_length", "prestress"} & member.keys() for member in members)
    if present:
        notes.append(f"members without a rest length, which is their present length: {present}")
    rigid = sum(not set(STIFFNESSES) & member.keys() for member in members)
    if rigid:
        notes.append(f"bars without a stiffness, which are rigid: {rigid}")
    return notes
