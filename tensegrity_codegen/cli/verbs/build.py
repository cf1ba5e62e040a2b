"""`tensegrity-codegen build`: from a scene to a compiled library."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.options import (
    BatchWidthOption,
    CompilerOption,
    FlagsOption,
    JsonOption,
    OverwriteOption,
    PrecisionOption,
    SceneArgument,
    read_folder,
)
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.output_folder import check_folder
from tensegrity_codegen.tables.targets import TARGETS, find_target

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.measure import MemoryUse
    from tensegrity_codegen.pipeline.build_library import BuiltLibrary
    from tensegrity_codegen.pipeline.tuning import TunedLibrary
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

FolderOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        parser=read_folder,
        metavar="<path>",
        help="Folder for header, C source, example and library.",
    ),
]
MeasureOption = Annotated[
    bool,
    typer.Option(
        "--measure", help="Also compile the omitted functions, to measure how many bytes were saved."
    ),
]
TargetOption = Annotated[
    str | None,
    typer.Option(
        "--target", help=f"Machine to compile for, by zig, instead of this one: {', '.join(TARGETS)}."
    ),
]
WheelOption = Annotated[
    bool, typer.Option("--wheel", help="Add a Python package of the library to --out; it needs NumPy alone.")
]


def use_preset(request: "ModelRequest", name: str | None) -> "ModelRequest":
    """Return the request with the settings of a preset in place of the scene's."""
    from tensegrity_codegen.tables.presets import find_preset

    return request if name is None else replace(request, **find_preset(name, "--preset").settings)


@dataclass(frozen=True)
class RequestOptions:
    """What is asked of a library in place of the scene's."""

    quantity: Annotated[
        list[str] | None,
        typer.Option("--quantity", "-q", help="Quantity to compute instead of the scene's; may be repeated."),
    ] = None
    precision: PrecisionOption = None
    emitter: Annotated[
        str | None,
        typer.Option("--emitter", help="Emitter, instead of the scene's: auto, unrolled, table."),
    ] = None
    batch_width: BatchWidthOption = None
    interface: Annotated[
        list[str] | None,
        typer.Option(
            "--interface",
            help="Also callable this way, besides the scene's: casadi, for casadi.external with first "
            "derivatives; casadi_hessian, with second derivatives too; acados, for its integrators (alone).",
        ),
    ] = None
    preset: Annotated[
        str | None,
        typer.Option(
            "--preset",
            help="Settings for a purpose, instead of the scene's: casadi, acados, f32, mcu "
            "(docs/machines.md).",
        ),
    ] = None
    flags: FlagsOption = None


@dataclass(frozen=True)
class TuneOptions:
    """Whether and by what emitters and compilers are compared."""

    tune: Annotated[
        bool, typer.Option("--tune", help="Measure emitters and compilers; use and remember the fastest.")
    ] = False
    tune_for: Annotated[
        str | None,
        typer.Option(
            "--tune-for", help="Like --tune, but by the time of this quantity (--tune: sum of all)."
        ),
    ] = None
    any_flags: Annotated[
        bool, typer.Option("--any-flags", help="Let --tune compare reference and native flags.")
    ] = False

    @property
    def is_given(self) -> bool:
        """Whether they are compared."""
        return self.tune or self.tune_for is not None


def narrow_request(request: "ModelRequest", wanted: RequestOptions) -> "ModelRequest":
    """Return the request with the choices of the command line in place of the scene's."""
    from tensegrity_codegen.codegen.compilation.flags import find_flags
    from tensegrity_codegen.tables.precision import find_precision
    from tensegrity_codegen.tables.request import check_batch_width

    if wanted.quantity:
        # Without the acceleration there is nothing to integrate.
        integrators = request.integrators if "acceleration" in wanted.quantity else ()
        minimised = {"potential_energy", "tangent_stiffness"} <= set(wanted.quantity)
        solvers = request.solvers if minimised else ()
        narrow = request.wanting(*wanted.quantity, integrators=integrators, solvers=solvers)
        request = replace(narrow, interfaces=request.interfaces)
    if wanted.precision is not None:
        request = replace(request, precision=find_precision(wanted.precision, "--precision").name)
    if wanted.emitter is not None:
        request = replace(request, emitter=wanted.emitter)
    if wanted.batch_width is not None:
        check_batch_width(wanted.batch_width, "--batch-width")
        request = replace(request, batch_width=wanted.batch_width)
    if wanted.flags is not None:
        request = replace(request, flags=find_flags(wanted.flags, "--flags").name)
    return request


