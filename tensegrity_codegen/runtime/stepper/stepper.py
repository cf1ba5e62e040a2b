"""Many copies of a motion that are advanced together, sample by sample, with inputs that are held."""

import itertools
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.accuracy.scales import find_length
from tensegrity_codegen.runtime.integrate.event_log import choose_watch
from tensegrity_codegen.runtime.integrate.integration import find_integrator, read_internal
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import (
    ATOL,
    RunOptions,
    Stepping,
    check_options,
    read_stepping,
)
from tensegrity_codegen.runtime.model.arguments import INPUT, check_arguments, merge_inputs
from tensegrity_codegen.runtime.model.arrays import (
    check_finite,
    check_saved,
    fit_saved,
    read_saved,
    to_doubles,
    to_sized,
    write_arrays,
)
from tensegrity_codegen.runtime.model.interface import require_double, require_model
from tensegrity_codegen.runtime.model.library import check_threads
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.motion_input import find_start
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_names, check_path, check_positive, check_whole
from tensegrity_codegen.system.errors import (
    FormulationError,
    InvalidValueError,
    LibraryError,
    UnknownNameError,
    suggest,
)
from tensegrity_codegen.system.summaries import Fact, Summarised
from tensegrity_codegen.tables.integrators import find_row
from tensegrity_codegen.tables.manifest import ALL_STATUS, Manifest
from tensegrity_codegen.tables.quantities import PARAMETERS, STATE

MOST_COPIES = 10_000_000
MOST_STEPS = 10_000  # of a copy in a sample, where none are named
BLOCKS_A_THREAD = 8  # of copies, so that no thread waits long for the last one
WORTH_THREADS = 3e-4  # time of a step [s] from which on other threads are woken, which takes a tenth of it
LONGEST_STEP = 1e100  # [s]
WHOLE = 1e-9  # by which a number of steps may differ from a whole one
FINER = 0.01  # tolerance of the steps that an error is estimated with, over that of the others
HELD = ("state", "next_step", "steps", "status")  # arrays that a copy goes on from, besides its arguments


