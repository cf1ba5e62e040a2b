"""The emitter `table`: which scenes and quantities it serves, and how their bodies come about."""

from tensegrity_codegen.codegen.emitter import Bodies, Emitter, refuse_empty
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import TableFunction, Writer
from tensegrity_codegen.codegen.table.node_quantities import WITHOUT_CONTACTS
from tensegrity_codegen.codegen.table.quantities import BUILDERS, served_quantities
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.rigid_bar_check import check_formulation
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities import find_quantity
from tensegrity_codegen.tables.request import ModelRequest, complete_options

OPTIONS = ("all", "first_order")  # words of options of rigid bars that there are no loops for


def _build(structure: Structure | BodySystem, request: ModelRequest) -> TableModel:
    formulations = [
        formulation.name for formulation in FORMULATIONS.values() if "table" in formulation.emitters
    ]
    if isinstance(structure, BodySystem) or request.formulation not in formulations:
        raise FormulationError(
            "the emitter 'table' does not support this formulation",
            where=f"{structure.name}: model.emitter",
            given=f"formulation {request.formulation!r}",
            allowed=" or ".join(f"formulation {name!r}" for name in formulations),
            hint='emitter = "unrolled"',
        ).unless_chosen_otherwise()
    check_formulation(structure, request)
    changed = {
        k: v for k, v in complete_options(request.formulation, request.options).items() if v in OPTIONS
    }
    if changed:
        raise FormulationError(
            "the emitter 'table' supports rigid bars in statics only, and only bars without stiffness",
            where=f"{structure.name}: model.options",
            given=", ".join(f"{key} = {option!r}" for key, option in changed.items()),
            allowed="the defaults of the options",
            hint='emitter = "unrolled"',
        ).unless_chosen_otherwise()
    served = served_quantities(request.formulation)
    if structure.ground is not None:
        spent = ("internal_rate", "state_derivative") if structure.ground.balances_energy else ()
        served = tuple(name for name in served if name not in (*WITHOUT_CONTACTS, *spent))
    return TableModel(structure, request, served)


def _prune(model: TableModel, quantities: tuple[str, ...]) -> tuple[TableFunction, ...]:
    return tuple(_prune_one(model, name) for name in quantities)


def _prune_one(model: TableModel, name: str) -> TableFunction:
    quantity = find_quantity(name)
    if name not in model.quantities:
        raise FormulationError(
            "the emitter 'table' does not serve this quantity",
            where=f"{model.name}: model.quantities",
            given=name,
            allowed=", ".join(model.quantities),
            hint=suggest(name, model.quantities),
        ).unless_chosen_otherwise(name)
    function = TableFunction(quantity, BUILDERS[name](model))
    if 0 in function.shape or function.recipe.is_empty:
        raise refuse_empty(model.name, name)
    return function


def _is_offered(model: TableModel, name: str) -> bool:
    try:
        _prune_one(model, name)
    except FormulationError:
        return False
    return True


def _write(model: TableModel, functions: tuple[TableFunction, ...], precision: Precision) -> Bodies:
    writer = Writer(model, precision)
    statements = {function.quantity.name: function.write(writer) for function in functions}
    checked = frozenset(function.quantity.name for function in functions if function.recipe.is_checked)
    return Bodies(statements, writer.preamble(), checked)


TABLE = Emitter("table", _build, _is_offered, _prune, _write)
