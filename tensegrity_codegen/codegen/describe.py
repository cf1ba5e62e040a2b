"""From pruned functions to the manifest: sizes, shapes, nominal values, patterns."""

from __future__ import annotations

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.fingerprint import hash_scene
from tensegrity_codegen.codegen.prune import PrunedFunction
from tensegrity_codegen.codegen.solvers import solver_spec
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
from tensegrity_codegen.symbolic.model import ModelArgument, SymbolicModel
from tensegrity_codegen.version import VERSION

__all__ = ["INTEGRATOR_WORK", "describe", "made_by"]

# Doubles of work memory, in multiples of n_coordinates. rk4: acceleration, old (q, v, a), trial (q, v),
# stages; rk54: seven rates (v, a), trial (q, v), old (q, v, a), what rounding took, change of the state.
INTEGRATOR_WORK = {"rk4": 1 + 3 + 2 + 7, "rk54": 14 + 2 + 3 + 2 + 2}


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
    specs = tuple(_function_spec(model, function) for function in functions)
    used = {name for function in functions for name in function.arguments}
    used |= {"coordinate", "velocity", "input"}
    frame = model.frame
    return Manifest(
        abi_version=ABI_VERSION,
        name=model.name,
        scene_hash=hash_scene(model.subject, request),
        formulation=model.formulation,
        emitter=request.emitter,
        made_by=made_by(),
        axes=frame.axes,
        node_name=frame.node_name,
        member_name=frame.member_name,
        connectivity=frame.connectivity,
        coordinate_name=frame.coordinate_name,
        coordinate_node_axis=frame.coordinate_node_axis,
        node_position=_rows(frame.node_position),
        node_velocity=_rows(frame.node_velocity),
        input_name=frame.input_name,
        arguments=tuple(_argument_spec(name, item) for name, item in model.arguments.items() if name in used),
        functions=specs,
        integrators=tuple(_integrator_spec(model, name, specs) for name in request.integrators),
        left_out=left_out,
        bar_pair=frame.bar_pair if any(f.quantity.over_bar_pairs for f in functions) else (),
        solvers=tuple(solver_spec(model, name, specs) for name in request.solvers),
    )


def _rows(values: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in values)


def _function_spec(model: SymbolicModel, function: PrunedFunction) -> FunctionSpec:
    quantity, sparsity = function.quantity, function.sparsity
    unit, sentence = model.words.get(quantity.name, (quantity.unit, quantity.sentence))
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
        symbol=f"{model.name}_compute_{quantity.name}",
        arguments=function.arguments,
        shape=shape,
        unit=unit,
        sentence=sentence,
        operations=function.operations,
        pattern=pattern,
    )


def _argument_spec(name: str, argument: ModelArgument) -> ArgumentSpec:
    return ArgumentSpec(
        name=name,
        shape=argument.nominal.shape,
        unit=argument.unit or ARGUMENTS[name].unit,
        sentence=argument.sentence or ARGUMENTS[name].sentence,
        nominal=tuple(float(value) for value in argument.nominal.ravel()),
        over=argument.over,
    )


def _integrator_spec(model: SymbolicModel, name: str, functions: tuple[FunctionSpec, ...]) -> IntegratorSpec:
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
    work = INTEGRATOR_WORK[name] * len(model.frame.coordinate_name)
    return IntegratorSpec(name, f"{model.name}_integrate_{name}", passed, work)
