"""Arguments that can change with time in integrators: which, and where each stands among their numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.manifest import FunctionSpec, Manifest

__all__ = ["count_driven", "driven_context", "find_driven"]

CONSTANT = ("coordinate", "velocity", "anchor_position")  # the anchors of a motion stand still


def find_driven(model: EmittedModel, functions: Sequence[FunctionSpec]) -> tuple[str, ...]:
    """Return the arguments that profiles can change, in the order of C signatures.

    None where no function that a motion follows depends on inputs: such a library holds nothing for profiles.
    """
    used = {name for function in functions for name in function.arguments}
    acceleration = [item.arguments for item in functions if item.quantity in ("acceleration", "cable_force")]
    if not any("input" in names for names in acceleration):
        return ()
    return tuple(name for name in model.arguments if name in used and name not in CONSTANT)


def count_driven(model: EmittedModel, driven: Sequence[str]) -> int:
    """Return how many numbers these arguments have."""
    return int(sum(model.arguments[name].nominal.size for name in driven))


def driven_context(manifest: Manifest, arguments: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return what the templates read of each argument that can change: name, size, place of its numbers."""
    rows: list[dict[str, Any]] = []
    for name in manifest.driven:
        place = rows[-1]["place"] + rows[-1]["size"] if rows else 0
        rows.append({"name": name, "size": arguments[name]["size"], "place": place})
    return rows
