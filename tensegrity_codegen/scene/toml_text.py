"""The TOML text of a scene document.

Numbers are written so that they read back bit-equal; one node, member, load or input takes one line.
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_ESCAPES = {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
_SECTIONS = (
    *(
        "model",
        "parameters",
        "classes",
        "shape",
        "nodes",
        "members",
        "bodies",
        "tendons",
        "groups",
        "sliding",
    ),
    *("joint_friction", "interference", "ground", "loads", "inputs", "actuators", "sensors", "limits"),
)
_TABLES = ("classes", "bodies")  # one [section.name] table each
_LISTS = ("joint_friction", "loads", "inputs", "actuators", "sensors")  # one [[section]] table each


def format_scene(document: Mapping[str, Any]) -> str:
    """Return the TOML text of a scene document; keys that are None and empty sections are left out."""
    head = [key for key in document if key not in _SECTIONS]
    lines = [_pair(key, document[key], key) for key in head if document[key] is not None]
    blocks = ["\n".join(lines)] if lines else []
    blocks += [block for name in _SECTIONS if document.get(name) for block in _section(name, document[name])]
    return "\n\n".join(blocks) + "\n"


def _section(name: str, value: Any) -> Iterable[str]:
    """Yield the text blocks of one section."""
    if name in _LISTS:
        for number, entry in enumerate(value):
            yield "\n".join([f"[[{name}]]", *_pairs(entry, key_path("", name, number))])
    elif name in _TABLES:
        for key, entry in value.items():
            yield "\n".join([f"[{name}.{_key(key)}]", *_pairs(entry, key_path("", name, key))])
    elif name == "limits" and isinstance(value, Mapping):
        inner = {key: entry for key, entry in value.items() if isinstance(entry, Mapping)}
        plain = {key: entry for key, entry in value.items() if key not in inner}
        yield "\n".join([f"[{name}]", *_pairs(plain, name)])
        for key, entry in inner.items():
            if entry:
                yield "\n".join([f"[{name}.{_key(key)}]", *_pairs(entry, key_path("", name, key))])
    else:
        yield "\n".join([f"[{name}]", *_pairs(value, name)])


def _pairs(table: Mapping[str, Any], where: str) -> list[str]:
    if not isinstance(table, Mapping):
        raise InvalidValueError("not a table", where=where, given=table, allowed="a table (dict)")
    return [_pair(key, value, f"{where}.{key}") for key, value in table.items() if value is not None]


def _pair(key: str, value: Any, where: str) -> str:
    return f"{_key(key)} = {_value(value, where)}"


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _string(key)


def _string(text: str) -> str:
    def escape(letter: str) -> str:
        if letter in _ESCAPES:
            return _ESCAPES[letter]
        return f"\\u{ord(letter):04X}" if ord(letter) < 0x20 or ord(letter) == 0x7F else letter

    return '"' + "".join(map(escape, text)) + '"'


def _value(value: Any, where: str) -> str:
    """Return one TOML value; floats by their shortest text that reads back bit-equal."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        if not math.isfinite(value):
            problem = "not a finite number"
            raise NonFiniteError(problem, where=where, given=float(value), allowed="a finite number")
        return repr(float(value))
    if isinstance(value, str):
        if any(0xD800 <= ord(letter) <= 0xDFFF for letter in value):
            raise InvalidValueError("the text is not valid Unicode", where=where, given=value)
        return _string(value)
    if isinstance(value, np.ndarray):
        return _value(value.tolist(), where)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_pairs(value, where)) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(entry, where) for entry in value) + "]"
    problem = f"a {type(value).__name__} cannot be written to a scene file"
    allowed = "numbers, texts, true, false, lists and tables"
    raise InvalidValueError(problem, where=where, given=value, allowed=allowed)