def add_interfaces(request: "ModelRequest", interfaces: Sequence[str]) -> "ModelRequest":
    """Return the request with the interfaces of the command line besides the scene's."""
    from tensegrity_codegen.tables.request import check_interfaces

    check_interfaces(interfaces, "--interface")
    return replace(request, interfaces=tuple(dict.fromkeys((*request.interfaces, *interfaces))))


def build(
    scene: SceneArgument,
    out: FolderOption = None,
    overwrite: OverwriteOption = False,
    *,
    wanted: RequestOptions,
    measure: MeasureOption = False,
    tuning: TuneOptions,
    compiler: CompilerOption = None,
    target: TargetOption = None,
    wheel: WheelOption = False,
    json: JsonOption = False,
) -> None:
    """Generate and compile the library of a scene.

    Example: tensegrity-codegen build prism.toml --out prism_library
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.codegen.measure import measure_memory
        from tensegrity_codegen.pipeline.build_library import build_library

        if out is not None:
            check_folder(out)
        _check_target(target, tuning.is_given)
        structure, request = output.load(scene)
        if wheel:
            _check_wheel(target, structure.name, out)
        request = use_preset(request, wanted.preset)
        is_for_mcu = (request.precision, request.flags) == ("single", "small")
        request = narrow_request(request, wanted)
        request = add_interfaces(request, wanted.interface or ())
        tuned = None
        if tuning.is_given:
            tuned = _tune(structure, request, compiler, tuning, measure)
            built = tuned.built
        elif tuning.any_flags:
            raise InvalidValueError("nothing to compare", where="--any-flags", hint="add --tune")
        else:
            built = build_library(structure, request, compiler=compiler, target=target, measure=measure)
        folder = built.entry.folder
        if out is not None:
            folder = built.export(out, overwrite=overwrite, inputs=[scene], wheel=wheel)
        memory = None
        if is_for_mcu:
            source = built.entry.folder
            memory = measure_memory(source, built.manifest, compiler=compiler, target=target)
        _report(output, built, folder, tuned, wheel, memory, _name_next_command(scene, out, target, wheel))


def _check_target(target: str | None, tunes: bool) -> None:
    """Refuse an unknown target, and one whose speed would have to be measured here."""
    find_target(target, "--target")
    if target is not None and tunes:
        problem = "libraries for another machine cannot be measured on this one"
        value, hint = f"--target {target} with --tune", "build without --tune, or tune on that machine"
        raise InvalidValueError(problem, where="--target", given=value, allowed="one of them", hint=hint)


def _check_wheel(target: str | None, scene: str, out: Path | None) -> None:
    """Refuse a Python package that has no place, or that cannot be."""
    from tensegrity_codegen.codegen.wheels.wheel import check_wheel

    if out is None:
        problem, allowed = "there is no folder for the Python package", "--wheel with --out"
        raise InvalidValueError(problem, where="--wheel", allowed=allowed, hint="add --out FOLDER")
    check_wheel(find_target(target), scene, "--target")


def _tune(
    structure: "Subject", request: "ModelRequest", compiler: str | None, tuning: TuneOptions, measure: bool
) -> "TunedLibrary":
    """Return the fastest library for this machine, and what it was compared with."""
    from tensegrity_codegen.codegen.compilation.flags import MEASURED
    from tensegrity_codegen.pipeline.tuning import build_tuned

    sets = MEASURED if tuning.any_flags else ()
    return build_tuned(
        structure, request, compiler=compiler, flags=sets, tune_for=tuning.tune_for, measure=measure
    )


def _report(
    output: Output,
    built: "BuiltLibrary",
    folder: Path,
    tuned: "TunedLibrary | None",
    wheel: bool,
    memory: "MemoryUse | None",
    following: str,
) -> None:
    """Print what a library contains, where it is, and which command uses it."""
    from tensegrity_codegen.codegen.wheels.wheel import wheel_file_name
    from tensegrity_codegen.report.long_table import add_row, new_table
    from tensegrity_codegen.report.tables import describe_parts, functions_table, left_out_table, memory_table
    from tensegrity_codegen.system.summaries import describe_count

    data, tables = _describe(built, folder), [functions_table(built.manifest), left_out_table(built.manifest)]
    if tuned is not None:
        # What was measured, the fastest first, those without a time last
        table = new_table("candidates", "emitter", "compiler", "flags", ns="right")
        for row in sorted(tuned.rows, key=lambda row: float("inf") if row.total is None else row.total):
            time = row.problem if row.total is None else f"{row.total:,.1f}"
            add_row(table, row.emitter, row.compiler, row.flags, time)
        tables.append(table)
        rows = [vars(row) for row in tuned.rows]
        data["tuned"] = {"by": tuned.by, "from_cache": tuned.from_cache, "candidates": rows}
    written = [data["library"]]
    if wheel:
        data["wheel"] = str(folder / wheel_file_name(built.manifest))
        written.append(data["wheel"])
    if memory is not None:
        data["memory"] = vars(memory)
        tables.append(memory_table(memory.code_bytes, memory.stack_bytes))
    how = "from the cache" if built.from_cache else f"built with {built.compiler}"
    manifest = built.manifest
    contents = {
        "function": manifest.functions,
        "integrator": manifest.integrators,
        "solver": manifest.solvers,
    }
    held = ", ".join(describe_count(len(entries), kind) for kind, entries in contents.items() if entries)
    if not held:
        output.warn(
            "the library has no function: name quantities in model.quantities of the scene, integrators in "
            "model.integrators, or add --quantity"
        )
    output.result(
        data,
        f"{manifest.name}: {held or 'no function'}, {how}",
        *tables,
        f"emitter {built.manifest.emitter}: {built.why_emitter}",
        describe_parts(built.manifest),
        "\n".join(written) + f"\n{how}, {built.seconds:.2f} s",
        f"next: {following}",
    )


def _name_next_command(scene: Path, out: Path | None, target: str | None, wheel: bool) -> str:
    """Return the command that uses the library, or copies it to a folder."""
    if out is None:
        return f"tensegrity-codegen build {quote(str(scene))} --out {quote(scene.stem)}"
    folder = quote(str(out))
    if wheel:
        return f"pip install {folder}/*.whl"
    return f"make -C {folder}" + ("" if target else f" && {folder}/example")


def _describe(built: "BuiltLibrary", folder: Path) -> dict[str, Any]:
    """Return what --json says of a library; folder: where it is for the user."""
    manifest = built.manifest
    return {
        "status": "ok",
        "name": manifest.name,
        "emitter": manifest.emitter,
        "why_emitter": built.why_emitter,
        "folder": str(folder),
        "library": str(folder / built.path.name),
        "from_cache": built.from_cache,
        "seconds": built.seconds,
        "compiler": built.compiler,
        "flags": built.flags,
        "target": manifest.target,
        "precision": manifest.precision,
        "instruction_sets": manifest.instruction_sets,
        "batch_width": manifest.batch_width,
        "interfaces": manifest.interfaces,
        "parts": [vars(section) for section in manifest.parts],
        "functions": {spec.quantity: spec.symbol for spec in manifest.functions},
        "operations": {spec.quantity: spec.operations for spec in manifest.functions},
        "left_out": [vars(row) for row in manifest.left_out],
    }


VERB = Verb(build, order=510)
