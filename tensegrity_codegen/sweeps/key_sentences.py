"""What each key of a sweep is, and its unit: from the schema of scenes, or the quantities of structures."""

import re
from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.array_keys import INPUT
from tensegrity_codegen.sweeps.key_schema import root_place
from tensegrity_codegen.sweeps.keys import KeyPath, parse_path
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.quantities import ARGUMENTS, QUANTITIES
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS

UNIT = re.compile(r"\[([^\]\d][^\]]*)\]")
OF_SHAPES = {"nodes": "node_", "members": ""}


def describe_key(key: str, document: Mapping[str, Any], subject: Subject) -> dict[str, str]:
    """Return the attributes of a key's values: `long_name`, and `units` where they are known.

    Parameters
    ----------
    key : str
        Path of a number of the scene, of an array of the structure, or of an input.
    document : mapping
        The scene as a plain dictionary.
    subject : Structure or BodySystem
        The structure that it describes.
    """
    sentence, unit = _of_scene(key, document) or _of_structure(key, subject)
    words = {"long_name": f"{key} of the scene" + (f": {sentence}" if sentence else "")}
    return words | ({"units": unit} if unit else {})


def _of_scene(key: str, document: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return sentence and unit of a number of the scene file, None where the key is none."""
    try:
        steps = KeyPath.find(key, document).steps
    except TensegrityError:
        return None
    place, sentence = root_place(document), ""
    for step in steps:
        below = place.below(step)
        if below is None:
            break
        place = below
        sentence = str(place.schema.get("description") or sentence)
    found = UNIT.search(sentence)
    return sentence, found[1] if found else ""


def _of_structure(key: str, subject: Subject) -> tuple[str, str]:
    """Return sentence and unit of entries of an array of the structure, or of an input."""
    name, *rest = (str(step) for step in parse_path(key))
    if name == INPUT:
        kind = next((item.kind for item in subject.inputs if rest and item.name == rest[0]), "")
        return "value of the input", INPUT_UNITS.get(kind, "")
    if name in OF_SHAPES and len(rest) > 1:  # a node or member that a shape makes
        name = OF_SHAPES[name] + rest[1]
    quantity = ARGUMENTS.get(name) or QUANTITIES.get(name)
    if quantity is None or " or " in quantity.unit or "," in quantity.unit:
        return quantity.sentence if quantity else "", ""
    return quantity.sentence, quantity.unit
