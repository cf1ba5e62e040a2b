"""Generated source that travels to other machines, which compile it for their own processor."""

import platform
import sys
from dataclasses import dataclass, replace

from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.compilation.cache_entry import MANIFEST_FILE, CacheEntry, read_contents
from tensegrity_codegen.codegen.compilation.fingerprint import hash_text
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.pipeline.build_library import BuiltLibrary
from tensegrity_codegen.pipeline.compile_source import compile_source
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import CompilerMissingError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import find_target

LOG = "compile.log"


@dataclass(frozen=True)
class SourceParcel:
    """Generated source of one library.

    Attributes
    ----------
    hash : str
        Hash of the source and of how it is compiled.
    files : tuple of (str, str)
        Generated files: name and text.
    flags : str
        How they are compiled: ``"native"`` for the processor of the machine that compiles them.
    scene : str
        Hash of the scene.
    library : bytes
        The library as this machine compiled it, for machines of the same kind without a compiler; empty with
        native flags, since it may hold instructions that another processor lacks.
    library_name : str
        Name of its file.
    platform : str
        System and architecture of `library`.
    """

    hash: str
    files: tuple[tuple[str, str], ...]
    flags: str
    scene: str
    library: bytes
    library_name: str
    platform: str


def make_parcel(built: BuiltLibrary, flags: str) -> SourceParcel:
    """Return the source of a library; raises LibraryError where its files in the cache are damaged."""
    contents = read_contents(built.entry)
    contents.pop(LOG, None)
    library = contents.pop(built.path.name)
    texts = {name: content.decode("utf-8") for name, content in contents.items()}
    # As it was generated: the manifest in the cache names the instruction sets of this processor.
    texts[MANIFEST_FILE] = replace(built.manifest, instruction_sets=(), target="").to_json()
    files = tuple(sorted(texts.items()))
    digest = hash_text(flags, built.entry.scene, *(part for item in files for part in item))
    portable = find_flags(flags).portable
    return SourceParcel(
        digest,
        files,
        flags,
        built.entry.scene,
        library if portable else b"",
        built.path.name,
        _describe_platform(),
    )


def load_parcel(parcel: SourceParcel, structure: Subject, cache: Cache | None = None) -> CompiledModel:
    """Return the library of a parcel, compiled for this machine or found in its cache.

    Raises
    ------
    CompilerMissingError
        This machine has no compiler, and the library that came along is not for it.
    CompileError, LibraryError, OutputError
        The compiler failed, the library does not load, the cache cannot be written.
    """
    cache = cache or Cache()
    texts = dict(parcel.files)
    manifest = Manifest.from_json(texts[MANIFEST_FILE])

    def matches(entry: CacheEntry, found: Manifest) -> bool:
        return entry.scene == parcel.scene and found.scene_hash == manifest.scene_hash

    try:
        compiler = find_compiler(None)
    except CompilerMissingError:
        if not parcel.library or parcel.platform != _describe_platform():
            raise
        entry = _store_library(parcel, cache)
    else:
        entry, manifest = compile_source(
            texts,
            manifest,
            compiler=compiler,
            flags=find_flags(parcel.flags),
            target=find_target(None),
            cache=cache,
            scene=parcel.scene,
            matches=matches,
        )
    assert entry.library is not None
    return CompiledModel(entry.library, manifest, structure=structure)


def _store_library(parcel: SourceParcel, cache: Cache) -> CacheEntry:
    """Keep the library that came along in the cache, under a key of its own."""
    key = hash_text("parcel", parcel.hash, parcel.platform)
    with cache.lock(key):
        known = cache.find(key)
        if known is not None:
            return known
        files = {name: text.encode("utf-8") for name, text in parcel.files}
        return cache.store(key, {**files, parcel.library_name: parcel.library}, scene=parcel.scene)


def _describe_platform() -> str:
    libc = "-".join(platform.libc_ver())
    return f"{sys.platform} {platform.machine()} {libc}"
