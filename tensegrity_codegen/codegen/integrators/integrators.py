"""Integrators that a library can hold: the needs, arguments and work memory of each."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.codegen.integrators.events import events_context, state_sizes, watched_events
from tensegrity_codegen.codegen.integrators.implicit import (
    KEPT_QUANTITIES,
    implicit_context,
    implicit_spec,
    keeper_context,
    keeper_memory,
)
from tensegrity_codegen.codegen.integrators.profiles import (
    PULL,
    columns_context,
    count_driven,
    driven_context,
    list_derivative_quantities,
    pull_size,
)
from tensegrity_codegen.codegen.integrators.work_memory import count_bytes, count_entries
from tensegrity_codegen.structure.ground_support import needs_state_jacobian
from tensegrity_codegen.structure.inertia_plan import find_massless, refuse_bare
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.integrators import INTEGRATORS, called_quantities, find_row
from tensegrity_codegen.tables.integrators.integrator import Integrator
from tensegrity_codegen.tables.manifest import FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.quantities import OF_COLUMNS, STATE, WEIGHT_OF, WEIGHTS
from tensegrity_codegen.tables.tableaus.tableau import Row, Tableau

# Functions of redundant coordinates that bring a state back onto their constraints; integrators call them.
PROJECTION = ("consistent_coordinate", "consistent_velocity")
SETTLING = "settled_internal"  # what internal states become at events
# If coordinates are not those of nodes, a pull needs these.
OF_NODES = ("node_position", "node_velocity")


def integrator_spec(
    model: EmittedModel,
    name: str,
    functions: tuple[FunctionSpec, ...],
    events: tuple[str, ...],
    keep: tuple[str, ...] = (),
    driven: tuple[str, ...] = (),
) -> IntegratorSpec:
    """Return the description of an integrator that monitors these kinds of events, if it can."""
    if name not in INTEGRATORS:
        raise FormulationError(
            "unknown integrator", where="model.integrators", given=name, hint=suggest(name, INTEGRATORS)
        )
    row = find_row(name, needs_state_jacobian(model.subject))
    watched = watched_events(model, functions, events if row.follows_events else ())
    if row.kind == "implicit":
        driven_size = count_driven(model, driven)
        return implicit_spec(name, model, functions, watched, driven_size)
    acceleration = next((f for f in functions if f.quantity == "acceleration"), None)
    if acceleration is None:
        if isinstance(model.subject, Structure):
            refuse_bare(model.subject, np.flatnonzero(find_massless(model.subject)).tolist())
        raise FormulationError(
            "an integrator needs the acceleration",
            where="model.integrators",
            given=name,
            hint='add "acceleration" to the wanted quantities',
        )
    # Functions that it calls, and the arguments that it passes on to them
    energy_quantities = KEPT_QUANTITIES[:2] if keep and row.keeps_energy else ()
    pulled = OF_NODES if PULL in driven else ()
    _check_called(model, row, functions)
    moving = ("acceleration", "state_derivative") if model.frame.n_internal else ("acceleration",)
    of_derivatives = list_derivative_quantities(model.arguments)
    method_quantities = (*PROJECTION, SETTLING, *row.quantities)
    names = (*moving, *method_quantities, *watched.quantities, *energy_quantities, *pulled, *of_derivatives)
    called = [f for f in functions if f.quantity in names]
    used = {a for f in called for a in f.arguments} - {*STATE, "column", *WEIGHTS}
    passed = tuple(a for a in model.arguments if a in used)
    # Work memory: values of the constants in the structs of templates/c
    energy = keeper_memory(model, {f.quantity: f for f in functions}) if energy_quantities else 0
    size = count_driven(model, driven) if row.follows_events else 0
    sizes = {
        **state_sizes(model),
        "WITH_EVENTS": 8 * watched.memory,
        "event_memory": 8 * watched.memory,
        "METHOD_KEEPS_ENERGY": energy,
        "energy_memory": energy,
        "WITH_PROFILE": size,
        "N_DRIVEN": size,
        **{f"N_{f.quantity.upper()}": count_entries(f) for f in called},
    }
    has_adjoint = any(f.quantity == "adjoint_rate" for f in called)
    adjoint_work, tape_row = _count_adjoint(model, row, sizes) if has_adjoint else (0, 0)
    return IntegratorSpec(
        name,
        f"{model.name}_integrate_{name}",
        passed,
        _count_work(row, sizes),
        watched.kinds,
        watched.cables,
        unwatched=watched.unwatched,
        keeps=keep if energy_quantities else (),
        adjoint_work=adjoint_work,
        tape_row=tape_row,
    )


def _check_called(model: EmittedModel, row: Integrator, functions: Iterable[FunctionSpec]) -> None:
    """Raise FormulationError for a model without the quantities that an integrator calls."""
    lacking = set(row.quantities) - {f.quantity for f in functions}
    if lacking:
        raise FormulationError(
            f"the integrator {row.name!r} needs the {', '.join(sorted(lacking))}",
            where=f"{model.name}: model.integrators",
            given=row.name,
            allowed="a formulation, and an emitter, that offer it",
            hint='choose emitter = "unrolled", or use rk54',
        )


def _count_work(row: Integrator, sizes: Mapping[str, int]) -> int:
    """Return the numbers in the work memory of a method that is not implicit; sizes: as count_bytes."""
    sizes = {
        **sizes,
        "METHOD_RATES": row.rates,
        "METHOD_HAS_DENSE": row.dense_order,
        "METHOD_DENSE": row.dense_order,
        "METHOD_HAS_MEMORY": int(row.tableau is None),
    }
    if row.kind == "adaptive" and row.tableau is None:
        sizes["method_memory"] = count_bytes(f"{row.c_files[-1]}_memory", f"{row.c_files[-1]}.h", sizes)
    has_internal = sizes["N_STATES"] > 2 * sizes["N"]
    is_stepped = row.kind == "adaptive" or bool(sizes["WITH_EVENTS"] or sizes["WITH_PROFILE"] or has_internal)
    structs = [(f"{row.name}_work", f"{row.name}.h")] if row.kind == "fixed" else []
    structs += [("method_work", "explicit.h")] if is_stepped else []
    return max(count_bytes(struct, file, sizes) for struct, file in structs) // 8


def _count_adjoint(model: EmittedModel, row: Integrator, sizes: Mapping[str, int]) -> tuple[int, int]:
    """Return the numbers in the work memory of a method's adjoint, and in a step of its tape."""
    assert row.tableau is not None
    moved = 2 * sizes["N"] + len(model.frame.internal_name)
    margins, jumps = sizes.get("N_CABLE_MARGIN", 0), "N_MARGIN_JUMP" in sizes
    adjoint_sizes = {
        **sizes,
        "METHOD_RATES": row.rates,
        "N_MOVED": moved,
        "N_VARIED": sizes["N_ADJOINT_RATE"],
        "N_CABLE_MARGINS": margins,
        "WITH_MARGIN_JUMPS": jumps,
    }
    work = count_bytes("method_adjoint_work", "adjoint.h", adjoint_sizes) // 8
    return work, 4 + moved * (row.tableau.stages + 1) + jumps * margins


