"""A compiled library of a tensegrity structure, called through ctypes; written by tensegrity_codegen.

tensegrity_codegen copies this file into the packages that it makes. It needs the standard library and NumPy.
"""

import ctypes
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "BranchLostError",
    "Equilibrium",
    "InvalidArgumentError",
    "Library",
    "Motion",
    "NonFiniteInputError",
    "NonFiniteResultError",
    "NotConvergedError",
    "SparseMatrix",
    "StatusError",
    "StepTooSmallError",
    "TooManyEventsError",
    "UnstableError",
    "UnsupportedMachineError",
]

Arguments = Mapping[str, ArrayLike | None]


class StatusError(RuntimeError):
    """A function of the library returned a status that is not 0.

    function: name of the C function; status: what it returned.
    """

    def __init__(self, function: str, status: int, meaning: str) -> None:
        super().__init__(f"{function}: {meaning} (status {status})")
        self.function, self.status = function, status


class NonFiniteInputError(StatusError, ValueError):
    """An argument holds a NaN or an infinity."""


class NonFiniteResultError(StatusError, ArithmeticError):
    """The result is not finite, as where the two nodes of a member are at one place."""


class InvalidArgumentError(StatusError, ValueError):
    """A step, a tolerance or a count is out of range."""


class StepTooSmallError(StatusError):
    """No step that the time can resolve meets the tolerance."""


class UnsupportedMachineError(StatusError, ImportError):
    """The library was compiled for instructions that this machine lacks."""


class TooManyEventsError(StatusError):
    """Events follow each other within ever shorter parts of a step."""


class NotConvergedError(StatusError):
    """No equilibrium within the allowed iterations, or no step decreases the energy."""


class UnstableError(StatusError):
    """An equilibrium that is no minimum of the energy."""


class BranchLostError(StatusError):
    """The equilibria of a path end, as at a limit point."""


# By number from 1 on; 0 is success.
STATUS_ERRORS: tuple[type[StatusError], ...] = (
    NonFiniteInputError,
    NonFiniteResultError,
    InvalidArgumentError,
    StatusError,  # a pointer that is NULL, which no function here passes
    StepTooSmallError,
    UnsupportedMachineError,
    TooManyEventsError,
    NotConvergedError,
    UnstableError,
    BranchLostError,
)


class _Short:
    """A result whose `repr` has the shapes of arrays instead of their numbers."""

    def __repr__(self) -> str:
        values = ((name, getattr(value, "shape", value)) for name, value in vars(self).items())
        return f"{type(self).__name__}({', '.join(f'{name}={value}' for name, value in values)})"


@dataclass(frozen=True, repr=False)
class SparseMatrix(_Short):
    """A matrix in compressed columns.

    shape: rows and columns.
    row: row of each non-zero.
    column_start: where each column starts among them, with the end of the last one.
    values: the non-zeros; ``scipy.sparse.csc_array((values, row, column_start), shape)`` is the same matrix.
    """

    shape: tuple[int, int]
    row: NDArray[np.int32]
    column_start: NDArray[np.int32]
    values: NDArray[Any]

    def to_dense(self) -> NDArray[Any]:
        """Return the matrix with its zeros, (rows, columns)."""
        matrix = np.zeros(self.shape, self.values.dtype)
        matrix[self.row, np.repeat(np.arange(self.shape[1]), np.diff(self.column_start))] = self.values
        return matrix


@dataclass(frozen=True, repr=False)
class Motion(_Short):
    """A motion at sample times.

    Attributes
    ----------
    time : ndarray, (n_samples,)
        Sample times [s].
    coordinate, velocity : ndarray, (n_samples, n_coordinates)
        State at each of them [m], [m/s].
    n_steps, n_rejected : int
        Accepted and rejected steps.
    """

    time: NDArray[np.float64]
    coordinate: NDArray[Any]
    velocity: NDArray[Any]
    n_steps: int
    n_rejected: int


@dataclass(frozen=True, repr=False)
class Equilibrium(_Short):
    """A stable equilibrium.

    Attributes
    ----------
    coordinate : ndarray, (n_coordinates,)
        Coordinates [m].
    iterations : int
        Steps of Newton's method.
    residual : float
        Largest remaining static force [N].
    smallest_pivot : float
        Of the Cholesky factors of the Hessian; positive at a minimum of the energy.
    potential_energy : float
        Potential energy [J].
    """

    coordinate: NDArray[Any]
    iterations: int
    residual: float
    smallest_pivot: float
    potential_energy: float


class _Description(ctypes.Structure):
    """The first fields of the descriptor of a library."""

    _fields_ = (
        ("abi_version", ctypes.c_int),
        ("name", ctypes.c_char * 64),
        ("scene_hash", ctypes.c_char * 65),
    )


