"""Simulated loops in C, one draw a call: controller and calls of the plant, which is another library."""

import math
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from tensegrity_codegen.codegen.print.render import BANNER, render, wrap_lines
from tensegrity_codegen.control.embedded.calls import find_measured, write_measure
from tensegrity_codegen.control.embedded.parts import CONTROL_STATUS, ControllerParts
from tensegrity_codegen.control.embedded.tables import build_tables
from tensegrity_codegen.control.embedded.write import ControllerFiles, read_declarations
from tensegrity_codegen.control.feedback.design.linear_samples import split_delays
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, build_run
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    ATOL,
    ENDINGS,
    MAX_STEPS,
    NODE_LOAD,
    RTOL,
    LoopStart,
)
from tensegrity_codegen.runtime.integrate.event_log import choose_watch
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.status import raise_for_status
from tensegrity_codegen.runtime.trajectory.control_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import STATUS, FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision

DOUBLE = find_precision("double")
OF_STATE = {"coordinate": "state", "velocity": "state + N_Q"}
TABLES = ("ACTUATOR_PLACE",)
ESTIMATE_LOST = "the estimate is not finite"


@dataclass(frozen=True)
class LoopSource:
    """A simulated loop in C.

    sources: files of the library.
    declarations: its types and functions, for cffi.
    symbols: field of ``plant_functions`` -> function of the plant's library.
    arguments: fields of ``plant_arguments``.
    """

    sources: Mapping[str, str]
    declarations: str
    symbols: Mapping[str, str]
    arguments: tuple[str, ...]
    function: str


def write_closed_loop(
    parts: ControllerParts, files: ControllerFiles, plant: Manifest, watch: int
) -> LoopSource:
    """Return the C text of a loop.

    parts, files: the controller, in double precision.
    plant: of the model that is simulated, with the integrator CONTROL_METHOD.
    watch: kinds of events at which its steps end.
    """
    # Functions and arguments of the plant that the loop calls.
    spec = find_integrator(plant, CONTROL_METHOD)
    measured = find_measured(parts.sensors, plant)
    sources = {item.source for item in measured} | {"member_tension"}
    called = {item.quantity: item for item in plant.functions if item.quantity in sources}
    symbols = {name: item.symbol for name, item in called.items()}
    symbols["integrate"] = f"{spec.symbol}_run"
    sizes = {item.name: item.shape for item in plant.arguments if item.name not in OF_STATE}
    # Types, code and declarations.
    context = {
        "name": parts.name,
        "NAME": parts.name.upper(),
        "real": "double",
        "suffix": "",
        "settings": {
            "WITH_ESTIMATOR": parts.estimator is not None,
            "WITH_DISTRIBUTION": parts.distribution is not None,
            "WITH_LOADS": NODE_LOAD in sizes,
        },
        "functions": [_write_field(plant.declarations, *item) for item in symbols.items()],
        "arguments": tuple(sizes),
    }
    types = render("control/closed_loop_types.h", context)
    return LoopSource(
        sources={
            **files.sources(),
            "closed_loop.c": wrap_lines(
                render(
                    "control/closed_loop.c", context | _write_code(parts, plant, spec, called, watch, types)
                )
            ),
        },
        declarations="\n".join(
            (
                plant.declarations,
                files.description.declarations,
                read_declarations(types),
                f"void {parts.name}_simulate(const plant_functions *f, closed_loop *d);",
            )
        ),
        symbols=symbols,
        arguments=tuple(sizes),
        function=f"{parts.name}_simulate",
    )