class Stepper(Summarised):
    """Copies of a motion in arrays of the caller, all advanced by one sample in a call of C.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"step"``, see compile_scene.
    n : int
        Number of copies.
    sample : float [s]
        Time by which a step advances them, with inputs that are held.
    method : str
        An explicit integrator of the library, ``"rk54"``, ``"rk853"``, ``"rk4"``, ...; its own steps are
        shorter where the tolerance asks for that, and end at events: where cables go slack or taut and nodes
        touch the ground, stick and slip. Structures whose events need not be met take several copies in the
        lanes of a core.
    rtol : float
        Relative tolerance of the integrator's steps.
    quantities : sequence of str
        Quantities of the library that are computed after each sample.
    arguments : mapping, optional
        Values of run-time parameters and inputs by name, where they differ from the scene, the same for all
        copies; `Stepper.arguments` has one row a copy.
    stepping : Stepping, optional
        `step` of ``"rk4"`` [s], of which the sample is a multiple; `atol` [m and m/s], by default `rtol`
        times the length of the structure; `max_steps` of a copy in a sample, by default 10,000.
    threads : int
        Number of threads; the results do not depend on it.

    Attributes
    ----------
    model : CompiledModel
        As given.
    state : ndarray, shape (n, n_states)
        Coordinates, velocities, internal states; `coordinate`, `velocity` and `internal` are parts of it. Who
        writes into it keeps lengths of rigid bars and bodies, as `reset` does.
    values : mapping of str to ndarray, shape (n, ...)
        The quantities at these states.
    arguments : mapping of str to ndarray, shape (n, ...)
        Run-time parameters of each copy, for the caller to change.
    inputs : ndarray, shape (n, n_inputs)
        Inputs of each copy, as held last.
    steps : ndarray of int, shape (n,)
        Samples since the last reset.
    status : ndarray of int, shape (n,)
        0, or why a copy failed, see `status_text`. Such a copy has NaN for a state and waits for a reset;
        the others go on as without it.
    next_step : ndarray, shape (n,) [s]
        Steps that the integrator tries next; 0: it chooses.

    Raises
    ------
    InvalidValueError, UnknownNameError
        A value is out of range, or a quantity or argument is unknown.
    FormulationError, LibraryError
        The library was not made for this, or lacks the method.

    Notes
    -----
    A copy has the same bits for any number of threads, and at any place among the others. Steps begin anew at
    every sample, for inputs may jump there; their errors are limited one by one, and `estimate_error` tells
    what they come to in a sample.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene
    >>> stepper = compile_scene("two_nodes.toml", for_="step").stepper(3, sample=0.01)
    >>> stepper.coordinate[1] = [0.0, 0.0, -1.1]
    >>> stepper.step()
    >>> stepper.coordinate.shape, stepper.status.tolist()
    ((3, 3), [0, 0, 0])
    """

    def __init__(
        self,
        model: CompiledModel,
        n: int = 1,
        *,
        sample: float,
        method: str = "rk54",
        rtol: float = 1e-6,
        quantities: ArrayLike | tuple[str, ...] = (),
        arguments: Mapping[str, Any] | None = None,
        stepping: Stepping | None = None,
        threads: int = 1,
    ) -> None:
        # Options.
        require_model(model)
        require_double(model.manifest, "a stepper")
        check_whole(n, "n", 1, MOST_COPIES)
        check_threads(threads)
        self.model, self.n, self.threads = model, n, threads
        self.sample = check_positive(sample, "sample", "[s]")
        stated = read_stepping(stepping)
        most = MOST_STEPS if stated.max_steps is None else stated.max_steps
        self._options = replace(stated, max_steps=most).with_method(method, rtol)
        _check_method(model.manifest, self._options, self.sample)
        self._given: dict[str, Any] = {
            "method": method, "rtol": rtol, "stepping": stepping, "threads": threads,
        }  # fmt: skip
        names = check_names(quantities, "quantities")
        shapes = {name: _find_shape(model, name) for name in names}
        # Arrays, all copies at the start of the scene.
        manifest = model.manifest
        n_coordinates = len(manifest.coordinate_name)
        self.state = np.zeros((n, 2 * n_coordinates + manifest.n_internal))
        self.coordinate, self.velocity, self.internal = np.split(
            self.state, (n_coordinates, 2 * n_coordinates), axis=1
        )
        self.values = MappingProxyType({name: np.full((n, *shape), np.nan) for name, shape in shapes.items()})
        self.next_step, self.steps = np.zeros(n), np.zeros(n, dtype=np.int64)
        self.status = np.zeros(n, dtype=np.int32)
        given = merge_inputs(manifest, arguments)
        check_arguments(manifest, given)
        own = {
            name: to_sized(given.get(name, value), value.shape, name).reshape(value.shape)
            for name, value in _list_arguments(model).items()
        }
        self.arguments = MappingProxyType(
            {name: np.array([value] * n, dtype=np.float64) for name, value in own.items()}
        )
        self.inputs = self.arguments.get(INPUT, np.zeros((n, 0)))
        self._first_inputs = self.inputs[0].copy()
        self._bind()
        self.reset()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute, but no array in place of one that C reads and writes."""
        if isinstance(self.__dict__.get(name), np.ndarray):
            raise AttributeError(f"write into the array: {name}[...] = ...")
        super().__setattr__(name, value)

    def _bind(self) -> None:
        """Give C the places of all arrays."""
        library, manifest, options = self.model.library, self.model.manifest, self._options
        ffi, spec = library.ffi, find_integrator(manifest, options.method)
        copies: Any = ffi.new(f"{manifest.name}_copies *")
        length = find_length(manifest)
        copies.sample, copies.rtol = self.sample, options.rtol
        copies.atol = max(options.rtol, ATOL) * length if options.atol is None else options.atol
        copies.fixed_step, copies.most_steps = options.step or 0.0, options.max_steps
        if any(integrator.events for integrator in manifest.integrators):
            copies.watch = choose_watch(spec, manifest, None).bits
        arrays = {"state": self.state, "step": self.next_step, **self.arguments, **self.values}
        for name, array in arrays.items():
            setattr(copies, name, ffi.from_buffer("double[]", array))
        copies.count = ffi.from_buffer("long long[]", self.steps)
        copies.status = ffi.from_buffer("int[]", self.status)
        self._copies = copies
        self._advance = library.symbol(f"{spec.symbol}_copies")
        self._evaluate = library.symbol(f"{manifest.name}_evaluate_copies")
        size = max(spec.work_size, spec.batch_work_size)
        self._work = [ffi.new("double[]", size) for _ in range(self.threads)]
        width = max(library.batch_width, 1)
        least = -(-self.n // (self.threads * BLOCKS_A_THREAD))
        block = -(-least // width) * width
        self._blocks = [(first, min(first + block, self.n)) for first in range(0, self.n, block)]
        self._pool = (
            ThreadPoolExecutor(self.threads - 1) if min(self.threads, len(self._blocks)) > 1 else None
        )
        self._seconds = 0.0  # of the last step, of all threads

    def check_sample(self, sample: float) -> float:
        """Return a time [s] that a step can take; raises InvalidValueError for another."""
        return _check_sample(self._options, sample)

    def step(self, inputs: ArrayLike | None = None, sample: float | None = None) -> None:
        """Advance all copies by a sample.

        Parameters
        ----------
        inputs : array_like, shape (n, n_inputs) or (n_inputs,), optional
            Held over the sample; by default the last ones. A copy whose inputs are not finite fails.
        sample : float, optional [s]
            Another time for this step.

        Raises
        ------
        InvalidValueError
            Inputs of another shape, or a sample out of range.
        """
        if inputs is not None:
            self.inputs[:] = _read_rows(inputs, self.inputs.shape, "inputs")
        if sample is not None:
            self._copies.sample = self.check_sample(sample)
        try:
            self._run()
        finally:
            self._copies.sample = self.sample

    def _run(self) -> None:
        """Advance all copies, blocks of them in threads that each take the next one."""
        started, used = time.perf_counter(), self.threads
        if self._pool is None or self._seconds < WORTH_THREADS:
            used = 1
            for first, end in self._blocks:
                self._check(self._advance(self._copies, first, end, self._work[0]))
        else:
            numbers = itertools.count()

            def work(thread: int) -> None:
                while (k := next(numbers)) < len(self._blocks):
                    self._check(self._advance(self._copies, *self._blocks[k], self._work[thread]))

            others = [self._pool.submit(work, thread) for thread in range(1, used)]
            work(0)
            for other in others:
                other.result()
        self._seconds = (time.perf_counter() - started) * used

    def _check(self, status: int) -> None:
        if status:
            raise LibraryError(f"the library returned the status {ALL_STATUS[status]!r}", where="step")

    def reset(
        self,
        which: ArrayLike | None = None,
        *,
        coordinate: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        internal: ArrayLike | None = None,
    ) -> None:
        """Begin anew with some copies: with the first inputs, run-time parameters stay as they are.

        Parameters
        ----------
        which : array_like of int or of bool, optional
            Numbers of the copies, or n truth values; by default all.
        coordinate, velocity, internal : array_like, shape (n_numbers,) or (n_which, n_numbers), optional
            Where they begin, the same for all or one row each; by default at the start of the scene, internal
            states as `simulate` begins with them.

        Raises
        ------
        InvalidValueError
            Copies that are not there, or another shape.
        NonFiniteError
            A number is not finite.
        """
        rows = self._find_rows(which)
        self.inputs[rows] = self._first_inputs
        names = ("coordinate", "velocity", "internal")
        given = dict(zip(names, (coordinate, velocity, internal), strict=True))
        starts = {
            name: _read_rows(value, (len(rows), getattr(self, name).shape[1]), name)
            for name, value in given.items()
            if value is not None
        }
        for name, array in starts.items():
            check_finite(array, name)
        manifest = self.model.manifest
        is_plain = not (starts or self.model.has("consistent_coordinate") or manifest.internal_name)
        for place, row in enumerate(rows.tolist()):
            if is_plain and place:
                self.state[row] = self.state[rows[0]]
                continue
            passed = {name: array[row] for name, array in self.arguments.items()}
            own = {name: array[place] for name, array in starts.items()}
            moved = find_start(self.model, own.get("coordinate"), own.get("velocity"), passed)
            if "internal" in own:
                passed["internal"] = own["internal"]
            start = Motion(self.model, moved, np.zeros(1), passed)
            self.state[row] = np.concatenate([moved, read_internal(start)])
        self.status[rows], self.steps[rows], self.next_step[rows] = 0, 0, 0.0
        for row in rows.tolist() if self.values else ():
            self._check(self._evaluate(self._copies, row, row + 1))

    def _find_rows(self, which: ArrayLike | None) -> NDArray[np.int64]:
        if which is None:
            return np.arange(self.n)
        array = np.atleast_1d(np.asarray(which))
        allowed = f"numbers from 0 to {self.n - 1}, or {self.n} truth values"
        is_mask = array.dtype == np.bool_ and array.shape == (self.n,)
        is_list = (array.dtype.kind in "iu" and array.ndim == 1) or array.size == 0
        if not (is_mask or (is_list and (array >= 0).all() and (array < self.n).all())):
            raise InvalidValueError("no such copies", where="which", given=which, allowed=allowed)
        return np.flatnonzero(array) if is_mask else array.astype(np.int64)

    def status_text(self, k: int) -> str:
        """Return the status of a copy as a word: ``"ok"``, ``"non_finite_input"``, ..."""
        return ALL_STATUS[self.status[check_whole(k, "k", 0, self.n - 1)]]

    def estimate_error(self, inputs: ArrayLike | None = None) -> FloatArray:
        """Return how far coordinates are off after the next sample, (n,) [m], as steps of 1 % of rtol show.

        The copies stay where they are.
        """
        ends = []
        for factor in (1.0, FINER):
            other = self.copy()
            other._copies.rtol, other._copies.atol = self._copies.rtol * factor, self._copies.atol * factor
            other._copies.fixed_step = self._copies.fixed_step / (1.0 if factor == 1.0 else 4.0)
            other.step(inputs)
            ends.append(other.coordinate)
        return np.asarray(np.abs(ends[0] - ends[1]).max(axis=1, initial=0.0))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays that the motions go on from; `restore` goes on with the same bits."""
        held = {name: getattr(self, name) for name in HELD}
        return {name: array.copy() for name, array in (held | dict(self.arguments)).items()}

    def restore(self, snapshot: Mapping[str, ArrayLike]) -> None:
        """Go on from a snapshot; raises InvalidValueError for one of other copies."""
        held = {name: getattr(self, name) for name in HELD} | dict(self.arguments)
        arrays = fit_saved(snapshot, held, "not a snapshot of these copies")
        check_saved(arrays["status"], "status", 0, len(ALL_STATUS) - 1)
        check_saved(arrays["steps"], "steps", 0, np.inf)
        check_saved(arrays["next_step"], "next_step", 0, LONGEST_STEP)
        for name, array in held.items():
            array[...] = arrays[name]
        self._check(self._evaluate(self._copies, 0, self.n))

    def save(self, path: str | Path) -> None:
        """Write a snapshot into an .npz file, which replaces one that is there."""
        check_path(path, "path")
        write_arrays(path, self.snapshot(), overwrite=True)

    def load(self, path: str | Path) -> None:
        """Go on from a file of `save`; raises SceneError for another file, or one of other copies."""
        self.restore(read_saved(path))

    def copy(self) -> "Stepper":
        """Return another stepper with the same copies."""
        other = Stepper(self.model, self.n, sample=self.sample, quantities=tuple(self.values), **self._given)
        other.restore(self.snapshot())
        return other

    def headline(self) -> str:
        """Return number of copies, sample and how many failed."""
        failed = int(np.count_nonzero(self.status))
        return f"{self.n} copies of {self.model.manifest.name}, sample {self.sample:g} s, {failed} failed"

    def facts(self) -> list[Fact]:
        """Return method and arrays, for `repr` and notebooks."""
        shapes = [f"{name} {array.shape}" for name, array in (*self.values.items(), *self.arguments.items())]
        return [
            ("method", f"{self._options.method}, rtol {self._options.rtol:g}, {self.threads} threads"),
            ("state", str(self.state.shape)),
            ("quantities and arguments", ", ".join(shapes) or "none"),
        ]


