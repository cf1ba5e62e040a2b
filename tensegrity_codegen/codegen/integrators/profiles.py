"""Arguments that can change with time in integrators: which, and where each stands among their numbers."""

from collections.abc import Mapping, Sequence
from typing import Any

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import STATE, WEIGHTS
from tensegrity_codegen.tables.request import ModelRequest

# A node's number, a spring constant, a damping constant and a point: no argument of any function.
PULL = "pull"
# The anchors of a motion stand still.
CONSTANT = (*STATE, "column", *WEIGHTS, "anchor_position")


def find_driven(
    model: EmittedModel, functions: Sequence[FunctionSpec], request: ModelRequest
) -> tuple[str, ...]:
    """Return the arguments that profiles can change, in the order of C signatures, and the pull if requested.

    None where no function that a motion follows depends on inputs, and no pull is requested: such a library
    holds nothing for profiles. Raises FormulationError for a pull without the loads of all nodes.
    """
    loads = len(request.parameters.get("node_load", ()))
    if request.driven and (request.driven != (PULL,) or loads < model.subject.n_nodes):
        raise FormulationError(
            "integrators cannot change this with time",
            where="ModelRequest.driven",
            given=request.driven,
            allowed=f"{PULL!r}, where the loads of all nodes are run-time parameters",
        )
    used = {name for function in functions for name in function.arguments}
    rates = ("acceleration", "cable_force", "state_derivative")
    moving = [item.arguments for item in functions if item.quantity in rates]
    if not request.driven and not any("input" in names for names in moving):
        return ()
    arguments = (name for name in model.arguments if name in used and name not in CONSTANT)
    return (*arguments, *request.driven)


def count_driven(model: EmittedModel, driven: Sequence[str]) -> int:
    """Return how many numbers these arguments have."""
    sizes = {name: item.nominal.size for name, item in model.arguments.items()}
    return int(sum(sizes.get(name, pull_size(model.frame.axes)) for name in driven))


def pull_size(axes: Sequence[int]) -> int:
    """Return how many numbers a pull has, where these axes are modelled."""
    return 3 + len(axes)


def driven_context(manifest: Manifest, arguments: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return what the templates read of each argument that can change: name, size, place of its numbers."""
    rows: list[dict[str, Any]] = []
    for name in manifest.driven:
        place = rows[-1]["place"] + rows[-1]["size"] if rows else 0
        size = pull_size(manifest.axes) if name == PULL else arguments[name]["size"]
        rows.append({"name": name, "size": size, "place": place})
    return rows
