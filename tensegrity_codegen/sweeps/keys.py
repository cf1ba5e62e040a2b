"""Numbers of a scene by their paths: `classes.cable.spring_constant`, `loads[0].force[2]`."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.sweeps.key_schema import ANY, Bounds, Place, root_place
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError, name_list, suggest

_STEP = re.compile(r"(?:^|\.)([A-Za-z_][A-Za-z0-9_]*)|\[(\d{1,9})\]")
# Vectors that mean zero where a scene has none, so that one of their numbers can be set.
ZERO_VECTORS = ("gravity", "velocity", "centre_velocity")

Steps = tuple[str | int, ...]


@dataclass(frozen=True)
class KeyPath:
    """One number of a scene.

    Attributes
    ----------
    text : str
        The path as it was given.
    steps : tuple of str and int
        Keys of tables and numbers of lists; an item of a list that was named is here by its number.
    bounds : Bounds
        Which numbers may stand there.
    vector : int
        Length of the vector of zeros that the number belongs to where the scene has none; else 0.

    Examples
    --------
    >>> from tensegrity_codegen.sweeps.keys import KeyPath
    >>> scene = {"name": "a", "loads": [{"node": "n", "force": [0, 0, -3]}]}
    >>> key = KeyPath.find("loads[0].force[2]", scene)
    >>> key.read(scene), key.write(scene, -4.0)["loads"], scene["loads"][0]["force"]
    (-3, [{'node': 'n', 'force': [0, 0, -4.0]}], [0, 0, -3])
    """

    text: str
    steps: Steps
    bounds: Bounds = ANY
    vector: int = 0

    @classmethod
    def find(cls, text: str, document: Mapping[str, Any], where: str = "scene") -> "KeyPath":
        """Return the number that a path leads to.

        text: keys joined by points, numbers of lists in brackets from 0; items of lists that have a name also
            by their name, as ``actuators.motor.delay``. The scene need not state a key that the schema has.
        document: the scene as a plain dictionary.
        where: source of the scene, for errors.
        Raises UnknownKeyError: there is no such key; the message lists near ones; InvalidValueError: the key
        is no number, or the path cannot be read.
        """
        steps, place = parse_path(text), root_place(document)
        found: list[str | int] = []
        for depth, step in enumerate(steps):
            index, below = place.index_of(step), place.below(step)
            if below is None and place.value is None and isinstance(step, int):
                return _in_vector_of_zeros(text, steps, depth, place, document, where)
            if index is None or below is None:
                raise _unknown(text, steps[: depth + 1], place, document, where)
            found.append(index)
            place = below
        if not place.is_number:
            raise _no_number(text, steps, place, where)
        return cls(text, tuple(found), place.bounds)

    def read(self, document: Mapping[str, Any]) -> float | None:
        """Return the number, None where the scene does not state it."""
        value: Any = document
        for step in self.steps:
            try:
                value = value[step]
            except (KeyError, IndexError):
                return None
        return value if isinstance(value, int | float) and not isinstance(value, bool) else None

    def write(self, document: Mapping[str, Any], value: float) -> dict[str, Any]:
        """Return the scene with this number changed; the scene itself and all else in it stay as they are."""
        whole = self.bounds.is_whole and float(value).is_integer()
        number = int(value) if whole else float(value)
        return dict(_write(document, self.steps, number, self.vector))


def parse_path(text: str, where: str = "key") -> Steps:
    """Return the steps of a path; raises InvalidValueError, which names `where`, for a text that is none."""
    steps, end = [], 0
    for match in _STEP.finditer(text):
        if match.start() != end:
            break
        steps.append(match[1] if match[1] is not None else int(match[2]))
        end = match.end()
    if not steps or end != len(text) or isinstance(steps[0], int):
        raise InvalidValueError(
            "not the path of a number",
            where=where,
            given=text,
            allowed="names joined by points, numbers of lists in brackets: loads[0].force[2]",
        )
    return tuple(steps)


def format_path(steps: Steps) -> str:
    """Return the text of a path, as `loads[0].force[2]`."""
    return key_path("", *steps)


def find_numbers(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield the paths of all numbers that a scene states, in its order."""
    for steps, _ in root_place(document).leaves():
        yield format_path(steps)


def _write(value: Any, steps: Steps, number: float, vector: int) -> Any:
    if not steps:
        return number
    step, rest = steps[0], steps[1:]
    if isinstance(step, int):
        items = list(value) if value is not None else [0.0] * vector
        items[step] = _write(items[step], rest, number, vector)
        return items
    table = dict(value) if value is not None else {}
    table[step] = _write(table.get(step), rest, number, vector)
    return table


def _in_vector_of_zeros(
    text: str, steps: Steps, depth: int, place: Place, document: Mapping[str, Any], where: str
) -> KeyPath:
    """Return one number of a vector that the scene does not state, and that then is zero."""
    axes = len(document.get("axes", "xyz")) if isinstance(document.get("axes", "xyz"), str) else 3
    size = axes if steps[0] != "bodies" else 3
    index = steps[depth]
    is_last = depth == len(steps) - 1 and place.schema.get("type") == "array"
    if not (is_last and steps[depth - 1] in ZERO_VECTORS and isinstance(index, int)):
        raise InvalidValueError(
            "the scene does not state this list",
            where=key_path(where, *steps[:depth]),
            given=text,
            allowed="one number of a list that the scene states",
            hint="write the whole list into the scene",
        )
    if index >= size:
        raise _too_far(text, steps[:depth], size, where)
    return KeyPath(text, steps, vector=size)


def _unknown(
    text: str, steps: Steps, place: Place, document: Mapping[str, Any], where: str
) -> UnknownKeyError | InvalidValueError:
    step, above = steps[-1], steps[:-1]
    if isinstance(step, int) and isinstance(place.value, list):
        return _too_far(text, above, len(place.value), where)
    if isinstance(place.value, list) and not place.names():
        return InvalidValueError(
            "this list has items without names",
            where=key_path(where, *above),
            given=text,
            allowed=f"a number in brackets: {format_path(above)}[0]",
        )
    if place.is_number or isinstance(step, int):
        return InvalidValueError(
            f"{'a number' if place.is_number else place.word} has nothing of this kind below",
            where=key_path(where, *above),
            given=text,
            allowed=format_path(above) if place.is_number else ", ".join(place.names()) or "no list",
        )
    names = place.names()
    near = suggest(step, names)
    return UnknownKeyError(
        "unknown key",
        where=key_path(where, *steps),
        given=text,
        allowed=name_list(names, 40) or "keys of the scene",
        hint=near if near.startswith("did") else suggest(text, find_numbers(document), most=6),
    )


def _too_far(text: str, above: Steps, size: int, where: str) -> InvalidValueError:
    return InvalidValueError(
        "the list is shorter",
        where=key_path(where, *above),
        given=text,
        allowed=f"numbers of the list are 0 to {size - 1}" if size else "the list is empty",
    )


def _no_number(text: str, steps: Steps, place: Place, where: str) -> InvalidValueError:
    below = [
        f"{format_path(steps)}.{name}" for name in place.names()
        if (found := place.below(name)) is not None and found.is_number
    ]  # fmt: skip
    if place.schema.get("type") == "array":
        size = len(place.value) if isinstance(place.value, list) else 3
        below = [f"{format_path(steps)}[{k}]" for k in range(size)]
    return InvalidValueError(
        f"this is {place.word}, not a number",
        where=key_path(where, *steps),
        given=text,
        allowed="the path of a number",
        hint=f"for example {', '.join(below[:4])}" if below else "",
    )
