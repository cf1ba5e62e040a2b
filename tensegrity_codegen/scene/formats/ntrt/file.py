"""One NTRT structure file as checked plain data: which keys, which shapes, where each thing stands.

Scalars stay texts, as the toolkit's own reader has them: a node may be called `no` or `1e3`.
"""

import math
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any

import yaml

from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.scene.names import unknown_key
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneSyntaxError,
)

MAX_YAML_BYTES = 2**20  # bytes
MAX_NUMBER = 1e50  # products of several stay finite
MAX_VALUES = 200_000  # of one file, each alias counted with all that it stands for
_SECTIONS = ("nodes", "pair_groups", "builders", "substructures", "bond_groups")


class _Loader(getattr(yaml, "CBaseLoader", yaml.BaseLoader)):  # type: ignore[misc]
    """Builds texts, lists and dicts only, and refuses a key that stands twice in one table."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if key_node.value in seen if isinstance(key_node.value, str) else True:
                raise _KeyTwiceError(str(key_node.value)[:80], key_node.start_mark.line + 1)
            seen.add(key_node.value)
        table: dict[Hashable, Any] = super().construct_mapping(node, deep=deep)
        return table


class _KeyTwiceError(Exception):
    def __init__(self, key: str, line: int) -> None:
        super().__init__(key)
        self.key, self.line = key, line


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the sections of an NTRT structure file."""
    text = read_text(path, MAX_YAML_BYTES, "an NTRT structure file (YAML)")
    where = str(path)
    try:
        content = yaml.load(text, Loader=_Loader)  # a BaseLoader: builds no objects
        size = _expanded_size(content, {})
    except _KeyTwiceError as error:
        problem = "a key is given twice in one table (or is not a text)"
        location = f"{where}: line {error.line}"
        raise DuplicateNameError(problem, where=location, given=error.key, allowed="each key once") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        position = f": line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise SceneSyntaxError(f"not valid YAML: {error.problem}", where=where + position) from None
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        problem = "nested too deeply" if isinstance(error, RecursionError) else str(error).split("\n")[0]
        raise SceneSyntaxError(f"not valid YAML: {problem}", where=where) from None
    if size > MAX_VALUES:
        problem = "the file has too many values, aliases written out"
        raise SceneSyntaxError(problem, where=where, given=size, allowed=f"up to {MAX_VALUES}")
    table = read_table(content, where)
    check_keys(table, _SECTIONS, where)
    return table


def _expanded_size(value: Any, sizes: dict[int, int]) -> int:
    """Return how many values there are in a value, those that aliases share counted wherever they stand."""
    if not isinstance(value, dict | list):
        return 1
    if id(value) not in sizes:
        entries = value.values() if isinstance(value, dict) else value
        sizes[id(value)] = 1 + sum(_expanded_size(entry, sizes) for entry in entries)
    return sizes[id(value)]


def read_table(value: Any, where: str) -> dict[str, Any]:
    """Return a YAML table, empty for an empty entry; raises InvalidValueError for anything else."""
    if value is None or value == "":
        return {}
    if not isinstance(value, dict):
        problem = "not a table"
        raise InvalidValueError(problem, where=where, given=_shown(value), allowed="a table of key: value")
    return value


def check_keys(table: dict[str, Any], known: Sequence[str], where: str) -> None:
    """Raise UnknownKeyError for a key that is not `known`."""
    for key in table:
        if key not in known:
            raise unknown_key(key, known, where)


def parse_number(value: Any, where: str) -> float:
    """Return a YAML scalar as a finite number; raises InvalidValueError or NonFiniteError."""
    try:
        number = float(value) if isinstance(value, str) and "_" not in value else None
    except ValueError:
        number = None
    if number is None:
        special = isinstance(value, str) and value.lower().lstrip("+-") in (".inf", ".nan")
        error = NonFiniteError if special else InvalidValueError
        raise error("not a number", where=where, given=_shown(value), allowed="a finite number")
    if not math.isfinite(number):
        raise NonFiniteError("not a finite number", where=where, given=value, allowed="a finite number")
    if abs(number) > MAX_NUMBER:
        problem = "the number is too large"
        raise InvalidValueError(problem, where=where, given=number, allowed=f"up to {MAX_NUMBER:g}")
    return number


def parse_vector(value: Any, where: str) -> tuple[float, float, float]:
    """Return three finite numbers; raises InvalidValueError or NonFiniteError."""
    if not isinstance(value, list) or len(value) != 3:
        raise InvalidValueError("not a vector", where=where, given=_shown(value), allowed="[x, y, z]")
    x, y, z = (parse_number(number, where) for number in value)
    return x, y, z


def parse_pair(value: Any, where: str) -> tuple[str, str]:
    """Return the two node names of a pair; raises InvalidValueError."""
    if not isinstance(value, list) or len(value) != 2 or not all(isinstance(name, str) for name in value):
        problem = "not a pair of nodes"
        raise InvalidValueError(problem, where=where, given=_shown(value), allowed="[node, node]")
    return value[0], value[1]


def _shown(value: Any) -> str:
    """Return a short text of a value that may be deep and long."""
    if isinstance(value, dict):
        return f"a table of {len(value)}"
    return f"a list of {len(value)}" if isinstance(value, list) else str(value)
