"""From a symbolic model to C text: one function an emitter, chosen by name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from tensegrity_codegen.codegen.casadi_interface.acados import build_acados
from tensegrity_codegen.codegen.casadi_interface.derivatives import (
    Derivatives,
    build_derivatives,
    list_derivative_parts,
    with_stiffness,
)
from tensegrity_codegen.codegen.choose_emitter import AUTO, settle_emitter
from tensegrity_codegen.codegen.describe import describe
from tensegrity_codegen.codegen.emitter import EmittedModel, Emitter, WantedFunction
from tensegrity_codegen.codegen.integrators.energy_keeping import KEPT_QUANTITIES, check_keep
from tensegrity_codegen.codegen.integrators.events import find_events
from tensegrity_codegen.codegen.integrators.integrators import PROJECTION
from tensegrity_codegen.codegen.lanes.emitter import LANES
from tensegrity_codegen.codegen.left_out import account_left_out, build_with
from tensegrity_codegen.codegen.print.lane_printer import PrintedLanes
from tensegrity_codegen.codegen.print.number_range import check_number_range
from tensegrity_codegen.codegen.source import write_sources
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.codegen.unrolled import UNROLLED
from tensegrity_codegen.codegen.way_out import find_way_out
from tensegrity_codegen.scene.names import check_names, check_scene_name
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.integrators import INTEGRATORS, called_quantities
from tensegrity_codegen.tables.manifest import LeftOut, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.request import ModelRequest

EMITTERS = {emitter.name: emitter for emitter in (UNROLLED, LANES, TABLE)}


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
) -> GeneratedSource:
    """Return the C source of what `request` wants of `structure`.

    object_size: bytes of object code of some sources; with it, what was left out is compiled too and its
    bytes are measured instead of estimated.
    Raises FormulationError for what formulation, emitter or precision cannot serve, InvalidValueError for
    numbers too large for single precision.
    """
    plan = check_request(structure, request)
    model, request, functions = plan.model, plan.request, plan.functions
    emitter = EMITTERS[request.emitter]
    left_out = account_left_out(model, request, functions, emitter)
    if object_size is not None:
        own = object_size(_sources(model, request, functions)[1])
        measured = []
        for row in left_out:
            variant, wider = build_with(row.what, model, request, emitter)
            _, files = _sources(variant, wider, emitter.prune(variant, wider.quantities))
            measured.append(replace(row, object_bytes=object_size(files) - own, measured=True))
        left_out = tuple(measured)
    return GeneratedSource(*_sources(model, request, functions, left_out), plan.why_emitter)


@dataclass(frozen=True)
class EmissionPlan:
    """A request with its emitter and all that integrators call settled, and the functions to be written."""

    model: EmittedModel
    request: ModelRequest
    functions: tuple[WantedFunction, ...]
    why_emitter: str


def check_request(structure: Subject, request: ModelRequest) -> EmissionPlan:
    """Return what `emit` would write, without writing it; raises all that `emit` raises of a request.

    Where another emitter or formulation serves the request, the error's hint names it: each has been tried
    here before it is named.
    """
    try:
        return _plan(structure, request)
    except FormulationError as error:
        if error.lacking is not None:
            error.hint = find_way_out(structure, request, error, _plan)
        raise


def _plan(structure: Subject, request: ModelRequest) -> EmissionPlan:
    if request.emitter not in (AUTO, *EMITTERS):
        raise FormulationError(
            "unknown emitter",
            where="model.emitter",
            given=request.emitter,
            hint=suggest(request.emitter, (AUTO, *EMITTERS)),
        )
    _check_names(structure)
    _check_precision(structure, request)
    request, why = settle_emitter(structure, request)
    emitter = EMITTERS[request.emitter]
    model = emitter.build(structure, request)
    request = _with_called_functions(model, emitter, request)
    functions = emitter.prune(model, request.quantities)
    emitter.check(model, functions)
    describe(model, request, functions, ())
    return EmissionPlan(model, request, functions, why)


def _check_names(structure: Subject) -> None:
    """Raise InvalidNameError or DuplicateNameError unless all names that get into C are identifiers."""
    check_scene_name(structure.name, "name")
    for what, names in (("nodes", structure.node_name), ("members", structure.member_name)):
        check_names(names, what, structure.name)
    check_names([item.name for item in structure.inputs], "inputs", structure.name)


def _check_precision(structure: Subject, request: ModelRequest) -> None:
    """Raise FormulationError or InvalidValueError for what single precision cannot serve."""
    precision = find_precision(request.precision)
    if precision.name == "double":
        return
    if request.solvers:
        raise FormulationError(
            "solvers need double precision",
            where=f"{structure.name}: model.solvers",
            given=f"{', '.join(request.solvers)} with precision {precision.name!r}",
            allowed="no solvers in single precision",
            hint='omit solvers, or choose precision = "double"',
        )
    in_single = [name for name, item in INTEGRATORS.items() if item.in_single]
    for name in request.integrators:
        if name in INTEGRATORS and name not in in_single:
            raise FormulationError(
                f"the integrator {name!r} needs double precision",
                where=f"{structure.name}: model.integrators",
                given=f"{name} with precision {precision.name!r}",
                allowed=f"{', '.join(in_single)} in single precision",
                hint='omit it, or choose precision = "double"',
            )
    if request.interfaces:
        raise FormulationError(
            "interfaces need double precision",
            where=f"{structure.name}: model.interfaces",
            given=f"{', '.join(request.interfaces)} with precision {precision.name!r}",
            allowed="no interfaces in single precision: casadi.external calls with doubles",
            hint='omit interfaces, or choose precision = "double"',
        )
    check_number_range(structure, precision)


def _with_called_functions(model: EmittedModel, emitter: Emitter, request: ModelRequest) -> ModelRequest:
    """Return the request with what interfaces and integrators call besides what is wanted.

    Integrators also keep coordinates consistent and see events.
    """
    structure = model.subject
    request = with_stiffness(structure, request)
    if not request.integrators:
        return request
    events, watched = find_events(request, lambda name: emitter.is_offered(model, name), structure)
    check_keep(request, structure.name)
    kept = KEPT_QUANTITIES if request.keep else ()
    called = (*PROJECTION, *kept, *called_quantities(request.integrators))
    wanted = [name for name in called if emitter.is_offered(model, name)]
    return replace(request, quantities=(*request.quantities, *wanted, *watched), events=events)


def _sources(
    model: EmittedModel,
    request: ModelRequest,
    functions: tuple[WantedFunction, ...],
    left_out: tuple[LeftOut, ...] = (),
) -> tuple[Manifest, dict[str, str]]:
    derivatives = build_derivatives(model, request, functions)
    if "acados" in request.interfaces:
        symbolic = model if isinstance(model, SymbolicModel) else build_model(model.subject, request)
        derivatives = Derivatives((*derivatives.made, *build_acados(symbolic)), derivatives.too_long)
    manifest = describe(model, request, functions, left_out)
    manifest = replace(manifest, parts=(*manifest.parts, *list_derivative_parts(request, derivatives)))
    emitter, precision = EMITTERS[request.emitter], find_precision(request.precision)
    bodies = emitter.write(model, functions, precision)
    lanes: Mapping[str, PrintedLanes] = {}
    if request.batch_width and emitter.write_lanes is not None:
        lanes = emitter.write_lanes(functions, request.batch_width, precision)
    return write_sources(manifest, functions, bodies, lanes, derivatives)
