"""`tensegrity-codegen build`: from a scene to a compiled library."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.cli.build_options import (
    AnyFlagsOption,
    EmitterOption,
    FolderOption,
    InterfaceOption,
    MeasureOption,
    PresetOption,
    QuantityOption,
    TargetOption,
    TuneForOption,
    TuneOption,
    WheelOption,
)
from tensegrity_codegen.cli.options import (
    BatchWidthOption,
    CompilerOption,
    FlagsOption,
    JsonOption,
    OverwriteOption,
    PrecisionOption,
    SceneArgument,
)
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.output_folder import check_folder
from tensegrity_codegen.tables.targets import find_target

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.memory_use import MemoryUse
    from tensegrity_codegen.pipeline.built_library import BuiltLibrary
    from tensegrity_codegen.pipeline.tuning import TunedLibrary
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


def build(
    scene: SceneArgument,
    out: FolderOption = None,
    overwrite: OverwriteOption = False,
    quantity: QuantityOption = None,
    measure: MeasureOption = False,
    precision: PrecisionOption = None,
    emitter: EmitterOption = None,
    tune: TuneOption = False,
    tune_for: TuneForOption = None,
    any_flags: AnyFlagsOption = False,
    batch_width: BatchWidthOption = None,
    interface: InterfaceOption = None,
    preset: PresetOption = None,
    compiler: CompilerOption = None,
    flags: FlagsOption = None,
    target: TargetOption = None,
    wheel: WheelOption = False,
    json: JsonOption = False,
) -> None:
    """Generate and compile the library of a scene.

    Example: tensegrity-codegen build prism.toml --out prism_library
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.cli.build_request import add_interfaces, narrow_request, use_preset
        from tensegrity_codegen.codegen.memory_use import measure_memory
        from tensegrity_codegen.pipeline.build_library import build_library

        if out is not None:
            check_folder(out)
        _check_target(target, tune or tune_for is not None)
        structure, request = output.load(scene)
        if wheel:
            _check_wheel(target, structure.name, out)
        request = use_preset(request, preset)
        request = narrow_request(request, quantity, precision, emitter, batch_width, flags)
        request = add_interfaces(request, interface or ())
        tuned = None
        if tune or tune_for is not None:
            tuned = _tune(structure, request, compiler, tune_for, any_flags, measure)
            built = tuned.built
        elif any_flags:
            raise InvalidValueError("nothing to compare", where="--any-flags", hint="add --tune")
        else:
            built = build_library(structure, request, compiler=compiler, target=target, measure=measure)
        folder = built.entry.folder
        if out is not None:
            folder = built.export(out, overwrite=overwrite, inputs=[scene], wheel=wheel)
        memory = None
        if preset == "mcu":
            source = built.entry.folder
            memory = measure_memory(source, built.manifest, compiler=compiler, target=target)
        _tell(output, built, folder, tuned, wheel, memory, _find_next(scene, out, target, wheel))


def _check_target(target: str | None, tunes: bool) -> None:
    """Refuse an unknown target, and one whose speed would have to be measured here."""
    find_target(target, "--target")
    if target is not None and tunes:
        raise InvalidValueError(
            "libraries for another machine cannot be measured on this one",
            where="--target",
            given=f"--target {target} with --tune",
            allowed="one of them",
            hint="build without --tune, or tune on that machine",
        )


def _check_wheel(target: str | None, scene: str, out: Path | None) -> None:
    """Refuse a Python package that has no place, or that cannot be."""
    from tensegrity_codegen.codegen.wheels.wheel import check_wheel

    if out is None:
        raise InvalidValueError(
            "there is no folder for the Python package",
            where="--wheel",
            allowed="--wheel with --out",
            hint="add --out FOLDER",
        )
    check_wheel(find_target(target), scene, "--target")


def _tune(
    structure: "Subject",
    request: "ModelRequest",
    compiler: str | None,
    by: str | None,
    any_flags: bool,
    measure: bool,
) -> "TunedLibrary":
    """Return the fastest library for this machine, and what it was compared with."""
    from tensegrity_codegen.codegen.compilation.flags import MEASURED
    from tensegrity_codegen.pipeline.tuning import build_tuned

    sets = MEASURED if any_flags else ()
    return build_tuned(structure, request, compiler=compiler, flags=sets, tune_for=by, measure=measure)


def _tell(
    output: Output,
    built: "BuiltLibrary",
    folder: Path,
    tuned: "TunedLibrary | None",
    wheel: bool,
    memory: "MemoryUse | None",
    following: str,
) -> None:
    """Say what a library holds, where it is, and which command comes next."""
    from tensegrity_codegen.codegen.wheels.wheel import wheel_file_name
    from tensegrity_codegen.report.tables import (
        candidates_table,
        describe_parts,
        functions_table,
        left_out_table,
        memory_table,
    )
    from tensegrity_codegen.system.summaries import describe_count

    data, tables = _describe(built, folder), [functions_table(built.manifest), left_out_table(built.manifest)]
    if tuned is not None:
        tables.append(candidates_table(tuned.rows))
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
    parts = {"function": manifest.functions, "integrator": manifest.integrators, "solver": manifest.solvers}
    held = ", ".join(describe_count(len(items), word) for word, items in parts.items() if items)
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


def _find_next(scene: Path, out: Path | None, target: str | None, wheel: bool) -> str:
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
        "parts": [vars(part) for part in manifest.parts],
        "functions": {spec.quantity: spec.symbol for spec in manifest.functions},
        "operations": {spec.quantity: spec.operations for spec in manifest.functions},
        "left_out": [vars(row) for row in manifest.left_out],
    }


VERB = Verb(build, order=510)
