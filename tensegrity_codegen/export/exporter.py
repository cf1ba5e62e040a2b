"""The formats that scenes are exported to.

A format is a module `export_*.py` of this folder that defines its `Exporter` as `EXPORTER`. Several of them
write shapes: positions, tensions and loads at the start of a scene, or over a simulated motion.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from tensegrity_codegen.report.loads import compute_loads, describe_other_loads
from tensegrity_codegen.report.pictures.draw import find_rigid, outline_motion
from tensegrity_codegen.report.pictures.shown import find_rest_tension
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import hide_bodies, outline_bodies, outline_tendons, split_at_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, OutputError, check_choice
from tensegrity_codegen.system.files import check_ending, check_output, replaced
from tensegrity_codegen.system.output_folder import check_folder, write_folder
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class ExportSource:
    """The source of an export."""

    path: Path  # the scene file; its name without ending names the written files
    structure: Subject  # the structure that it describes
    request: ModelRequest  # the request of the scene
    out: Path | None = None  # written by `write_export`; for formats of several files, which name each other


@dataclass(frozen=True)
class Exported:
    """The written files.

    facts: for programs and tables: {"n_nodes": 6, ...}, in JSON's types.
    notes: a sentence for each fact of the scene that the file lacks or states differently.
    files: contents by file name: those of the folder that a format of a folder writes, else those of a folder
        beside the file, of its name without ending.
    """

    facts: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    files: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Exporter:
    """One format.

    name: the word on the command line: "fmu".
    title: the kind of the file, for people: "functional mock-up unit (FMI 2.0 or 3.0)".
    endings: endings that the name of the file may have, in lower case, the usual one first.
    write: writes the file: write(source, path, **options); raises TensegrityError if the format cannot
        express the scene. `path` has the ending of the file that the user named, and takes its place when
        `write` returns.
    options: names of further keyword arguments of `write`, in Python as on the command line (with `-` for
        `_`). A `design` is made of the options of the verb `control` there.
    order: place in lists of formats.
    is_folder: whether the output is a folder, of files with these endings; `write` then writes nothing
        itself.
    """

    name: str
    title: str
    endings: tuple[str, ...]
    write: Callable[..., Exported]
    options: tuple[str, ...] = ()
    order: int = 0
    is_folder: bool = False


def find_exporters() -> list[Exporter]:
    """Return all formats, in their order."""
    package = import_module("tensegrity_codegen.export")
    names = [entry.name for entry in iter_modules(package.__path__) if entry.name.startswith("export_")]
    exporters = [import_module(f"{package.__name__}.{name}").EXPORTER for name in names]
    return sorted(exporters, key=lambda entry: entry.order)


def check_export(
    format_name: str,
    out: Path,
    *,
    overwrite: bool,
    inputs: tuple[Path, ...] = (),
    of_design: Mapping[str, Any] = MappingProxyType({}),
    **options: Any,
) -> Exporter:
    """Return the format of that name; raise for a wrong format, option or output before any work."""
    chosen = _find_exporter(format_name)
    for key, value in (options | dict(of_design)).items():
        if value is not None and key not in _list_options(chosen, of_design):
            having = [one.name for one in find_exporters() if key in _list_options(one, of_design)]
            raise InvalidValueError(
                f"the format {chosen.name} does not have this option",
                where=key,
                given=value,
                allowed=f"with {', '.join(having)} only",
            )
    # The output: a file with its ending, or a folder.
    if not chosen.is_folder:
        check_ending(out, *chosen.endings)
        check_output(out, overwrite=overwrite, inputs=inputs)
        return chosen
    if out.suffix:
        raise OutputError(
            "the output of this format is a folder with several files",
            where=str(out),
            given=out.name,
            allowed="a name without an ending",
            hint=out.stem,
        )
    check_folder(out)
    return chosen


def _find_exporter(format_name: str) -> Exporter:
    """Return the format of that name, of which only its own module is imported; UnknownNameError."""
    name = f"tensegrity_codegen.export.export_{format_name}"
    if str(format_name).isidentifier() and find_spec(name):
        return cast(Exporter, import_module(name).EXPORTER)
    exporters = {exporter.name: exporter for exporter in find_exporters()}
    check_choice(format_name, list(exporters), "format", "export")
    return exporters[format_name]


def _list_options(exporter: Exporter, of_design: Mapping[str, Any]) -> tuple[str, ...]:
    return (*exporter.options, *(of_design if "design" in exporter.options else ()))


def write_export(
    format_name: str, source: ExportSource, out: Path, *, overwrite: bool = False, **options: Any
) -> Exported:
    """Write a scene in a format: the whole file or none."""
    chosen = check_export(format_name, out, overwrite=overwrite, inputs=(source.path,), **options)
    stated = {key: value for key, value in options.items() if value is not None}
    source = replace(source, out=out)
    if chosen.is_folder:
        exported = chosen.write(source, out, **stated)
        write_folder(out, exported.files, inputs=(source.path,), overwrite=overwrite)
        return exported
    with replaced(out, overwrite=overwrite) as path:
        exported = chosen.write(source, path, **stated)
        if exported.files:
            write_folder(out.with_suffix(""), exported.files, inputs=(source.path,), overwrite=overwrite)
        return exported


@dataclass(frozen=True)
class Shapes:
    """One shape, or those of a motion."""

    # nodes and members, of bodies the tendons, bars, and edges of rigid bodies, of cables through rings their
    # strands
    structure: Structure
    time: FloatArray  # (n_t,) [s]
    # node_position, node_load (n_t, n_nodes, 3) [m, N]; member_tension (n_t, n_members) [N], NaN where
    # unknown
    node_position: FloatArray
    node_load: FloatArray
    member_tension: FloatArray
    notes: tuple[str, ...]  # facts that these arrays lack


def read_shapes(source: ExportSource, trajectory: Path | None = None) -> Shapes:
    """Return the stated shape of a scene, or those of a result file of the verb `simulate`."""
    subject = source.structure
    structure, motion, notes = outline_bodies(subject), None, []
    if trajectory is None:
        time, position = np.zeros(1), structure.node_position[None]
        tension = find_rest_tension(subject, find_rigid(subject, source.request))[None]
    else:
        motion = outline_motion(read_trajectory(trajectory, outline_tendons(subject)), structure)
        time, position, tension = motion.time, motion.node_position, motion.member_tension
        if motion.status != "ok":
            notes.append(f"the motion is {motion.headline()}")
    if isinstance(subject, BodySystem):
        notes.append("bodies are drawn: bars and edges of rigid bodies are members without a tension")
    further, load = describe_other_loads(subject, motion), compute_loads(subject, motion)
    if structure.bodies:
        notes.append("rigid bodies are not in the file, but for their points")
        structure = hide_bodies(structure)
        position, load = position[:, : structure.n_nodes], load[:, : structure.n_nodes]
    tension = structure.strands.spread(tension[:, : structure.n_members])
    notes += [further] if further else []
    return Shapes(split_at_rings(structure), time, position, load, tension, tuple(notes))
