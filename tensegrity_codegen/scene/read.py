"""Reading a scene: file -> TOML document -> checked Scene.

The long and plain sections of a file are read as JSON, several times as fast as TOML in Python. A section is
plain if every line of it is `name = { key = value, ... }` with bare keys and with values that TOML and JSON
write alike: numbers, true, false, short texts without escapes, lists of these. So importers write the nodes
and members of a scene. All else, and every doubt, is left to the TOML reader.
"""

import json
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from tensegrity_codegen.scene.checks.limits import (
    MAX_FILE_BYTES,
    check_document,
    check_regular,
    check_text,
    validate,
)
from tensegrity_codegen.scene.names import key_path, unknown_key
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.translate import translate
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    SceneSyntaxError,
    StructureError,
)

MIN_PLAIN_LENGTH = 100_000  # characters of a file for which it pays
_SECTIONS = ("nodes", "members")

_PLAIN_KEY = r"[A-Za-z0-9_-]{1,64}+"
_NUMBER = r"-?+(?:0|[1-9][0-9]{0,40}+)(?:\.[0-9]{1,40}+)?+(?:[eE][+-]?+[0-9]{1,4}+)?+"
_SCALAR = rf'(?:{_NUMBER}|"[A-Za-z0-9_.-]*+"|true|false)'
_LIST = rf"\[ *+{_SCALAR}(?: *+, *+{_SCALAR}){{0,15}}+ *+\]"
_PAIR = rf"{_PLAIN_KEY} *+= *+(?:{_SCALAR}|{_LIST})"
_LINE = rf"{_PLAIN_KEY} *+= *+\{{ *+{_PAIR}(?: *+, *+{_PAIR})*+ *+\}}"
_PLAIN = re.compile(rf"(?:(?:{_LINE})?+[ \t]*+\r?+\n)*+")
_ASSIGNED = re.compile(rf"({_PLAIN_KEY}) *+= *+")


def cut_plain_sections(text: str) -> tuple[str, dict[str, dict[str, Any]]]:
    """Return a scene's text without the lines of its plain sections, and the tables of these lines.

    The headers stay, and empty lines in the place of the others, so that the TOML reader finds a section
    that is there twice, and names lines by their numbers.
    """
    tables: dict[str, dict[str, Any]] = {}
    if len(text) < MIN_PLAIN_LENGTH or '"""' in text or "'''" in text:  # a long text could hold anything
        return text, tables
    for name in _SECTIONS:
        header = re.compile(rf"^\[{name}\][ \t]*\r?\n", re.MULTILINE)
        headers = list(header.finditer(text)) if f"[{name}]" in text else []
        if len(headers) != 1:
            continue
        start = headers[0].end()
        match = _PLAIN.match(text, start)
        end = match.end() if match else start
        table = _read_table(text[start:end]) if text[end : end + 1] in ("", "[") else None
        if table:
            tables[name] = table
            text = text[:start] + "\n" * text.count("\n", start, end) + text[end:]
    return text, tables


def _read_table(lines: str) -> dict[str, Any] | None:
    """Return the table of plain lines, None if a name or key stands twice or they are not plain after all.

    Python 3.11.2 matches possessive groups wrongly, so that _PLAIN lets `1.` and lists in lists through.
    """
    rows = [line for line in _ASSIGNED.sub(r'"\1":', lines).split("\n") if not line.isspace() and line]
    try:
        table: dict[str, dict[str, Any]] = json.loads("{" + ",".join(rows) + "}")
    except ValueError:
        return None
    is_complete = len(table) + sum(map(len, table.values())) == lines.count("=") and len(table) == len(rows)
    return table if is_complete else None


