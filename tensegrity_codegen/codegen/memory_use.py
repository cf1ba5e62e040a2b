"""Program memory and stack of a generated library, as its compiler reports them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tensegrity_codegen.codegen.compilation.call_depth import deepest_stack
from tensegrity_codegen.codegen.compilation.compile import object_size, stack_use
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import find_target


@dataclass(frozen=True)
class MemoryUse:
    """Program memory and stack of a library.

    code_bytes: machine code and constants, before a linker drops what is not used; None: unknown format.
    stack_bytes: public function -> bytes of stack that it takes at most, along its longest chain of calls;
    functions of the C library count nothing; empty where the compiler does not say.
    """

    code_bytes: int | None
    stack_bytes: Mapping[str, int]


def measure_memory(
    folder: Path, manifest: Manifest, *, compiler: str | None = None, target: str | None = None
) -> MemoryUse:
    """Compile the sources in a folder again, and return what they take.

    Raises CompilerMissingError or CompileError as a build does.
    """
    sources = {
        path.name: path.read_text(encoding="utf-8")
        for path in sorted(folder.iterdir())
        if path.suffix in (".c", ".h") and path.name != "example.c"
    }
    flags, machine = find_flags(manifest.flags), find_target(target)
    tool = find_compiler("zig" if machine.name else compiler)
    code = object_size(sources, compiler=tool, flags=flags, target=machine)
    frames = stack_use(sources, compiler=tool, flags=flags, target=machine)
    prefix = f"{manifest.name}_"
    deepest = deepest_stack(frames, sources.values())
    return MemoryUse(code, {name: size for name, size in deepest.items() if name.startswith(prefix)})
