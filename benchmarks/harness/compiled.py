"""Compiling with time and memory measured, and kept: a text is compiled once, its figures stay with it."""

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.machine import all_cores
from harness.sections import read_sections
from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.codegen.compilation.compile import compile_library
from tensegrity_codegen.codegen.compilation.flags import Compiler, FlagSet
from tensegrity_codegen.system.errors import CompileError

TIME_LIMIT = 180.0  # s
RECORD = 2  # version of what is kept beside a library


class CompileFailed(Exception):
    """The compiler failed or met its limit; the text says which."""


@dataclass(frozen=True)
class Built:
    """A compiled library: where it is, seconds and peak memory [byte] of the compiler, bytes in it."""

    path: str
    seconds: float
    peak_memory: int | None
    code_bytes: int | None
    table_bytes: int | None


@dataclass(frozen=True)
class Compilation:
    """A folder of libraries by the hash of their texts and commands; time_limit: of one compilation [s]."""

    folder: Path
    time_limit: float = TIME_LIMIT

    def build(self, sources: Mapping[str, str], command: Sequence[str], *, version: str) -> Built:
        """Return what `command` makes of `sources` (file name -> text), from the folder if it is there.

        command: calls a compiler and names the sources; "-o", the output's path are added, then -lm. version:
        of the compiler. Raises CompileFailed.
        """
        return self._keep((sources, command, version), lambda library: self._run(sources, command, library))

    def build_own(self, sources: Mapping[str, str], name: str, compiler: Compiler, flags: FlagSet) -> Built:
        """Return what the package makes of its own sources, as `build` does."""

        def make(library: Path) -> tuple[float, int | None]:
            try:
                made = compile_library(
                    sources, name=name, compiler=compiler, flags=flags, timeout=self.time_limit
                )
            except CompileError as error:
                raise CompileFailed(str(error).splitlines()[0]) from None
            library.write_bytes(made.library)
            return made.seconds, made.peak_memory

        command = (*compiler.command, *flags.options)
        return self._keep((sources, command, compiler.version), make)

    def _keep(
        self,
        parts: tuple[Mapping[str, str], Sequence[str], str],
        make: Callable[[Path], tuple[float, int | None]],
    ) -> Built:
        """Return the kept library of these sources, command and version, made first where there is none."""
        sources, command, version = parts
        text = json.dumps([RECORD, sorted(sources.items()), list(command), version])
        key = hashlib.sha256(text.encode("utf-8")).hexdigest()[:24]
        record, library = self.folder / f"{key}.json", self.folder / f"{key}.so"
        if record.exists():
            known = json.loads(record.read_text(encoding="utf-8"))
            if "failed" not in known:
                return Built(path=str(library), **known)
            if known["limit"] >= self.time_limit:
                raise CompileFailed(known["failed"])
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            with all_cores():
                seconds, peak = make(library)
        except CompileFailed as error:
            record.write_text(json.dumps({"failed": str(error), "limit": self.time_limit}), encoding="utf-8")
            raise
        code, tables = read_sections(library) or (None, None)
        facts = {"seconds": seconds, "peak_memory": peak, "code_bytes": code, "table_bytes": tables}
        record.write_text(json.dumps(facts), encoding="utf-8")
        return Built(path=str(library), **facts)

    def _run(
        self, sources: Mapping[str, str], command: Sequence[str], library: Path
    ) -> tuple[float, int | None]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            for file_name, text in sources.items():
                (folder / file_name).write_text(text, encoding="utf-8")
            whole = [*command, "-o", str(library.resolve()), "-lm"]
            outcome = run_limited(whole, folder=folder, environment=os.environ, timeout=self.time_limit)
        if outcome.ended == "time":
            raise CompileFailed(f"does not compile in {self.time_limit:.0f} s")
        if not outcome.ok:
            line = next((line for line in outcome.log.splitlines() if "error" in line), outcome.log[-200:])
            raise CompileFailed(f"the compiler failed: {line.strip()}")
        return outcome.seconds, outcome.peak_memory
