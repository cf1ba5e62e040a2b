"""Shared parts of all studies: identity of a run, names of scenes, sections kept in a journal."""

import ctypes
import functools
import importlib.util
import platform
from collections import Counter
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeVar

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.fingerprint import hash_package, hash_scene, hash_text
from tensegrity_codegen.codegen.compilation.flags import describe_toolchain, find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.report.pages.page import Section, read_section, section_as_json
from tensegrity_codegen.structure.collision import require_no_collision
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_positive
from tensegrity_codegen.system.errors import DuplicateNameError, TensegrityError
from tensegrity_codegen.system.journal import Journal
from tensegrity_codegen.system.output_folder import check_folder, write_folder
from tensegrity_codegen.system.progress import ProgressFunction
from tensegrity_codegen.system.provenance import name_processor
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.request import ModelRequest

PACKAGES = ("casadi", "matplotlib", "mujoco", "numpy", "scikit-sundae", "scipy")


def hash_run(*texts: str) -> str:
    """Return the sha256 of `texts` with the source code, the packages in use and the machine."""
    return hash_text(*_surroundings(), *texts)


def hash_study(structure: Structure, compiler: str | None, flags: str, *texts: str) -> str:
    """Return the sha256 of a study of a structure by compiled models; texts: its options."""
    toolchain = describe_toolchain(find_compiler(compiler), find_flags(flags))
    return hash_run(hash_scene(structure, ModelRequest(())), toolchain, *texts)


def prepare_study(
    structures: Sequence[Structure], t_end: float, folder: Path, names: Sequence[str], *, overwrite: bool
) -> None:
    """Check the time [s], names of scenes and files of a study, and make its folder before the long work."""
    check_positive(t_end, "t_end", "[s]")
    for structure in structures:
        require_no_collision(structure, "a comparison of methods and programs")
    for name, count in Counter(structure.name for structure in structures).items():
        if count > 1:
            raise DuplicateNameError(
                f"{count} scenes have the same name",
                where="SCENE",
                given=name,
                allowed="one scene of each name",
                hint="give each scene a `name` of its own",
            )
    make_folder(folder, names, overwrite=overwrite)


def make_folder(folder: str | Path, names: Sequence[str], *, overwrite: bool) -> Path:
    """Return the folder, made if need be, if files of these names may be written into it later."""
    check_folder(folder, names, overwrite=overwrite)
    return write_folder(folder, {})


@functools.cache
def _surroundings() -> tuple[str, ...]:
    machine = (platform.system(), platform.machine(), platform.node(), name_processor())
    source = hash_package(Path(__file__).resolve().parent.parent, template_folder())
    return (VERSION, source, platform.python_version(), *machine, *map(find_version, PACKAGES))


def find_version(package: str) -> str:
    """Return the version of an installed package, or that it is not installed or has none."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed" if importlib.util.find_spec(package) is None else "unknown"


@functools.cache
def load_c(name: str, text: str) -> ctypes.CDLL:
    """Return the library of one C file, compiled once a machine."""
    compiler, cache, flags = find_compiler(), Cache(), find_flags("reference")
    key = hash_text(text, describe_toolchain(compiler, flags))
    entry = cache.find(key)
    if entry is None:
        made = compile_library({f"{name}.c": text}, name=name, compiler=compiler, flags=flags)
        entry = cache.store(key, {"manifest.json": b"{}", made.file_name: made.library})
    return ctypes.CDLL(str(entry.library))


Result = TypeVar("Result")
# Name of the study, its share of the time, and the function that computes its section.
Step = tuple[str, float, Callable[[], Section]]


def build_sections(
    steps: Sequence[Step], progress: ProgressFunction | None = None, journal: Journal | None = None
) -> tuple[Section, ...]:
    """Return the sections of the steps in their order; `progress` is called with the fraction done.

    Sections that the journal has are taken from there; others are kept in it as soon as they are built.
    """
    journal = journal or Journal(None)
    sections = {name: read_section(journal.find(name)) for name, _, _ in steps}
    done_names = [name for name, section in sections.items() if section is not None]
    journal.announce(steps[0][0].split()[0], "sections", len(done_names), len(steps))
    total = sum(weight for _, weight, _ in steps)
    done = sum(weight for name, weight, _ in steps if name in done_names)
    if progress is not None:
        progress(min(done / total, 1.0))
    for name, weight, build in steps:
        if sections[name] is not None:
            continue
        sections[name] = section = run_study(name, build)
        journal.store(name, section_as_json(section))
        done += weight
        if progress is not None:
            progress(min(done / total, 1.0))
    return tuple(section for section in sections.values() if section is not None)


def run_study(name: str, build: Callable[[], Result]) -> Result:
    """Return the result of `build`; the place of an error starts with the study's name."""
    try:
        return build()
    except TensegrityError as error:
        error.where = f"study {name}" + (f": {error.where}" if error.where else "")
        raise
