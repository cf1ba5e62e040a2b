"""Solvers that a library can hold: what each needs, what it passes on, how much work memory it takes."""

from collections.abc import Mapping
from typing import Any

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import SOLVER_STATUS, FunctionSpec, SolverSpec

SOLVERS = ("equilibrium",)

# The solver keeps the Hessian dense: its work memory grows as the square, its time as the cube.
MOST_SOLVED_COORDINATES = 60

ENERGY, STIFFNESS = "potential_energy", "tangent_stiffness"
FORCES = ("node_residual", "coordinate_force")  # what formulations call -dU/dq


def solver_spec(model: EmittedModel, name: str, functions: tuple[FunctionSpec, ...]) -> SolverSpec:
    """Return what a library says of a solver.

    Raises FormulationError for an unknown one, for a model that lacks a function it needs, that is too large
    for a dense Hessian, or whose loads have no potential.
    """
    if name not in SOLVERS:
        raise FormulationError(
            "unknown solver", where="model.solvers", given=name, hint=suggest(name, SOLVERS)
        )
    count = len(model.frame.coordinate_name)
    _check(model, name, {item.quantity for item in functions}, count)
    needed = _needed(functions)
    passed = tuple(
        argument
        for argument in model.arguments
        if argument != "coordinate" and any(argument in item.arguments for item in needed.values())
    )
    pattern = needed["stiffness"].pattern
    nonzeros = len(pattern.row) if pattern is not None else count * count
    loads = model.arguments["node_load"] if "node_load" in passed else None
    return SolverSpec(
        name=name,
        symbol=f"{model.name}_find_{name}",
        arguments=passed,
        varied="node_load" if loads else "",
        work_size=5 * count + nonzeros + count * count + (count + loads.nominal.size if loads else 0),
    )


def _check(model: EmittedModel, name: str, present: set[str], count: int) -> None:
    if find_formulation(model.formulation).has_rigid_bars:
        raise FormulationError(
            "the solver in C has no rigid bars",
            where=f"{model.name}: model.solvers",
            given=name,
            allowed="bars with axial_stiffness or spring_constant",
            hint="leave the solver out and call find_equilibrium in Python, or give the bars a stiffness",
        )
    force = next((item for item in FORCES if item in model.quantities), FORCES[0])
    missing = [item for item in (ENERGY, force, STIFFNESS) if item not in present]
    if missing:
        raise FormulationError(
            "the solver needs quantities that are not wanted",
            where="model.solvers",
            given=name,
            hint="add to the wanted quantities: " + ", ".join(missing),
        )
    if count > MOST_SOLVED_COORDINATES:
        raise FormulationError(
            "the structure is too large for a solver with a dense Hessian",
            where=f"{model.name}: model.solvers",
            given=f"{count} coordinates",
            allowed=f"at most {MOST_SOLVED_COORDINATES} coordinates",
            hint="leave the solver out and call find_equilibrium in Python, whose Hessian is sparse",
        )
    if isinstance(model.subject, BodySystem) and model.subject.has_unpotential_load:
        raise FormulationError(
            "torques and forces that turn with their body have no potential, whose minimum the solver seeks",
            where=f"{model.name}: model.solvers",
            given=name,
            hint='give forces the frame "inertial" and leave torques out',
        )


def _needed(functions: tuple[FunctionSpec, ...]) -> dict[str, FunctionSpec]:
    by_name = {item.quantity: item for item in functions}
    force = next(name for name in FORCES if name in by_name)
    return {"energy": by_name[ENERGY], "force": by_name[force], "stiffness": by_name[STIFFNESS]}


def solver_context(
    spec: SolverSpec, functions: tuple[FunctionSpec, ...], arguments: Mapping[str, dict[str, Any]]
) -> dict[str, Any]:
    """Return what the templates of a solver read."""
    needed = _needed(functions)
    pattern = needed["stiffness"].pattern
    return {
        "name": spec.name,
        "symbol": spec.symbol,
        "work_size": spec.work_size,
        "statuses": SOLVER_STATUS,
        "arguments": [arguments[name] for name in spec.arguments],
        "varied": arguments[spec.varied] if spec.varied else None,
        "nonzeros": len(pattern.row) if pattern is not None else 0,
        "quantity": {role: item.quantity for role, item in needed.items()},
        "kernel_arguments": {role: list(item.arguments) for role, item in needed.items()},
        "unit": needed["force"].unit,
    }