class _Report(ctypes.Structure):
    """What the search for an equilibrium reports."""

    _fields_ = (
        ("status", ctypes.c_int),
        ("iterations", ctypes.c_int),
        ("shifted", ctypes.c_int),
        ("contraction", ctypes.c_double),
        ("residual", ctypes.c_double),
        ("smallest_pivot", ctypes.c_double),
        ("potential_energy", ctypes.c_double),
    )


class Library:
    """A compiled library with its manifest.

    folder: folder of library and manifest.json; file_name: file name of the library. Raises ImportError: the
    library does not load on this machine, or is not the one of the manifest.
    """

    def __init__(self, folder: Path, file_name: str) -> None:
        self.path = folder / file_name
        self.manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        self.name = str(self.manifest["name"])
        self.dtype = np.dtype(np.float32 if self.manifest["precision"] == "single" else np.float64)
        self.n_coordinates = len(self.manifest["coordinate_name"])
        self._arguments = {argument["name"]: argument for argument in self.manifest["arguments"]}
        self._functions = {function["quantity"]: function for function in self.manifest["functions"]}
        self._integrators = {integrator["name"]: integrator for integrator in self.manifest["integrators"]}
        self._solvers = {solver["name"]: solver for solver in self.manifest["solvers"]}
        self.c = self._load()

    def names(self, key: str) -> tuple[str, ...]:
        """Return names of the manifest, as of "node_name"."""
        return tuple(self.manifest[key])

    def nominal(self, argument: str) -> NDArray[Any]:
        """Return the value of an argument in the scene, as a new array."""
        spec = self._arguments[argument]
        return np.array(spec["nominal"], dtype=self.dtype).reshape(spec["shape"])

    def compute(self, quantity: str, arguments: Arguments) -> NDArray[Any]:
        """Return a quantity as an array, (); (n,); ...: of a sparse matrix its non-zeros.

        Raises a subclass of StatusError, or ValueError or TypeError for an argument of another shape or type.
        """
        spec = self._functions[quantity]
        pattern = spec["pattern"]
        result = np.empty(spec["shape"] if pattern is None else len(pattern["row"]), dtype=self.dtype)
        self._call(spec["symbol"], *self._read(spec["arguments"], arguments), result)
        return result

    def compute_sparse(self, quantity: str, arguments: Arguments) -> SparseMatrix:
        """Return a quantity that is a sparse matrix; errors as in `compute`."""
        pattern = self._functions[quantity]["pattern"]
        row = np.array(pattern["row"], dtype=np.int32)
        start = np.array(pattern["column_start"], dtype=np.int32)
        rows, columns = pattern["shape"]
        return SparseMatrix((rows, columns), row, start, self.compute(quantity, arguments))

    def integrate_steps(
        self, name: str, step: float, n_steps: int, sample_time: ArrayLike | None, arguments: Arguments
    ) -> Motion:
        """Integrate with fixed steps from time 0; without sample times all steps are samples.

        arguments: also "coordinate" and "velocity", where the motion starts.
        """
        spec = self._integrators[name]
        time = np.arange(n_steps + 1) * step if sample_time is None else sample_time
        time, samples, sampled = self._samples(time)
        state, done = self._state(arguments), ctypes.c_longlong(0)
        self._call(
            spec["symbol"],
            *(ctypes.c_double(0.0), ctypes.c_double(step), ctypes.c_longlong(0), ctypes.c_longlong(n_steps)),
            state,
            *self._read(spec["arguments"], arguments),
            *(ctypes.c_longlong(len(time)), time, samples, ctypes.byref(sampled), ctypes.byref(done)),
            np.zeros(spec["work_size"], dtype=self.dtype),
        )
        return self._motion(time, samples, sampled.value, done.value, 0)

    def integrate(
        self,
        name: str,
        t_end: float,
        rtol: float,
        atol: float,
        most_steps: int,
        sample_time: ArrayLike | None,
        arguments: Arguments,
        *,
        is_implicit: bool = False,
    ) -> Motion:
        """Integrate with error control from time 0; default: 101 sample times over the whole time.

        is_implicit: whether tensions of stiff members are unknowns of the integrator.
        """
        spec = self._integrators[name]
        time, samples, sampled = self._samples(
            np.linspace(0.0, t_end, 101) if sample_time is None else sample_time
        )
        state = self._state(arguments)
        now, step = ctypes.c_double(0.0), ctypes.c_double(0.0)
        counts = (ctypes.c_longlong * 6)()
        if is_implicit:
            tensions = [np.zeros((len(time), max(len(spec["tensions"]), 1)))]
            counted: list[Any] = [counts, np.zeros(3)]
        else:
            tensions = []
            rejected = ctypes.byref(counts, ctypes.sizeof(ctypes.c_longlong))
            counted = [counts, rejected]
        self._call(
            spec["symbol"],
            *(
                ctypes.c_double(t_end),
                ctypes.c_double(rtol),
                ctypes.c_double(atol),
                ctypes.c_longlong(most_steps),
            ),
            *(ctypes.byref(now), ctypes.byref(step), state),
            *self._read(spec["arguments"], arguments),
            *(ctypes.c_longlong(len(time)), time, samples, *tensions, ctypes.byref(sampled)),
            *counted,
            np.zeros(spec["work_size"], dtype=self.dtype),
        )
        if now.value < t_end:
            problem = f"{most_steps} steps reach {now.value:.6g} s of {t_end:.6g} s"
            raise NotConvergedError(spec["symbol"], 0, problem)
        return self._motion(time, samples, sampled.value, counts[0], counts[1])

    def find_equilibrium(self, tolerance: float, most_iterations: int, arguments: Arguments) -> Equilibrium:
        """Return a minimum of the potential energy near arguments["coordinate"]."""
        spec, report = self._solvers["equilibrium"], _Report()
        coordinate = self._one("coordinate", arguments.get("coordinate")).copy()
        self._call(
            spec["symbol"],
            coordinate,
            *self._read(spec["arguments"], arguments),
            *(ctypes.c_double(tolerance), ctypes.c_int(most_iterations), ctypes.byref(report)),
            np.zeros(spec["work_size"], dtype=self.dtype),
        )
        return Equilibrium(
            coordinate,
            int(report.iterations),
            float(report.residual),
            float(report.smallest_pivot),
            float(report.potential_energy),
        )

    def _load(self) -> ctypes.CDLL:
        """Load the library and compare it with the manifest."""
        try:
            library = ctypes.CDLL(str(self.path))
            descriptor = _Description.in_dll(library, f"{self.name}_descriptor")
        except (OSError, ValueError) as error:
            target = self.manifest["target"] or "the machine that it was built on"
            raise ImportError(f"{self.path} does not load; it was compiled for {target}: {error}") from error
        expected = (self.manifest["abi_version"], self.manifest["scene_hash"])
        if (descriptor.abi_version, descriptor.scene_hash.decode("ascii", "replace")) != expected:
            raise ImportError(f"{self.path} is not the library of the manifest beside it; install it again")
        status = int(getattr(library, f"{self.name}_check_machine")())
        if status:
            _raise(f"{self.name}_check_machine", status)
        return library

    def _call(self, symbol: str, *arguments: Any) -> None:
        """Call a C function; arrays are passed by their addresses."""
        passed = [
            ctypes.c_void_p(argument.ctypes.data) if isinstance(argument, np.ndarray) else argument
            for argument in arguments
        ]
        status = int(getattr(self.c, symbol)(*passed))
        if status:
            _raise(symbol, status)

    def _read(self, names: list[str], arguments: Arguments) -> list[NDArray[Any]]:
        return [self._one(name, arguments.get(name)) for name in names]

    def _one(self, name: str, value: ArrayLike | None) -> NDArray[Any]:
        """Return an argument as an array that C can read; None: as in the scene."""
        if value is None:
            return self.nominal(name)
        if isinstance(value, np.ndarray) and self.dtype == np.float32 and value.dtype == np.float64:
            raise TypeError(f"{name}: the library computes in single precision; pass an array of float32")
        array = np.ascontiguousarray(value, dtype=self.dtype)
        shape = tuple(self._arguments[name]["shape"])
        if np.shape(value) != shape:
            raise ValueError(f"{name}: given an array of shape {np.shape(value)}, needed {shape}")
        return array.reshape(shape)

    def _state(self, arguments: Arguments) -> NDArray[Any]:
        """Return coordinates, then velocities."""
        return np.concatenate([self._one(name, arguments.get(name)) for name in ("coordinate", "velocity")])

    def _samples(self, time: ArrayLike) -> tuple[NDArray[np.float64], NDArray[Any], ctypes.c_longlong]:
        times = np.ascontiguousarray(time, dtype=np.float64)
        if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) < 0):
            raise ValueError("sample_time: needed are finite times in ascending order, (n_samples,)")
        samples = np.full((len(times), 2 * self.n_coordinates), np.nan, dtype=self.dtype)
        return times, samples, ctypes.c_longlong(0)

    def _motion(
        self, time: NDArray[np.float64], samples: NDArray[Any], n_sampled: int, n_steps: int, n_rejected: int
    ) -> Motion:
        coordinate, velocity = np.split(samples[:n_sampled], 2, axis=1)
        return Motion(time[:n_sampled], coordinate, velocity, n_steps, n_rejected)


def _raise(symbol: str, status: int) -> None:
    """Raise the error of a status."""
    is_listed = 0 < status <= len(STATUS_ERRORS)
    error = STATUS_ERRORS[status - 1] if is_listed else StatusError
    meaning = (error.__doc__ or "").partition("\n")[0].rstrip(".") if error is not StatusError else "failed"
    raise error(symbol, status, meaning)
