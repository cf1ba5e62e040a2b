"""Simulated loops in C, one draw a call: controller and calls of the plant, which is another library.

And many draws of errors of one motion and controller.
"""

import math
import os
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
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
from tensegrity_codegen.control.embedded.parts import (
    CONTROL_STATUS,
    MOVED_TO_CODE,
    SIMULATED_LOOP_NAME,
    ControllerCode,
    ControllerParts,
    collect_parts,
    find_model_and_request,
    read_code,
)
from tensegrity_codegen.control.embedded.tables import build_tables
from tensegrity_codegen.control.embedded.write import (
    ControllerFiles,
    find_measured,
    read_declarations,
    write_files,
    write_measure,
)
from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import find_reference, split_delays
from tensegrity_codegen.control.feedback.loop.actuator_bounds import (
    MOVED_TO_LIMITS,
    ActuatorBounds,
    ActuatorLimits,
)
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, build_run, compare_with_open_loop
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    ATOL,
    ENDINGS,
    MAX_STEPS,
    NODE_LOAD,
    RTOL,
    Disturbance,
    LoopStart,
    count_samples,
    describe_unknown_delays,
    read_disturbance,
)
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.runtime.integrate.event_log import choose_watch
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.interface import require_double, require_model, require_quantities
from tensegrity_codegen.runtime.model.library import raise_for_status
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTROL_METHOD
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import (
    check_instance,
    check_positive,
    check_switch,
    check_whole,
    with_moved,
)
from tensegrity_codegen.system.errors import LibraryError
from tensegrity_codegen.tables.manifest import STATUS, FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision

DOUBLE = find_precision("double")
OF_STATE = {"coordinate": "state", "velocity": "state + N_Q"}
TABLES = ("ACTUATOR_PLACE",)
ESTIMATE_LOST = "the estimate is not finite"


@dataclass(frozen=True)
class LoopSource:
    """A simulated loop in C."""

    sources: Mapping[str, str]  # files of the library
    declarations: str  # its types and functions, for cffi
    symbols: Mapping[str, str]  # field of ``plant_functions`` -> function of the plant's library
    arguments: tuple[str, ...]  # fields of ``plant_arguments``
    function: str


def write_closed_loop(
    parts: ControllerParts, files: ControllerFiles, plant: Manifest, watch: int
) -> LoopSource:
    """Return the C text of a loop."""
    # Functions and arguments of the plant that the loop calls.
    spec = find_integrator(plant, CONTROL_METHOD)
    measured = find_measured(parts.sensors, plant)
    sources = {number.source for number in measured} | {"member_tension"}
    called = {function.quantity: function for function in plant.functions if function.quantity in sources}
    symbols = {name: function.symbol for name, function in called.items()}
    symbols["integrate"] = f"{spec.symbol}_run"
    sizes = {argument.name: argument.shape for argument in plant.arguments if argument.name not in OF_STATE}
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
        "functions": [_write_field(plant.declarations, *pair) for pair in symbols.items()],
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
    """Return the values of the template besides names."""
    load = next((argument for argument in plant.arguments if argument.name == NODE_LOAD), None)
    # A function is a field of plant_functions here, and its arguments are fields of plant_arguments.
    fields = {
        name: replace(
            function,
            symbol=f"f->{name}",
            arguments=tuple(arg if arg in OF_STATE else f"with->{arg}" for arg in function.arguments),
        )
        for name, function in called.items()
    }
    tension = fields["member_tension"]
    arguments = ", ".join(f"with->{name}" for name in spec.arguments)
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
        "integrate": f"f->integrate(span, {RTOL!r}, {ATOL!r}, {MAX_STEPS}, time, &step, state, {arguments}, "
        "2, sample_time, samples, &n_sampled, &run, work)",
        "tension": f"{tension.symbol}({', '.join((*tension.arguments, 'tension'))})",
        "measure": write_measure(fields, find_measured(parts.sensors, plant), DOUBLE),
    }