_POSITION = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_HEADER = re.compile(r"^[ \t]*\[+([^\[\]\n]+)\]", re.MULTILINE)
_KEY = re.compile(r"\s*\[*\s*([^=\[\]\n]{1,200}?)\s*[=\]]")
_TWICE = re.compile(r"Cannot (overwrite|declare|mutate|redefine)|Duplicate inline table key")
# The first statement, after blank lines and comments, if its key is a bare one.
_FIRST_KEY = re.compile(r"(?:[ \t\r\n]++|#[^\n]*+\n)*+\[*+([A-Za-z0-9_-]++)[ \t]*+[=.\]]")
# A dotted key of more than 32 parts: the TOML reader takes quadratic time for it.
_LONG_KEY = re.compile(r"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){32}")
# A list of more than 1000 numbers or bare words: a scene has none, and the reader is slow with millions.
_LONG_LIST = re.compile(r"\[\s*+(?:[-+.\w]++\s*+,\s*+){1000}")
_LONG_NUMBER = re.compile(r"(?<![0-9_])[0-9_]{1000}")


def read_scene(path: str | Path | Mapping[str, Any] | Scene) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    path : str, Path, mapping or Scene
        Scene file (TOML), or the scene as a dictionary with the sections and keys of such a file. Its
        numbers and lists may be NumPy's. A Scene is returned as it is.

    Returns
    -------
    Scene
        The checked scene; `to_toml` gives it as text again.

    Raises
    ------
    SceneError
        The file cannot be read.
    SceneSyntaxError
        The file is not TOML, not UTF-8, or too large.
    DuplicateNameError
        A name that the file defines twice.
    UnknownKeyError, InvalidNameError, UnknownNameError, NonFiniteError, InvalidValueError, StructureError
        A wrong key or value, or an empty scene.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, read_scene
    >>> scene = read_scene({
    ...     "name": "swing",
    ...     "gravity": [0, 0, -9.81],
    ...     "nodes": {"top": {"position": [0, 0, 0], "anchored": True},
    ...               "load": {"position": [0, 0, -1], "mass": 2.0}},
    ...     "members": {"rope": {"kind": "cable", "nodes": ["top", "load"],
    ...                          "axial_stiffness": 1e4, "rest_length": 1.0}},
    ... })
    >>> compile_scene(scene, for_="equilibrium").structure.n_members
    1
    """
    if isinstance(path, Scene):
        return path
    if isinstance(path, Mapping):
        try:
            return parse_scene(to_plain(path))
        except RecursionError:
            raise SceneSyntaxError("the scene is nested too deeply", where="scene") from None
    if not isinstance(path, str | os.PathLike):
        allowed = "the path of a scene file, a mapping with its sections, or a Scene"
        raise InvalidValueError("not a scene", where="scene", given=type(path).__name__, allowed=allowed)
    return parse_scene(read_document(path, known=frozenset(Scene.model_fields)), str(path))


def name_source(path: str | Path | Mapping[str, Any] | Scene) -> str:
    """Return the name of a scene's source in messages: its file, or "scene"."""
    return "scene" if isinstance(path, Mapping | Scene) else str(path)


