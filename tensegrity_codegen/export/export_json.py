"""Export to JSON: the whole scene, with every key that the scene file has."""

import json
from pathlib import Path

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tensegrity_codegen.scene.formats.import_scene_json import SCENE_FORMAT
from tensegrity_codegen.scene.read import read_scene
from tensegrity_codegen.structure.outline import hide_bodies, outline_tendons


def write_json(source: ExportSource, path: Path) -> Exported:
    """Write the scene file of `source` as JSON: numbers by their shortest text that reads back bit-equal."""
    document = read_scene(source.path).to_document()
    content = json.dumps({"format": SCENE_FORMAT, **document}, indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(content + "\n", encoding="utf-8", newline="\n")
    structure = hide_bodies(outline_tendons(source.structure))
    return Exported(
        {"n_nodes": structure.n_nodes, "n_members": structure.n_members},
        ("comments and layout of the scene file are not in the file",),
    )


EXPORTER = Exporter(
    name="json", title="the whole scene (JSON)", endings=(".json",), write=write_json, order=30
)