def _check_method(manifest: Manifest, options: RunOptions, sample: float) -> None:
    """Raise for a library without functions for copies, and for a method that cannot advance them."""
    if not manifest.copies:
        raise LibraryError(
            "the library has no functions that advance copies",
            where=manifest.name,
            hint='compile_scene(..., for_="step")',
        )
    check_options(options, sample, 2)
    explicit = [
        spec.name
        for spec in manifest.integrators
        if find_row(spec.name, manifest.needs_state_jacobian).kind != "implicit"
    ]
    if options.method not in explicit:
        raise InvalidValueError(
            "copies are advanced by explicit integrators of the library",
            where="method",
            given=options.method,
            allowed=", ".join(explicit),
            hint='compile_scene(..., for_="step", method=...)',
        )
    if options.keep:
        raise InvalidValueError("a stepper keeps no energy", where="keep", given=options.keep, allowed='""')
    if manifest.column_name:
        raise FormulationError(
            "a stepper carries no derivatives", where=manifest.name, given=", ".join(manifest.column_name)
        )
    _check_sample(options, sample)


def _check_sample(options: RunOptions, sample: float) -> float:
    """Return a sample [s] that a fixed step divides; raises InvalidValueError for another."""
    check_positive(sample, "sample", "[s]")
    if options.step is not None:
        count = sample / options.step
        if abs(count - round(count)) > WHOLE * count or round(count) < 1:
            raise InvalidValueError(
                "the step does not divide the sample",
                where="sample",
                given=f"{sample} s, with a step of {options.step} s",
                allowed=f"multiples of {options.step} s",
                hint=f"step={sample / max(1, round(count)):.9g}",
            )
    return float(sample)


