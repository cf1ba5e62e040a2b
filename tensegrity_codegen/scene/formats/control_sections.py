"""Actuators, sensors and limits of a foreign file, which has them as a scene has: only names change."""

from collections.abc import Mapping
from typing import Any

CONTROL_SECTIONS = ("actuators", "sensors", "limits")

Names = Mapping[str, str]


def rename_control(content: Mapping[str, Any], nodes: Names, members: Names) -> dict[str, Any]:
    """Return the sections `actuators`, `sensors` and `limits` of a file with the scene's names.

    nodes, members: names of the scene by those of the file, which may be numbers. What is not there, or not
    of the right kind, stays as it is: the checks of the scene name it.
    """
    renamed: dict[str, Any] = {}
    for section in ("actuators", "sensors"):
        value = content.get(section)
        if value is not None:
            entries = value if isinstance(value, list) else [value]
            items = [_rename_entry(entry, nodes, members) for entry in entries]
            renamed[section] = items if isinstance(value, list) else items[0]
    limits = content.get("limits")
    if isinstance(limits, dict) and isinstance(limits.get("members"), dict):
        of_members: dict[str, Any] = {}
        for key, value in limits["members"].items():
            name = members.get(key, key)
            of_members[key if name in of_members else name] = value
        limits = {**limits, "members": of_members}
    return renamed | ({} if limits is None else {"limits": limits})


def _rename_entry(entry: Any, nodes: Names, members: Names) -> Any:
    if not isinstance(entry, dict):
        return entry
    tables = {"members": members, "nodes": nodes}
    return {
        key: _rename(value, tables[key]) if key in tables else value
        for key, value in entry.items()
    }  # fmt: skip


def _rename(value: Any, names: Names) -> Any:
    """Return the scene's name of a name or number, or of each of a list of them."""
    if isinstance(value, list):
        return [_rename(item, names) if not isinstance(item, list) else item for item in value]
    if isinstance(value, bool) or not isinstance(value, str | int):
        return value
    return names.get(str(value) if isinstance(value, str) or abs(value) < 10**18 else "", value)
