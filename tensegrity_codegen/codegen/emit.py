"""From a symbolic model to C text: one function an emitter, chosen by name."""

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.build_manifest import build_manifest
from tensegrity_codegen.codegen.casadi_functions import (
    Derivatives,
    build_acados,
    build_derivatives,
    list_derivative_parts,
    needed_stiffness,
)
from tensegrity_codegen.codegen.choose_emitter import (
    AUTO,
    EmitterChoice,
    choose_emitter,
    find_alternatives,
    find_facts,
)
from tensegrity_codegen.codegen.emitter import EmittedModel, Emitter, WantedFunction
from tensegrity_codegen.codegen.integrators.events import find_events
from tensegrity_codegen.codegen.integrators.implicit import KEPT_QUANTITIES, check_keep
from tensegrity_codegen.codegen.integrators.integrators import PROJECTION, SETTLING
from tensegrity_codegen.codegen.integrators.profiles import check_jumps, list_derivative_quantities
from tensegrity_codegen.codegen.left_out import account_left_out, build_with
from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes
from tensegrity_codegen.codegen.source import write_sources
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.codegen.unrolled import UNROLLED
from tensegrity_codegen.scene.names import check_names, check_scene_name
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.body_support import check_bodies, has_free_bodies
from tensegrity_codegen.structure.collision import check_collision
from tensegrity_codegen.structure.ground_support import check_ground, has_contacts, needs_state_jacobian
from tensegrity_codegen.structure.memory import find_setting_events
from tensegrity_codegen.structure.memory_support import check_memory
from tensegrity_codegen.structure.sliding import check_ring_friction, check_rings
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.integrators import INTEGRATORS, called_quantities
from tensegrity_codegen.tables.manifest import LeftOut, Manifest
from tensegrity_codegen.tables.precision import Precision, check_precision, find_precision
from tensegrity_codegen.tables.request import ModelRequest

PLASTIC_QUANTITIES = ("plastic_power", "plastic_work", "plastic_elongation")  # of members that yield
# Fields of a structure with a number a member.
OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius")

EMITTERS = {emitter.name: emitter for emitter in (UNROLLED, TABLE)}


@dataclass(frozen=True)
class GeneratedSource:
    """Generated files by name, the manifest that describes them, and why its emitter wrote them."""

    manifest: Manifest
    files: dict[str, str]
    why_emitter: str = ""


def emit(
    structure: Subject,
    request: ModelRequest,
    object_size: Callable[[dict[str, str]], int] | None = None,
    *,
    account: bool = True,
    quick: bool = False,
) -> GeneratedSource:
    """Return the C source of a structure for a request.

    account: whether the manifest lists the omitted features, which takes longer than all else; quick: whether
    the emitter `table`, whose code compiles quickest, goes before the choice of `auto` where it serves all.
    object_size: bytes of object code of some sources; with it, what was left out is compiled too and its
    bytes are measured.
    """
    plan = (quick and _plan_loops(structure, request)) or check_request(structure, request)
    _checked.clear()
    left_out = account_left_out(plan.model, plan.request, plan.functions, plan.emitter) if account else ()
    if object_size is not None:
        size = object_size(_write(plan)[1])
        sizes = {}
        for row in left_out:
            model, variant_request = build_with(row.what, plan.model, plan.request, plan.emitter)
            sizes[row.what] = object_size(_write(_plan_functions(plan.emitter, model, variant_request))[1])
        left_out = tuple(replace(row, object_bytes=sizes[row.what] - size, measured=True) for row in left_out)
    return GeneratedSource(*_write(plan, left_out), plan.why_emitter)


@dataclass(frozen=True)
class EmissionPlan:
    """All that is settled before C is written; nothing changes it afterwards.

    request: with the emitter's own name, and with what interfaces and integrators call; manifest: without
    what was left out.
    """

    emitter: Emitter
    model: EmittedModel
    request: ModelRequest
    functions: tuple[WantedFunction, ...]
    manifest: Manifest
    why_emitter: str = ""


_checked: list[tuple[Subject, ModelRequest, EmissionPlan]] = []


