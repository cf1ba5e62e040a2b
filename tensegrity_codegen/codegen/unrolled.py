"""Emitter `unrolled`: every wanted function as straight-line C.

For scenes of up to about a hundred members: code and compile time grow with the structure.
"""

from tensegrity_codegen.codegen.annotate import NamedValues
from tensegrity_codegen.codegen.batch import write_lanes
from tensegrity_codegen.codegen.emitter import Bodies, Emitter
from tensegrity_codegen.codegen.print.printer import print_body, print_columns
from tensegrity_codegen.codegen.print.render import render
from tensegrity_codegen.codegen.prune import PrunedFunction, is_offered, prune
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.precision import Precision
from tensegrity_codegen.tables.quantities import OF_COLUMNS
from tensegrity_codegen.tables.request import ModelRequest

MOST_MEMBERS = 400
MOST_OPERATIONS = 150_000
COMPILED_OPERATIONS_A_SECOND = 4_000.0


def check_unrollable(structure: Structure | BodySystem) -> None:
    """Raise FormulationError if unrolling this many members would not compile in reasonable time."""
    if structure.n_members > MOST_MEMBERS:
        raise FormulationError(
            "this structure is too large for the emitter 'unrolled', whose code grows with every member",
            where=f"{structure.name}: model.emitter",
            given=f"{structure.n_members} members",
            allowed=f"at most {MOST_MEMBERS} members",
            hint="a smaller structure",
        ).unless_chosen_otherwise()


def _build(structure: Structure | BodySystem, request: ModelRequest) -> SymbolicModel:
    check_unrollable(structure)
    return build_model(structure, request)


def check_length(model: SymbolicModel, functions: tuple[PrunedFunction, ...]) -> None:
    """Raise FormulationError if these functions would take too long to compile."""
    operations = sum(function.operations for function in functions)
    if operations > MOST_OPERATIONS:
        raise FormulationError(
            "the requested functions are too long for unrolled code",
            where=f"{model.name}: model.quantities",
            given=f"{operations} operations, {operations / COMPILED_OPERATIONS_A_SECOND:.0f} s to compile",
            allowed=f"at most {MOST_OPERATIONS} operations",
            hint="request fewer quantities (Jacobians are the longest) or use a smaller structure",
        ).unless_chosen_otherwise()


def _write(model: SymbolicModel, functions: tuple[PrunedFunction, ...], precision: Precision) -> Bodies:
    """Return the statements of all functions; FormulationError if they would take too long to compile."""
    check_length(model, functions)
    landmarks = NamedValues(model)
    statements = {}
    for function in functions:
        name, arguments = function.quantity.name, list(function.arguments)
        if function.quantity.over_columns:
            before = function.sparsity.numel() // 2 if function.quantity.follows_state else 0
            printed = print_columns(function.function, arguments, OF_COLUMNS, name, before)
            statements[name] = printed.lines
        else:
            annotations = landmarks.annotate(function)
            body = print_body(function.function, arguments, [name], precision, annotations=annotations)
            statements[name] = body.lines
    count = len(model.frame.column_name)
    return Bodies(statements, [render("column_lanes.c", {"count": count})] if count else ())


UNROLLED = Emitter("unrolled", _build, is_offered, prune, _write, write_lanes, check_length)
