"""A compiled library in the cache: load it, or copy its files into a folder."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.codegen.compilation.cache_entry import CacheEntry, read_contents
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.targets import find_host

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class BuiltLibrary:
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

    @property
    def path(self) -> Path:
        """Path of the shared library."""
        if self.entry.library is None:
            raise LibraryError(
                "the cache entry has no library", where=str(self.entry.folder), hint="build again"
            )
        return self.entry.library

    def load(self, *, precision: str | None = None) -> CompiledModel:
        """Load the library into this process.

        LibraryError if it is not of the `precision` asked for, or was built for another machine.

        A library from the cache that does not load, as after a change of the system, is built again once.
        """
        try:
            return CompiledModel(self.path, self.manifest, precision=precision, structure=self.structure)
        except LibraryError:
            foreign = self.manifest.target not in ("", find_host())
            if self.build_again is None or foreign or precision not in (None, self.manifest.precision):
                raise
        return self.build_again().load(precision=precision)

    def export(
        self,
        folder: str | Path,
        *,
        overwrite: bool = False,
        inputs: Iterable[Path] = (),
        wheel: bool = False,
    ) -> Path:
        """Copy sources, example, build files, manifest and library into a folder: all of them, or none.

        SHA256SUMS lists what was written. Without `overwrite`, files in the folder that are not as its
        SHA256SUMS says are an OutputError, as everything that cannot be written; files of `inputs` are never
        replaced. wheel: whether to add a Python package of the library, which needs NumPy
        alone; FormulationError where Python cannot load it, InvalidNameError for a scene named "codegen".
        """
        from tensegrity_codegen.codegen.bundle.bundle import emit_bundle
        from tensegrity_codegen.codegen.wheels.wheel import build_wheel

        contents = dict(sorted(read_contents(self.entry).items()))
        contents.pop("compile.log", None)
        sources = [name for name in contents if name.endswith(".c") and name != "example.c"]
        bundle = emit_bundle(self.manifest, sources, self.path.name)
        contents |= {name: text.encode("utf-8") for name, text in bundle.items()}
        if wheel:
            contents |= dict([build_wheel(self.manifest, self.path)])
        return write_folder(folder, contents, overwrite=overwrite, inputs=inputs, listed=True)
