"""Build the library for a request, or find it in the cache."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.codegen.compilation.cache import Cache, CacheEntry, read_contents
from tensegrity_codegen.codegen.compilation.compile import object_size
from tensegrity_codegen.codegen.compilation.fingerprint import (
    hash_package_state,
    hash_request,
    hash_structure,
    hash_text,
)
from tensegrity_codegen.codegen.compilation.flags import (
    Compiler,
    FlagSet,
    check_target_flags,
    compile_quickly,
    describe_toolchain,
    find_flags,
)
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler, find_cross_compiler
from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.pipeline.compile_source import compile_source, is_library_source, read_manifest
from tensegrity_codegen.pipeline.rigid_twin import request_rigid_twin
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import COMPILING, GENERATING, work_pass
from tensegrity_codegen.system.summaries import Summarised
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.request import ModelRequest
from tensegrity_codegen.tables.targets import Target, find_host, find_target

if TYPE_CHECKING:
    from tensegrity_codegen.codegen.emit import GeneratedSource

# Of each function, in an analysis and in motions: see `calls` of build_library.
FEW_CALLS, MANY_CALLS = 300, 100_000
MOST_QUICK_MEMBERS = 10_000  # up to which compiling takes longer than so few calls


@dataclass(frozen=True, repr=False)
class BuiltLibrary(Summarised):
    """A compiled library in the cache.

    Attributes
    ----------
    entry : CacheEntry
        Files of the library in the cache.
    manifest : Manifest
        Names, shapes, units and nominal values.
    compiler, flags : str
        Version of the compiler, and its options.
    from_cache : bool
        Whether the library was in the cache before.
    seconds : float
        Time to find or build it [s].
    why_emitter : str
        Reason for the emitter that the manifest names.
    structure : Structure, BodySystem or None
        What the library was made from, for the models that are loaded.
    build_again : callable or None
        Removes the entry from the cache and builds it again; None for a library that was just built.
    build_twin : callable or None
        Makes `rigid_twin` of the models that are loaded; None in a library that was not built for motions.
    """

    entry: CacheEntry
    manifest: Manifest
    compiler: str
    flags: str
    from_cache: bool
    seconds: float
    why_emitter: str = ""
    structure: Subject | None = field(default=None, repr=False, compare=False)
    build_again: "Callable[[], BuiltLibrary] | None" = field(default=None, repr=False, compare=False)
    build_twin: Callable[[], CompiledModel | None] | None = field(default=None, repr=False, compare=False)

    @property
    def path(self) -> Path:
        """Path of the shared library."""
        if self.entry.library is None:
            problem = "the cache entry has no library"
            raise LibraryError(problem, where=str(self.entry.folder), hint="build again")
        return self.entry.library

    def load(self, *, precision: str | None = None) -> CompiledModel:
        """Load the library into this process.

        LibraryError if it is not of the `precision` asked for, or was built for another machine.

        A library from the cache that does not load, as after a change of the system, is built again once.
        """
        try:
            model = CompiledModel(self.path, self.manifest, precision=precision, structure=self.structure)
            model.build_twin = self.build_twin
            return model
        except LibraryError:
            foreign = self.manifest.target not in ("", find_host())
            if self.build_again is None or foreign or precision not in (None, self.manifest.precision):
                raise
        return self.build_again().load(precision=precision)

    def export(
        self, folder: str | Path, *, overwrite: bool = False, inputs: Iterable[Path] = (), wheel: bool = False
    ) -> Path:
        """Copy sources, example, build files, manifest and library into a folder: all of them, or none.

        SHA256SUMS lists what was written. Without `overwrite`, files in the folder that are not as its
        SHA256SUMS says are an OutputError, as everything that cannot be written; files of `inputs` are never
        replaced. wheel: whether to add a Python package of the library, which needs NumPy
        alone; FormulationError where Python cannot load it, InvalidNameError for a scene named "codegen".
        """
        from tensegrity_codegen.codegen.bundle import emit_bundle
        from tensegrity_codegen.codegen.wheels.wheel import build_wheel

        contents = dict(sorted(read_contents(self.entry).items()))
        contents.pop("compile.log", None)
        sources = [name for name in contents if name.endswith(".c") and name != "example.c"]
        bundle = emit_bundle(self.manifest, sources, self.path.name)
        contents |= {name: content.encode("utf-8") for name, content in bundle.items()}
        if wheel:
            contents |= dict([build_wheel(self.manifest, self.path)])
        return write_folder(folder, contents, overwrite=overwrite, inputs=inputs, listed=True)


def build_library(
    structure: Subject,
    request: ModelRequest,
    *,
    compiler: str | None = None,
    flags: str | None = None,
    target: str | None = None,
    cache: Cache | None = None,
    measure: bool = False,
    calls: int | None = None,
) -> BuiltLibrary:
    """Build the library for a request, or find it in the cache.

    Parameters
    ----------
    structure : Structure or BodySystem
        The structure.
    request : ModelRequest
        Quantities, integrators, parameters and options.
    compiler : str, optional
        ``"gcc"``, ``"clang"``, ``"zig"`` or a command; by default the first compiler found.
    flags : str, optional
        ``"reference"`` (bit-equal to CasADi's virtual machine) or ``"native"``; by default those of the
        request.
    target : str, optional
        Machine to compile for, by zig: ``"aarch64-linux"``, ``"x86_64-linux"``, ``"x86_64-windows"``,
        ``"aarch64-macos"``, ``"x86_64-macos"``, ``"wasm32"`` or ``"thumbv7em"``; by default this one. A
        library for another machine can be exported, not loaded.
    cache : Cache, optional
        Cache of compiled libraries; by default that of the user.
    measure : bool
        Whether to compile the omitted functions too, to measure how many bytes were saved.
    calls : int, optional
        About how often each function will be called, of a library that is used here and not kept: its
        manifest does not list what was omitted, and for few calls it is made of loops, with -O1, where
        the request leaves the emitter open. Its results are the same, bit by bit, with reference flags.

    Returns
    -------
    BuiltLibrary
        The library in the cache; ``load()`` gives the CompiledModel, ``export(folder)`` copies the files.

    Raises
    ------
    FormulationError
        The formulation or emitter does not support the request.
    UnknownNameError
        An unknown target.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.
    OutputError
        The cache cannot be written.

    Examples
    --------
    >>> from tensegrity_codegen import build_library, load_scene
    >>> built = build_library(*load_scene("two_nodes.toml"))
    >>> built.manifest.name, built.load().has("member_tension")
    ('two_nodes', True)
    """
    started = time.perf_counter()
    check_instance(structure, (Structure, BodySystem), "structure", "what load_scene(...)[0] returns")
    check_instance(request, ModelRequest, "request", "ModelRequest(...), or what load_scene(...)[1] returns")
    cache = Cache() if cache is None else cache
    check_instance(cache, Cache, "cache", "Cache(...), or None")
    if flags is not None:
        request = replace(request, flags=find_flags(flags, "flags").name)
    machine, flag_set = find_target(target), find_flags(request.flags)
    check_target_flags(flag_set, machine, "flags" if flags is not None else "model.flags")
    tool = find_cross_compiler(machine, compiler) if machine.name else find_compiler(compiler)
    kind = "measured" if measure else "estimated" if calls is None else "many"
    if calls is not None and calls <= FEW_CALLS and structure.n_members <= MOST_QUICK_MEMBERS:
        kind, flag_set = "few", compile_quickly(flag_set)
    # A request that led to a library before leads to it again, without its source being generated.
    toolchain = describe_toolchain(tool, flag_set, machine)
    identity = _Identity.of(structure, request)
    request_key = _request_key(identity, toolchain, kind)
    entry, manifest = _find(cache, request_key, identity)
    is_cached = entry is not None

    def build_again() -> BuiltLibrary:
        assert entry is not None
        cache.drop(entry.key)
        return build_library(
            structure, request, compiler=compiler, target=target, cache=cache, measure=measure, calls=calls
        )

    if entry is None or manifest is None:
        with work_pass(GENERATING):
            source = _emit(structure, request, tool, flag_set, machine, kind)
        with work_pass(COMPILING):
            entry, manifest = compile_source(
                source.files,
                source.manifest,
                compiler=tool,
                flags=flag_set,
                target=machine,
                cache=cache,
                scene=identity.scene,
                matches=identity.matches,
            )
        cache.store_request(request_key, entry.key, {"why_emitter": source.why_emitter})
    return BuiltLibrary(
        entry=entry,
        manifest=manifest,
        compiler=f"zig {tool.version}" if tool.name == "zig" else tool.version,
        flags=" ".join(flag_set.options),
        from_cache=is_cached,
        seconds=time.perf_counter() - started,
        why_emitter=str(cache.lookup_note(request_key).get("why_emitter", "")),
        structure=structure,
        build_again=build_again if is_cached else None,
        build_twin=partial(_build_twin, structure, request, compiler, cache) if kind == "many" else None,
    )


def check_buildable(structure: Subject, request: ModelRequest) -> None:
    """Raise the error that build_library would raise, before any C code is written or compiled."""
    from tensegrity_codegen.codegen.emit import check_request

    check_request(structure, request)


def _build_twin(
    structure: Subject, request: ModelRequest, compiler: str | None, cache: Cache
) -> CompiledModel | None:
    """Return the model with corrected rigid bars beside that of a request, None where there is none."""
    wanted = request_rigid_twin(structure, request)
    if wanted is None:
        return None
    return build_library(structure, wanted, compiler=compiler, cache=cache, calls=MANY_CALLS).load()


@dataclass(frozen=True)
class _Identity:
    """What a library in the cache must have been made from.

    structure, request: their hashes; scene: hash of both without what the generator settles itself
    (emitter, quantities, events), kept beside the library.
    """

    structure: str
    request: str
    scene: str
    wanted: frozenset[str]  # quantities that the library must have

    @classmethod
    def of(cls, structure: Subject, request: ModelRequest) -> "_Identity":
        shape = hash_structure(structure)
        settled = replace(request, emitter="", quantities=(), events=())
        scene = hash_text(shape, hash_request(settled))
        return cls(shape, hash_request(request), scene, frozenset(request.quantities))

    def matches(self, entry: CacheEntry, manifest: Manifest) -> bool:
        """Return whether the library is of this structure and has what is wanted of it."""
        return entry.scene == self.scene and self.wanted <= {spec.quantity for spec in manifest.functions}


def _request_key(identity: _Identity, toolchain: str, kind: str) -> str:
    package = hash_package_state(Path(__file__).resolve().parents[1], template_folder())
    return hash_text(identity.structure, identity.request, package, version("casadi"), toolchain, kind)


def _find(cache: Cache, request_key: str, identity: _Identity) -> tuple[CacheEntry | None, Manifest | None]:
    """Return the library that a request led to, if it is in the cache, and its manifest."""
    library_key = cache.lookup_request(request_key)
    entry = cache.find(library_key) if library_key else None
    manifest = read_manifest(entry, identity.matches) if entry is not None else None
    return (entry, manifest) if manifest is not None else (None, None)


def _emit(
    structure: Subject, request: ModelRequest, compiler: Compiler, flags: FlagSet, target: Target, kind: str
) -> "GeneratedSource":
    # Imported here, so that a library from the cache costs no import of CasADi.
    from tensegrity_codegen.codegen.emit import emit

    def size(files: Mapping[str, str]) -> int:
        sources = {name: content for name, content in files.items() if is_library_source(name)}
        return object_size(sources, compiler=compiler, flags=flags, target=target) or 0

    account = kind in ("measured", "estimated")
    return emit(
        structure, request, size if kind == "measured" else None, account=account, quick=kind == "few"
    )
