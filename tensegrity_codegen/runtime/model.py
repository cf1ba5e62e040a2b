"""A compiled model: call its functions by quantity name with NumPy arrays. No CasADi in here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from tensegrity_codegen.errors import (
    InvalidValueError,
    LibraryError,
    NonFiniteError,
    UnknownNameError,
    suggest,
)
from tensegrity_codegen.manifest import STATUS, ArgumentSpec, FunctionSpec, Manifest
from tensegrity_codegen.quantities import ARGUMENTS
from tensegrity_codegen.runtime.library import LoadedLibrary

__all__ = ["CompiledFunction", "CompiledModel", "raise_for_status"]

FloatArray = NDArray[np.float64]
DOUBLE = np.dtype(np.float64)


class CompiledFunction:
    """One C function; call it with arrays in the order of `arguments`.

    Arrays that are C-contiguous float64 of the right size are passed without a copy; others are converted.
    """

    def __init__(self, library: LoadedLibrary, spec: FunctionSpec, sizes: Mapping[str, ArgumentSpec]) -> None:
        self.spec = spec
        self.arguments = spec.arguments
        self._shapes = tuple(sizes[name].shape for name in spec.arguments)
        self._sizes = tuple(int(np.prod(shape)) for shape in self._shapes)
        self._size = len(spec.pattern.row) if spec.pattern else int(np.prod(spec.shape))
        self._shape = (self._size,) if spec.pattern else spec.shape or (1,)
        self.values = self._bind(library)

    def __call__(self, *values: ArrayLike, out: FloatArray | None = None) -> Any:
        """Return the quantity: a float, an array of the spec's shape, or a scipy.sparse.csc_array.

        out: array to write dense results or the non-zeros of sparse ones into. Raises InvalidValueError for
        a wrong shape, NonFiniteError if an argument or the result is not finite.
        """
        return self.wrap(self.values(values, out))

    def wrap(self, result: FloatArray) -> Any:
        """Return raw values as what a caller expects: a float, an array or a sparse array."""
        pattern = self.spec.pattern
        if pattern is not None:
            return sparse.csc_array((result, pattern.row, pattern.column_start), shape=pattern.shape)
        return result if self.spec.shape else float(result[0])

    def _bind(self, library: LoadedLibrary) -> Callable[[Sequence[Any], FloatArray | None], FloatArray]:
        """Return the raw call: arrays in, dense values or the non-zeros of a sparse result out.

        Everything it needs is a local of the closure, which halves the time of a call.
        """
        call, empty, shapes, shape = library.symbol(self.spec.symbol), np.empty, self._shapes, self._shape
        pointer = partial(library.ffi.from_buffer, library.ffi.typeof("double[]"))

        def values(arrays: Sequence[Any], out: FloatArray | None = None) -> FloatArray:
            result = empty(shape) if out is None else self._check_out(out, arrays)
            try:
                for array, expected in zip(arrays, shapes, strict=True):
                    if array.shape != expected or array.dtype is not DOUBLE:
                        raise TypeError
                status = call(*map(pointer, arrays), pointer(result))
            except (AttributeError, TypeError, ValueError, BufferError):  # no such array, or not contiguous
                arrays = self._convert_all(arrays)
                status = call(*map(pointer, arrays), pointer(result))
            if status:
                raise_for_status(status, self.spec.quantity, dict(zip(self.arguments, arrays, strict=True)))
            return result

        return values

    def _convert_all(self, values: Sequence[Any]) -> list[FloatArray]:
        if len(values) != len(self._shapes):
            self._refuse_count(len(values))
        return [self._convert(index, value) for index, value in enumerate(values)]

    def _refuse_count(self, given: int) -> None:
        raise InvalidValueError(
            "wrong number of arguments",
            where=self.spec.quantity,
            given=given,
            allowed=f"{len(self.arguments)}: {', '.join(self.arguments)}",
        )

    def _convert(self, index: int, value: ArrayLike) -> FloatArray:
        shape, name = self._shapes[index], self.arguments[index]
        try:
            array = np.ascontiguousarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidValueError(
                "not an array of numbers", where=name, given=value, allowed=f"shape {shape}"
            ) from error
        if array.size != self._sizes[index] or (array.ndim > 1 and array.shape != shape):
            raise InvalidValueError("wrong shape", where=name, given=array.shape, allowed=f"shape {shape}")
        return array

    def _check_out(self, out: FloatArray, arrays: Sequence[Any]) -> FloatArray:
        fits = isinstance(out, np.ndarray) and out.dtype == DOUBLE and out.shape == self._shape
        apart = fits and not any(np.may_share_memory(out, array) for array in arrays)
        if not (apart and out.flags.c_contiguous and out.flags.writeable):
            given = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
            raise InvalidValueError(
                "`out` does not fit",
                where=self.spec.quantity,
                given=given,
                allowed=f"writable C-contiguous float64 of shape {self._shape}, apart from the arguments",
            )
        return out


class CompiledModel:
    """A generated library with its manifest; functions by quantity name.

    path: the shared library; manifest: what it holds (read from `manifest.json` beside it if not given).
    """

    def __init__(self, path: Path | str, manifest: Manifest | None = None) -> None:
        self.path = Path(path)
        self.manifest = manifest or Manifest.read(self.path.parent / "manifest.json")
        self.library = LoadedLibrary(self.path, self.manifest)
        specs = {argument.name: argument for argument in self.manifest.arguments}
        self._nominal = {
            name: np.array(spec.nominal, dtype=np.float64).reshape(spec.shape) for name, spec in specs.items()
        }
        self._functions = {
            spec.quantity: CompiledFunction(self.library, spec, specs) for spec in self.manifest.functions
        }

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that the library computes."""
        return tuple(self._functions)

    def has(self, quantity: str) -> bool:
        """Return whether the library computes `quantity`."""
        return quantity in self._functions

    def function(self, quantity: str) -> CompiledFunction:
        """Return the function of `quantity`; raises UnknownNameError listing the ones there are."""
        if quantity not in self._functions:
            raise UnknownNameError(
                "the library does not compute this quantity",
                where=str(self.path),
                given=quantity,
                hint=f"{suggest(quantity, self._functions)}; or build with it among the wanted quantities",
            )
        return self._functions[quantity]

    def nominal(self, argument: str) -> FloatArray:
        """Return a copy of the scene's own value of an argument, in its shape."""
        if argument not in self._nominal:
            raise UnknownNameError(
                "the library has no such argument",
                where=str(self.path),
                given=argument,
                hint=suggest(argument, self._nominal),
            )
        return self._nominal[argument].copy()

    def compute(self, quantity: str, /, *, out: FloatArray | None = None, **arguments: ArrayLike) -> Any:
        """Return `quantity`; arguments not given take the scene's own values.

        Arguments that this quantity does not depend on are accepted and ignored. Raises UnknownNameError
        for a word that is no argument, and what CompiledFunction raises.
        """
        function = self.function(quantity)
        for name in arguments:
            if name not in ARGUMENTS:
                raise UnknownNameError(
                    "unknown argument", where=quantity, given=name, hint=suggest(name, function.arguments)
                )
        nominal = self._nominal
        values = [arguments[name] if name in arguments else nominal[name] for name in function.arguments]
        return function.wrap(function.values(values, out))


def raise_for_status(status: int, where: str, arguments: Mapping[str, FloatArray]) -> None:
    """Raise the error that a non-zero status stands for, naming the argument and entry at fault."""
    word = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
    if word == "non_finite_input":
        for name, array in arguments.items():
            bad = np.argwhere(~np.isfinite(array))
            if bad.size:
                place = tuple(int(k) for k in bad[0])
                raise NonFiniteError(
                    f"argument {name!r} is not finite at {place}",
                    where=where,
                    given=float(array[place]),
                    allowed="finite numbers",
                )
    if word == "non_finite_result":
        raise NonFiniteError(
            "the result is not finite",
            where=where,
            hint="look for nodes that coincide, a rest length or mass of zero, or an overflow",
        )
    raise LibraryError(f"the library answered {word!r}", where=where)
