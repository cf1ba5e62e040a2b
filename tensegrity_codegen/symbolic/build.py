"""The symbolic model in any formulation."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module

import casadi as ca

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.collision import check_collision
from tensegrity_codegen.structure.ground_support import FORMULATIONS_WITH_GROUND, check_ground
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError, check_choice
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.manifest import COLUMN_STARTS
from tensegrity_codegen.tables.quantities import PARAMETERS, STATE
from tensegrity_codegen.tables.request import ModelRequest


def build_model(structure: Structure | BodySystem, request: ModelRequest) -> SymbolicModel:
    """Return the symbolic model in the requested formulation; FormulationError lists the known ones.

    The function build_NAME of the module of its name in `formulations` makes it.
    """
    name = find_formulation(request.formulation).name
    check_ground(structure, request)
    check_collision(structure, request)
    module = import_module(f"tensegrity_codegen.symbolic.formulations.{name}")
    model: SymbolicModel = getattr(module, f"build_{name}")(structure, request)
    if request.columns:
        check_columns(model, request)
        model.frame = replace(model.frame, column_name=name_columns(model, request.columns))
        model.offer(_build_margin_jacobians(model))
    return model


def _build_margin_jacobians(model: SymbolicModel) -> dict[str, Callable[[], ca.SX]]:
    """Return the builders of the Jacobians of the margins of cables, at which forces may jump."""
    if not model.subject.tension_only.any():
        return {}

    def by(names: Sequence[str]) -> Callable[[], ca.SX]:
        return lambda: ca.jacobian(model.expression("cable_margin"), model.stack(names))

    return {"margin_state_jacobian": by(STATE), "margin_parameter_jacobian": by(PARAMETERS)}


def check_columns(model: SymbolicModel, request: ModelRequest) -> None:
    """Raise FormulationError or UnknownNameError for derivatives of motions that no library integrates."""
    where, ground = f"{model.name}: columns", getattr(model.subject, "ground", None)
    starts = () if model.frame.rigid_bar else COLUMN_STARTS
    for name in request.columns:
        check_choice(name, (*starts, *request.parameters), "number to differentiate to", where)
    foreign = {
        f"formulation {request.formulation!r}": request.formulation not in FORMULATIONS_WITH_GROUND,
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "batch functions": bool(request.batch_width),
        "energy that is kept": bool(request.keep),
        "single precision": request.precision != "double",
        "static_friction above friction": ground is not None and ground.has_static_friction,
    }
    tableaus = {name: INTEGRATORS[name].tableau for name in request.integrators if name in INTEGRATORS}
    foreign |= {f"integrator {name!r}": table is None or not table.errors for name, table in tableaus.items()}
    for what, is_foreign in foreign.items():
        if is_foreign:
            raise FormulationError(
                f"motions are not differentiated with {what}",
                where=where,
                allowed="node positions or rigid bars, emitter unrolled, rk54, tsit5 and rk853",
                hint="build another library for this",
            )


def name_columns(model: SymbolicModel, columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the numbers that motions are differentiated to: starts, then parameters."""
    names: list[str] = []
    for argument in (name for name in model.arguments if name in columns):
        item = model.arguments[argument]
        axes = ["xyz"[axis] for axis in model.frame.axes]
        if argument in COLUMN_STARTS:
            names += [f"{argument}.{name}" for name in model.frame.coordinate_name]
        elif argument == "gravity":
            names += [f"gravity.{axis}" for axis in axes]
        elif item.nominal.ndim == 2:
            names += [f"{argument}.{name}_{axis}" for name in item.over for axis in axes]
        else:
            names += [f"{argument}.{name}" for name in item.over]
    return tuple(names)
