"""The identity of a sweep in a folder; what differs, by its keys, where it is another one."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tensegrity_codegen.system.errors import OutputError

MOST_NAMED = 8
LONGEST = 60  # characters of a value in a message
ABSENT = object()
# Values of an identity, and those that they follow from by the beginnings of their keys.
FOLLOWING = {
    "structure_hash": ("scene",),
    "cases.method": ("cases.points.method",),
    "cases.count": ("cases.axes", "cases.points"),
}


def check_same_sweep(path: str | Path, stored: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Raise OutputError, naming what differs, unless two identities are equal."""
    differences = find_differences(stored, asked)
    if not differences:
        return
    more = len(differences) - MOST_NAMED
    rows = [*differences[:MOST_NAMED], *([f"and {more} more"] if more > 0 else [])]
    raise OutputError(
        f"the folder holds another sweep; {len(differences)} of its settings "
        f"{'differs' if len(differences) == 1 else 'differ'}:\n    " + "\n    ".join(rows),
        where=str(path),
        allowed="the sweep that the folder holds, which then goes on where it stopped",
        hint="choose another name, or remove the folder",
    )


def find_differences(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> list[str]:
    """Return a line for each value that differs: its key, what is stored, what is asked for.

    Values that follow from others, such as the number of cases, are listed where only they differ.
    """
    found = {key: (old, new) for key, old, new in _compare("", _normalise(stored), _normalise(asked))}
    for result, sources in FOLLOWING.items():
        if result in found and any(key != result and key.startswith(sources) for key in found):
            del found[result]
    return [f"{key}: {_show(old)} in the folder, {_show(new)} now" for key, (old, new) in found.items()]


def _normalise(value: Mapping[str, Any]) -> Any:
    """Return the value as JSON gives it back: tuples are lists."""
    return json.loads(json.dumps(value))


def _compare(key: str, old: Any, new: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in [*old, *(name for name in new if name not in old)]:
            path = f"{key}.{name}" if key else name
            yield from _compare(path, old.get(name, ABSENT), new.get(name, ABSENT))
    elif (
        isinstance(old, list)
        and isinstance(new, list)
        and len(old) == len(new)
        and any(isinstance(item, dict) for item in old)
    ):
        for place, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from _compare(f"{key}[{_label(place, a, b)}]", a, b)
    elif old is ABSENT or new is ABSENT or old != new:
        yield key, old, new


def _label(place: int, a: Any, b: Any) -> str:
    """Return the key or name that two entries of a list have in common, else their place."""
    for word in ("key", "name"):
        if isinstance(a, dict) and isinstance(b, dict) and a.get(word) and a.get(word) == b.get(word):
            return str(a[word])
    return str(place)


def _show(value: Any) -> str:
    if value is ABSENT:
        return "absent"
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) > 6:
        return f"{len(value)} values from {value[0]} to {value[-1]}"
    text = json.dumps(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
