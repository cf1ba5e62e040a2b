"""Derivatives of motions: their variables, and the rates by which integrators move them."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from tensegrity_codegen.structure.ground_support import FORMULATIONS_WITH_GROUND
from tensegrity_codegen.symbolic.model import ModelArgument, SymbolicModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import DuplicateNameError, FormulationError, check_choice
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.quantities import ADJOINTS, DIRECTED, STATE
from tensegrity_codegen.tables.request import ModelRequest

TENSIONS = ("spring_constant", "axial_stiffness", "damping")  # to which tensions are proportional
STARTS = STATE[:2]  # variables of derivatives at the start


def add_derivatives(
    model: SymbolicModel, request: ModelRequest, build: Callable[[Any, ModelRequest], SymbolicModel]
) -> None:
    """Add the derivatives of motions that a request asks for: columns beside the motion, and adjoints."""
    check_columns(model, request)
    if request.has_adjoint:
        _add_adjoint(model)
    if request.columns or request.directions:
        _add_columns(model, request)
    if jumping := list_jumping(model.subject, request):
        _add_jumps(model, request, jumping, build)


def list_jumping(subject: Any, request: ModelRequest) -> list[int]:
    """Return the cables whose force jumps as they are pulled taut: with damping, or where that can change."""
    changeable = np.isin(np.arange(subject.n_members), request.parameters.get("damping", ()))
    return np.flatnonzero(subject.tension_only & ((subject.damping > 0) | changeable)).tolist()


def _add_jumps(
    model: SymbolicModel,
    request: ModelRequest,
    jumping: list[int],
    build: Callable[[Any, ModelRequest], SymbolicModel],
) -> None:
    """Add the jumps of rates as cables are pulled taut, t dx'/dt: t is linear in stiffness and damping."""
    cables = np.flatnonzero(model.subject.tension_only).tolist()
    weight = ca.SX.sym("margin_weight", len(cables))
    argument = model.arguments.setdefault("margin_weight", ModelArgument(weight, np.zeros(len(cables))))
    parameters = {name: request.parameters.get(name, ()) for name in TENSIONS}
    chosen = {name: tuple(dict.fromkeys((*parameters[name], *jumping))) for name in TENSIONS}

    def find_jump() -> ca.SX:
        free = build(model.subject, replace(request, parameters={**request.parameters, **chosen}))
        symbol_of = {name: model_argument.symbol for name, model_argument in model.arguments.items()}
        along = []
        for name, members in chosen.items():
            variable = free.arguments[name]
            values = {e: symbol_of[name][k] for k, e in enumerate(parameters[name])}
            symbol_of[name] = ca.vertcat(
                *[values.get(e, x) for e, x in zip(members, variable.nominal, strict=True)]
            )
            shifts = [argument.symbol[cables.index(e)] if e in jumping else 0.0 for e in members]
            along.append(ca.vertcat(*shifts) * variable.symbol)
        rates = ca.densify(free.expression("state_derivative"))
        change = ca.jtimes(rates, free.stack(TENSIONS), ca.vertcat(*along))
        names = [*free.arguments, "margin_weight"]
        symbols = [*(model_argument.symbol for model_argument in free.arguments.values()), argument.symbol]
        return ca.Function("jump", symbols, [change])(*[symbol_of[name] for name in names])

    model.offer({"margin_jump": find_jump})


def _add_adjoint(model: SymbolicModel) -> None:
    """Add products of weights with derivatives of rates, tensions and margins, and the weights."""
    varied = ca.vertcat(model.stack(STATE), model.stack(DIRECTED))

    def weigh(value: ca.SX, symbol: ca.SX) -> Callable[[], ca.SX]:
        return lambda: ca.jtimes(value, varied, symbol, True)

    for name, (weight, quantity) in ADJOINTS.items():
        if quantity == "cable_margin" and not model.subject.tension_only.any():
            continue
        value = ca.densify(ca.vec(model.expression(quantity)))
        symbol = ca.SX.sym(weight, value.numel())
        model.arguments[weight] = ModelArgument(symbol, np.zeros(value.numel()))
        model.offer({name: weigh(value, symbol)})


