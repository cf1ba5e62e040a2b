"""Solvers that a library can hold: the needs, arguments and work memory of each."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.codegen.print.printer import print_numbers
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest, SolverSpec

SOLVERS = ("equilibrium",)

# The solver keeps the Hessian dense: its work memory grows as the square, its time as the cube.
MAX_SOLVED_COORDINATES = 60

ENERGY, STIFFNESS, TENSION = "potential_energy", "tangent_stiffness", "member_tension"
AT_REST = ("velocity", "damping")  # arguments of tensions that do not matter at rest
FORCES = ("node_residual", "coordinate_force")  # what formulations call -dU/dq


def solver_spec(model: EmittedModel, name: str, functions: tuple[FunctionSpec, ...]) -> SolverSpec:
    """Return the description of a solver in a manifest."""
    if name not in SOLVERS:
        raise FormulationError(
            "unknown solver", where="model.solvers", given=name, hint=suggest(name, SOLVERS)
        )
    count = len(model.frame.coordinate_name)
    _check(model, name, {function.quantity for function in functions}, count)
    needed = _needed(functions)
    passed = tuple(
        argument
        for argument in model.arguments
        if argument != "coordinate" and any(argument in function.arguments for function in needed.values())
    )
    pattern = needed["stiffness"].pattern
    nonzeros = len(pattern.row) if pattern is not None else count * count
    loads = model.arguments["node_load"] if "node_load" in passed else None
    size = 5 * count + 3 + nonzeros + count * count + (count + loads.nominal.size if loads else 0)
    if _find_tension(functions, passed, model.frame) is not None:
        size += count * count + 14 * len(model.frame.member_name) + 2 * count + 4
    return SolverSpec(
        name=name,
        symbol=f"{model.name}_find_{name}",
        arguments=passed,
        varied="node_load" if loads else "",
        work_size=size,
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
    force = next((quantity for quantity in FORCES if quantity in model.quantities), FORCES[0])
    missing = [quantity for quantity in (ENERGY, force, STIFFNESS) if quantity not in present]
    if missing:
        raise FormulationError(
            "the solver needs quantities that are not wanted",
            where="model.solvers",
            given=name,
            hint="add to the wanted quantities: " + ", ".join(missing),
        )
    if count > MAX_SOLVED_COORDINATES:
        raise FormulationError(
            "the structure is too large for a solver with a dense Hessian",
            where=f"{model.name}: model.solvers",
            given=f"{count} coordinates",
            allowed=f"at most {MAX_SOLVED_COORDINATES} coordinates",
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
    by_name = {function.quantity: function for function in functions}
    force = next(name for name in FORCES if name in by_name)
    return {"energy": by_name[ENERGY], "force": by_name[force], "stiffness": by_name[STIFFNESS]}


def _find_tension(
    functions: tuple[FunctionSpec, ...], passed: tuple[str, ...], frame: Any
) -> FunctionSpec | None:
    """Return the function for tensions of members between two nodes, None if steps cannot damp members."""
    is_plain = bool(frame.coordinate_node_axis) and not frame.ring_nodes and not frame.body_places
    tension = next((function for function in functions if function.quantity == TENSION), None)
    available = {"coordinate", *AT_REST, *passed}
    return tension if tension is not None and is_plain and available.issuperset(tension.arguments) else None


def _member_context(manifest: Manifest, still: int) -> dict[str, Any]:
    """Return the members as tables: coordinates of their ends, entries of arguments, and fixed places."""
    n_coordinates, shape = len(manifest.coordinate_name), (len(manifest.node_name), 3)
    number, anchor, fixed = np.full(shape, n_coordinates), np.full(shape, -1), manifest.stated_position.copy()
    moved = manifest.find_argument("anchor_position")
    if moved is not None:
        rows = [manifest.node_name.index(name) for name in moved.over]
        anchor[np.ix_(rows, manifest.axes)] = np.arange(len(moved.nominal)).reshape(moved.shape)
    nodes, axes = manifest.coordinate_place.T
    number[nodes, axes], anchor[nodes, axes] = np.arange(n_coordinates), -1
    fixed[(anchor >= 0) | (number < n_coordinates)] = 0.0
    ends = np.array(manifest.connectivity, dtype=np.int64).reshape(-1, 2)
    return {
        "ends": number[ends].ravel().tolist(),
        "anchors": anchor[ends].ravel().tolist() if moved is not None else None,
        "fixed": print_numbers(fixed[ends[:, 0]] - fixed[ends[:, 1]]),
        "at_rest": still,
    }


def solver_context(
    spec: SolverSpec, manifest: Manifest, arguments: Mapping[str, dict[str, Any]]
) -> dict[str, Any]:
    """Return the context of the templates of a solver."""
    needed = _needed(manifest.functions)
    tension = _find_tension(manifest.functions, spec.arguments, manifest)
    members = None
    if tension is not None:
        needed["tension"] = tension
        still = (arguments[name]["size"] for name in tension.arguments if name in AT_REST)
        members = _member_context(manifest, max(still, default=0))
    pattern = needed["stiffness"].pattern
    return {
        "name": spec.name,
        "symbol": spec.symbol,
        "work_size": spec.work_size,
        "arguments": [arguments[name] for name in spec.arguments],
        "varied": arguments[spec.varied] if spec.varied else None,
        "members": members,
        "nonzeros": len(pattern.row) if pattern is not None else 0,
        "quantity": {role: function.quantity for role, function in needed.items()},
        "kernel_arguments": {role: list(function.arguments) for role, function in needed.items()},
        "unit": needed["force"].unit,
    }
