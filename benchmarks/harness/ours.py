"""Our own candidates: every emitter that the package has, found by name, with several compilers and flags."""

import re
import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from harness.problem import Problem
from harness.tools import Built, Candidate, Compilation, CompileFailed, Runner, Unavailable
from tensegrity_codegen.codegen.compilation.flags import Compiler, find_flags
from tensegrity_codegen.codegen.emit import EMITTERS, GeneratedSource, emit
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest

BATCH = 8
AUTO = "auto"


@dataclass(frozen=True)
class Build:
    """How generated C is compiled: the compiler and the name of a flag set."""

    compiler: Compiler
    flags: str

    @property
    def title(self) -> str:
        """Short name for rows."""
        return f"{self.compiler.name} {self.flags}"


def list_emitters() -> tuple[str, ...]:
    """Return the names of all emitters, without the rule that chooses one of them."""
    return tuple(name for name in EMITTERS if name != AUTO)


@dataclass
class Ours:
    """Makes candidates of the package's own emitters; each source is emitted once and kept."""

    compilation: Compilation
    runner: Runner
    _sources: dict[tuple[str, str], tuple[GeneratedSource, float]] = field(default_factory=dict)

    def forget(self) -> None:
        """Drop the sources, which are large for large structures."""
        self._sources.clear()

    def chosen(self, problem: Problem, quantity: str) -> str | None:
        """Return the emitter that `auto` takes for this function, None where there is no such rule."""
        try:
            return self._emit(problem, make_request(problem, quantity, AUTO, False))[0].manifest.emitter
        except Unavailable:
            return None

    def make(self, problem: Problem, quantity: str, emitter: str, build: Build, batch: int = 0) -> Candidate:
        """Return the candidate that evaluates one structure, or `batch` states in one call.

        Raises Unavailable where the emitter refuses, has no such function or its code does not compile.
        """
        request = replace(make_request(problem, quantity, emitter, bool(batch)), flags=build.flags)
        source, seconds = self._emit(problem, request)
        spec = source.manifest.functions[0]
        symbol = f"{spec.symbol}_batch" if batch else spec.symbol
        if not re.search(rf"\b{symbol}\(", source.files[f"{source.manifest.name}.h"]):
            raise Unavailable("this emitter writes no such function")
        built = self._compile(source, build)
        arguments = [_argument(problem, source, name, batch) for name in spec.arguments]
        size = len(spec.pattern.row) if spec.pattern else int(np.prod(spec.shape))
        result = np.zeros((batch, size) if batch else size)
        loop = self.runner.batch if batch else self.runner.plain
        title = f"{emitter}, batch of {batch}" if batch else emitter
        return Candidate(
            name=f"{title} ({build.title})",
            run=loop(built, symbol, arguments, result),
            value=(lambda: result[0].copy()) if batch else result.copy,
            side="ours",
            called="C",
            per_call=batch or 1,
            built=built,
            made=seconds + built.seconds,
        )

    def _emit(self, problem: Problem, request: ModelRequest) -> tuple[GeneratedSource, float]:
        key = (problem.name, repr(request))
        if key not in self._sources:
            started = time.perf_counter()
            try:
                source = emit(problem.structure, request)
            except TensegrityError as error:
                text = str(error).splitlines()[0].partition("model.emitter: ")
                raise Unavailable(f"refused: {text[2] or text[0]}") from None
            self._sources[key] = (source, time.perf_counter() - started)
        return self._sources[key]

    def _compile(self, source: GeneratedSource, build: Build) -> Built:
        files = {name: text for name, text in source.files.items() if _is_library_file(name)}
        flags = find_flags(build.flags)
        try:
            return self.compilation.build_own(files, source.manifest.name, build.compiler, flags)
        except CompileFailed as error:
            raise Unavailable(str(error)) from None


def make_request(problem: Problem, quantity: str, emitter: str, batch: bool) -> ModelRequest:
    """Return the request for one quantity by that emitter, with functions over a batch or without."""
    request = replace(problem.request(quantity), emitter=emitter)
    return replace(request, batch_width=BATCH) if batch else request


def _is_library_file(name: str) -> bool:
    return name.endswith((".c", ".h")) and name != "example.c"


def _argument(problem: Problem, source: GeneratedSource, name: str, batch: int) -> NDArray[np.float64]:
    """Return the coordinates of the problem, or another argument's own value, once for each of a batch."""
    if name == "coordinate":
        return problem.coordinates(batch) if batch else problem.coordinate
    value = np.array(source.manifest.argument(name).nominal)
    return np.tile(value, (batch, 1)) if batch else value