def _write_field(declarations: str, field: str, symbol: str) -> str:
    """Return the declaration of a function of the plant as a pointer of this name."""
    match = re.search(rf"int {re.escape(symbol)}\(([^;]*)\);", declarations)
    assert match is not None, symbol  # declarations have all functions of the manifest
    return f"int (*{field})({match[1].strip()})"


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
        library, ffi = self.model.library, self._ffi
        functions = ffi.new("plant_functions *")
        for field, symbol in source.symbols.items():
            address = int(library.ffi.cast("uintptr_t", library.symbol(symbol)))
            setattr(functions, field, ffi.cast(ffi.typeof(getattr(functions, field)), address))
        self._functions = functions

    def run(self, draw: LoopStart, count: int, simulated: ActuatorBounds | None = None) -> ControlRun:
        """Return the run of a draw over so many samples; several threads may call it at the same time."""
        arrays, alive, loop = self._prepare(draw, count, simulated or self.parts.bounds)
        began = time.thread_time()  # of this thread alone: of other work on the machine it knows nothing
        getattr(self._library, self._source.function)(self._functions, loop)
        cost = time.thread_time() - began
        del alive  # memory that the loop points to
        status = ESTIMATE_LOST if loop.is_lost else STATUS[loop.plant_status]
        if status not in ("ok", ESTIMATE_LOST, *ENDINGS):
            raise_for_status(
                loop.plant_status, f"integrate_{CONTROL_METHOD}", {"state": draw.state, **draw.given}
            )
        done, statuses = int(loop.n_done), tuple(CONTROL_STATUS)
        estimates = np.hstack([arrays["estimate"][:done], arrays["disturbance"][:done]])
        run = build_run(
            self.model,
            self.parts.motion,
            self.parts.sample,
            state=arrays["state"][: done + 1],
            command=arrays["command"][len(arrays["command"]) - count :][:done],
            input=arrays["input"][:done],
            tension=arrays["tension"][: done + 1],
            known=None if self.parts.estimator is None else estimates,
            statuses=[statuses[k] for k in arrays["status"][:done].tolist()],
            word=status,
            yielding=self._read_yielding(arrays, done),
        )
        return replace(run, sample_cost=cost / max(done, 1))

    def _read_yielding(self, arrays: dict[str, NDArray[Any]], done: int) -> NDArray[np.bool_] | None:
        """Return the members whose least tension yields, (n_samples, n_members)."""
        if self.parts.distribution is None:
            return None
        yielding = np.zeros((done, len(self.model.manifest.member_name)), dtype=bool)
        yielding[:, self.parts.distribution.cables.driven] = arrays["yields"][:done] != 0
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
        """Return the arrays that are filled, objects that must stay alive, and the struct of a draw."""
        manifest, ffi, sample = self.model.manifest, self._ffi, self.parts.sample
        n, bounds = len(manifest.coordinate_name), self.parts.bounds
        # Actuators as fast as the controller believes, or faster, reach each command when it arrives.
        back, offset, _ = split_delays(simulated.delay, sample)
        arrivals, arrival = np.unique([0.0, *offset], return_inverse=True)
        is_slow, before = simulated.rate < bounds.rate, int(back.max(initial=0))
        start = self.parts.motion.at(0.0).input[bounds.place]
        # The results of the loop.
        filled: dict[str, NDArray[Any]] = {
            "state": np.zeros((count + 1, 2 * n + manifest.n_internal)),
            "tension": np.zeros((count + 1, len(manifest.member_name))),
            "command": np.tile(start, (before + count, 1)),
            "input": np.zeros((count, len(manifest.input_name))),
            "estimate": np.zeros((count, 2 * n)),
            "disturbance": np.zeros((count, n)),
            "status": np.zeros(count, dtype=np.intc),
        }
        if self.parts.distribution is not None:
            filled["yields"] = np.zeros((count, len(self.parts.distribution.cables.driven)), dtype=np.intc)
        # Its inputs, and its memory for work.
        changes, load = _tabulate_loads(self.model, draw)
        largest = max((int(np.prod(function.shape)) for function in manifest.functions), default=1)
        memory = {
            "start": np.concatenate([draw.state, draw.given.get("internal", np.zeros(0))]),
            "noise": self._draw_noise(draw.seed, count),
            "arrival_time": arrivals,
            "arrival": arrival[1:].astype(np.intc),
            "delay_samples": back.astype(np.intc),
            "most_change": np.where(is_slow, simulated.rate * sample, np.inf),
            "applied": start.copy(),
            "change_time": changes,
            "load": load,
            "work": np.zeros(self._spec.work_size),
            "values": np.zeros(largest),
        }
        # The struct that points to both.
        loop = ffi.new("closed_loop *")
        alive: list[Any] = [memory]
        for name, array in {**filled, **memory}.items():
            kind = "int[]" if array.dtype == np.intc else "double[]"
            setattr(loop, name, ffi.from_buffer(kind, array))
        for name in self._source.arguments:
            array = _read_argument(self.model, draw, name)
            setattr(getattr(loop, "with"), name, ffi.from_buffer("double[]", array))
            alive.append(array)
        loop.count, loop.n_changes, loop.n_arrivals, loop.n_before = (
            count,
            len(changes),
            len(arrivals),
            before,
        )
        controller = ffi.new(f"{self.parts.name}_control *")
        loop.controller = controller
        alive.append(controller)
        return filled, alive, loop


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
        has_loads = any(argument.name == NODE_LOAD for argument in model.manifest.arguments)
        return np.zeros(0), _read_argument(model, draw, NODE_LOAD) if has_loads else np.zeros(0)
    times = draw.gusts.changes_between(-np.inf, np.inf)
    between = [0.5 * (begin + end) for begin, end in pairwise(times)]
    middles = [times[0] - 1.0, *between, times[-1] + 1.0] if times else [0.0]
    return np.array(times, dtype=float), np.array([draw.gusts.at(middle) for middle in middles])


# One motion and controller, many draws of errors.