def _add_columns(model: SymbolicModel, request: ModelRequest) -> None:
    """Add the derivatives that are integrated beside a motion: arguments, rates, names of columns."""
    names = request.directions or _name_columns(model, request.columns)
    state, directed = model.stack(STATE), model.stack(DIRECTED)
    column, direction = ca.SX.sym("column", state.numel()), ca.SX.sym("direction", directed.numel())
    start, along = _find_nominal(model, request, len(names))
    model.frame = replace(model.frame, column_name=names)
    model.arguments["column"] = ModelArgument(column, start)
    model.arguments["direction"] = ModelArgument(direction, along)

    def find_change(quantity: str) -> ca.SX:
        variables, change = ca.vertcat(state, directed), ca.vertcat(column, direction)
        return ca.jtimes(ca.densify(model.expression(quantity)), variables, change)

    def find_rates() -> ca.SX:
        return ca.vertcat(ca.densify(model.expression("state_derivative")), find_change("state_derivative"))

    model.offer({"column_rate": find_rates, "tension_column": lambda: find_change("member_tension")})
    if model.subject.tension_only.any():
        model.offer({"margin_column": lambda: find_change("cable_margin")})


def check_columns(model: SymbolicModel, request: ModelRequest) -> None:
    """Raise FormulationError or UnknownNameError for derivatives of motions that no library integrates."""
    location, ground = f"{model.name}: columns", getattr(model.subject, "ground", None)
    starts = () if model.frame.rigid_bar else STARTS
    inputs = ("input",) if model.frame.input_name else ()
    for name in request.columns:
        check_choice(name, (*starts, *request.parameters, *inputs), "number to differentiate to", location)
    if len(set(request.directions)) < len(request.directions):
        raise DuplicateNameError("two directions have one name", where=f"{model.name}: directions")
    foreign = {
        f"formulation {request.formulation!r}": request.formulation not in FORMULATIONS_WITH_GROUND,
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "batch functions": bool(request.batch_width),
        "energy that is kept": bool(request.keep),
        "single precision": request.precision != "double",
        "interfaces": bool(request.interfaces),
        "columns and directions in one library": bool(request.columns and request.directions),
        "static_friction above friction": ground is not None and ground.has_static_friction,
    }
    tableaus = {name: INTEGRATORS[name].tableau for name in request.integrators if name in INTEGRATORS}
    foreign |= {f"integrator {name!r}": table is None or not table.errors for name, table in tableaus.items()}
    for feature, is_foreign in foreign.items():
        if is_foreign:
            raise FormulationError(
                f"motions are not differentiated with {feature}",
                where=location,
                allowed="node positions or rigid bars, emitter unrolled, rk54, tsit5 and rk853",
                hint="build another library for this",
            )


def _name_columns(model: SymbolicModel, columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the numbers that motions are differentiated to: starts, then parameters."""
    names: list[str] = []
    for argument in (name for name in model.arguments if name in columns):
        model_argument = model.arguments[argument]
        axes = ["xyz"[axis] for axis in model.frame.axes]
        if argument in STARTS:
            names += [f"{argument}.{name}" for name in model.frame.coordinate_name]
        elif argument == "gravity":
            names += [f"gravity.{axis}" for axis in axes]
        elif model_argument.nominal.ndim == 2:
            names += [f"{argument}.{name}_{axis}" for name in model_argument.over for axis in axes]
        else:
            names += [f"{argument}.{name}" for name in model_argument.over]
    return tuple(names)


def _find_nominal(model: SymbolicModel, request: ModelRequest, count: int) -> tuple[FloatArray, FloatArray]:
    """Return starts and directions of columns: zero for directions, which motions give.

    Otherwise one number each, times its size, so that a tolerance means the same for all.
    """
    rows = {name: model.arguments[name].nominal for name in (*STATE, *DIRECTED) if name in model.arguments}
    columns = {name: np.zeros((value.size, count)) for name, value in rows.items()}
    names = [name for name in model.arguments if name in request.columns]
    first = 0
    for name in names:
        size = rows[name].size
        scale = np.ones(size) if name in STARTS else np.abs(rows[name].ravel())
        columns[name][:, first : first + size] = np.diag(np.where(scale > 0, scale, 1.0))
        first += size
    none = np.zeros((0, count))
    start, along = (
        np.vstack([none, *(columns[name] for name in names if name in columns)])
        for names in (STATE, DIRECTED)
    )
    return start, along
