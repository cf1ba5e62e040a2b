"""Classical Runge-Kutta 4 with a fixed step: the loop runs in the generated C, in interruptible chunks."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import FormulationError, InvalidValueError
from tensegrity_codegen.manifest import STATUS, IntegratorSpec, Manifest
from tensegrity_codegen.runtime.model import CompiledModel, raise_for_status
from tensegrity_codegen.runtime.trajectory import RawTrajectory

__all__ = ["integrate_rk4"]

FloatArray = NDArray[np.float64]
Progress = Callable[[float], None]

CHUNK_SECONDS = 0.1


def integrate_rk4(
    model: CompiledModel,
    state: FloatArray,
    sample_time: FloatArray,
    step: float,
    arguments: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> RawTrajectory:
    """Integrate x' = (q', H^-1 f) from x(0) = state (n_states,) over sample_time (n_t,) [s] from 0 up.

    The step used is the largest one not above `step` that divides the span. progress is called with the
    fraction done. Status "unstable" and the samples reached if the state stops being finite. Raises
    FormulationError if the model has no such integrator, InvalidValueError for a state or an argument of
    another size, NonFiniteError for one that is not finite.
    """
    span = float(sample_time[-1])
    n_steps = max(1, math.ceil(span / step * (1.0 - 1e-12)))
    run = _Run(model, np.array(state, dtype=np.float64), sample_time, span / n_steps, arguments or {})
    chunk, done = 64, 0
    while done < n_steps:
        count, started = min(chunk, n_steps - done), clock.perf_counter()
        status = run.advance(done, count)
        done += run.last_done
        if status:
            return run.result(done, f"the state is not finite after t = {done * run.step:.6g} s")
        if progress is not None:
            progress(done / n_steps)
        if clock.perf_counter() - started < CHUNK_SECONDS:
            chunk *= 2
    return run.result(done, "")


class _Run:
    """Arrays of one integration, bound once for the C loop."""

    def __init__(
        self,
        model: CompiledModel,
        state: FloatArray,
        sample_time: FloatArray,
        step: float,
        arguments: Mapping[str, Any],
    ) -> None:
        spec = _find_integrator(model.manifest)
        n_states = 2 * len(model.manifest.coordinate_name)
        self.ffi = model.library.ffi
        self.call = model.library.symbol(spec.symbol)
        self.step, self.asked_time = step, sample_time
        self.state = _sized("state", state, (n_states,))
        self.sample_time = np.array(sample_time, dtype=np.float64)
        # The last sample is the end of the last step, whatever the rounding of n times the step.
        self.sample_time[-1] = min(self.sample_time[-1], round(sample_time[-1] / step) * step)
        self.samples = np.empty((len(sample_time), n_states))
        self.samples[0] = state
        self.passed = {
            name: _sized(name, arguments.get(name, nominal), nominal.shape)
            for name, nominal in ((name, model.nominal(name)) for name in spec.arguments)
        }
        self.work = np.empty(spec.work_size)
        self.n_sampled = self.ffi.new("long long *", 1)
        self.n_done = self.ffi.new("long long *", 0)

    @property
    def last_done(self) -> int:
        """Steps done by the last call."""
        return int(self.n_done[0])

    def advance(self, first_step: int, count: int) -> int:
        """Do `count` steps from `first_step`; return 0, or 1 if the state stopped being finite."""
        pointer = self.ffi.from_buffer
        status = self.call(
            0.0,
            self.step,
            first_step,
            count,
            pointer("double[]", self.state),
            *[pointer("double[]", array) for array in self.passed.values()],
            len(self.sample_time),
            pointer("double[]", self.sample_time),
            pointer("double[]", self.samples),
            self.n_sampled,
            self.n_done,
            pointer("double[]", self.work),
        )
        if status and STATUS[status] != "non_finite_result":
            raise_for_status(status, "integrate_rk4", {"state": self.state, **self.passed})
        return int(status != 0)

    def result(self, n_steps: int, trouble: str) -> RawTrajectory:
        """Return the samples reached so far."""
        reached = int(self.n_sampled[0])
        return RawTrajectory(
            time=self.asked_time[:reached],
            state=self.samples[:reached],
            status="unstable" if trouble else "ok",
            message=f"{trouble}: take a smaller step" if trouble else f"fixed step {self.step:.6g} s",
            method="rk4",
            n_steps=n_steps,
            n_evaluations=4 * n_steps + 1,
            step=self.step,
        )


def _find_integrator(manifest: Manifest) -> IntegratorSpec:
    for spec in manifest.integrators:
        if spec.name == "rk4":
            return spec
    raise FormulationError(
        "the library has no integrator 'rk4'",
        where=manifest.name,
        allowed='a library that was built with integrators = ["rk4"]',
        hint='build it with integrators=("rk4",), or use one of the methods scipy_*',
    )


def _sized(name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return `value` as the C loop reads it; raises InvalidValueError for another size."""
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(
            "not an array of numbers", where=name, given=value, allowed=f"shape {shape}"
        ) from error
    if array.size != np.prod(shape, dtype=np.int64):
        raise InvalidValueError("wrong shape", where=name, given=array.shape, allowed=f"shape {shape}")
    return array
