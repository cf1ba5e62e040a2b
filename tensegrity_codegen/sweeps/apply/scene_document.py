"""A scene as a plain dictionary, which keys read and write."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.read import name_source, parse_scene, read_document, to_plain
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.shapes import expand_shape


def read_scene_document(scene: str | Path | Mapping[str, Any] | Scene) -> tuple[dict[str, Any], str]:
    """Return a scene as a plain dictionary, checked, and its source for messages; raises as `read_scene`."""
    if isinstance(scene, Scene):
        document = scene.to_document()
    elif isinstance(scene, Mapping):
        document = dict(scene)
    else:
        document = read_document(scene, known=frozenset(Scene.model_fields))
    plain, where = to_plain(document), name_source(scene)
    parse_scene(plain, where)
    return plain, where


def expand_document(document: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the scene with the nodes, members and groups of its shape written out, in place of the shape."""
    shape = parse_scene(document, where).shape
    if shape is None:
        return dict(document)
    made = expand_shape(shape, f"{where}: shape")
    rest = {key: value for key, value in document.items() if key != "shape"}
    return rest | {
        section: {**made[section], **document.get(section, {})} for section in ("nodes", "members", "groups")
    }
