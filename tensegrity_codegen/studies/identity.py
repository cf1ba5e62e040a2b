"""What results of long work depend on besides scene and options: the code, the packages, the machine."""

import functools
import importlib.util
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tensegrity_codegen.codegen.compilation.fingerprint import hash_package, hash_scene, hash_text
from tensegrity_codegen.codegen.compilation.flags import describe_toolchain, find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.processor import name_processor
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.request import ModelRequest

PACKAGES = ("casadi", "matplotlib", "mujoco", "numpy", "scipy")


def hash_run(*words: str) -> str:
    """Return the sha256 of `words` with the source code, the packages in use and the machine."""
    return hash_text(*_surroundings(), *words)


def hash_study(structure: Structure, compiler: str | None, flags: str, *words: str) -> str:
    """Return the sha256 of a study of a structure by compiled models; words: its options.

    Raises CompilerMissingError, or UnknownNameError for unknown flags.
    """
    toolchain = describe_toolchain(find_compiler(compiler), find_flags(flags))
    return hash_run(hash_scene(structure, ModelRequest(())), toolchain, *words)


@functools.cache
def _surroundings() -> tuple[str, ...]:
    machine = (platform.system(), platform.machine(), platform.node(), name_processor())
    source = hash_package(Path(__file__).resolve().parent.parent, template_folder())
    return (VERSION, source, platform.python_version(), *machine, *map(_version, PACKAGES))


def _version(package: str) -> str:
    if importlib.util.find_spec(package) is None:
        return "not installed"
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
