"""Integrations of many states by the generated C: side by side in the lanes of a core, groups in threads."""

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.adaptive import STEPS_BEFORE_FORECAST
from tensegrity_codegen.runtime.integrate.c_run import count_steps
from tensegrity_codegen.runtime.integrate.integration import find_integrator
from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import (
    GIVEN_UP,
    RawBatch,
    is_within_reach,
    judge_ends,
    say_unmonitored,
)
from tensegrity_codegen.runtime.model.arrays import to_batch
from tensegrity_codegen.runtime.model.interface import require_double
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, LibraryError
from tensegrity_codegen.tables.manifest import STATUS, IntegratorSpec, Manifest

CountArray = NDArray[np.int64]

MOTION_STATUS = ("non_finite_input", "non_finite_result", "step_too_small")  # of one state, not of the call


def integrate_batch(motion: Motion, options: RunOptions, threads: int = 1) -> RawBatch:
    """Integrate motions from states (n_batch, n_states) by a method that does several side by side.

    step [s]: of "rk4", the largest one used; rtol, atol: of the others, for the error of every step of every
    state, component by component. Run-time arguments have their own shape, for all states, or one more,
    leading axis of n_batch rows. threads: how many share the work.

    What becomes of a state does not depend on the others, nor on the threads; steps are not cut at events. A
    state that cannot go on has its word in `status`: "non_finite_input", "unstable" or "not_converged".
    Raises FormulationError and LibraryError for a library without this integrator or without batches,
    InvalidValueError for arrays of another shape.
    """
    run = _Batch(motion, options)
    groups = range(0, len(run.state), run.width)
    stop = threading.Event()

    def integrate(start: int) -> None:
        run.advance_to_end(start, stop)

    if min(threads, len(groups)) < 2:
        for done, start in enumerate(groups, 1):
            integrate(start)
            motion.report(done / len(groups))
        return run.result()
    from concurrent.futures import ThreadPoolExecutor  # which imports logging

    with ThreadPoolExecutor(threads) as pool:  # the calls into C hold no lock of Python's
        try:
            for done, _ in enumerate(pool.map(integrate, groups), 1):
                motion.report(done / len(groups))
        except BaseException:
            stop.set()  # the pool waits for its threads
            raise
    return run.result()


def runs_side_by_side(options: RunOptions, manifest: Manifest) -> bool:
    """Return whether a batch integrates its motions side by side; else one by one, as `simulate` does.

    Two runs that pass over contacts, slips and the like may agree and be wrong.
    """
    method = find_method(options.method)
    is_plain = method.has_fixed_step or options.control == "steps" or not manifest.needs_state_jacobian
    return method.in_batches and is_plain and not options.keep


