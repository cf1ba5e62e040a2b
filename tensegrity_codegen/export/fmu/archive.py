"""The archive of a unit: description, sources and binaries, the same bytes every time."""

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler, find_cross_compiler
from tensegrity_codegen.export.fmu.sources import UnitSources
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.targets import SHARED, TARGETS, Target, find_host, find_system, find_target

OLD_NAMES = {"x86_64-linux": "linux64", "x86_64-windows": "win64", "x86_64-darwin": "darwin64"}
DATE = (1980, 1, 1, 0, 0, 0)  # the first that an archive can have


def check_targets(names: Sequence[str]) -> tuple[Target, ...]:
    """Return the machines of these names.

    Raises UnknownNameError, and InvalidValueError for a machine that has no shared libraries.
    """
    found = tuple(find_target(name, "targets") for name in names)
    for target in found:
        if target.kind != SHARED:
            raise InvalidValueError(
                f"an FMU holds shared libraries, and {target.name} has none",
                where="targets",
                given=target.name,
                allowed=", ".join(name for name, item in TARGETS.items() if item.kind == SHARED),
            )
    return found


def compile_unit(
    name: str,
    sources: UnitSources,
    fmi: str,
    *,
    compiler: str | None,
    flags: str,
    targets: Sequence[Target] = (),
) -> dict[str, bytes]:
    """Return the binaries of a unit for these machines, for this one if none is named: place -> bytes.

    Raises CompilerMissingError, CompileError.
    """
    texts = {key: text for key, text in sources.files.items() if key.endswith((".c", ".h"))}
    binaries = {}
    for target in targets or (find_system(),):
        tool = find_cross_compiler(target, compiler) if target.name else find_compiler(compiler)
        made = compile_library(texts, name=name, compiler=tool, flags=find_flags(flags), target=target)
        folder = (target.name or find_host()).replace("macos", "darwin")
        if fmi == "2.0":
            folder = OLD_NAMES.get(folder, folder)
        binaries[f"binaries/{folder}/{name}{target.suffix}"] = made.library
    return binaries


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an archive of files, by their places in it."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files, key=lambda item: (item != "modelDescription.xml", item)):
            info = zipfile.ZipInfo(name, DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, files[name])
