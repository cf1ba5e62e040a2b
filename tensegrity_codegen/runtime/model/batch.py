"""A function over a whole batch: elements side by side in the lanes of a core, chunks of them in threads."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arrays import to_batch
from tensegrity_codegen.runtime.model.library import LoadedLibrary, raise_for_status
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import InvalidValueError, check_choice
from tensegrity_codegen.tables.manifest import ArgumentSpec, FunctionSpec, Pattern

FloatArray = NDArray[Any]
StatusArray = NDArray[np.int32]

ON_ERROR = ("raise", "status")
LARGEST_CHUNK = 2**30  # elements of one call, which counts them in an int


@dataclass(frozen=True, eq=False)
class SparseBatch:
    """Sparse matrices of one pattern: values (n_batch, n_nonzeros), pattern of compressed columns.

    `batch[k]` is matrix k as a scipy.sparse.csc_array; numpy.asarray(batch) are the values.
    """

    values: FloatArray
    pattern: Pattern

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, k: int) -> "scipy.sparse.csc_array":
        pattern = (self.pattern.row.copy(), self.pattern.column_start.copy())
        return scipy.sparse.csc_array((self.values[k].copy(), *pattern), shape=self.pattern.shape)

    def __iter__(self) -> "Iterator[scipy.sparse.csc_array]":
        return (self[k] for k in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> FloatArray:
        return np.array(self.values, dtype=dtype, copy=copy) if copy else np.asarray(self.values, dtype=dtype)


class BatchFunction:
    """One C function over a batch; call it with arrays in the order of `arguments`.

    An argument of shape (n_batch, *shape) has one row an element, one of its own shape is shared by all.
    """

    def __init__(self, library: LoadedLibrary, spec: FunctionSpec, sizes: Mapping[str, ArgumentSpec]) -> None:
        self.spec = spec
        self.arguments = spec.arguments
        self.width = library.batch_width
        self.precision = library.precision
        self._shapes = tuple(sizes[name].shape for name in spec.arguments)
        self._shape = (len(spec.pattern.row),) if spec.pattern else spec.shape
        self._call = library.symbol(f"{spec.symbol}_batch")
        self._pointer = partial(library.ffi.from_buffer, library.ffi.typeof(f"{self.precision.c_type}[]"))
        self._status_pointer = partial(library.ffi.from_buffer, library.ffi.typeof("int[]"))

    def __call__(self, *values: ArrayLike, threads: int = 1, on_error: str = "raise") -> Any:
        """Return the quantity of every element, (n_batch, *shape) or a SparseBatch; see compute_batch."""
        check_threads(threads)
        check_choice(on_error, ON_ERROR, "word", "on_error")
        arrays, n_batch = self._convert_all(values)
        result = np.empty((n_batch, *self._shape), self.precision.dtype)
        status = np.zeros(n_batch, np.int32)
        self._run(arrays, result, status, threads)
        answer = SparseBatch(result, self.spec.pattern) if self.spec.pattern else result
        if on_error == "status":
            return answer, status
        if status.any():
            self._raise(arrays, status)
        return answer

    def _run(
        self, arrays: Sequence[tuple[FloatArray, bool]], result: FloatArray, status: StatusArray, threads: int
    ) -> None:
        """Fill result and status; each chunk but the last is a whole number of lanes wide."""
        n_batch = len(status)
        blocks = -(-n_batch // self.width)
        chunk = self.width * min(-(-blocks // threads), LARGEST_CHUNK // self.width)
        starts = range(0, n_batch, max(chunk, 1))

        def evaluate(start: int) -> None:
            stop = min(start + chunk, n_batch)
            passed: list[Any] = []
            for array, is_batched in arrays:
                passed += [
                    self._pointer(array[start:stop] if is_batched else array),
                    int(np.prod(array.shape[1:])) if is_batched else 0,
                ]
            self._call(
                stop - start,
                *passed,
                self._pointer(result[start:stop]),
                self._status_pointer(status[start:stop]),
            )

        if len(starts) < 2:
            for start in starts:
                evaluate(start)
            return
        from concurrent.futures import ThreadPoolExecutor  # which imports logging

        with ThreadPoolExecutor(threads) as pool:  # the calls into C hold no lock of Python's
            list(pool.map(evaluate, starts))

    def _convert_all(self, values: Sequence[ArrayLike]) -> tuple[list[tuple[FloatArray, bool]], int]:
        """Return each array with whether it has the batch axis, and how long that axis is."""
        if len(values) != len(self.arguments):
            raise InvalidValueError(
                "wrong number of arguments",
                where=self.spec.quantity,
                given=len(values),
                allowed=f"{len(self.arguments)}: {', '.join(self.arguments)}",
            )
        arrays = [
            to_batch(value, shape, self.precision, name)
            for value, shape, name in zip(values, self._shapes, self.arguments, strict=True)
        ]
        lengths = {
            name: len(a) for name, (a, is_batched) in zip(self.arguments, arrays, strict=True) if is_batched
        }
        if not lengths:
            raise InvalidValueError(
                "no argument has a batch axis",
                where=self.spec.quantity,
                allowed=f"a leading axis on one of {', '.join(self.arguments)}" if self.arguments else "",
                hint="use compute() for a single state",
            )
        if len(set(lengths.values())) > 1:
            raise InvalidValueError(
                "arguments of different batch lengths",
                where=self.spec.quantity,
                given=", ".join(f"{name} {length}" for name, length in lengths.items()),
                allowed="one length, or no leading axis where all elements share a value",
            )
        return arrays, next(iter(lengths.values()))

    def _raise(self, arrays: Sequence[tuple[FloatArray, bool]], status: StatusArray) -> None:
        bad = np.flatnonzero(status)
        failed = int(bad[0])
        rows = {
            name: array[failed] if is_batched else array
            for name, (array, is_batched) in zip(self.arguments, arrays, strict=True)
        }
        location = f"{self.spec.quantity}: element {failed} of {len(status)}"
        if len(bad) > 1:
            location += f", the first of {len(bad)} that failed"
        raise_for_status(int(status[failed]), location, rows)


def check_threads(threads: int) -> None:
    """Raise InvalidValueError for what is no number of threads."""
    check_whole(threads, "threads", 1, problem="not a number of threads")