def _write_code(
    parts: ControllerParts,
    plant: Manifest,
    spec: IntegratorSpec,
    called: Mapping[str, FunctionSpec],
    watch: int,
    types: str,
) -> dict[str, Any]:
    """Return what the template of the code needs besides names."""
    load = next((item for item in plant.arguments if item.name == NODE_LOAD), None)
    # A function is a field of plant_functions here, and its arguments are fields of plant_arguments.
    fields = {
        name: replace(
            item,
            symbol=f"f->{name}",
            arguments=tuple(arg if arg in OF_STATE else f"with->{arg}" for arg in item.arguments),
        )
        for name, item in called.items()
    }
    tension = fields["member_tension"]
    given = ", ".join(f"with->{name}" for name in spec.arguments)
    return {
        "banner": BANNER,
        "declarations": f"{plant.declarations}\n\n{types}",
        "n_members": len(plant.member_name),
        "n_internal": plant.n_internal,
        "load_size": 0 if load is None else math.prod(load.shape),
        "plant_ok": STATUS.index("ok"),
        "plant_step_too_small": STATUS.index("step_too_small"),
        "tables": [table for table in build_tables(parts, DOUBLE) if table.name in TABLES],
        "run_type": f"{plant.name}_run",
        "watch": watch,
        "integrate": f"f->integrate(span, {RTOL!r}, {ATOL!r}, {MAX_STEPS}, time, &step, state, {given}, "
        "2, sample_time, samples, &n_sampled, &run, work)",
        "tension": f"{tension.symbol}({', '.join((*tension.arguments, 'tension'))})",
        "measure": write_measure(fields, find_measured(parts.sensors, plant), DOUBLE),
    }


def _write_field(declarations: str, field: str, symbol: str) -> str:
    """Return the declaration of a function of the plant as a pointer of this name."""
    found = re.search(rf"int {re.escape(symbol)}\(([^;]*)\);", declarations)
    assert found is not None, symbol  # declarations have all functions of the manifest
    return f"int (*{field})({found[1].strip()})"