def check_request(structure: Subject, request: ModelRequest) -> EmissionPlan:
    """Return the plan of `emit`, without writing it; raises all that `emit` raises of a request.

    If another emitter or formulation serves the request, the error's hint names it: each has been tried
    here before it is named. The last answer is kept until its library is emitted.
    """
    for subject, planned_request, known in _checked[:]:
        if subject is structure and planned_request == request:
            return known
    try:
        plan = _plan(structure, request)
    except FormulationError as error:
        if error.lacking is not None:
            error.hint = find_alternatives(structure, request, error, _plan)
        raise
    _checked[:] = [(structure, request, plan)]
    return plan


def _plan(structure: Subject, request: ModelRequest) -> EmissionPlan:
    if request.emitter not in (AUTO, *EMITTERS):
        raise FormulationError(
            "unknown emitter",
            where="model.emitter",
            given=request.emitter,
            hint=suggest(request.emitter, (AUTO, *EMITTERS)),
        )
    # All names that get into C are identifiers.
    check_scene_name(structure.name, "name")
    for kind, names in (("nodes", structure.node_name), ("members", structure.member_name)):
        check_names(names, kind, structure.name)
    check_names([source.name for source in structure.inputs], "inputs", structure.name)
    check_ground(structure, request)
    check_bodies(structure, request)
    check_rings(structure, request)
    check_collision(structure, request)
    check_memory(structure, request)
    check_ring_friction(structure, request)
    _check_precision(structure, request)
    choice = EmitterChoice(request.emitter, "asked for by name")
    lags = any(actuator.time_constant for actuator in structure.actuators)
    remembers = structure.remembers.any() or bool(structure.sliding) or bool(find_setting_events(structure))
    is_bound = getattr(structure, "collision", None) or remembers or lags or has_free_bodies(structure)
    if request.emitter == AUTO and (is_bound or request.differentiates_motions):
        why = "the only emitter for bodies, collisions, static friction, memory and derivatives of motions"
        choice = EmitterChoice(UNROLLED.name, why)
    elif request.emitter == AUTO:
        choice = choose_emitter(find_facts(structure, request))
    emitter = EMITTERS[choice.name]
    if request.differentiates_motions and emitter is not UNROLLED:
        raise FormulationError(
            "motions are differentiated by unrolled code alone",
            where=f"{structure.name}: model.emitter",
            given=request.emitter,
            hint='choose emitter = "auto"',
        )
    model = emitter.build(structure, request)
    called, events = _find_called(model, emitter, request)
    settled = replace(request, emitter=choice.name, quantities=(*request.quantities, *called), events=events)
    return _plan_functions(emitter, model, settled, choice.why)


def _plan_loops(structure: Subject, request: ModelRequest) -> EmissionPlan | None:
    """Return the plan with the emitter `table`, None if another one is asked for or serves more."""
    if request.emitter != AUTO:
        return None
    try:
        plan = _plan(structure, replace(request, emitter=TABLE.name))
    except FormulationError:
        return None
    return replace(plan, why_emitter="few calls: loops, which compile quickest")


def _plan_functions(
    emitter: Emitter, model: EmittedModel, request: ModelRequest, why_emitter: str = ""
) -> EmissionPlan:
    functions = emitter.prune(model, request.quantities)
    emitter.check(model, functions)
    return EmissionPlan(
        emitter, model, request, functions, build_manifest(model, request, functions, ()), why_emitter
    )


def _check_precision(structure: Subject, request: ModelRequest) -> None:
    """Raise FormulationError or InvalidValueError for a request that single precision cannot serve."""
    precision = find_precision(request.precision)
    if precision.name == "double":
        return
    in_single = [name for name, integrator in INTEGRATORS.items() if integrator.in_single]
    unserved = [name for name in request.integrators if name in INTEGRATORS and name not in in_single][:1]
    reason = "casadi.external calls with doubles"
    for key, names, need, allowed, omitted in (
        ("solvers", request.solvers, "solvers need", "no solvers in single precision", "solvers"),
        (
            "integrators",
            unserved,
            f"the integrator {''.join(unserved)!r} needs",
            f"{', '.join(in_single)} in single precision",
            "it",
        ),
        (
            "interfaces",
            request.interfaces,
            "interfaces need",
            f"no interfaces in single precision: {reason}",
            "interfaces",
        ),
    ):
        if names:
            raise FormulationError(
                f"{need} double precision",
                where=f"{structure.name}: model.{key}",
                given=f"{', '.join(names)} with precision {precision.name!r}",
                allowed=allowed,
                hint=f'omit {omitted}, or choose precision = "double"',
            )
    _check_number_range(structure, precision)


