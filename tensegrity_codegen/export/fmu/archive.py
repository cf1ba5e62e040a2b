"""The archive of a unit: description, sources and the binary for this machine, the same bytes every time."""

from __future__ import annotations

import platform
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.export.fmu.sources import UnitSources
from tensegrity_codegen.targets import find_system

__all__ = ["compile_unit", "write_archive"]

SYSTEMS = {"linux": "linux", "win32": "windows", "darwin": "darwin"}
MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
OLD_NAMES = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
DATE = (1980, 1, 1, 0, 0, 0)  # the first that an archive can have


def compile_unit(
    name: str, sources: UnitSources, fmi: str, *, compiler: str | None, flags: str
) -> dict[str, bytes]:
    """Return the binary of a unit for this machine: its place in the archive -> bytes.

    Raises CompilerMissingError, CompileError.
    """
    texts = {key: text for key, text in sources.files.items() if key.endswith((".c", ".h"))}
    artifact = compile_library(texts, name=name, compiler=find_compiler(compiler), flags=find_flags(flags))
    machine = platform.machine().lower()
    folder = f"{MACHINES.get(machine, machine)}-{SYSTEMS.get(sys.platform, sys.platform)}"
    if fmi == "2.0":
        folder = OLD_NAMES.get(folder, folder)
    return {f"binaries/{folder}/{name}{find_system().suffix}": artifact.library}


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an archive of files, by their places in it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files, key=lambda item: (item != "modelDescription.xml", item)):
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, files[name])