@with_moved(**MOVED_TO_CODE, **MOVED_TO_LIMITS)
def simulate_control_batch(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    gains: Gains | Mpc | None = None,
    *,
    draws: Sequence[Disturbance],
    estimator: Estimator | None = None,
    distribution: TensionDistribution | None = None,
    t_end: float | None = None,
    sample: float | None = None,
    limits: ActuatorLimits | None = None,
    threads: int | None = None,
    code: ControllerCode | None = None,
    compare: bool = True,
) -> tuple[ControlRun, ...]:
    """Simulate a motion with sampled feedback many times, controller and model in one loop in C.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene, with its structure.
    motion : Motion or Equilibrium
        The motion to hold, as of `simulate_control`.
    gains : Gains or Mpc, optional
        Feedback, or model-predictive control of `design_mpc`; without it the inputs of the motion alone
        act (open loop).
    draws : sequence of Disturbance
        One for each run.
    estimator : Estimator, optional
        Estimates the state from noisy measurements; without it feedback acts on the true state.
    distribution : TensionDistribution, optional
        Keeps tensions above the least ones.
    t_end : float, optional [s]
        End of the simulation; by default the end of the motion.
    sample : float, optional [s]
        Time between two commands; by default that of the gains, 0.005 s without.
    limits : ActuatorLimits, optional
        Rates, ranges and delays of the actuators, by default those of the scene.
    threads : int, optional
        Number of runs at the same time; by default the number of processors.
    code : ControllerCode, optional
        Stored gains, solver and compiler, as of `build_controller`; name and precision are not used.
    compare : bool
        As of `simulate_control`, which simulates the open loops.

    Returns
    -------
    tuple of ControlRun
        One for each draw.

    Raises
    ------
    InvalidValueError, NonFiniteError, UnknownNameError, FormulationError
        As `simulate_control`.
    LibraryError
        The model was loaded without its structure.
    MissingSourceError
        The C text of DAQP is not to be found, for a distribution.
    CompilerMissingError, CompileError
        No C compiler was found, or it failed.

    Notes
    -----
    The controller is that of `build_controller`. The model is integrated as by `simulate_control` (rk853,
    relative tolerance 1e-9), by the same library, and noise follows from the seed in the same order: with
    ``gains.at_knots(knots)`` both give the same numbers up to rounding. A measured length of 0 or less has
    the status ``"invalid_length"`` here, and the last command is kept.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import Disturbance, compile_scene, design_lqr, find_equilibrium
    >>> from tensegrity_codegen import simulate_control_batch
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> found = find_equilibrium(model)
    >>> gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    >>> draws = [Disturbance(coordinate_error=[error]) for error in (-0.01, 0.01)]
    >>> runs = simulate_control_batch(model, found, gains, draws=draws, t_end=1.0)
    >>> [run.status for run in runs], max(run.worst_error(last=0.2) for run in runs) < 1e-4
    (['ok', 'ok'], True)
    """
    require_model(model)
    require_double(model.manifest, "a simulated closed loop")
    require_quantities(model, ("member_tension",), "a simulated closed loop needs")
    check_switch(compare, "compare")
    check_instance(draws, Sequence, "draws", "a list of Disturbance")
    written = replace(read_code(code), name=SIMULATED_LOOP_NAME, precision="double")
    held = 1.0 if t_end is None else check_positive(t_end, "t_end", "[s]")
    workers = (os.cpu_count() or 1) if threads is None else check_whole(threads, "threads", 1)
    # The controller, with the checks of all controllers.
    described, request = find_model_and_request(model, motion)
    reference = find_reference(model, motion, held)
    parts = collect_parts(
        described, reference, gains=gains, estimator=estimator, distribution=distribution, sample=sample,
        limits=limits, code=written,
    )  # fmt: skip
    # The draws, all of them checked before the first one is simulated.
    count = count_samples(reference.duration if t_end is None else t_end, parts.sample)
    for k, draw in enumerate(draws):
        check_instance(draw, Disturbance, f"draws[{k}]", "a Disturbance")
    ready = [read_disturbance(model, parts.motion, draw, f"draws[{k}]") for k, draw in enumerate(draws)]
    if not ready:
        return ()
    # Controller and plant in one library; the draws in several threads.
    loop = CompiledLoop(model, parts, write_files(parts, request, find_precision("double")), written.compiler)
    with ThreadPoolExecutor(workers) as pool:
        runs = list(pool.map(lambda draw: loop.run(draw, count), ready))
    late = describe_unknown_delays(None if isinstance(gains, Mpc) else gains, parts.bounds)
    runs = [replace(run, warnings=((late,) if late else ()) + run.warnings) for run in runs]
    # The open loop of a motion that is too fast for its actuators is no comparison.
    lags = bool((reference.peak_rate > parts.bounds.rate).any())
    if gains is None or not compare or lags:
        return tuple(runs)
    open_loop = partial(
        simulate_control, model, reference, t_end=count * parts.sample, sample=parts.sample, limits=limits
    )
    return tuple(
        compare_with_open_loop(model, reference, run, partial(open_loop, disturbance=draw))
        for run, draw in zip(runs, draws, strict=True)
    )