def _check_number_range(structure: Subject, precision: Precision) -> None:
    """Raise InvalidValueError for a number that the precision cannot hold, naming it and whose it is."""
    for field in dataclasses.fields(structure):
        names = structure.node_name if field.name.startswith("node_") else structure.member_name
        named = field.name in OF_MEMBERS or field.name.startswith("node_")
        for index, value in _numbers(getattr(structure, field.name)):
            owner = names[index[0]] if named else ".".join(map(str, index))
            check_precision(value, precision, f"{structure.name}: {field.name} of {owner}")


def _numbers(value: Any, index: tuple[int | str, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Give every number of more than 1 in arrays and containers, with the way that leads to it."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        for index_tuple in np.argwhere(np.abs(value) > 1.0):
            yield (*index, *map(int, index_tuple)), float(value[tuple(index_tuple)])
    elif isinstance(value, float):
        yield index, value
    elif isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _numbers(entry, (*index, key))
    elif isinstance(value, tuple):
        for number, entry in enumerate(value):
            yield from _numbers(entry, (*index, number))
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from _numbers(getattr(value, field.name), (*index, field.name))


def _find_called(
    model: EmittedModel, emitter: Emitter, request: ModelRequest
) -> tuple[tuple[str, ...], tuple[str, ...] | None]:
    """Return the further quantities that interfaces and integrators call, and the monitored events."""
    stiffness = needed_stiffness(model.subject, request)
    if not request.integrators:
        return stiffness, request.events
    events, watched = find_events(request, lambda name: emitter.is_offered(model, name), model.subject)
    check_keep(request, model.name)
    check_jumps(model.subject, request, events)
    energy_quantities = KEPT_QUANTITIES if request.keep else ()
    of_forces = ("state_derivative", "energy_rate") if has_contacts(model.subject) else ()
    of_states: tuple[str, ...] = ("state_derivative",) if model.frame.n_internal else ()
    if model.subject.remembers.any():
        of_states = (*of_states, "energy_rate")
    if model.subject.sliding:
        of_states = (*of_states, "energy_rate", "friction_power")
    if model.subject.yields.any():
        of_states = (*of_states, SETTLING, *PLASTIC_QUANTITIES)
    if model.subject.relaxes.any():
        of_states = (*of_states, "viscous_power", "relaxed_internal")
    of_integrators = called_quantities(request.integrators, needs_state_jacobian(model.subject))
    of_derivatives = list_derivative_quantities(model.arguments)
    called = (*PROJECTION, *energy_quantities, *of_forces, *of_states, *of_integrators, *of_derivatives)
    offered = [name for name in called if emitter.is_offered(model, name)]
    return (*stiffness, *offered, *watched), events


def _write(plan: EmissionPlan, left_out: tuple[LeftOut, ...] = ()) -> tuple[Manifest, dict[str, str]]:
    """Return the manifest and the text of each file."""
    emitter, model, request, functions = plan.emitter, plan.model, plan.request, plan.functions
    # Derivatives for CasADi, and functions of the whole model for acados
    derivatives = build_derivatives(model, request, functions)
    if "acados" in request.interfaces:
        symbolic = model if isinstance(model, SymbolicModel) else build_model(model.subject, request)
        derivatives = Derivatives((*derivatives.made, *build_acados(symbolic)), derivatives.too_long)
    source_parts = (*plan.manifest.parts, *list_derivative_parts(request, derivatives))
    manifest = replace(plan.manifest, left_out=left_out, parts=source_parts)
    # Bodies of functions, one by one and over the lanes of a batch
    precision = find_precision(request.precision)
    bodies = emitter.write(model, functions, precision)
    lanes: Mapping[str, PrintedLanes] = {}
    if request.batch_width and emitter.write_lanes is not None:
        lanes = emitter.write_lanes(functions, request.batch_width, precision)
    return write_sources(manifest, functions, bodies, lanes, derivatives)