class CompiledLoop:
    """A controller and the functions of a plant in one loop.

    model: the plant, in double precision.
    compiler: as of `build_controller`.
    Raises CompilerMissingError, CompileError, LibraryError: no C compiler was found, it failed, or the
        library does not load.
    """

    def __init__(
        self, model: CompiledModel, parts: ControllerParts, files: ControllerFiles, compiler: str | None
    ) -> None:
        self.model, self.parts = model, parts
        self._spec = find_integrator(model.manifest, CONTROL_METHOD)
        watch = choose_watch(self._spec, model.manifest, None).bits if self._spec.events else 0
        source = write_closed_loop(parts, files, model.manifest, watch)
        artifact = _compile_loop(tuple(sorted(source.sources.items())), compiler)
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
        # Functions of the plant as C pointers.
        own, ffi = self.model.library, self._ffi
        functions = ffi.new("plant_functions *")
        for field, symbol in source.symbols.items():
            address = int(own.ffi.cast("uintptr_t", own.symbol(symbol)))
            setattr(functions, field, ffi.cast(ffi.typeof(getattr(functions, field)), address))
        self._functions = functions

    def run(self, draw: LoopStart, count: int, simulated: ActuatorBounds | None = None) -> ControlRun:
        """Return the run of a draw over so many samples; several threads may call it at the same time.

        simulated: delays and rates of the simulated actuators; by default those that the controller knows.
        """
        found, kept, loop = self._prepare(draw, count, simulated or self.parts.bounds)
        getattr(self._library, self._source.function)(self._functions, loop)
        del kept  # memory that the loop points to
        word = ESTIMATE_LOST if loop.is_lost else STATUS[loop.plant_status]
        if word not in ("ok", ESTIMATE_LOST, *ENDINGS):
            raise_for_status(
                loop.plant_status, f"integrate_{CONTROL_METHOD}", {"state": draw.state, **draw.given}
            )
        done, words = int(loop.n_done), tuple(CONTROL_STATUS)
        known = np.hstack([found["estimate"][:done], found["disturbance"][:done]])
        return build_run(
            self.model,
            self.parts.motion,
            self.parts.sample,
            state=found["state"][: done + 1],
            command=found["command"][len(found["command"]) - count :][:done],
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

    def _draw_noise(self, seed: int, count: int) -> FloatArray:
        """Return the noise of the measurements (n_samples, n_y), in the order of `simulate_control`."""
        if self.parts.estimator is None:
            return np.zeros((0, 0))
        size = self.parts.estimator.sensing.noise
        noise: FloatArray = size * np.random.default_rng(seed).normal(size=(count, len(size)))
        return noise

    def _prepare(
        self, draw: LoopStart, count: int, simulated: ActuatorBounds
    ) -> tuple[dict[str, NDArray[Any]], list[Any], Any]:
        """Return the arrays that are filled, what must stay alive, and the struct of a draw."""
        manifest, ffi, sample = self.model.manifest, self._ffi, self.parts.sample
        n, known = len(manifest.coordinate_name), self.parts.bounds
        # Actuators as fast as the controller believes, or faster, reach each command when it arrives.
        back, rest, _ = split_delays(simulated.delay, sample)
        arrivals, arrival = np.unique([0.0, *rest], return_inverse=True)
        is_slow, before = simulated.rate < known.rate, int(back.max(initial=0))
        first = self.parts.motion.at(0.0).input[known.place]
        # What the loop fills.
        found: dict[str, NDArray[Any]] = {
            "state": np.zeros((count + 1, 2 * n + manifest.n_internal)),
            "tension": np.zeros((count + 1, len(manifest.member_name))),
            "command": np.tile(first, (before + count, 1)),
            "input": np.zeros((count, len(manifest.input_name))),
            "estimate": np.zeros((count, 2 * n)),
            "disturbance": np.zeros((count, n)),
            "status": np.zeros(count, dtype=np.intc),
        }
        if self.parts.distribution is not None:
            found["yields"] = np.zeros((count, len(self.parts.distribution.cables.driven)), dtype=np.intc)
        # What it reads, and its memory for work.
        time, load = _tabulate_loads(self.model, draw)
        largest = max((int(np.prod(item.shape)) for item in manifest.functions), default=1)
        memory = {
            "start": np.concatenate([draw.state, draw.given.get("internal", np.zeros(0))]),
            "noise": self._draw_noise(draw.seed, count),
            "arrival_time": arrivals,
            "arrival": arrival[1:].astype(np.intc),
            "delay_samples": back.astype(np.intc),
            "most_change": np.where(is_slow, simulated.rate * sample, np.inf),
            "applied": first.copy(),
            "change_time": time,
            "load": load,
            "work": np.zeros(self._spec.work_size),
            "values": np.zeros(largest),
        }
        # The struct that points to both.
        loop = ffi.new("closed_loop *")
        kept: list[Any] = [memory]
        for name, array in {**found, **memory}.items():
            kind = "int[]" if array.dtype == np.intc else "double[]"
            setattr(loop, name, ffi.from_buffer(kind, array))
        for name in self._source.arguments:
            array = _read_argument(self.model, draw, name)
            setattr(getattr(loop, "with"), name, ffi.from_buffer("double[]", array))
            kept.append(array)
        loop.count, loop.n_changes, loop.n_arrivals, loop.n_before = count, len(time), len(arrivals), before
        controller = ffi.new(f"{self.parts.name}_control *")
        loop.controller = controller
        kept.append(controller)
        return found, kept, loop


@lru_cache(maxsize=4)
def _compile_loop(sources: tuple[tuple[str, str], ...], compiler: str | None) -> CompiledArtifact:
    """Return the library of these files; the last ones are kept, so that draws can be added to a study."""
    return compile_library(
        dict(sources), name="closed_loop", compiler=find_compiler(compiler), flags=find_flags("reference")
    )


def _read_argument(model: CompiledModel, draw: LoopStart, name: str) -> FloatArray:
    """Return an argument of the plant, of its own memory."""
    nominal = model.nominal(name)
    return np.array(to_sized(draw.given.get(name, nominal), nominal.shape, name), dtype=np.float64)


def _tabulate_loads(model: CompiledModel, draw: LoopStart) -> tuple[FloatArray, FloatArray]:
    """Return the times at which loads change, and the loads before, between and after them."""
    if draw.gusts is None:
        has_loads = any(item.name == NODE_LOAD for item in model.manifest.arguments)
        return np.zeros(0), _read_argument(model, draw, NODE_LOAD) if has_loads else np.zeros(0)
    times = draw.gusts.changes_between(-np.inf, np.inf)
    between = [0.5 * (first + last) for first, last in pairwise(times)]
    middles = [times[0] - 1.0, *between, times[-1] + 1.0] if times else [0.0]
    return np.array(times, dtype=float), np.array([draw.gusts.at(middle) for middle in middles])
