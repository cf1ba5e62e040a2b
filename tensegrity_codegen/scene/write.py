"""Writing a scene: plain document -> TOML file, and structure -> plain document."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.checks.limits import MAX_FILE_BYTES
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.system.checks import check_instance, check_path, check_switch
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.files import write_text


def write_scene(document: Mapping[str, Any], path: str | Path, *, overwrite: bool = False) -> None:
    """Write a scene document as a TOML file: whole or not at all.

    Raises OutputError if the file exists (without `overwrite`) or cannot be written, and what
    `format_scene` raises.
    """
    check_path(path, "path")
    check_switch(overwrite, "overwrite")
    check_instance(document, Mapping, "document", "a dictionary, as Scene.to_document() returns it")
    for key in document:
        check_instance(key, str, "document", "names of sections, as texts")
    text = format_scene(document)
    if len(text) > MAX_FILE_BYTES:
        problem, allowed = "the scene is too large to be read again", f"up to {MAX_FILE_BYTES >> 20} MB"
        raise InvalidValueError(problem, where=str(path), given=f"{len(text) >> 20} MB", allowed=allowed)
    write_text(text, path, overwrite=overwrite)
