"""Compile generated files into a library in the cache, or find it there."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.codegen.compilation.cache import MANIFEST_FILE, Cache, CacheEntry
from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.fingerprint import hash_text
from tensegrity_codegen.codegen.compilation.flags import (
    Compiler,
    FlagSet,
    describe_toolchain,
    find_instruction_sets,
)
from tensegrity_codegen.codegen.compilation.toolchain import check_foreign_library, check_library
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import Target

if TYPE_CHECKING:
    pass


def compile_source(
    sources: Mapping[str, str],
    manifest: Manifest,
    *,
    compiler: Compiler,
    flags: FlagSet,
    target: Target,
    cache: Cache,
    scene: str,
    matches: Callable[[CacheEntry, Manifest], bool],
) -> tuple[CacheEntry, Manifest]:
    """Compile generated files into a library in the cache, or find it there; with its complete manifest."""
    toolchain = describe_toolchain(compiler, flags, target)
    key = hash_text(*(content for source in sorted(sources.items()) for content in source), toolchain)
    with cache.lock(key):
        entry = cache.find(key)
        if entry is not None:
            known = read_manifest(entry, matches)
            if known is not None:
                return entry, known
            cache.drop(key)
        # Source, manifest, library and log are one entry, which appears when the library has been checked.
        artifact = compile_library(
            {name: text for name, text in sources.items() if is_library_source(name)},
            name=manifest.name,
            compiler=compiler,
            flags=flags,
            target=target,
        )
        texts, manifest = dict(sources), replace(manifest, target=target.name)
        if not flags.portable:
            manifest = replace(manifest, instruction_sets=find_instruction_sets(artifact.library))
        texts["manifest.json"] = manifest.to_json()
        files = {name: text.encode("utf-8") for name, text in texts.items()}
        files |= {artifact.file_name: artifact.library, "compile.log": artifact.log.encode("utf-8")}

        def check(folder: Path) -> None:
            library = folder / artifact.file_name
            if target.name:
                check_foreign_library(library, manifest, target, compiler, artifact.log)
            else:
                check_library(library, manifest, compiler, artifact.log)

        return cache.store(key, files, scene=scene, check=check), manifest


def read_manifest(entry: CacheEntry, matches: Callable[[CacheEntry, Manifest], bool]) -> Manifest | None:
    """Return the manifest of an entry, None if it cannot be read or is not of the requested library."""
    try:
        manifest = Manifest.read(entry.folder / MANIFEST_FILE)
    except LibraryError:
        return None
    return manifest if matches(entry, manifest) else None


def is_library_source(name: str) -> bool:
    """Return whether a generated file belongs to the library itself, unlike the example."""
    return name.endswith((".c", ".h")) and name != "example.c"