def _find_shape(model: CompiledModel, name: str) -> tuple[int, ...]:
    """Return the shape of a quantity that copies can compute; raises UnknownNameError, FormulationError."""
    if not model.has(name):
        hint = f'{suggest(name, model.quantities)}; or compile_scene(..., quantities=("{name}",))'
        raise UnknownNameError(
            "the library does not compute this quantity", where="quantities", given=name, hint=hint
        )
    spec = model.function(name).spec
    if spec.pattern is not None or not {*STATE, *_list_arguments(model)}.issuperset(spec.arguments):
        raise FormulationError("copies compute dense quantities of states", where="quantities", given=name)
    return spec.shape


def _list_arguments(model: CompiledModel) -> dict[str, FloatArray]:
    """Return the run-time arguments that each copy has a row of, as in the scene."""
    return {
        argument.name: model.nominal(argument.name)
        for argument in model.manifest.arguments
        if argument.nominal and argument.name in (*PARAMETERS, INPUT)
    }


def _read_rows(value: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    """Return one row for each copy; raises InvalidValueError."""
    array = to_doubles(value, name, f"shape {shape[1:]} or {shape}")
    if array.shape not in (shape, shape[1:]):
        raise InvalidValueError(
            "wrong shape", where=name, given=array.shape, allowed=f"{shape}, or {shape[1:]} for all alike"
        )
    return np.broadcast_to(array, shape)
