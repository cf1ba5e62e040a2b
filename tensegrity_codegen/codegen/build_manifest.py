"""The manifest of a library, from its pruned functions: sizes, shapes, nominal values, patterns, parts."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.emitter import EmittedModel, WantedFunction
from tensegrity_codegen.codegen.integrators.events import describe_unwatched
from tensegrity_codegen.codegen.integrators.integrators import integrator_spec
from tensegrity_codegen.codegen.integrators.profiles import find_driven
from tensegrity_codegen.codegen.integrators.solvers import solver_spec
from tensegrity_codegen.codegen.integrators.work_memory import with_batch
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.manifest import (
    ABI_VERSION,
    ArgumentSpec,
    FunctionSpec,
    IntegratorSpec,
    LeftOut,
    Manifest,
    SourcePart,
)
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.quantities import ARGUMENTS, DIRECTED
from tensegrity_codegen.tables.quantities.quantity import fit_sentence
from tensegrity_codegen.tables.request import ModelRequest


def find_program_versions() -> dict[str, str]:
    """Return the versions of the programs that write the code."""
    return {"tensegrity_codegen": VERSION, "casadi": ca.__version__}


def build_manifest(
    model: EmittedModel,
    request: ModelRequest,
    functions: tuple[WantedFunction, ...],
    left_out: tuple[LeftOut, ...],
) -> Manifest:
    """Return the manifest of the library that these functions make."""
    frame = model.frame
    present = {
        "slack cables": model.subject.tension_only.any(),
        "damping": model.subject.damping.any() or "damping" in request.parameters,
        "rigid bars": frame.rigid_bar,
    }
    features = [feature for feature, is_present in present.items() if is_present]
    specs = tuple(_function_spec(model, function, features) for function in functions)
    used = {name for function in functions for name in function.arguments}
    used |= {"coordinate", "velocity", "internal", "input"}
    used |= set(DIRECTED) if request.differentiates_motions else set()  # a direction has them all
    driven = find_driven(model, specs, request) if request.integrators else ()
    integrators = tuple(_integrator_spec(model, name, specs, request, driven) for name in request.integrators)
    return Manifest(
        abi_version=ABI_VERSION,
        name=model.name,
        scene_hash=hash_scene(model.subject, request),
        formulation=model.formulation,
        emitter=request.emitter,
        precision=find_precision(request.precision).name,
        flags=find_flags(request.flags).name,
        checks=request.checks,
        made_by=find_program_versions(),
        axes=frame.axes,
        node_name=frame.node_name,
        member_name=frame.member_name,
        connectivity=frame.connectivity,
        coordinate_name=frame.coordinate_name,
        coordinate_node_axis=frame.coordinate_node_axis,
        node_position=_rows(frame.node_position),
        node_velocity=_rows(frame.node_velocity),
        input_name=frame.input_name,
        arguments=tuple(
            ArgumentSpec(
                name=name,
                shape=argument.nominal.shape,
                unit=argument.unit or ARGUMENTS[name].unit,
                sentence=argument.sentence or ARGUMENTS[name].sentence,
                nominal=tuple(float(value) for value in argument.nominal.ravel()),
                over=argument.over,
            )
            for name, argument in model.arguments.items()
            if name in used
        ),
        functions=specs,
        integrators=integrators,
        left_out=left_out,
        batch_width=request.batch_width,
        rigid_bar=frame.rigid_bar,
        bar_pair=frame.find_bar_pair() if any(f.quantity.over_bar_pairs for f in functions) else (),
        solvers=tuple(solver_spec(model, name, specs) for name in request.solvers),
        interfaces=request.interfaces,
        driven=driven,
        internal_name=frame.internal_name,
        contact_name=frame.contact_name,
        column_name=frame.column_name,
        ring_nodes=frame.ring_nodes,
        body_places=frame.body_places,
        copies=request.copies,
        parts=list_parts(request, integrators, driven, describe_unwatched(request, model.subject)),
    )


def _integrator_spec(
    model: EmittedModel,
    name: str,
    functions: tuple[FunctionSpec, ...],
    request: ModelRequest,
    driven: tuple[str, ...],
) -> IntegratorSpec:
    spec = integrator_spec(model, name, functions, request.events or (), request.keep, driven)
    sizes = [model.arguments[argument].nominal.size for argument in spec.arguments]
    n, n_internal = len(model.frame.coordinate_name), len(model.frame.internal_name)
    return with_batch(spec, n, n_internal, sizes, request.batch_width, find_precision(request.precision))


def _rows(values: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in values)


def _function_spec(model: EmittedModel, function: WantedFunction, features: Sequence[str]) -> FunctionSpec:
    quantity, (rows, columns) = function.quantity, function.shape
    unit, sentence = model.words.get(quantity.name, (quantity.unit, quantity.sentence))
    shape: tuple[int, ...] = (columns, rows) if len(quantity.shape) == 2 else (rows * columns,)
    if quantity.sparse:
        shape = (rows, columns)
    elif not quantity.shape:
        shape = ()
    return FunctionSpec(
        quantity=quantity.name,
        symbol=f"{model.name}_compute_{quantity.name}",
        arguments=function.arguments,
        shape=shape,
        unit=unit,
        sentence=fit_sentence(sentence, features),
        operations=function.operations,
        pattern=function.pattern,
    )


def list_parts(
    request: ModelRequest, integrators: Sequence[IntegratorSpec], driven: Sequence[str], unwatched: str
) -> tuple[SourcePart, ...]:
    """Return the optional parts of a C source, with the reason for each that is there or not.

    unwatched: what a motion without events means, see describe_unwatched.
    """
    portable = find_flags(request.flags).portable
    machine = "suit every machine of an architecture" if portable else "use what one machine has"
    kinds = dict.fromkeys(kind for integrator in integrators for kind in integrator.events)
    monitored = f"integrators monitor {', '.join(kinds)}" if kinds else unwatched or "events names no kind"
    keeping = [integrator.name for integrator in integrators if integrator.keeps]
    keeps = f"keep names energy, for {', '.join(keeping)}" if keeping else "keep does not name energy"
    varied = "no motion depends on an input" if integrators else NO_INTEGRATOR
    if driven:
        varied = f"integrators take inputs; {', '.join(driven)} can change with time"
    interfaces = f"names {', '.join(request.interfaces)}" if request.interfaces else "does not name casadi"
    return (
        SourcePart("machine_check", not portable, f"flags {request.flags!r} {machine}"),
        SourcePart("batch_functions", request.batch_width > 0, f"batch_width is {request.batch_width}"),
        SourcePart("event_search", bool(kinds), monitored if integrators else NO_INTEGRATOR),
        SourcePart("energy_correction", bool(keeping), keeps),
        SourcePart("profiles", bool(driven), varied),
        SourcePart("casadi_interface", bool(request.interfaces), f"interfaces {interfaces}"),
    )


NO_INTEGRATOR = "there is no integrator"
