"""Arguments that can change with time in integrators, and derivatives of motions to them."""

from collections.abc import Container, Mapping, Sequence
from typing import Any

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.symbolic.columns import list_jumping
from tensegrity_codegen.system.errors import FormulationError, name_list
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.quantities import DIRECTED, STATE, WEIGHTS
from tensegrity_codegen.tables.request import ModelRequest

# A node's number, a spring constant, a damping constant and a point: no argument of any function.
PULL = "pull"
# The anchors of a motion stand still.
CONSTANT = (*STATE, "column", *WEIGHTS, "anchor_position")


def find_driven(
    model: EmittedModel, functions: Sequence[FunctionSpec], request: ModelRequest
) -> tuple[str, ...]:
    """Return the arguments that profiles can change, in the order of C signatures, and the pull if requested.

    None if no function that a motion follows depends on inputs, and no pull is requested: such a library
    holds nothing for profiles.
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
    moving = [function.arguments for function in functions if function.quantity in rates]
    if not request.driven and not any("input" in names for names in moving):
        return ()
    arguments = (name for name in model.arguments if name in used and name not in CONSTANT)
    return (*arguments, *request.driven)


def count_driven(model: EmittedModel, driven: Sequence[str]) -> int:
    """Return how many numbers these arguments have."""
    sizes = {name: argument.nominal.size for name, argument in model.arguments.items()}
    return int(sum(sizes.get(name, pull_size(model.frame.axes)) for name in driven))


def pull_size(axes: Sequence[int]) -> int:
    """Return how many numbers a pull has, where these axes are modelled."""
    return 3 + len(axes)


def driven_context(manifest: Manifest, arguments: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the template context of each argument that can change: name, size, place of its numbers."""
    rows: list[dict[str, Any]] = []
    for name in manifest.driven:
        place = rows[-1]["place"] + rows[-1]["size"] if rows else 0
        size = pull_size(manifest.axes) if name == PULL else arguments[name]["size"]
        rows.append({"name": name, "size": size, "place": place})
    return rows


def list_derivative_quantities(arguments: Container[str]) -> tuple[str, ...]:
    """Return the quantities by which integrators differentiate motions; arguments: names of the model's."""
    of_columns = ("column_rate", "margin_column") if "column" in arguments else ()
    of_adjoints = ("adjoint_rate", "adjoint_margin") if "state_weight" in arguments else ()
    return (*of_columns, *of_adjoints, *(("margin_jump",) if of_columns or of_adjoints else ()))


def check_jumps(subject: Any, request: ModelRequest, events: Sequence[str]) -> None:
    """Raise FormulationError if derivatives would miss jumps of forces, since no event finds them."""
    if not request.differentiates_motions or "cable" in events:
        return
    if jumping := list_jumping(subject, request):
        raise FormulationError(
            "forces jump where damped cables become taut, and no event of the library finds that",
            where=f"{subject.name}: columns",
            given=name_list(subject.member_name[e] for e in jumping),
            allowed='cables without damping, or the event "cable" among model.events',
            hint='add "cable" to model.events',
        )


def columns_context(manifest: Manifest) -> dict[str, Any] | None:
    """Return sizes, and the row in a direction of each number that can change with time; None if none."""
    functions = {function.quantity: function for function in manifest.functions}
    has_adjoint = "adjoint_rate" in functions
    if not manifest.column_name and not has_adjoint:
        return None
    rows, offset = {}, 0
    for name in DIRECTED:
        for argument in (argument for argument in manifest.arguments if argument.name == name):
            rows[name] = list(range(offset, offset + len(argument.nominal)))
            offset += len(argument.nominal)
    sizes = {argument.name: len(argument.nominal) for argument in manifest.arguments} | {
        PULL: pull_size(manifest.axes)
    }
    driven = [row for name in manifest.driven for row in rows.get(name, [-1] * sizes[name])]
    margins = functions.get("cable_margin")
    moved = 2 * len(manifest.coordinate_name) + len(manifest.internal_name)
    is_directed = any("direction" in function.arguments for function in functions.values())
    return {
        "cables": margins.shape[0] if margins else 0,
        "moved": moved,
        "directed": offset,
        "driven": driven,
        "is_directed": is_directed,
        "has_columns": bool(manifest.column_name),
        "has_adjoint": has_adjoint,
        "has_jumps": "margin_jump" in functions,
    }
