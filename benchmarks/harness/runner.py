"""The loops of runner.c from Python: seconds that many calls of a C function take."""

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.compiled import Built, Compilation
from tensegrity_codegen.codegen.compilation.flags import Compiler

Run = Callable[[int], float]
Array = NDArray[Any]


class Runner:
    """The compiled loops; every method returns run(count) -> seconds. Arrays are kept alive by it."""

    def __init__(self, compilation: Compilation, compiler: Compiler) -> None:
        source = Path(__file__).with_name("runner.c").read_text(encoding="utf-8")
        command = (*compiler.command, "-std=c99", "-O2", "-fPIC", "-shared", "runner.c")
        built = compilation.build({"runner.c": source}, command, version=compiler.version)
        self._library = ctypes.CDLL(built.path)
        for name in ("time_plain", "time_batch", "time_casadi", "time_pair"):
            getattr(self._library, name).restype = ctypes.c_double

    def plain(self, built: Built, symbol: str, arguments: Sequence[Array], result: Array) -> Run:
        """Time int f(const real *argument, ..., real *result)."""
        function, pointers = _symbol(built, symbol), _pointers(arguments)
        time, kept = self._library.time_plain, (arguments, result)
        fixed = (function, len(arguments), pointers, _address(kept[1]))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def batch(self, built: Built, symbol: str, arguments: Sequence[Array], result: Array) -> Run:
        """Time int f(int n_batch, const real *argument, int stride, ..., real *result, int *status).

        arguments, result: arrays with a leading batch axis.
        """
        function, pointers = _symbol(built, symbol), _pointers(arguments)
        strides = (ctypes.c_int * len(arguments))(*[array[0].size for array in arguments])
        time, kept = self._library.time_batch, (arguments, result)
        fixed = (function, len(arguments), len(result), pointers, strides, _address(kept[1]))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def casadi(self, built: Built, symbol: str, argument: Array, result: Array) -> Run:
        """Time a function of CasADi's C interface with one argument and one result."""
        function = _symbol(built, symbol)
        sizes = [ctypes.c_longlong() for _ in range(4)]
        getattr(ctypes.CDLL(built.path), f"{symbol}_work")(*map(ctypes.byref, sizes))
        n_arg, n_res, n_iw, n_w = (max(1, size.value) for size in sizes)
        arg, res = (ctypes.c_void_p * n_arg)(), (ctypes.c_void_p * n_res)()
        arg[0], res[0] = argument.ctypes.data, result.ctypes.data
        integers, work = np.zeros(n_iw, dtype=np.int64), np.zeros(n_w)
        time, kept = self._library.time_casadi, (argument, result, integers, work)
        fixed = (function, arg, res, _address(integers), _address(work))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), kept)

    def pair(self, function: Any, model: int, data: int) -> Run:
        """Time void f(const void *model, void *data) at two addresses."""
        time = self._library.time_pair
        fixed = (function, ctypes.c_void_p(model), ctypes.c_void_p(data))
        return lambda count: _positive(time(*fixed, ctypes.c_long(count)), None)


def _symbol(built: Built, name: str) -> Any:
    return getattr(ctypes.CDLL(built.path), name)


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _pointers(arrays: Sequence[Array]) -> Any:
    return (ctypes.c_void_p * max(1, len(arrays)))(*[array.ctypes.data for array in arrays])


def _positive(seconds: float, kept: object) -> float:
    """Return the seconds; a negative answer means a signature that runner.c does not have."""
    if seconds < 0:
        raise TypeError("runner.c has no loop for this number of arguments")
    return float(seconds)
