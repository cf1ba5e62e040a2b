"""A compiled loop in this process: controller and plant in C, one draw a call."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.compilation.compile import CompiledArtifact, compile_library
from tensegrity_codegen.codegen.compilation.flags import find_flags
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.control.embedded.closed_loop_source import LoopSource, write_closed_loop
from tensegrity_codegen.control.embedded.parts import ControllerParts
from tensegrity_codegen.control.embedded.status import CONTROL_STATUS
from tensegrity_codegen.control.embedded.write import ControllerFiles
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, build_run
from tensegrity_codegen.control.feedback.loop.sampled_plant import ENDINGS, NODE_LOAD, GustLoad
from tensegrity_codegen.runtime.integrate.event_log import choose_watch
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.status import raise_for_status
from tensegrity_codegen.runtime.trajectory.control_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import STATUS

LOST = "the estimate is not finite"


@dataclass(frozen=True, eq=False)
class LoopDraw:
    """One draw: start (n_states,), arguments of the plant, loads that change, noise (n_samples, n_y)."""

    start: FloatArray
    given: Mapping[str, Any]
    gusts: GustLoad | None
    noise: FloatArray


class CompiledLoop:
    """A controller and the functions of a plant in one loop.

    Parameters
    ----------
    model : CompiledModel
        The plant, in double precision.
    parts, files : ControllerParts, ControllerFiles
        The controller and its files.
    compiler : str, optional
        As of `build_controller`.

    Raises
    ------
    CompilerMissingError, CompileError, LibraryError
        No C compiler was found, it failed, or the library does not load.
    """

    def __init__(
        self, model: CompiledModel, parts: ControllerParts, files: ControllerFiles, compiler: str | None
    ) -> None:
        self.model, self.parts = model, parts
        self._spec = find_integrator(model.manifest, CONTROL_METHOD)
        watch = choose_watch(self._spec, model.manifest, None).bits if self._spec.events else 0
        source = write_closed_loop(parts, files, model.manifest, watch)
        artifact = _compile(tuple(sorted(source.sources.items())), compiler)
        self._ffi = cffi.FFI()
        self._ffi.cdef(source.declarations)
        self._source = source
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / artifact.file_name
            path.write_bytes(artifact.library)
            try:
                self._library = self._ffi.dlopen(str(path))
            except OSError as error:
                raise LibraryError(
                    "the simulated loop does not load", where=str(path), given=str(error)
                ) from error
        self._functions = self._bind(source)

    def run(self, draw: LoopDraw, count: int) -> ControlRun:
        """Return the run of a draw over so many samples; several threads may call it at the same time."""
        found, kept, loop = self._prepare(draw, count)
        getattr(self._library, self._source.function)(self._functions, loop)
        del kept  # memory that the loop points to
        word = LOST if loop.is_lost else STATUS[loop.plant_status]
        if word not in ("ok", LOST, *ENDINGS):
            raise_for_status(
                loop.plant_status, f"integrate_{CONTROL_METHOD}", {"state": draw.start, **draw.given}
            )
        done, words = int(loop.n_done), tuple(CONTROL_STATUS)
        known = np.hstack([found["estimate"][:done], found["disturbance"][:done]])
        return build_run(
            self.model.manifest,
            self.parts.motion,
            self.parts.sample,
            state=found["state"][: done + 1],
            command=found["command"][:done],
            input=found["input"][:done],
            tension=found["tension"][: done + 1],
            known=None if self.parts.estimator is None else known,
            statuses=[words[k] for k in found["status"][:done].tolist()],
            word=word,
            yielding=self._read_yielding(found, done),
        )

    def _read_yielding(self, found: dict[str, NDArray[Any]], done: int) -> NDArray[np.bool_] | None:
        """Return the members whose least tension yields, (n_samples, n_members)."""
        if self.parts.distribution is None:
            return None
        yielding = np.zeros((done, len(self.model.manifest.member_name)), dtype=bool)
        yielding[:, self.parts.distribution.cables.driven] = found["yields"][:done] != 0
        return yielding

    def _bind(self, source: LoopSource) -> Any:
        """Return the functions of the plant as C pointers."""
        own, ffi = self.model.library, self._ffi
        functions = ffi.new("plant_functions *")
        for field, symbol in source.symbols.items():
            address = int(own.ffi.cast("uintptr_t", own.symbol(symbol)))
            setattr(functions, field, ffi.cast(ffi.typeof(getattr(functions, field)), address))
        return functions

    def _prepare(self, draw: LoopDraw, count: int) -> tuple[dict[str, NDArray[Any]], list[Any], Any]:
        """Return the arrays that are filled, what must stay alive, and the struct of a draw."""
        manifest, ffi = self.model.manifest, self._ffi
        n, m = len(manifest.coordinate_name), len(self.parts.bounds.names)
        found: dict[str, NDArray[Any]] = {
            "state": np.zeros((count + 1, 2 * n)),
            "tension": np.zeros((count + 1, len(manifest.member_name))),
            "command": np.zeros((count, m)),
            "input": np.zeros((count, len(manifest.input_name))),
            "estimate": np.zeros((count, 2 * n)),
            "disturbance": np.zeros((count, n)),
            "status": np.zeros(count, dtype=np.intc),
        }
        if self.parts.distribution is not None:
            found["yields"] = np.zeros((count, len(self.parts.distribution.cables.driven)), dtype=np.intc)
        time, load = _tabulate_loads(self.model, draw)
        largest = max((int(np.prod(item.shape)) for item in manifest.functions), default=1)
        memory = {
            "start": np.ascontiguousarray(draw.start),
            "noise": np.ascontiguousarray(draw.noise),
            "change_time": time,
            "load": load,
            "work": np.zeros(self._spec.work_size),
            "values": np.zeros(largest),
        }
        loop = ffi.new("closed_loop *")
        kept: list[Any] = [memory]
        for name, array in {**found, **memory}.items():
            kind = "int[]" if array.dtype == np.intc else "double[]"
            setattr(loop, name, ffi.from_buffer(kind, array))
        for name in self._source.arguments:
            array = _read_argument(self.model, draw, name)
            setattr(getattr(loop, "with"), name, ffi.from_buffer("double[]", array))
            kept.append(array)
        loop.count, loop.n_changes = count, len(time)
        controller = ffi.new(f"{self.parts.name}_control *")
        loop.controller = controller
        kept.append(controller)
        return found, kept, loop


@lru_cache(maxsize=4)
def _compile(sources: tuple[tuple[str, str], ...], compiler: str | None) -> CompiledArtifact:
    """Return the library of these files; the last ones are kept, so that draws can be added to a study."""
    return compile_library(
        dict(sources), name="closed_loop", compiler=find_compiler(compiler), flags=find_flags("reference")
    )


def _read_argument(model: CompiledModel, draw: LoopDraw, name: str) -> FloatArray:
    """Return an argument of the plant, of its own memory."""
    nominal = model.nominal(name)
    return np.array(to_sized(draw.given.get(name, nominal), nominal.shape, name), dtype=np.float64)


def _tabulate_loads(model: CompiledModel, draw: LoopDraw) -> tuple[FloatArray, FloatArray]:
    """Return the times at which loads change, and the loads before, between and after them."""
    if draw.gusts is None:
        has_loads = any(item.name == NODE_LOAD for item in model.manifest.arguments)
        return np.zeros(0), _read_argument(model, draw, NODE_LOAD) if has_loads else np.zeros(0)
    times = draw.gusts.changes_between(-np.inf, np.inf)
    between = [0.5 * (first + last) for first, last in pairwise(times)]
    middles = [times[0] - 1.0, *between, times[-1] + 1.0] if times else [0.0]
    return np.array(times, dtype=float), np.array([draw.gusts.at(middle) for middle in middles])
