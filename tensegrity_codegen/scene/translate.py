"""From the validator's list of errors to one error of this package that names file, key, value and range."""

import functools
import math
import reprlib
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from tensegrity_codegen.scene.names import FILE_NAME_RULE, NAME_RULE, key_path, unknown_key
from tensegrity_codegen.scene.schema.body_schema import LOAD_TAGS
from tensegrity_codegen.scene.schema.schema import scene_json_schema
from tensegrity_codegen.system.errors import (
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    UnknownNameError,
    suggest,
)

MAX_SHOWN = 5

_RANGE = {
    "greater_than": ("gt", "a number greater than {}"),
    "greater_than_equal": ("ge", "a number not less than {}"),
    "less_than": ("lt", "a number less than {}"),
    "less_than_equal": ("le", "a number not greater than {}"),
    "too_short": ("min_length", "a list of at least {}"),
    "too_long": ("max_length", "a list of at most {}"),
}
_TYPE = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text in quotes",
    "tuple_type": "a list [...]",
    "dict_type": "a table {...}",
    "model_type": "a table {...}",
    "model_attributes_type": "a table {...}",
}


def translate(error: ValidationError, where: str) -> SceneError:
    """Return the validator's errors as one of ours, unknown keys first, up to five others in its hint."""
    details = error.errors(include_url=False)
    # A list whose items were refused was long enough: "too short" of it says nothing.
    lists = {detail["loc"][:-1] for detail in details}
    selected = [detail for detail in details if detail["type"] != "too_short" or detail["loc"] not in lists]
    details = selected or details
    details.sort(key=lambda detail: detail["type"] != "extra_forbidden")
    main_error = _translate_one(details[0], where)
    remaining = details[1:]
    if remaining:
        shown = [_translate_one(detail, "") for detail in remaining[:MAX_SHOWN]]
        lines = [f"{detail.where}: {detail.problem}" for detail in shown]
        if len(remaining) > MAX_SHOWN:
            lines.append(f"and {len(remaining) - MAX_SHOWN} more")
        main_error.problem += f" ({len(remaining)} more problem{'s' if len(remaining) > 1 else ''} below)"
        main_error.hint = "\n           ".join(
            line for line in (main_error.hint, "also correct", *lines) if line
        )
    return main_error


def _translate_one(detail: ErrorDetails, where: str) -> SceneError:
    kind, loc, context = detail["type"], list(detail["loc"]), detail.get("ctx", {})
    is_key = kind != "extra_forbidden" and bool(loc) and loc[-1] == "[key]"
    path = _path_without_tags(loc[:-1] if is_key else loc)
    location = key_path(where, *path)
    value = loc[-2] if is_key else _shown(detail["input"])
    if kind == "extra_forbidden":
        return unknown_key(str(loc[-1]), _schema_at(loc[:-1]).get("properties", {}), location)
    if kind in ("string_pattern_mismatch", "name_keyword", "name_of_file"):
        problem = "not a valid name" if kind == "string_pattern_mismatch" else detail["msg"]
        allowed = FILE_NAME_RULE if kind == "name_of_file" else NAME_RULE
        if "[.]" in str(context.get("pattern", "")):
            return InvalidNameError(
                "not the name of a point",
                where=location,
                given=value,
                allowed='"body.point"',
                hint="rename it",
            )
        return InvalidNameError(problem, where=location, given=value, allowed=allowed, hint="rename it")
    if kind == "unknown_name":
        hint = suggest(value, context["known"])
        known_names = ", ".join(context["known"])
        return UnknownNameError(
            f"unknown {context['what']}", where=location, given=value, allowed=known_names, hint=hint
        )
    if kind == "missing":
        allowed, hint = _meaning(loc), f"add {path[-1]!r}"
        return InvalidValueError("a needed key is missing", where=location, allowed=allowed, hint=hint)
    if kind == "finite_number" or (isinstance(value, float) and not math.isfinite(value)):
        return NonFiniteError("not a finite number", where=location, given=value, allowed=_meaning(loc))
    return _invalid_value(detail, loc, location, value)


