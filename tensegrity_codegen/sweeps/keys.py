"""Numbers of a scene by their paths: `classes.cable.spring_constant`, `loads[0].force[2]`."""

import functools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.schema.body_schema import LOAD_TAGS, load_tag
from tensegrity_codegen.scene.schema.schema import scene_json_schema
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError, suggest

NUMBERS = ("number", "integer")


@dataclass(frozen=True)
class Bounds:
    """Which numbers may stand at a place: from `lower` to `upper`; an open end is not allowed itself."""

    lower: float = -math.inf
    upper: float = math.inf
    lower_is_open: bool = False
    upper_is_open: bool = False
    is_whole: bool = False

    def contain(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which values are allowed, (n,)."""
        above = values > self.lower if self.lower_is_open else values >= self.lower
        below = values < self.upper if self.upper_is_open else values <= self.upper
        is_integer = np.floor(values) == values if self.is_whole else True
        return np.asarray(above & below & is_integer & np.isfinite(values), dtype=np.bool_)


ANY = Bounds()


class Place:
    """One place of a scene: the schema of what stands there, and its value, None where it is not stated.

    schema: one node of the JSON schema, references and unions resolved as far as the value decides them.
    """

    def __init__(self, schema: Mapping[str, Any], value: Any) -> None:
        self.value = value
        self.schema = _resolve(schema, value)

    @property
    def is_number(self) -> bool:
        """Whether a number may stand here."""
        return any(variant.get("type") in NUMBERS for variant in self._variants())

    @property
    def bounds(self) -> Bounds:
        """Which numbers may stand here."""
        number = next((variant for variant in self._variants() if variant.get("type") in NUMBERS), {})
        lower, upper = number.get("exclusiveMinimum"), number.get("exclusiveMaximum")
        return Bounds(
            lower if lower is not None else number.get("minimum", -math.inf),
            upper if upper is not None else number.get("maximum", math.inf),
            lower is not None,
            upper is not None,
            number.get("type") == "integer",
        )

    @property
    def word(self) -> str:
        """The kind of value, in a message: "a table", "a list", "a text", ..."""
        if isinstance(self.value, bool):
            return "true or false"
        types = {variant.get("type", "") for variant in self._variants()}
        names = {"object": "a table", "array": "a list", "string": "a text", "boolean": "true or false"}
        return next((names[variant] for variant in names if variant in types), "no number")

    def names(self) -> list[str]:
        """Return the keys that may stand below: those of the schema, names that the scene has."""
        stated = list(self.value) if isinstance(self.value, Mapping) else []
        if isinstance(self.value, list):
            stated = [
                str(entry["name"]) for entry in self.value if isinstance(entry, Mapping) and "name" in entry
            ]
        return list(dict.fromkeys([*self.schema.get("properties", {}), *stated]))

    def index_of(self, step: str | int) -> str | int | None:
        """Return the index of `step` in the value: a key, a number of a list, an item by its name."""
        if isinstance(self.value, list) and isinstance(step, str):
            named = (
                k
                for k, entry in enumerate(self.value)
                if isinstance(entry, Mapping) and entry.get("name") == step
            )
            return next(named, None)
        return step

    def below(self, step: str | int) -> "Place | None":
        """Return the place that `step` leads to, None if there can be none."""
        index = self.index_of(step)
        if index is None:
            return None
        if isinstance(index, int):
            if "items" not in self.schema:
                return None
            length = len(self.value) if isinstance(self.value, list) else 0
            return Place(self.schema["items"], self.value[index]) if index < length else None
        schema = self.schema.get("properties", {}).get(index)
        stated = isinstance(self.value, Mapping) and index in self.value
        if schema is None:
            patterns = self.schema.get("patternProperties") or {}
            schema = next(iter(patterns.values()), None)
            if not stated and _needs_keys(schema):
                return None
        return None if schema is None else Place(schema, self.value[index] if stated else None)

    def _variants(self) -> list[Mapping[str, Any]]:
        return [_resolve(variant, None) for variant in self.schema.get("oneOf", [self.schema])]

    def leaves(self) -> Iterator[tuple[tuple[str | int, ...], float]]:
        """Yield the path and value of every number that is stated here and below."""
        if isinstance(self.value, Mapping | list):
            keys = self.value if isinstance(self.value, Mapping) else range(len(self.value))
            for step in keys:
                child = self.below(step)
                for path, value in child.leaves() if child else ():
                    yield (step, *path), value
        elif self.is_number and isinstance(self.value, int | float) and not isinstance(self.value, bool):
            yield (), self.value


def root_place(document: Mapping[str, Any]) -> Place:
    """Return the place of a whole scene."""
    return Place(_schema(), document)


@functools.cache
def _schema() -> dict[str, Any]:
    return scene_json_schema()


def _resolve(schema: Mapping[str, Any], value: Any) -> Mapping[str, Any]:
    """Return the schema with its reference followed, and of a union the part that the value belongs to."""
    if "$ref" in schema:
        target = _schema()["$defs"][schema["$ref"].rsplit("/", 1)[1]]
        return _resolve({**target, **{key: entry for key, entry in schema.items() if key != "$ref"}}, value)
    if "oneOf" not in schema or value is None:
        return schema
    kinds = schema.get("discriminator", {}).get("mapping", {})
    if isinstance(value, Mapping):
        tag = LOAD_TAGS[load_tag(dict(value))]
        reference = kinds.get(str(value.get("kind")), f"#/$defs/{tag}" if not kinds else "")
        return _resolve({"$ref": reference}, value) if reference else schema
    if isinstance(value, list):
        return next((entry for entry in schema["oneOf"] if entry.get("type") == "array"), schema)
    return schema


def _needs_keys(schema: Mapping[str, Any] | None) -> bool:
    """Return whether an entry that the scene has not cannot come about by one number."""
    if schema is None:
        return True
    resolved = _resolve(schema, None)
    return bool(resolved.get("required")) or "oneOf" in resolved or resolved.get("type") == "array"


_STEP = re.compile(r"(?:^|\.)([A-Za-z_][A-Za-z0-9_]*)|\[(\d{1,9})\]")
# Vectors that are zero if a scene has none, so that one of their numbers can be set.
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
        steps, node = parse_path(text), root_place(document)
        indices: list[str | int] = []
        for depth, step in enumerate(steps):
            index, below = node.index_of(step), node.below(step)
            if below is None and node.value is None and isinstance(step, int):
                return _in_vector_of_zeros(text, steps, depth, node, document, where)
            if index is None or below is None:
                raise _unknown(text, steps[: depth + 1], node, document, where)
            indices.append(index)
            node = below
        if not node.is_number:
            raise _no_number(text, steps, node, where)
        return cls(text, tuple(indices), node.bounds)

    def read(self, document: Mapping[str, Any]) -> float | None:
        """Return the number, None if the scene does not state it."""
        value: Any = document
        for step in self.steps:
            try:
                value = value[step]
            except (KeyError, IndexError):
                return None
        return value if isinstance(value, int | float) and not isinstance(value, bool) else None

    def write(self, document: Mapping[str, Any], value: float) -> dict[str, Any]:
        """Return the scene with this number changed; the scene itself and all else in it stay as they are."""
        is_integer = self.bounds.is_whole and float(value).is_integer()
        number = int(value) if is_integer else float(value)
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
        allowed = "names joined by points, numbers of lists in brackets: loads[0].force[2]"
        raise InvalidValueError("not the path of a number", where=where, given=text, allowed=allowed)
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
    step, remaining = steps[0], steps[1:]
    if isinstance(step, int):
        entries = list(value) if value is not None else [0.0] * vector
        entries[step] = _write(entries[step], remaining, number, vector)
        return entries
    table = dict(value) if value is not None else {}
    table[step] = _write(table.get(step), remaining, number, vector)
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
        problem, location = "the scene does not state this list", key_path(where, *steps[:depth])
        allowed, hint = "one number of a list that the scene states", "write the whole list into the scene"
        raise InvalidValueError(problem, where=location, given=text, allowed=allowed, hint=hint)
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
        problem = "this list has items without names"
        allowed = f"a number in brackets: {format_path(above)}[0]"
        return InvalidValueError(problem, where=key_path(where, *above), given=text, allowed=allowed)
    if place.is_number or isinstance(step, int):
        problem = f"{'a number' if place.is_number else place.word} has nothing of this kind below"
        allowed = format_path(above) if place.is_number else ", ".join(place.names()) or "no list"
        return InvalidValueError(problem, where=key_path(where, *above), given=text, allowed=allowed)
    names = place.names()
    suggestion = suggest(step, names)
    problem, allowed = "unknown key", ", ".join(names[:40]) or "keys of the scene"
    hint = suggestion if suggestion.startswith("did") else suggest(text, find_numbers(document), most=6)
    return UnknownKeyError(problem, where=key_path(where, *steps), given=text, allowed=allowed, hint=hint)


def _too_far(text: str, above: Steps, size: int, where: str) -> InvalidValueError:
    problem = "the list is shorter"
    allowed = f"numbers of the list are 0 to {size - 1}" if size else "the list is empty"
    return InvalidValueError(problem, where=key_path(where, *above), given=text, allowed=allowed)


def _no_number(text: str, steps: Steps, place: Place, where: str) -> InvalidValueError:
    below = [
        f"{format_path(steps)}.{name}" for name in place.names()
        if (child := place.below(name)) is not None and child.is_number
    ]  # fmt: skip
    if place.schema.get("type") == "array":
        size = len(place.value) if isinstance(place.value, list) else 3
        below = [f"{format_path(steps)}[{k}]" for k in range(size)]
    problem, location = f"this is {place.word}, not a number", key_path(where, *steps)
    hint = f"for example {', '.join(below[:4])}" if below else ""
    return InvalidValueError(problem, where=location, given=text, allowed="the path of a number", hint=hint)
