"""What a sweep is: what its results follow from, and what else is kept with them."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.apply.scene_document import read_scene_document
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.key_sentences import describe_key
from tensegrity_codegen.sweeps.plan import SweepPlan
from tensegrity_codegen.sweeps.tasks.operation import Operation
from tensegrity_codegen.system.processor import name_processor
from tensegrity_codegen.system.version import VERSION

PACKAGES = ("casadi", "numpy", "scipy", "zarr")
SceneSource = str | Path | Mapping[str, Any] | Scene


def identify_sweep(scene: SceneSource, cases: Cases, operation: Operation) -> dict[str, Any]:
    """Return what the results of a sweep follow from, JSON-ready: the same on every machine.

    Two sweeps of equal identity have equal results; the keys of an identity say what differs in others.
    """
    document, _ = read_scene_document(scene)
    structure, request = load_scene(scene)
    return {
        "scene": document,
        "structure_hash": hash_scene(structure, request),  # of what files beside the scene hold too
        "operation": operation.describe(),
        "cases": cases.describe(),
        "tensegrity_codegen": VERSION,
    }


def describe_facts(scene: SceneSource, plan: SweepPlan, operation: Operation) -> dict[str, Any]:
    """Return what else is kept with the results: attributes of the data set, JSON-ready."""
    structure, (document, _) = plan.groups[0].structure, read_scene_document(scene)
    return {
        "title": f"sweep of {structure.name}: {operation.name} of {plan.cases.count} cases",
        "source": f"tensegrity_codegen {VERSION}",
        "scene_name": structure.name,
        "scene_text": _read_text(scene),
        "key_attributes": {key: describe_key(key, document, structure) for key in plan.cases.keys},
        "sampling_method": plan.cases.method,
        "seed": plan.cases.seed,
        "libraries": [
            {"group": group.number, "hash": group.hash, "cases": len(group.rows)} for group in plan.groups
        ],
        "versions": {name: _find_version(name) for name in PACKAGES} | {"Python": platform.python_version()},
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


def _find_version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