def to_plain(value: Any) -> Any:
    """Return tables and lists of NumPy's as Python's own; other values as they are."""
    if isinstance(value, Mapping):
        return {key: to_plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(entry) for entry in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def parse_scene(document: Mapping[str, Any], where: str = "scene") -> Scene:
    """Return the scene of a plain `document` (the dict form of the TOML); `where` names its source."""
    if not isinstance(document, Mapping):
        raise InvalidValueError("not a scene", where=where, given=document, allowed="a table (dict)")
    if not document:
        allowed = "a name, nodes and members, or a name and a shape"
        raise StructureError("the scene is empty", where=where, allowed=allowed, hint="start from an example")
    check_document(document, where)
    try:
        return validate(document)
    except ValidationError as error:
        raise translate(error, where) from None
    except RecursionError:
        raise SceneSyntaxError("the scene is nested too deeply", where=where) from None


def read_document(path: str | Path, *, known: frozenset[str] = frozenset()) -> dict[str, Any]:
    """Read a TOML file as a plain dict, unchecked; another top-level key than `known` is refused first."""
    where = str(path)
    full_text = _read_text(Path(path), where)
    check_text(full_text, where)
    text, plain = cut_plain_sections(full_text)
    check_text(text, where, plain=True)
    _refuse_nonsense(text, known, where)
    try:
        document = tomllib.loads(text)
        if any(document[name] for name in plain):  # a plain section is there in another form too
            return tomllib.loads(full_text)
        return {key: plain.get(key, value) for key, value in document.items()}
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(full_text.replace("\r\n", "\n"), str(error), where) from None
    except RecursionError:
        raise SceneSyntaxError("the file is nested too deeply to be a scene", where=where) from None
    except ValueError as error:  # an integer of thousands of digits
        raise SceneSyntaxError(f"not a scene: {error}", where=where) from None


def _read_text(path: Path, where: str) -> str:
    check_regular(path, where)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        problem = f"the file cannot be read: {reason}"
        raise SceneError(problem, where=where, hint="check the path and its permissions") from None
    except ValueError as error:  # a path with a null character
        raise SceneError(f"no such file: {error}", where=repr(where)) from None
    if len(data) > MAX_FILE_BYTES:
        problem = "the file is too large to be a scene"
        raise SceneSyntaxError(problem, where=where, allowed=f"up to {MAX_FILE_BYTES >> 20} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        problem, location = "the file is not UTF-8 text", f"{where}: line {line}"
        value, allowed = bytes(data[error.start : error.start + 8]), "TOML, which is UTF-8"
        hint = "save it as UTF-8"
        raise SceneSyntaxError(problem, where=location, given=value, allowed=allowed, hint=hint) from None


def _refuse_nonsense(text: str, known: frozenset[str], where: str) -> None:
    """Refuse in linear time a text that takes the TOML reader long."""
    first_key = _FIRST_KEY.match(text)
    if known and first_key and first_key[1] not in known:
        raise unknown_key(first_key[1], sorted(known), key_path(where, first_key[1][:80]))
    for pattern, mark, problem, allowed in (
        (_LONG_KEY, ".", "a dotted key has too many parts", "up to 32 parts"),
        (
            _LONG_LIST,
            ",",
            "a list of numbers is too long to be part of a scene",
            "vectors of up to 3 numbers",
        ),
        (_LONG_NUMBER, "", "a number has too many digits", "numbers of ordinary size"),
    ):
        match = pattern.search(text) if mark in text else None
        if match:
            line = text.count("\n", 0, match.start()) + 1
            raise SceneSyntaxError(problem, where=f"{where}: line {line}", allowed=allowed)


def _syntax_error(text: str, message: str, where: str) -> SceneError:
    """Return the error for a TOML reader's `message`, with the line, its text and the key named."""
    match = _POSITION.search(message)
    problem = message[: match.start()] if match else message
    lines = text.split("\n")
    if match and match[1]:
        number, column = int(match[1]), int(match[2])
    else:  # the end of the document
        while len(lines) > 1 and not lines[-1].strip():
            lines.pop()
        number, column = len(lines), len(lines[-1]) + 1
    line = lines[number - 1]
    if _TWICE.match(problem):
        return _twice(lines, number, problem, where)
    start = max(0, column - 50)
    return SceneSyntaxError(
        f"not valid TOML: {problem[:100]}",
        where=f"{where}: line {number}, column {column}",
        given=line[start : start + 80],
        hint="strings need quotes, numbers a digit before the point, inline tables one line; see https://toml.io",
    )


def _twice(lines: list[str], number: int, problem: str, where: str) -> DuplicateNameError:
    line = lines[number - 1]
    inline = re.search(r"Duplicate inline table key '(.*)'", problem)
    key = _KEY.match(line)
    name = inline[1] if inline else key[1] if key else line.strip()
    section = ""
    if not line.lstrip().startswith("["):
        headers = _HEADER.findall("\n".join(lines[: number - 1]))
        section = headers[-1].strip() if headers else ""
    owner = key[1] if inline and key and key[1] != name else ""
    path = ".".join(key_part for key_part in (section, owner, name) if key_part)
    return DuplicateNameError(
        "the name is defined twice",
        where=f"{key_path(where)}: line {number}: {path[:200]}",
        given=name[:80],
        allowed="each key and each name once",
        hint="rename or remove one of the two",
    )
