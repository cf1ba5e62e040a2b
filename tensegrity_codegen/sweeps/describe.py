"""The description of a sweep: sources of its results, and a sentence and unit of each key."""

import platform
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.analyses.cases.quantities import GUST, GUST_TIME
from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.array_keys import INPUT
from tensegrity_codegen.sweeps.apply.assembler import read_scene_document
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.engines.dask_engine import find_version
from tensegrity_codegen.sweeps.engines.work import SweepPlan
from tensegrity_codegen.sweeps.keys import KeyPath, parse_path, root_place
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.system.provenance import name_processor
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.quantities import ARGUMENTS, QUANTITIES
from tensegrity_codegen.tables.quantities.arguments import INPUT_UNITS

PACKAGES = ("casadi", "numpy", "scipy", "zarr")
SceneSource = str | Path | Mapping[str, Any] | Scene
UNIT = re.compile(r"\[([^\]\d][^\]]*)\]")
OF_SHAPES = {"nodes": "node_", "members": ""}
OF_GUSTS = {GUST: ("force of a gust on the node", "N"), GUST_TIME: ("when gusts push", "s")}


def identify_sweep(scene: SceneSource, cases: Cases, operation: CaseAnalysis) -> dict[str, Any]:
    """Return the sources of the results, JSON-ready, the same on every machine: equal for equal results."""
    document, _ = read_scene_document(scene)
    structure, request = load_scene(scene)
    return {
        "scene": document,
        "structure_hash": hash_scene(structure, request),  # of files beside the scene too
        "operation": operation.describe(),
        "cases": cases.describe(),
        "tensegrity_codegen": VERSION,
    }


def describe_facts(scene: SceneSource, plan: SweepPlan, operation: CaseAnalysis) -> dict[str, Any]:
    """Return the facts that are stored with the results: attributes of the data set, JSON-ready."""
    structure, (document, _) = plan.groups[0].structure, read_scene_document(scene)
    return {
        "title": f"sweep of {structure.name}: {operation.name} of {plan.cases.count} cases",
        "source": f"tensegrity_codegen {VERSION}",
        "scene_name": structure.name,
        "scene_file": Path(scene).name if isinstance(scene, str | Path) else "",
        "scene_text": _read_text(scene),
        "key_attributes": {key: describe_key(key, document, structure) for key in plan.cases.keys},
        "sampling_method": plan.cases.method,
        "seed": plan.cases.seed,
        "libraries": [
            {"group": group.number, "hash": group.hash, "cases": len(group.rows)} for group in plan.groups
        ],
        "versions": {name: find_version(name) for name in PACKAGES} | {"Python": platform.python_version()},
        "machine": {
            "system": platform.system(),
            "architecture": platform.machine(),
            "processor": name_processor(),
        },
    }


def _read_text(scene: SceneSource) -> str:
    """Return the text of a scene file; "" for a scene that is no file, or an example by its name."""
    if not isinstance(scene, str | Path) or not Path(scene).is_file():
        return ""
    return Path(scene).read_text(encoding="utf-8", errors="replace")


def describe_key(key: str, document: Mapping[str, Any], subject: Subject) -> dict[str, str]:
    """Return the attributes of a key's values: `long_name`, and `units` if they are known."""
    sentence, unit = _of_scene(key, document) or _of_structure(key, subject)
    attributes = {"long_name": f"{key} of the scene" + (f": {sentence}" if sentence else "")}
    return attributes | ({"units": unit} if unit else {})


def _of_scene(key: str, document: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return sentence and unit of a number of the scene file, None for another key."""
    try:
        steps = KeyPath.find(key, document).steps
    except TensegrityError:
        return None
    node, sentence = root_place(document), ""
    for step in steps:
        below = node.below(step)
        if below is None:
            break
        node = below
        sentence = str(node.schema.get("description") or sentence)
    unit = UNIT.search(sentence)
    return sentence, unit[1] if unit else ""


def _of_structure(key: str, subject: Subject) -> tuple[str, str]:
    """Return sentence and unit of entries of an array of the structure, or of an input."""
    name, *steps = (str(step) for step in parse_path(key))
    if name == INPUT:
        kind = next((source.kind for source in subject.inputs if steps and source.name == steps[0]), "")
        return "value of the input", INPUT_UNITS.get(kind, "")
    if name in OF_GUSTS:
        return OF_GUSTS[name]
    if name in OF_SHAPES and len(steps) > 1:  # a node or member that a shape makes
        name = OF_SHAPES[name] + steps[1]
    quantity = ARGUMENTS.get(name) or QUANTITIES.get(name)
    if quantity is None or " or " in quantity.unit or "," in quantity.unit:
        return quantity.sentence if quantity else "", ""
    return quantity.sentence, quantity.unit
