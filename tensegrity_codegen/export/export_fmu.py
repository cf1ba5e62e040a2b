"""Export to functional mock-up units (FMI 2.0 and 3.0), with C sources, derivatives and an integrator."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.emit import GeneratedSource, check_request, emit
from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource, write_export
from tensegrity_codegen.export.fmu.description import Unit, describe_build, describe_unit, list_variables
from tensegrity_codegen.export.fmu.layout import POSITION, Layout, find_tangent
from tensegrity_codegen.export.fmu.sources import (
    Experiment,
    check_targets,
    compile_unit,
    write_archive,
    write_unit_sources,
)
from tensegrity_codegen.pipeline.analyses import Needs, find_needs
from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.accuracy.choice import choose_method
from tensegrity_codegen.runtime.accuracy.scales import find_length, set_atol_by_length
from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.collision import require_no_collision
from tensegrity_codegen.structure.ground_support import refuse_ground
from tensegrity_codegen.structure.memory_support import require_no_lag, require_no_memory
from tensegrity_codegen.structure.sliding import require_no_ring_friction
from tensegrity_codegen.system.checks import (
    check_instance,
    check_names,
    check_path,
    check_positive,
    check_switch,
    is_number,
)
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice
from tensegrity_codegen.tables.quantities import QUANTITIES, find_quantity
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

SAMPLES = 101
OFFERED = ("auto", "adaptive", "implicit")  # kinds of methods that choose steps of their own


def settle_method(
    structure: Subject,
    request: ModelRequest,
    method: str,
    *,
    rtol: float,
    t_end: float,
    compiler: str | None,
    may_compile: bool,
) -> str:
    """Return the integrator of a unit: the one given, or for "auto" the one that `simulate` would choose."""
    # If the choice is between an explicit method and another, the library is built to weigh them; without a
    # compiler the explicit one is taken.
    kind = find_method(method).kind
    if kind not in OFFERED:
        raise InvalidValueError(
            "a unit integrates with error control, in its own C code",
            where="method",
            given=method,
            allowed=", ".join(
                name for name in list_methods("finds_events") if find_method(name).kind in OFFERED
            ),
        )
    names = find_needs("simulate", structure, request, method=method, rtol=rtol).integrators
    if len(names) == 1 or not may_compile:
        return names[0]
    alone = find_needs("simulate", structure, request, method=method, rtol=rtol).alone(request)
    model = build_library(structure, alone, compiler=compiler, calls=MANY_CALLS).load()
    state = np.concatenate([model.nominal("coordinate").ravel(), model.nominal("velocity").ravel()])
    motion = Motion(model, state, np.linspace(0.0, t_end, SAMPLES), {})
    options = set_atol_by_length(model.manifest, RunOptions(method="auto", rtol=rtol, control="steps"))
    return choose_method(motion, options).name


VERSIONS = ("2.0", "3.0")
KINDS = {"me": ("me",), "cs": ("cs",), "both": ("me", "cs")}
USUAL = (POSITION, "member_length", "member_tension")
# Those that states and their derivatives contain already.
SAME = ("acceleration", "state_derivative", "internal_rate")


def export_fmu(
    scene: str | Path | Mapping[str, Any] | Scene,
    out: str | Path,
    *,
    fmi: str = "2.0",
    kind: str = "both",
    outputs: Iterable[str] = (),
    method: str = "auto",
    t_end: float = 1.0,
    rtol: float = 1e-6,
    sources_only: bool = False,
    targets: Iterable[str] = (),
    compiler: str | None = None,
    overwrite: bool = False,
) -> Exported:
    """Write a scene as a functional mock-up unit.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        Scene file (TOML), or the scene as for `read_scene`.
    out : str or Path
        File to write, ending in ``.fmu``.
    fmi : str
        Version of the standard: ``"2.0"`` or ``"3.0"``.
    kind : str
        ``"me"`` (model exchange), ``"cs"`` (co-simulation) or ``"both"``.
    outputs : iterable of str
        Quantities that are outputs; by default node positions, member lengths and tensions, and the scene's
        own quantities.
    method : str
        Integrator of the co-simulation: ``"auto"`` or an integrator with error control.
    t_end : float
        Stop time of the default experiment [s].
    rtol : float
        Relative tolerance of the default experiment.
    sources_only : bool
        Whether to leave out the binary for this machine, which needs a C compiler.
    targets : iterable of str
        Machines that binaries are compiled for, by zig, instead of this one: ``"x86_64-linux"``,
        ``"aarch64-linux"``, ``"x86_64-windows"``, ``"x86_64-macos"``, ``"aarch64-macos"``.
    compiler : str, optional
        ``"gcc"``, ``"clang"``, ``"zig"`` or a command; by default the first compiler found.
    overwrite : bool
        Whether to replace a file that exists.

    Returns
    -------
    Exported
        The written file, and notes on the limits of the unit.

    Raises
    ------
    SceneError
        The scene has an error.
    UnknownNameError, InvalidValueError
        A version, interface, output, method or number that is not allowed.
    FormulationError
        The scene cannot move (no masses), or is in single precision.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.
    OutputError
        The file cannot be written, or exists.

    Examples
    --------
    >>> from tensegrity_codegen import export_fmu
    >>> exported = export_fmu("two_nodes.toml", "two_nodes.fmu", fmi="3.0", sources_only=True)
    >>> exported.facts["n_states"], exported.facts["method"]
    (6, 'rk853')
    """
    check_path(out, "out")
    check_switch(overwrite, "overwrite")
    if compiler is not None:
        check_instance(compiler, str, "compiler", "a name or command, or None")
    structure, request = load_scene(scene)
    path = Path(scene) if isinstance(scene, str | os.PathLike) else Path(f"{structure.name}.toml")
    source = ExportSource(path, structure, request)
    options: dict[str, Any] = {"fmi": fmi, "kind": kind, "method": method, "t_end": t_end, "rtol": rtol}
    options |= {"outputs": check_names(outputs, "outputs"), "targets": check_names(targets, "targets")}
    options |= {"sources_only": check_switch(sources_only, "sources_only"), "compiler": compiler}
    return write_export("fmu", source, Path(out), overwrite=overwrite, **options)


def _write(
    source: ExportSource,
    path: Path,
    *,
    fmi: str = "2.0",
    kind: str = "both",
    outputs: Sequence[str] = (),
    method: str = "auto",
    t_end: float = 1.0,
    rtol: float = 1e-6,
    sources_only: bool = False,
    targets: Sequence[str] = (),
    compiler: str | None = None,
) -> Exported:
    """Write the unit of a scene to `path`; see export_fmu."""
    _check_ground(source.structure)
    require_no_collision(source.structure, "a functional mock-up unit")
    _check_options(fmi, kind, t_end, rtol)
    machines = check_targets(targets)
    structure, request = source.structure, _narrow(source)
    chosen = _choose_outputs(structure, request, source.request.quantities, outputs)
    integrator = settle_method(
        structure, request, method, rtol=rtol, t_end=t_end, compiler=compiler, may_compile=not sources_only
    )
    # Library, layout and derivatives, from which sources and description follow.
    generated, own_request = _generate(structure, request, chosen, integrator)
    layout = Layout(generated.manifest, structure, chosen)
    length = 1.0 if "rad" in layout.coordinate_units() else find_length(generated.manifest)
    experiment = Experiment(fmi, KINDS[kind], integrator, float(t_end), float(rtol), length)
    tangent = find_tangent(layout, own_request)
    sources = write_unit_sources(generated.files, layout, tangent, experiment)
    unit = Unit(generated.manifest.name, sources.token, sources.compiled, tangent is not None, experiment)
    variables = list_variables(layout, tangent)
    # The archive.
    files = {f"sources/{name}": content.encode("utf-8") for name, content in sources.files.items()}
    files["modelDescription.xml"] = describe_unit(unit, variables)
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = describe_build(unit)
    if not sources_only:
        files |= compile_unit(
            unit.name, sources, fmi, compiler=compiler, flags=request.flags, targets=machines
        )
    write_archive(path, files)
    facts = {
        "fmi": fmi,
        "kinds": list(experiment.kinds),
        "method": integrator,
        "n_inputs": layout.n_inputs,
        "n_parameters": layout.n_arguments - layout.n_inputs,
        "n_states": layout.n_states,
        "n_outputs": sum(variable.causality == "output" for variable in variables),
        "n_event_indicators": len(layout.margins),
        "has_derivatives": tangent is not None,
        "token": sources.token,
        "binaries": sorted(name for name in files if name.startswith("binaries/")),
    }
    return Exported(facts, _list_notes(layout, tangent is not None))


def _check_ground(structure: Subject) -> None:
    """Raise FormulationError for internal states that events set, which importers cannot follow."""
    require_no_memory(structure, "a functional mock-up unit", "leave {key} out")
    require_no_lag(structure, "a functional mock-up unit")
    require_no_ring_friction(structure, "a functional mock-up unit")
    ground = getattr(structure, "ground", None)
    if ground is not None and ground.has_static_friction:
        raise refuse_ground(
            structure.name,
            "a functional mock-up unit with static_friction above friction",
            "leave static_friction out",
        )


def _check_options(fmi: str, kind: str, t_end: float, rtol: float) -> None:
    check_choice(fmi, VERSIONS, "version of FMI", "fmi")
    check_choice(kind, KINDS, "kind of interface", "kind")
    check_positive(t_end, "t_end", "[s]")
    if not (is_number(rtol) and 0.0 < rtol < 1.0):
        raise InvalidValueError(
            "the relative tolerance is out of range", where="rtol", given=rtol, allowed="a number > 0 and < 1"
        )


def _narrow(source: ExportSource) -> ModelRequest:
    """Return the request for the functions of a unit; raises FormulationError for single precision."""
    request = source.request
    if request.precision != "double":
        raise FormulationError(
            "an FMU needs double precision",
            where=f"{source.path}: model.precision",
            given=request.precision,
            allowed="double",
            hint='precision = "double"',
        )
    if request.flags != "reference":
        request = replace(request, flags="reference")  # the unit may run on another machine
    return replace(request, batch_width=0, interfaces=(), solvers=(), keep=(), integrators=())


def _choose_outputs(
    structure: Subject, request: ModelRequest, wanted: Sequence[str], given: Sequence[str]
) -> tuple[str, ...]:
    """Return the quantities that are outputs; raises for those given that cannot be."""
    check_request(structure, request.wanting("acceleration"))
    if not given:
        usual = [name for name in USUAL if _is_offered(structure, request, name)]
        further = [name for name in wanted if name not in (*USUAL, *SAME) and not find_quantity(name).sparse]
        return tuple(dict.fromkeys((*usual, *further)))
    for name in given:
        if find_quantity(name).sparse:
            raise InvalidValueError(
                "a sparse matrix cannot be an output",
                where="outputs",
                given=name,
                allowed=", ".join(key for key, row in QUANTITIES.items() if not row.sparse),
            )
        if not (name == POSITION and _has_node_coordinates(request)):
            check_request(structure, request.wanting("acceleration", name))
    return tuple(dict.fromkeys(given))


def _has_node_coordinates(request: ModelRequest) -> bool:
    from tensegrity_codegen.tables.formulations import find_formulation

    return find_formulation(request.formulation).in_nodes


def _is_offered(structure: Subject, request: ModelRequest, name: str) -> bool:
    if name == POSITION and _has_node_coordinates(request):
        return True
    try:
        check_request(structure, request.wanting("acceleration", name))
    except FormulationError:
        return False
    return True


def _generate(
    structure: Subject, request: ModelRequest, outputs: Sequence[str], integrator: str
) -> tuple[GeneratedSource, ModelRequest]:
    """Return the C of the library, and the request that it was made from."""
    coordinates = _has_node_coordinates(request)
    computed = [name for name in outputs if not (name == POSITION and coordinates)]
    if getattr(structure, "internal_name", ()):
        computed.append("internal_rate")
    extended = Needs(("acceleration", *computed), (integrator,), events=AUTO_EVENTS).alone(request)
    return emit(structure, extended), extended


def _list_notes(layout: Layout, has_derivatives: bool) -> tuple[str, ...]:
    notes = []
    if not has_derivatives:
        notes.append("the structure is too large for directional derivatives, which the unit lacks")
    manifest = layout.manifest
    if manifest.rigid_bar or manifest.formulation == "node_distance":
        notes.append(
            "the coordinates depend on each other: initial values must agree, and importers that integrate "
            "by themselves (model exchange) do not keep the constraints exactly"
        )
    if layout.structure.has_switch.any() and not any(kind for _, kind in layout.margins):
        notes.append("switches of member laws are no events of this unit")
    return tuple(notes)


EXPORTER = Exporter(
    "fmu",
    "functional mock-up unit (FMI 2.0 or 3.0), with C sources",
    (".fmu",),
    _write,
    ("fmi", "kind", "outputs", "method", "t_end", "rtol", "sources_only", "targets", "compiler"),
    order=10,
)
