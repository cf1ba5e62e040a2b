"""The schema of scene files, walked together with a scene: what may stand below a place."""

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.schema.body_schema import LOAD_TAGS, load_tag
from tensegrity_codegen.scene.schema.schema import scene_json_schema

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
        whole = np.floor(values) == values if self.is_whole else True
        return np.asarray(above & below & whole & np.isfinite(values), dtype=np.bool_)


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
        return any(item.get("type") in NUMBERS for item in self._variants())

    @property
    def bounds(self) -> Bounds:
        """Which numbers may stand here."""
        found = next((item for item in self._variants() if item.get("type") in NUMBERS), {})
        lower, upper = found.get("exclusiveMinimum"), found.get("exclusiveMaximum")
        return Bounds(
            lower if lower is not None else found.get("minimum", -math.inf),
            upper if upper is not None else found.get("maximum", math.inf),
            lower is not None,
            upper is not None,
            found.get("type") == "integer",
        )

    @property
    def word(self) -> str:
        """What stands here, in a message: "a table", "a list", "a text", ..."""
        if isinstance(self.value, bool):
            return "true or false"
        types = {item.get("type", "") for item in self._variants()}
        names = {"object": "a table", "array": "a list", "string": "a text", "boolean": "true or false"}
        return next((names[item] for item in names if item in types), "no number")

    def names(self) -> list[str]:
        """Return the keys that may stand below: those of the schema, names that the scene has."""
        stated = list(self.value) if isinstance(self.value, Mapping) else []
        if isinstance(self.value, list):
            stated = [
                str(item["name"]) for item in self.value if isinstance(item, Mapping) and "name" in item
            ]
        return list(dict.fromkeys([*self.schema.get("properties", {}), *stated]))

    def index_of(self, step: str | int) -> str | int | None:
        """Return where the value has what `step` names: a key, a number of a list, an item by its name."""
        if isinstance(self.value, list) and isinstance(step, str):
            named = (
                k
                for k, item in enumerate(self.value)
                if isinstance(item, Mapping) and item.get("name") == step
            )
            return next(named, None)
        return step

    def below(self, step: str | int) -> "Place | None":
        """Return the place that `step` leads to, None where there can be none."""
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
            more = self.schema.get("patternProperties") or {}
            schema = next(iter(more.values()), None)
            if not stated and _needs_keys(schema):
                return None
        return None if schema is None else Place(schema, self.value[index] if stated else None)

    def _variants(self) -> list[Mapping[str, Any]]:
        return [_resolve(item, None) for item in self.schema.get("oneOf", [self.schema])]

    def leaves(self) -> Iterator[tuple[tuple[str | int, ...], float]]:
        """Yield the path and value of every number that is stated here and below."""
        if isinstance(self.value, Mapping | list):
            keys = self.value if isinstance(self.value, Mapping) else range(len(self.value))
            for step in keys:
                place = self.below(step)
                for path, value in place.leaves() if place else ():
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
        return _resolve({**target, **{key: item for key, item in schema.items() if key != "$ref"}}, value)
    if "oneOf" not in schema or value is None:
        return schema
    kinds = schema.get("discriminator", {}).get("mapping", {})
    if isinstance(value, Mapping):
        tag = LOAD_TAGS[load_tag(dict(value))]
        word = kinds.get(str(value.get("kind")), f"#/$defs/{tag}" if not kinds else "")
        return _resolve({"$ref": word}, value) if word else schema
    if isinstance(value, list):
        return next((item for item in schema["oneOf"] if item.get("type") == "array"), schema)
    return schema


def _needs_keys(schema: Mapping[str, Any] | None) -> bool:
    """Return whether an entry that the scene has not cannot come about by one number."""
    if schema is None:
        return True
    resolved = _resolve(schema, None)
    return bool(resolved.get("required")) or "oneOf" in resolved or resolved.get("type") == "array"