def integrator_context(
    manifest: Manifest,
    arguments: Mapping[str, dict[str, Any]],
    reach: Mapping[str, int] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the context of the templates of integrators: all, the first with error control, its events.

    reach: quantity -> how many coordinates it depends on, see events_context.
    """
    functions = {spec.quantity: spec for spec in manifest.functions}
    rows = {spec.name: find_row(spec.name, manifest.needs_state_jacobian) for spec in manifest.integrators}
    adaptive = [spec for spec in manifest.integrators if rows[spec.name].kind == "adaptive"]
    driven = driven_context(manifest, arguments)
    watching = [spec for spec in manifest.integrators if spec.events]
    has_run = bool(driven or manifest.n_internal)
    counted = (
        [spec for spec in manifest.integrators if rows[spec.name].follows_events] if has_run else watching
    )
    tried = [
        spec
        for spec in manifest.integrators
        if spec in adaptive or (rows[spec.name].kind == "fixed" and spec in counted)
    ]
    explicit = [name for name, row in rows.items() if row.kind != "implicit"]
    integrators = [_context(spec, manifest, functions, arguments) for spec in manifest.integrators]
    passed = {name for spec in manifest.integrators for name in spec.arguments}
    return {
        "integrators": integrators,
        "example_integrator": min(
            integrators, key=lambda integrator: integrator["template"] == "fixed", default=None
        ),
        "explicit": next((integrator for integrator in integrators if integrator["name"] in explicit), None),
        "motion_arguments": [argument for name, argument in arguments.items() if name in passed],
        "motion_call": _motion_call,
        "motion_functions": [
            {
                "quantity": name,
                "arguments": functions[name].arguments,
                "size": count_entries(functions[name]),
                "weight": WEIGHT_OF.get(name),
            }
            for name in dict.fromkeys(
                (
                    *called_quantities(explicit, manifest.needs_state_jacobian),
                    *(name for name in list_derivative_quantities(arguments) if name in functions),
                    *(name for name in (SETTLING,) if name in functions),
                )
            )
        ],
        "first_copies": next((name for name in explicit if manifest.copies), ""),
        "first_batch": next((spec.name for spec in manifest.integrators if spec.batch_work_size), ""),
        "first_run": next((spec.name for spec in manifest.integrators if spec in (*tried, *counted)), ""),
        "n_internal": manifest.n_internal,
        "settles": SETTLING in functions,
        "columns": columns_context(manifest),
        "state_text": f"2 * {len(manifest.coordinate_name)}"
        + (f" + {manifest.n_internal}" if manifest.n_internal else ""),
        "has_run": bool(watching) or has_run,
        "driven": driven,
        "pull": _pull_context(manifest, functions) if PULL in manifest.driven else None,
        "keeper": keeper_context(manifest, functions) if any(spec.keeps for spec in adaptive) else None,
        "events": events_context(manifest, watching[0], functions, reach) if watching else None,
    }


def copies_context(
    manifest: Manifest,
    arguments: Mapping[str, dict[str, Any]],
    functions: Sequence[Mapping[str, Any]],
) -> dict[str, Any] | None:
    """Return what the functions that advance copies take: run-time arguments, dense quantities; else None."""
    if not manifest.copies:
        return None
    others = (*STATE, *OF_COLUMNS, *WEIGHTS)
    own = [argument for name, argument in arguments.items() if name not in others]
    known = {*STATE, *(argument["name"] for argument in own)}
    return {
        "arguments": own,
        "functions": [
            function
            for function in functions
            if function["pattern"] is None and known.issuperset(a["name"] for a in function["arguments"])
        ],
    }


def _pull_context(manifest: Manifest, functions: Mapping[str, FunctionSpec]) -> dict[str, Any]:
    """Return the context of the template of a pull: axes in loads, functions of node positions if needed."""
    place = {tuple(pair): k for k, pair in enumerate(manifest.coordinate_node_axis)}
    return {
        "points": [  # node, first coordinate of the corners, weights of these
            (node, place[body.corner[0], 0], weights)
            for body in manifest.body_places
            for node, weights in zip(body.point, body.weights, strict=True)
        ],
        "axes": len(manifest.axes),
        "size": pull_size(manifest.axes),
        "column": [manifest.axes.index(axis) if axis in manifest.axes else -1 for axis in range(3)],
        "functions": [] if manifest.coordinate_node_axis else [functions[name] for name in OF_NODES],
    }


def _motion_call(names: Iterable[str]) -> str:
    """Return the arguments of a kernel: coordinate and velocity, and the others as fields of `with`."""
    state_names = (*STATE, "column", *WEIGHTS)
    return "".join(f"{name}, " if name in state_names else f"with->{name}, " for name in names)


def _method_settings(spec: IntegratorSpec, row: Integrator, keeps_constraints: bool) -> dict[str, bool]:
    """Return the settings of the branches of templates/c/explicit.h."""
    ends_late = row.tableau.ends_late if row.tableau else not row.iterates
    return {
        "METHOD_HAS_ERROR": row.has_step_control,
        "METHOD_HAS_DENSE": bool(row.dense_order),
        "METHOD_HAS_MEMORY": row.tableau is None,
        "METHOD_ITERATES": row.iterates,
        "METHOD_KEEPS_ENERGY": bool(spec.keeps),
        "METHOD_HAS_LATE_END": ends_late or keeps_constraints,
        "METHOD_ENDS_WATCHED": ends_late and bool(spec.events),
    }


def motion_settings(context: Mapping[str, Any]) -> dict[str, bool]:
    """Return the settings of the branches of the plain C files that integrators share."""
    explicit, events, keeper = context["explicit"] or {}, context["events"] or {}, context["keeper"] or {}
    columns = context["columns"] or {}
    has_jumps = bool(columns and events and columns["has_jumps"])
    # Bars whose lengths follow their tensions: where a force jumps, places do.
    moves_places = any("velocity" in function.arguments for function in explicit.get("projection", ())[:1])
    return {
        "WITH_PROFILE": bool(context["driven"]),
        "WITH_EVENTS": bool(events),
        "WITH_INTERNAL": bool(context["n_internal"]),
        "WITH_COLUMNS": bool(columns.get("has_columns")),
        "WITH_DIRECTION": bool(columns.get("is_directed")),
        "WITH_ADJOINT": bool(columns.get("has_adjoint")),
        "WITH_MARGIN_JUMPS": has_jumps,
        "WITH_COLUMN_JUMPS": has_jumps and columns["has_columns"],
        "WITH_EVENT_FORECAST": any(
            [events and moves_places, *(events.get(key) for key in ("is_smooth", "n_contacts", "n_rings"))]
        ),
        **{
            f"WITH_{event.upper()}_EVENTS": any(kind["word"] == event for kind in events.get("kinds", ()))
            for event in ("switch", "collision", "ground", "stick", "yield", "motor", "ring")
        },
        "WITH_CONTACT_EVENTS": bool(events.get("n_contacts")),
        "WITH_NOISY_MARGINS": any([events.get("n_contacts"), events.get("n_rings"), events and moves_places]),
        "WITH_MOVED_PLACES": bool(events and moves_places and not events.get("is_smooth")),
        "WITH_STIFFENING": any(events.get(count) for count in ("n_contacts", "n_yields")),
        "WITH_SET_STATES": bool(events.get("n_slips")),
        "WITH_STATIC_FRICTION": "stick" in events.get("setting", ()),
        "WITH_SETTLING": context["settles"],
        "WITH_SMOOTH_EVENTS": bool(events.get("is_smooth")),
        "WITH_CONSTRAINTS": bool(explicit.get("keeps_constraints")),
        "WITH_VELOCITY": bool(explicit.get("uses_velocity")),
        "WITH_ENERGY": bool(keeper),
        "WITH_DIAGONAL_MASS": bool(keeper.get("is_mass_diagonal")),
        "WITH_RIGID_MOTION": bool(keeper.get("rigid")),
        "WITH_AXES_3": keeper.get("axes") == 3,
        "WITH_AXES_2": keeper.get("axes") == 2,
    }


def _context(
    spec: IntegratorSpec,
    manifest: Manifest,
    functions: Mapping[str, FunctionSpec],
    arguments: Mapping[str, dict[str, Any]],
) -> dict[str, Any]:
    row = find_row(spec.name, manifest.needs_state_jacobian)
    if row.kind == "implicit":
        return {
            "name": spec.name,
            "template": spec.name,
            "has_tensions": True,
            "symbol": spec.symbol,
            "work_size": spec.work_size,
            "arguments": [arguments[name] for name in spec.arguments],
            "argument_name": spec.arguments,
            "saddle": implicit_context(spec, manifest, functions),
            "batch_work_size": 0,
        }
    kernel = functions["acceleration"].arguments
    side_by_side = bool(spec.batch_work_size) and manifest.has_only_bristles
    keeps_constraints = all(name in functions for name in PROJECTION)
    return {
        "name": spec.name,
        "title": row.title[0].upper() + row.title[1:],
        "has_tensions": False,
        "template": row.kind,
        "files": [f"{file}.h" for file in row.c_files],
        "renamed": {row.c_files[-1]: spec.name},
        "symbol": spec.symbol,
        "work_size": spec.work_size,
        "arguments": [arguments[name] for name in spec.arguments],
        "argument_name": spec.arguments,
        "kernel_arguments": kernel,
        "derivative_arguments": functions["state_derivative"].arguments if manifest.n_internal else (),
        "uses_velocity": "velocity" in kernel,
        "keeps_constraints": keeps_constraints,
        "projection": [functions[name] for name in PROJECTION if name in functions],
        "method": f"{spec.name}_run" if row.kind == "fixed" else spec.name,
        "settings": _method_settings(spec, row, keeps_constraints),
        "dense_title": row.dense_title,
        "tableau": _tableau_context(row.tableau) if row.tableau else None,
        "batch_work_size": spec.batch_work_size,
        "copies_side_by_side": side_by_side,
        "copies_work": spec.batch_work_size if side_by_side else spec.work_size,
        "adjoint_work": spec.adjoint_work,
        "tape_row": spec.tape_row,
    }


def _tableau_context(table: Tableau) -> dict[str, Any]:
    return {
        "title": table.title,
        "source": table.source,
        "stages": table.stages,
        "rates": table.rates,
        "ends_late": table.ends_late,
        "error_order": table.error_order,
        "rows": [_numbers(row) for row in table.rows],
        "errors": [_numbers(row) for row in table.errors],
        "nodes": [repr(node) for node in table.nodes],
        "dense_nodes": [repr(node) for node in table.dense_nodes],
        "dense_rows": [_numbers(row) for row in table.dense_rows],
        "dense": [_numbers(row) for row in table.dense],
    }


def _numbers(row: Row) -> list[tuple[int, str]]:
    return [(stage, repr(float(value))) for stage, value in row.items()]
