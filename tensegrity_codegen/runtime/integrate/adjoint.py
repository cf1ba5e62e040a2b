"""Gradients of motions, backwards over their steps: the passes in both directions are in the generated C."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.adaptive import AdaptiveRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import DIRECTED

TAPE_BYTES = 2**26  # of a tape; longer motions are integrated twice, piece by piece


@dataclass(frozen=True)
class StartGradient:
    """Derivatives of a weighed sum of states.

    state: to the state at the start (n_states,); number: to every run-time parameter and input by its name,
    in its shape, as a constant; coefficient: to the coefficients of the schedule, (n_pieces, degree + 1,
    n_values), None without.
    """

    state: FloatArray
    number: dict[str, FloatArray]
    coefficient: FloatArray | None


def directed_shapes(manifest: Manifest) -> dict[str, tuple[int, ...]]:
    """Return the shapes of all run-time parameters and of the inputs, in the order of adjoints."""
    shapes = {item.name: item.shape for item in manifest.arguments}
    return {name: shapes[name] for name in DIRECTED if name in shapes}


class TapedRun(AdaptiveRun):
    """One integration whose steps are kept on a tape, for its gradients.

    memory: bytes of the tape. A motion with more steps keeps where each tape begins, and is integrated again
    from there. Raises FormulationError for a library without the adjoint, and as AdaptiveRun does.
    """

    def __init__(self, motion: Motion, options: RunOptions, memory: int = TAPE_BYTES) -> None:
        super().__init__(motion, options)
        spec = self.bound.spec
        if not spec.adjoint_work:
            raise FormulationError(
                "the library has no gradients of motions",
                where=spec.symbol,
                allowed='a library with the quantity "adjoint_rate"',
                hint='add "adjoint_rate" to the wanted quantities, or integrate columns beside the motion',
            )
        self.tape = np.empty((max(1, memory // (8 * spec.tape_row)), spec.tape_row))
        self.events.counts.tape = self.bound.pointer(self.tape)
        self.events.counts.most_taped = len(self.tape)
        self.starts: list[tuple[Any, ...]] = []
        self._begin_tape()

    def _begin_tape(self) -> None:
        bound, counts = self.bound, self.events.counts
        counts.n_taped = 0
        numbers = (self.time[0], self.step[0], bound.n_sampled[0], bytes(bound.ffi.buffer(counts)))
        self.starts.append((*numbers, bound.state.copy(), bound.work.copy()))

    def _repeat_tape(self, start: tuple[Any, ...]) -> None:
        """Integrate again from the start of a tape until it is full."""
        bound, counts = self.bound, self.events.counts
        self.time[0], self.step[0], bound.n_sampled[0], kept, bound.state[:], bound.work[:] = start
        bound.ffi.memmove(counts, kept, len(kept))
        while counts.n_taped < counts.most_taped:
            super().advance(len(self.tape))

    def advance(self, count: int) -> None:
        """Try so many steps."""
        if self.events.counts.n_taped == self.events.counts.most_taped:
            self._begin_tape()
        super().advance(count)

    def go_back(self, weight: FloatArray) -> StartGradient:
        """Return the gradient of sum(weight * state) over the samples reached; weight: (n_t, n_states)."""
        bound, manifest, counts = self.bound, self.motion.model.manifest, self.events.counts
        spec = bound.spec
        compute = self.motion.model.library.symbol(f"{spec.symbol}_adjoint")
        weight = np.ascontiguousarray(weight, dtype=np.float64)
        left, work = bound.ffi.new("long long *", len(weight)), np.empty(spec.adjoint_work)
        shapes = directed_shapes(manifest)
        sizes = [int(np.prod(shape)) for shape in shapes.values()]
        state, number = np.zeros(weight.shape[1]), np.zeros(sum(sizes))
        schedule, coefficient = self.motion.schedule, None
        if bound.knots is not None:
            assert isinstance(schedule, DrivenArguments)
            coefficient = np.zeros(schedule.pieces.coefficient.shape)
        changing: tuple[Any, ...] = ()
        if manifest.driven:
            changing = (bound.ffi.NULL if coefficient is None else bound.pointer(coefficient.reshape(-1)),)
        for k, start in reversed(list(enumerate(self.starts))):
            if k < len(self.starts) - 1:
                self._repeat_tape(start)
            status = compute(
                counts,
                *bound.arguments(),
                left,
                bound.pointer(bound.sample_time),
                bound.pointer(weight.reshape(-1)),
                bound.pointer(state),
                bound.pointer(number),
                *changing,
                bound.pointer(work),
            )
            bound.check(status, ())
        state += weight[: left[0]].sum(axis=0)
        parts = np.split(number, np.cumsum(sizes)[:-1])
        found = {name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)}
        return StartGradient(state, found, coefficient)
