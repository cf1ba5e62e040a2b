"""The result of every importer, and how foreign names become names of a scene."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import check_regular
from tensegrity_codegen.scene.names import check_scene_name, is_name, is_scene_name
from tensegrity_codegen.system.errors import SceneError, SceneSyntaxError, describe_reason

_LONGEST_NAME = 63


@dataclass(frozen=True)
class ImportResult:
    """A scene document made from foreign files; the notes say what was changed, assumed or left out."""

    document: dict[str, Any]
    notes: tuple[str, ...]


class NameBook:
    """Turns foreign names into names of a scene, each into its own, and remembers what was renamed.

    A name that is fine stays; otherwise letters that are not allowed become `_`, several of them one, none at
    the end; a name that does not start with a letter gets `prefix`, and a name that is taken gets a number.
    """

    def __init__(self, prefix: str, reserved: Iterable[str] = ()) -> None:
        self.prefix = prefix
        self.renamed: dict[str, str] = {}
        self._taken = set(reserved)
        self._last: dict[str, int] = {}  # the last number that a stem got

    def add(self, foreign: str) -> str:
        """Return the scene name of a new foreign name."""
        stem = self._clean(foreign)
        name, number = stem, self._last.get(stem, 1)
        while name in self._taken:
            number += 1
            ending = f"_{number}"
            name = stem[: _LONGEST_NAME - len(ending)] + ending
        self._last[stem] = number
        self._taken.add(name)
        if name != foreign:
            self.renamed[foreign] = name
        return name

    def _clean(self, foreign: str) -> str:
        if is_name(foreign):
            return foreign
        name = re.sub(r"(?:[^A-Za-z0-9]|_)+", "_", foreign[:1000])[:_LONGEST_NAME].rstrip("_")
        if not name[:1].isalpha():
            name = (self.prefix + name.lstrip("_"))[:_LONGEST_NAME].rstrip("_")
        return name if is_name(name) else f"{self.prefix.rstrip('_')}_{name}"[:_LONGEST_NAME].rstrip("_")

    def notes(self, what: str) -> list[str]:
        """Return a note about the renamed things, at most one."""
        if not self.renamed:
            return []
        shown = [f"{old!r} is {new}" for old, new in list(self.renamed.items())[:5]]
        hidden = len(self.renamed) - len(shown)
        ending = f", and {hidden} more" if hidden else ""
        return [
            f"{what} renamed, since names start with a letter and hold letters, digits and _ only: "
            + ", ".join(shown)
            + ending
        ]


def name_all(foreign: Iterable[str], prefix: str, what: str) -> tuple[dict[str, str], list[str]]:
    """Return scene names by foreign names that differ, and a note on those renamed.

    Names that are fine stay, whatever the others become. prefix: as in NameBook; what: "nodes were".
    """
    foreign, book = list(foreign), NameBook(prefix)
    unchanged = {name: book.add(name) for name in foreign if NameBook(prefix).add(name) == name}
    return {name: unchanged.get(name) or book.add(name) for name in foreign}, book.notes(what)


def read_bytes(path: Path, largest: int, what: str) -> bytes:
    """Return the content of a foreign file; raises SceneError, or SceneSyntaxError where it is too large."""
    where = str(path)
    check_regular(path, where)
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:
        problem = f"the file cannot be read: {describe_reason(error)}"
        raise SceneError(problem, where=where, hint="check the path and its permissions") from None
    if len(data) > largest:
        problem = f"the file is too large for {what}"
        raise SceneSyntaxError(problem, where=where, allowed=f"up to {largest >> 10} KB")
    return data


def read_text(path: Path, largest: int, what: str, fallback: str = "") -> str:
    """Return the text of a foreign file, without byte-order mark and with plain newlines.

    fallback: the encoding of files that are not UTF-8; without it they are refused.
    """
    where, data = str(path), read_bytes(path, largest, what)
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        if fallback:
            return data.decode(fallback).replace("\r\n", "\n").replace("\r", "\n")
        problem = "the file is not UTF-8 text"
        raise SceneSyntaxError(problem, where=where, allowed=what, hint="save it as UTF-8") from None
    if not text.strip():
        raise SceneSyntaxError("the file is empty", where=where, allowed=what)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def scene_name(given: str | None, path: Path, fallback: str) -> tuple[str, list[str]]:
    """Return the scene's name and notes: the given one (checked), else one made from the file's stem."""
    if given is not None:
        check_scene_name(given, "name")
        return given, []
    name = NameBook(fallback).add(path.stem)
    name = name if is_scene_name(name) else f"{fallback}{name}"
    return name, [] if name == path.stem else [
        f"the scene is named {name} (the file's name is {path.stem!r})"
    ]
