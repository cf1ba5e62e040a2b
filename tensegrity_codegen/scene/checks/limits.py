"""Limits of the size of scenes and their files, and the validator of documents of any size.

Counts of characters bound what a reader would build of a text; counts of entries bound what the checks that
follow would do. Limits lie well above the largest structures that the generator serves. Large sections are
validated in batches of entries, so that errors stay few.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, SceneSyntaxError
from tensegrity_codegen.system.files import find_kind

MAX_ENTRIES = 200_000  # entries of one section: nodes, members, loads
MAX_TABLES = 2 * MAX_ENTRIES + 100_000  # tables of a whole file
MAX_PAIRS = 3_000_000  # keys of a whole file
MAX_VALUES = 1_000_000  # values outside plain sections of nodes and members
MAX_FILE_BYTES = 64 * 2**20  # bytes of a scene file
MAX_KEYS = 100  # keys of one node, member, body; sections of a file


def check_regular(path: Path, where: str) -> None:
    """Raise SceneError for a path to read that leads to a folder, pipe, socket or device."""
    kind = find_kind(path)
    if kind:
        problem, allowed = f"the file cannot be read: this is {kind}", "a regular file"
        raise SceneError(problem, where=where, allowed=allowed, hint="write the text to a file first")


def check_text(text: str, where: str, plain: bool = False) -> None:
    """Raise SceneSyntaxError for a text with too many tables or values; plain: without its plain sections."""
    counts = {"tables": (text.count("{") + text.count("\n["), MAX_TABLES)}
    counts["keys"] = (text.count("="), MAX_PAIRS)
    if plain:
        counts["tables"] = (counts["tables"][0], MAX_ENTRIES + 100_000)
        counts["values"] = (text.count(",") + text.count("="), MAX_VALUES)
    check_counts(counts, "the file has too many {} to be a scene", where)


def check_counts(counts: Mapping[str, tuple[int, int]], problem: str, where: str, hint: str = "") -> None:
    """Raise SceneSyntaxError, `problem` with the name in it, for a count above the most that is allowed."""
    for name, (count, limit) in counts.items():
        if count > limit:
            allowed = f"up to {limit}"
            raise SceneSyntaxError(problem.format(name), where=where, given=count, allowed=allowed, hint=hint)


def check_document(document: Mapping[str, Any], where: str) -> None:
    """Raise InvalidValueError for a section with too many entries, or an entry with too many keys."""
    for section, content in document.items():
        if isinstance(content, dict | list | tuple) and len(content) > MAX_ENTRIES:
            raise InvalidValueError(
                "too many entries",
                where=key_path(where, str(section)),
                given=f"{len(content)} entries",
                allowed=f"up to {MAX_ENTRIES}",
            )
        entries = content.items() if isinstance(content, dict) else ()
        for name, entry in entries:
            limit = MAX_ENTRIES if section == "limits" else MAX_KEYS
            if isinstance(entry, dict) and len(entry) > limit:
                problem, location = "a table with too many keys", key_path(where, str(section), str(name))
                allowed = f"up to {limit}"
                raise InvalidValueError(problem, where=location, given=f"{len(entry)} keys", allowed=allowed)
    if len(document) > MAX_KEYS:
        problem = "too many sections"
        raise InvalidValueError(problem, where=where, given=len(document), allowed=f"up to {MAX_KEYS}")


PART = 500  # entries of a section that are validated at once
# Sections whose entries are valid or not one by one.
_SECTIONS = ("nodes", "members", "classes", "groups", "bodies", "tendons")


def validate(document: Mapping[str, Any]) -> Scene:
    """Return the scene of a document; raises ValidationError, of the first bad part of a large section."""
    large = {
        name: document[name]
        for name in _SECTIONS
        if isinstance(document.get(name), dict) and len(document[name]) > PART
    }
    small = {key: value for key, value in document.items() if key not in large}
    for key, value in small.items():  # errors of the whole list could be millions
        if isinstance(value, list) and len(value) > PART:
            _check_list(small, key, value)
    scene = Scene.model_validate({**small, **{name: {} for name in large}})
    if not large:
        return scene
    bare = {"name": scene.name}
    sections = {
        name: {
            key: entry
            for batch in _parts(content)
            for key, entry in getattr(Scene.model_validate({**bare, name: batch}), name).items()
        }
        for name, content in large.items()
    }
    return scene.model_copy(update=sections)


def _check_list(small: Mapping[str, Any], key: str, value: list[Any]) -> None:
    """Raise ValidationError for the first part of a long list that has errors, its entries counted from 0."""
    bare = {"name": small.get("name")}
    for start in range(0, len(value), PART):
        try:
            Scene.model_validate({**bare, key: value[start : start + PART]})
        except ValidationError:
            Scene.model_validate({**small, key: value[: start + PART]})
            raise


def _parts(content: dict[str, Any]) -> Iterator[dict[str, Any]]:
    batch: dict[str, Any] = {}
    for key, value in content.items():
        batch[key] = value
        if len(batch) == PART:
            yield batch
            batch = {}
    yield batch
