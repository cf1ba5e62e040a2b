"""The schema's validator on documents of any size: large sections part by part, so that errors stay few."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from tensegrity_codegen.scene.schema.schema import Scene

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
    whole = {
        name: {
            key: entry
            for part in _parts(content)
            for key, entry in getattr(Scene.model_validate({**bare, name: part}), name).items()
        }
        for name, content in large.items()
    }
    return scene.model_copy(update=whole)


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
    part: dict[str, Any] = {}
    for key, value in content.items():
        part[key] = value
        if len(part) == PART:
            yield part
            part = {}
    yield part
