"""Import of a whole scene from JSON: the sections and keys of a scene file, as `export` writes them."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.files.documents import MAX_JSON_BYTES, read_json
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, read_text
from tensegrity_codegen.scene.names import check_scene_name, key_path
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import InvalidValueError

SCENE_FORMAT = "tensegrity_codegen scene 1"
WHAT = "a scene in JSON"
_FORMAT_KEY = re.compile(r'"format"\s*:\s*"tensegrity_codegen scene')


def import_scene_json(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of a JSON file with the key ``"format": "tensegrity_codegen scene 1"``."""
    content = read_json(Path(path), WHAT)
    if not isinstance(content, dict) or content.get("format") != SCENE_FORMAT:
        raise InvalidValueError(
            "not a version of the format that is known",
            where=key_path(str(path), "format"),
            given=content.get("format") if isinstance(content, dict) else type(content).__name__,
            allowed=repr(SCENE_FORMAT),
        )
    document: dict[str, Any] = {
        key: value for key, value in content.items() if key not in ("format", "comment")
    }
    if name is not None:
        check_scene_name(name, "name")
        document["name"] = name
    if gravity is not None:
        document["gravity"] = [float(value) for value in gravity]
    return ImportResult(parse_scene(document, str(path)).to_document(), ())


def is_scene_json(path: Path) -> bool:
    """Return whether a JSON file says that it is a scene."""
    return _FORMAT_KEY.search(read_text(path, MAX_JSON_BYTES, WHAT)) is not None


FORMAT = Format(
    title="a whole scene (JSON), as the verb export writes it", sources=("scene.json",), endings=(".json",),
    read=import_scene_json, order=3, recognises=is_scene_json,
)  # fmt: skip