class _Batch:
    """The arrays of one batch, of which groups of `width` states are integrated apart."""

    def __init__(self, motion: Motion, options: RunOptions) -> None:
        model, sample_time, step = motion.model, motion.sample_time, options.step
        require_double(model.manifest, "an integration from Python")
        self.name, self.library, self.max_steps = options.method, model.library, options.max_steps
        contacts = len(model.manifest.contact_name)
        self.spec = _find_batch_integrator(model, self.name)
        self.unmonitored = say_unmonitored(self.spec.unwatched + len(self.spec.cables), contacts)
        self.is_fixed = find_method(self.name).has_fixed_step
        self.width, self.call = model.library.batch_width, model.library.symbol(f"{self.spec.symbol}_batch")
        self.n_moved = 2 * len(model.manifest.coordinate_name)  # states besides the internal ones
        moved = _check_state(motion.state, self.n_moved)
        self.state = np.hstack([moved, read_internals(motion, moved)])
        self.end, self.tolerance = motion.t_end, (options.rtol, options.absolute)
        self.asked_time, self.sample_time = sample_time, np.array(sample_time, dtype=np.float64)
        self.n_steps_wanted, self.step = _divide(self.end, step)
        if step is not None:  # the last sample is the end of the last step, whatever the rounding
            last = round(self.end / self.step) * self.step
            self.sample_time[-1] = min(self.sample_time[-1], last)
        n_batch, n_states = self.state.shape
        self.passed = [self._argument(motion, argument) for argument in self.spec.arguments]
        self.samples = np.full((n_batch, len(sample_time), n_states), np.nan)
        self.samples[:, 0] = self.state
        self.n_sampled = np.ones(n_batch, dtype=np.int64)
        self.status = np.zeros(n_batch, dtype=np.int32)
        self.count = np.zeros((n_batch, 3), dtype=np.int64)
        self.times, self.steps = np.zeros(n_batch), np.zeros(n_batch)

    def _argument(self, motion: Motion, name: str) -> tuple[FloatArray, bool]:
        nominal = motion.model.nominal(name)
        value = motion.arguments.get(name, nominal)
        array, is_batched = to_batch(value, nominal.shape, self.library.precision, name)
        if is_batched and len(array) != len(self.state):
            raise InvalidValueError(
                "arguments of different batch lengths",
                where=name,
                given=f"{len(array)} rows for {len(self.state)} states",
                allowed=f"{len(self.state)} rows, or no leading axis where all states share a value",
            )
        return array, is_batched

    def advance_to_end(self, start: int, stop: threading.Event) -> None:
        """Integrate the group that begins with state `start`, in calls that Ctrl-C can come between."""
        rows = slice(start, min(start + self.width, len(self.state)))
        work, done = np.empty(self.spec.batch_work_size), 0
        advance = self._fixed if self.is_fixed else self._adaptive
        for chunk in count_steps():
            if stop.is_set() or not self._goes_on(rows, done):
                break
            status = advance(rows, done, chunk, work)
            done += chunk
            if status > 0 and STATUS[status] not in MOTION_STATUS:
                raise LibraryError(
                    f"the library returned the status {STATUS[status]!r}", where=self.spec.symbol
                )

    def _goes_on(self, rows: slice, done: int) -> bool:
        """Return whether any state of a group is still on its way; gives up those that are out of reach."""
        good = self.status[rows] == 0
        if self.is_fixed:
            return bool(good.any()) and done < self.n_steps_wanted
        trials = self.count[rows, :2].sum(axis=1)
        reach = [
            is_within_reach(int(n), float(t) / self.end, self.max_steps, STEPS_BEFORE_FORECAST)
            for n, t in zip(trials, self.times[rows], strict=True)
        ]
        open_ = good & (self.times[rows] < self.end)
        # C leaves alone whatever has a status; which one is made good again by `result`.
        self.status[rows][open_ & ~np.array(reach)] = GIVEN_UP
        return bool((open_ & reach).any())

    def _fixed(self, rows: slice, done: int, chunk: int, work: FloatArray) -> int:
        chunk = min(chunk, self.n_steps_wanted - done)
        advanced = np.zeros(rows.stop - rows.start, dtype=np.int64)
        head = (0.0, self.step, done, chunk)
        status = self._call(rows, head, (), advanced, work)
        self.count[rows, 0] += advanced
        return status

    def _adaptive(self, rows: slice, done: int, chunk: int, work: FloatArray) -> int:
        head = (self.end, *self.tolerance, chunk)
        return self._call(rows, head, (self.times[rows], self.steps[rows]), self.count[rows], work)

    def _call(
        self,
        rows: slice,
        head: Sequence[float],
        own: Sequence[FloatArray],
        count: CountArray,
        work: FloatArray,
    ) -> int:
        pointer: Callable[..., Any] = self.library.ffi.from_buffer
        passed: list[Any] = []
        for array, is_batched in self.passed:
            passed += [pointer("double[]", array[rows] if is_batched else array)]
            passed += [int(np.prod(array.shape[1:])) if is_batched else 0]
        return int(
            self.call(
                rows.stop - rows.start,
                *head,
                *(pointer("double[]", array) for array in own),
                pointer("double[]", self.state[rows]),
                *passed,
                len(self.sample_time),
                pointer("double[]", self.sample_time),
                pointer("double[]", self.samples[rows]),
                pointer("long long[]", self.n_sampled[rows]),
                pointer("long long[]", count),
                pointer("int[]", self.status[rows]),
                pointer("double[]", work),
            )
        )

    def result(self) -> RawBatch:
        """Return what was reached."""
        step = self.step if self.is_fixed else None
        times = self.count[:, 0] * np.float64(step) if step else self.times
        end = (self.n_steps_wanted - 0.5) * self.step if step else self.end
        ends = judge_ends(self.status, times, end, self.count, step, self.unmonitored)
        n_steps, n_evaluations = self.count[:, 0].copy(), self.count[:, 2].copy()
        if step:
            n_evaluations = 4 * n_steps + 1
        return RawBatch(
            time=self.asked_time,
            state=self.samples[..., : self.n_moved],
            internal=self.samples[..., self.n_moved :] if self.samples.shape[-1] > self.n_moved else None,
            n_reached=np.where(self.status == STATUS.index("non_finite_input"), 0, self.n_sampled),
            status=tuple(word for word, _ in ends),
            message=tuple(message for _, message in ends),
            method=self.name,
            n_steps=n_steps,
            n_rejected=self.count[:, 1].copy(),
            n_evaluations=n_evaluations,
            step=step,
        )


def read_internals(motion: Motion, moved: FloatArray) -> FloatArray:
    """Return the internal states that the motions of a batch start from, (n_batch, n_internal).

    moved (n_batch, 2 n_coordinates): where they start.
    """
    if "internal" not in motion.arguments and motion.model.has("relaxed_internal"):
        start = {"coordinate": np.split(moved, 2, axis=1)[0]}
        return np.asarray(motion.model.compute_batch("relaxed_internal", **{**motion.arguments, **start}))
    nominal = np.zeros(len(motion.model.manifest.internal_name))
    value = motion.arguments.get("internal", nominal)
    array, is_batched = to_batch(value, nominal.shape, motion.model.library.precision, "internal")
    return array if is_batched else np.tile(array.reshape(1, -1), (len(moved), 1))


def _divide(span: float, step: float | None) -> tuple[int, float]:
    """Return number and length of the equal steps, at most `step` long, that a span takes."""
    if step is None:
        return 0, 0.0
    count = max(1, math.ceil(span / step * (1.0 - 1e-12)))
    return count, span / count


def _find_batch_integrator(model: CompiledModel, name: str) -> IntegratorSpec:
    spec = find_integrator(model.manifest, name)
    if spec.batch_work_size:
        return spec
    if not model.library.batch_width:
        raise LibraryError(
            "the library has no batch functions",
            where=model.manifest.name,
            hint='compile_scene(..., for_="simulate_batch"), or batch_width = 8 under [model]',
        )
    raise FormulationError(
        f"the integrator {name!r} has no batch function",
        where=model.manifest.name,
        allowed=", ".join(list_methods("in_batches")),
    )


def _check_state(state: FloatArray, n_states: int) -> FloatArray:
    array = np.ascontiguousarray(state, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != n_states or not len(array):
        raise InvalidValueError(
            "wrong shape",
            where="state",
            given=array.shape,
            allowed=f"shape (n_batch, {n_states}), n_batch > 0",
        )
    return array
