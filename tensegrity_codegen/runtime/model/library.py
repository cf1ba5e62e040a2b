"""A loaded shared library: its symbols, checked against its manifest, and its functions over batches."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arrays import to_batch
from tensegrity_codegen.system.binaries import describe_binary
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import (
    AbiMismatchError,
    InvalidValueError,
    LibraryError,
    NonFiniteError,
    check_choice,
)
from tensegrity_codegen.tables.manifest import (
    ABI_VERSION,
    STATUS,
    ArgumentSpec,
    FunctionSpec,
    Manifest,
    Pattern,
)
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.targets import TARGETS, find_host

# The same names for the types of every library.
TYPES = {
    "run": "integrator_run",
    "event": "integrator_event",
    "profile": "integrator_profile",
    "equilibrium_report": "equilibrium_report",
}
FloatArray = NDArray[Any]
StatusArray = NDArray[np.int32]
ON_ERROR = ("raise", "status")
LARGEST_CHUNK = 2**30  # elements of one call, which counts them in an int


def raise_for_status(status: int, where: str, arguments: Mapping[str, NDArray[Any]]) -> None:
    """Raise the error that a non-zero status stands for, naming the argument and entry at fault."""
    reason = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
    if reason == "non_finite_input":
        for name, array in arguments.items():
            bad = np.argwhere(~np.isfinite(array))
            if bad.size:
                index = tuple(int(k) for k in bad[0])
                raise NonFiniteError(
                    f"argument {name!r} is not finite at {index}",
                    where=where,
                    given=float(array[index]),
                    allowed="finite numbers",
                )
    if reason == "non_finite_result":
        raise NonFiniteError(
            "the result is not finite",
            where=where,
            hint="look for nodes that coincide, a rest length or mass of zero, or an overflow",
        )
    raise LibraryError(f"the library returned the status {reason!r}", where=where)


class LoadedLibrary:
    """A generated library in this process, which has to fit its manifest."""

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self.path = path
        self.precision = find_precision(manifest.precision)
        self.batch_width = manifest.batch_width
        _check_target(path, manifest)
        self.ffi = cffi.FFI()
        try:
            self.ffi.cdef(_declarations(manifest))
        except (cffi.FFIError, cffi.CDefError) as error:
            raise LibraryError("the manifest is damaged", where=str(path), hint="build it again") from error
        try:
            # Absolute: a bare file name would be looked up on the system's library path.
            self._library = self.ffi.dlopen(str(path.absolute()))
        except OSError as error:
            raise _explain_refusal(path, error) from error
        self._check_descriptor(manifest)
        self._check_machine(manifest.name)

    def symbol(self, name: str) -> Any:
        """Return the C function of that name."""
        try:
            return getattr(self._library, name)
        except (AttributeError, KeyError) as error:
            raise LibraryError(
                "the library lacks a function that its manifest lists",
                where=str(self.path),
                given=name,
                hint="build it again",
            ) from error

    def _check_descriptor(self, manifest: Manifest) -> None:
        # Version of the interface, precision, and hash of the scene.
        descriptor = self.symbol(f"{manifest.name}_descriptor")
        if descriptor.abi_version != ABI_VERSION:
            raise AbiMismatchError(
                "the library was made for another version of the C interface",
                where=str(self.path),
                given=descriptor.abi_version,
                allowed=str(ABI_VERSION),
                hint="build it again with this version of tensegrity_codegen",
            )
        for name, said, unit in (
            ("precision", "are of different precision", "{} precision"),
            ("scene_hash", "were made from different scenes", "scene hash {:.12}"),
        ):
            here, stated = self.ffi.string(getattr(descriptor, name)), getattr(manifest, name)
            if here.decode("ascii", "replace") != stated:
                raise AbiMismatchError(
                    f"library and manifest {said}",
                    where=str(self.path),
                    given=unit.format(here.decode("ascii", "replace")),
                    allowed=unit.format(stated),
                    hint="build it again",
                )

    def _check_machine(self, name: str) -> None:
        """Raise LibraryError if the library's code needs instructions that this machine lacks."""
        if self.symbol(f"{name}_check_machine")() == 0:
            return
        find, missing = self.symbol(f"{name}_missing_instruction_set"), list[str]()
        while instruction_set := find(len(missing)):
            missing.append(self.ffi.string(instruction_set).decode("ascii", "replace"))
        raise LibraryError(
            "the library was compiled for instructions that this machine lacks",
            where=str(self.path),
            given=f"lacking {', '.join(missing)}",
            allowed="a machine like the one that it was compiled on",
            hint='build it with flags that suit every machine: `flags="reference"`',
        )


def _check_target(path: Path, manifest: Manifest) -> None:
    """Raise LibraryError for a library that was compiled for another machine."""
    if manifest.target and manifest.target != find_host():
        raise LibraryError(
            "the library was compiled for another machine, and cannot be loaded here",
            where=str(path),
            given=manifest.target,
            allowed=find_host(),
            hint="build it without `target`, or run it on that machine",
        )


def _explain_refusal(path: Path, error: OSError) -> LibraryError:
    """Return the error for a file that the system does not load, with its machine if that is the reason."""
    try:
        with path.open("rb") as file:
            binary = describe_binary(file.read(2**16))
    except OSError:
        binary = ""
    here = TARGETS.get(find_host())
    if binary and here is not None and binary != here.binary:
        return LibraryError(
            "the library does not load: it is for another machine",
            where=str(path),
            given=binary,
            allowed=here.binary,
            hint="build it again",
        )
    return LibraryError("the library does not load", where=str(path), given=str(error), hint="build it again")


def _declarations(manifest: Manifest) -> str:
    """Return the declarations of the header, with the common names of its types."""
    declarations = manifest.declarations
    if not declarations:
        raise AbiMismatchError(
            "the manifest does not hold the declarations of the library",
            where=manifest.name,
            hint="build it again with this version of tensegrity_codegen",
        )
    common = [
        f"typedef {manifest.name}_{type_name} {name};"
        for type_name, name in TYPES.items()
        if f"}} {manifest.name}_{type_name};" in declarations
    ]
    return "\n".join((declarations, *common))


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
    """One C function over a batch, of arrays (n_batch, *shape), or of its own shape, shared by all."""

    def __init__(self, library: LoadedLibrary, spec: FunctionSpec, sizes: Mapping[str, ArgumentSpec]) -> None:
        self.spec = spec
        self.arguments = spec.arguments
        self.width = library.batch_width
        self.precision = library.precision
        self._shapes = tuple(sizes[name].shape for name in spec.arguments)
        self._shape = (len(spec.pattern.row),) if spec.pattern else spec.shape
        self._call = library.symbol(f"{spec.symbol}_batch")
        self.address = int(library.ffi.cast("intptr_t", self._call))
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
        # Arrays, and one length of the batch axis.
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
    """Raise InvalidValueError unless this is a number of threads."""
    check_whole(threads, "threads", 1, problem="not a number of threads")