def _invalid_value(detail: ErrorDetails, loc: list[str | int], place: str, given: Any) -> InvalidValueError:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind in _RANGE:
        key, range_text = _RANGE[kind]
        problem, allowed = "the value is out of range", range_text.format(f"{context[key]:g}")
    elif kind == "float_type" and type(detail["input"]) is int:
        problem, allowed = "the number is too large", "a number of ordinary size"
    elif kind in _TYPE:
        problem, allowed = f"{_article(detail['input'])} where {_TYPE[kind]} is needed", _TYPE[kind]
    elif kind in ("literal_error", "union_tag_invalid"):
        problem = "not one of the allowed words"
        allowed = str(context.get("expected", context.get("expected_tags", "")))
        if kind == "union_tag_invalid" and isinstance(detail["input"], dict) and "kind" in detail["input"]:
            place, given = f"{place}.kind", detail["input"]["kind"]
    elif kind == "union_tag_not_found":
        kinds = _schema_at(loc).get("discriminator", {}).get("mapping", {})
        problem, allowed = "the key 'kind' is missing", ", ".join(kinds)
    else:
        problem, allowed = detail["msg"][:1].lower() + detail["msg"][1:], ""
    allowed = "; ".join(sentence for sentence in (allowed, _meaning(loc)) if sentence)
    return InvalidValueError(problem, where=place, given=given, allowed=allowed)


def _article(value: Any) -> str:
    names = {bool: "a truth value", str: "a text", int: "a number", float: "a number"}
    names |= {dict: "a table", list: "a list", tuple: "a list"}
    return names.get(type(value), f"a {type(value).__name__}")


class _Shown(str):
    """A text that is shown without quotes."""

    def __repr__(self) -> str:
        return str(self)


def _shown(value: Any) -> Any:
    """Return a scalar as it is, a container as a short text (it may be deep and long), a long text cut."""
    if isinstance(value, bool):
        return _Shown("true" if value else "false")
    if isinstance(value, str):
        return value[:200]
    if value is None or isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**63):
        return value
    return _Shown(reprlib.repr(value))


# The schema is walked with the validator's path, in which the tags of unions appear as extra steps.


@functools.cache
def _schema() -> dict[str, Any]:
    return scene_json_schema()


def _path_without_tags(loc: list[str | int]) -> list[str | int]:
    root = node = _schema()
    path: list[str | int] = []
    for step in loc:
        node, is_tag = _step(root, node, step)
        if not is_tag:
            path.append(step)
    return path


def _schema_at(loc: list[str | int]) -> dict[str, Any]:
    root = node = _schema()
    for step in loc:
        node, _ = _step(root, node, step)
    return node


def _step(root: dict[str, Any], node: dict[str, Any], step: str | int) -> tuple[dict[str, Any], bool]:
    """Return the schema below `node` and whether `step` was only the tag of a union."""
    if isinstance(step, str) and step.startswith("@"):
        tagged = LOAD_TAGS.get(step)
        return (_resolve(root, {"$ref": f"#/$defs/{tagged}"}) if tagged else node), True
    mapping = node.get("discriminator", {}).get("mapping", {})
    if step in mapping:
        return _resolve(root, {"$ref": mapping[step]}), True
    below = node.get("items", {}) if isinstance(step, int) else _below(node, step)
    return _resolve(root, below), False


def _below(node: dict[str, Any], key: str) -> dict[str, Any]:
    any_key = node.get("additionalProperties")
    patterns: dict[str, Any] = next(iter(node.get("patternProperties", {}).values()), {})
    schema: dict[str, Any] = node.get("properties", {}).get(key) or (
        any_key if isinstance(any_key, dict) else patterns
    )
    return schema


def _resolve(root: dict[str, Any], node: dict[str, Any]) -> dict[str, Any]:
    if "$ref" not in node:
        return node
    target = root["$defs"][node["$ref"].rsplit("/", 1)[1]]
    return {**target, **{key: value for key, value in node.items() if key != "$ref"}}


def _meaning(loc: list[str | int]) -> str:
    """Return the sentence of the innermost key of `loc` that has one."""
    for end in range(len(loc), max(len(loc) - 3, 0), -1):
        sentence = str(_schema_at(loc[:end]).get("description", ""))
        if sentence:
            return sentence
    return ""
