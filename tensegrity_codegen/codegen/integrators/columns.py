"""Derivatives of motions as states: which functions they call, and what the templates read."""

from collections.abc import Container, Sequence
from typing import Any

from tensegrity_codegen.codegen.integrators.profiles import PULL, pull_size
from tensegrity_codegen.symbolic.columns import list_jumping
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import DIRECTED
from tensegrity_codegen.tables.request import ModelRequest


def list_derivative_quantities(arguments: Container[str]) -> tuple[str, ...]:
    """Return the quantities by which integrators differentiate motions; arguments: names of the model's."""
    of_columns = ("column_rate", "margin_column") if "column" in arguments else ()
    of_adjoints = ("adjoint_rate", "adjoint_margin") if "state_weight" in arguments else ()
    return (*of_columns, *of_adjoints, *(("margin_jump",) if of_columns or of_adjoints else ()))


def check_jumps(subject: Any, request: ModelRequest, events: Sequence[str]) -> None:
    """Raise FormulationError where derivatives would miss jumps of forces, since no event finds them.

    A cable with damping, in the scene or at run time, pulls with a jump as it becomes taut. events: the kinds
    that integrators watch.
    """
    if not request.differentiates_motions or "cable" in events:
        return
    if jumping := list_jumping(subject, request):
        names = [subject.member_name[e] for e in jumping]
        raise FormulationError(
            "forces jump where damped cables become taut, and no event of the library finds that",
            where=f"{subject.name}: columns",
            given=", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else ""),
            allowed='cables without damping, or the event "cable" among model.events',
            hint='add "cable" to model.events',
        )


def columns_context(manifest: Manifest, is_dense: bool) -> dict[str, Any] | None:
    """Return sizes, and the row in a direction of each number that can change with time; None if none.

    is_dense: whether an integrator has dense output of its own.
    """
    functions = {item.quantity: item for item in manifest.functions}
    has_adjoint = "adjoint_rate" in functions
    if not manifest.column_name and not has_adjoint:
        return None
    rows, first = {}, 0
    for name in DIRECTED:
        for item in (item for item in manifest.arguments if item.name == name):
            rows[name] = list(range(first, first + len(item.nominal)))
            first += len(item.nominal)
    sizes = {item.name: len(item.nominal) for item in manifest.arguments} | {PULL: pull_size(manifest.axes)}
    driven = [row for name in manifest.driven for row in rows.get(name, [-1] * sizes[name])]
    margins = functions.get("cable_margin")
    moved = 2 * len(manifest.coordinate_name) + len(manifest.internal_name)
    is_directed = any("direction" in item.arguments for item in functions.values())
    return {
        "cables": margins.shape[0] if margins else 0,
        "moved": moved,
        "directed": first,
        "driven": driven,
        "is_directed": is_directed,
        "has_columns": bool(manifest.column_name),
        "has_adjoint": has_adjoint,
        "has_jumps": "margin_jump" in functions,
        "calls_state_rate": not manifest.column_name or (has_adjoint and is_dense),
    }
