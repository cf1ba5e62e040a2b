"""From pruned functions to the manifest: sizes, shapes, nominal values, patterns."""

from __future__ import annotations


import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.fingerprint import hash_scene
from tensegrity_codegen.codegen.prune import PrunedFunction
from tensegrity_codegen.errors import FormulationError, suggest
from tensegrity_codegen.manifest import (
    ABI_VERSION,
    ArgumentSpec,
    FunctionSpec,
    IntegratorSpec,
    LeftOut,
    Manifest,
    Pattern,
)
from tensegrity_codegen.quantities import ARGUMENTS
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.version import VERSION

__all__ = ["INTEGRATOR_WORK", "describe", "made_by"]

# Doubles of work memory, in multiples of n_coordinates: acceleration, old (q, v, a), trial (q, v), stages.
INTEGRATOR_WORK = {"rk4": 1 + 3 + 2 + 7}


def made_by() -> dict[str, str]:
    """Return the versions of what makes the code."""
    return {
        "tensegrity_codegen": VERSION,
        "casadi": ca.__version__,
    }


def describe(
    model: SymbolicModel,
    request: ModelRequest,
    functions: tuple[PrunedFunction, ...],
    left_out: tuple[LeftOut, ...],
) -> Manifest:
    """Return the manifest of the library that these functions make."""
    structure = model.structure
    specs = tuple(_function_spec(structure, function) for function in functions)
    used = {name for function in functions for name in function.arguments}
    used |= {"coordinate", "velocity"} | ({"input"} if structure.inputs else set())
    return Manifest(
        abi_version=ABI_VERSION,
        name=structure.name,
        scene_hash=hash_scene(structure, request),
        formulation=model.formulation,
        emitter=request.emitter,
        made_by=made_by(),
        axes=structure.axes,
        node_name=structure.node_name,
        member_name=structure.member_name,
        connectivity=tuple((int(i), int(j)) for i, j in structure.connectivity),
        coordinate_node_axis=tuple((int(n), int(a)) for n, a in structure.coordinate_node_axis),
        node_position=_rows(structure.node_position),
        node_velocity=_rows(structure.node_velocity),
        input_name=tuple(item.name for item in structure.inputs),
        arguments=tuple(_argument_spec(structure, request, name) for name in ARGUMENTS if name in used),
        functions=specs,
        integrators=tuple(_integrator_spec(structure, name, specs) for name in request.integrators),
        left_out=left_out,
    )


def _rows(values: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in values)


def _function_spec(structure: Structure, function: PrunedFunction) -> FunctionSpec:
    quantity, sparsity = function.quantity, function.sparsity
    pattern = None
    shape: tuple[int, ...] = (
        tuple(reversed(sparsity.shape)) if len(quantity.shape) == 2 else (sparsity.numel(),)
    )
    if quantity.sparse:
        shape = (sparsity.shape[0], sparsity.shape[1])
        pattern = Pattern(shape, tuple(sparsity.row()), tuple(sparsity.colind()))
    elif not quantity.shape:
        shape = ()
    return FunctionSpec(
        quantity=quantity.name,
        symbol=f"{structure.name}_compute_{quantity.name}",
        arguments=function.arguments,
        shape=shape,
        unit=quantity.unit,
        sentence=quantity.sentence,
        operations=function.operations,
        pattern=pattern,
    )


def _argument_spec(structure: Structure, request: ModelRequest, name: str) -> ArgumentSpec:
    values, over = _nominal(structure, request, name)
    return ArgumentSpec(
        name=name,
        shape=values.shape,
        unit=ARGUMENTS[name].unit,
        sentence=ARGUMENTS[name].sentence,
        nominal=tuple(float(value) for value in values.ravel()),
        over=over,
    )


def _nominal(structure: Structure, request: ModelRequest, name: str) -> tuple[np.ndarray, tuple[str, ...]]:
    axes, places = list(structure.axes), structure.coordinate_node_axis
    if name == "coordinate":
        return structure.node_position[places[:, 0], places[:, 1]], ()
    if name == "velocity":
        return structure.node_velocity[places[:, 0], places[:, 1]], ()
    if name == "input":
        return np.zeros(len(structure.inputs)), tuple(item.name for item in structure.inputs)
    if name == "gravity":
        return structure.gravity[axes], ()
    chosen = list(request.parameters[name])
    if name in ("node_load", "anchor_position"):
        source = structure.node_load if name == "node_load" else structure.node_position
        return source[np.ix_(chosen, axes)], tuple(structure.node_name[k] for k in chosen)
    names = structure.node_name if name == "node_mass" else structure.member_name
    values: np.ndarray = getattr(structure, name)
    return values[chosen], tuple(names[k] for k in chosen)


def _integrator_spec(structure: Structure, name: str, functions: tuple[FunctionSpec, ...]) -> IntegratorSpec:
    if name not in INTEGRATOR_WORK:
        raise FormulationError(
            "unknown integrator", where="model.integrators", given=name, hint=suggest(name, INTEGRATOR_WORK)
        )
    acceleration = next((f for f in functions if f.quantity == "acceleration"), None)
    if acceleration is None:
        raise FormulationError(
            "an integrator needs the acceleration",
            where="model.integrators",
            given=name,
            hint='add "acceleration" to the wanted quantities',
        )
    passed = tuple(a for a in acceleration.arguments if a not in ("coordinate", "velocity"))
    work = INTEGRATOR_WORK[name] * len(structure.coordinate_node_axis)
    return IntegratorSpec(name, f"{structure.name}_integrate_{name}", passed, work)
