"""A compiled model: call its functions by quantity name with NumPy arrays. No CasADi in here."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arguments import check_argument_names, merge_inputs
from tensegrity_codegen.runtime.model.arrays import to_array
from tensegrity_codegen.runtime.model.library import BatchFunction, LoadedLibrary, raise_for_status
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance, check_path
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError, UnknownNameError, suggest
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names
from tensegrity_codegen.tables.body_places import show_members, show_nodes
from tensegrity_codegen.tables.manifest import STATUS, ArgumentSpec, FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.quantities import STATE

FloatArray = NDArray[Any]  # float64, or float32 where the library is of single precision


class CompiledFunction:
    """One C function; call it with arrays in the order of `arguments`.

    Arrays that are C-contiguous, of the library's `dtype` (float64, float32 in single precision) and of the
    right size are passed without a copy; others are converted, unless that would round an array's numbers.
    """

    def __init__(self, library: LoadedLibrary, spec: FunctionSpec, sizes: Mapping[str, ArgumentSpec]) -> None:
        self.spec = spec
        self.precision = library.precision
        self.dtype = library.precision.dtype
        self.arguments = spec.arguments
        self._shapes = tuple(sizes[name].shape for name in spec.arguments)
        self._sizes = tuple(int(np.prod(shape)) for shape in self._shapes)
        self._size = len(spec.pattern.row) if spec.pattern else int(np.prod(spec.shape))
        self._shape = (self._size,) if spec.pattern else spec.shape or (1,)
        self.values = self._bind(library)  # also sets _call and _pointer
        self._batch = BatchFunction(library, spec, sizes) if library.batch_width else None

    def __call__(self, *values: ArrayLike, out: FloatArray | None = None) -> Any:
        """Return the quantity, a float, an array or a csc_array; out: for dense results, or non-zeros."""
        return self.wrap(self.values(values, out))

    def rows(self, rows: Mapping[str, FloatArray], shared: Mapping[str, Any], count: int) -> FloatArray:
        """Return raw values (count, ...) of so many calls, NAN in the rows that are not finite.

        rows: arguments that change from call to call, (count, ...); shared: those of all calls.
        """
        result = np.empty((count, *self._shape), self.dtype)
        arrays, steps = [], []
        for index, name in enumerate(self.arguments):
            is_moving = name in rows
            array = rows[name] if is_moving else self._convert(index, shared[name])
            arrays.append(np.ascontiguousarray(array, self.dtype))
            steps.append(self._sizes[index] if is_moving else 0)
            if is_moving and array.size != count * self._sizes[index]:
                allowed = f"shape {(count, *self._shapes[index])}"
                raise InvalidValueError("wrong shape", where=name, given=array.shape, allowed=allowed)
        starts, out = [self._pointer(array) for array in arrays], self._pointer(result)
        for k in range(count):
            places = [start + k * step for start, step in zip(starts, steps, strict=True)]
            status = self._call(*places, out + k * self._size)
            if status:
                if not STATUS[status].startswith("non_finite"):
                    raise_for_status(status, self.spec.quantity, {})
                result[k] = np.nan
        return result

    @property
    def batch(self) -> BatchFunction:
        """The function over a whole batch; raises LibraryError if the library was built without."""
        if self._batch is None:
            raise LibraryError(
                "the library has no batch functions",
                where=self.spec.quantity,
                hint='compile_scene(..., for_="simulate_batch"), or batch_width = 8 under [model]',
            )
        return self._batch

    def wrap(self, result: FloatArray) -> Any:
        """Return raw values as a float, an array or a sparse array."""
        pattern = self.spec.pattern
        if pattern is not None:
            indices = (pattern.row.copy(), pattern.column_start.copy())  # the caller may change the matrix
            return scipy.sparse.csc_array((result, *indices), shape=pattern.shape)
        return result if self.spec.shape else float(result[0])

    def _bind(self, library: LoadedLibrary) -> Callable[[Sequence[Any], FloatArray | None], FloatArray]:
        """Return the raw call, arrays to values; its closure of locals halves the time of a call."""
        call, empty, shapes, shape = library.symbol(self.spec.symbol), np.empty, self._shapes, self._shape
        real = self.dtype
        pointer = partial(library.ffi.from_buffer, library.ffi.typeof(f"{self.precision.c_type}[]"))
        self._call, self._pointer = call, pointer

        def values(arrays: Sequence[Any], out: FloatArray | None = None) -> FloatArray:
            result = empty(shape, real) if out is None else self._check_out(out, arrays)
            try:
                for array, expected in zip(arrays, shapes, strict=True):
                    if array.shape != expected or array.dtype is not real:
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
            raise InvalidValueError(
                "wrong number of arguments",
                where=self.spec.quantity,
                given=len(values),
                allowed=f"{len(self.arguments)}: {', '.join(self.arguments)}",
            )
        return [self._convert(index, value) for index, value in enumerate(values)]

    def _convert(self, index: int, value: ArrayLike) -> FloatArray:
        shape, name = self._shapes[index], self.arguments[index]
        array = np.ascontiguousarray(to_array(value, self.precision, name, f"shape {shape}"))
        if array.size != self._sizes[index] or (array.ndim > 1 and array.shape != shape):
            raise InvalidValueError("wrong shape", where=name, given=array.shape, allowed=f"shape {shape}")
        return array

    def _check_out(self, out: FloatArray, arrays: Sequence[Any]) -> FloatArray:
        fits = isinstance(out, np.ndarray) and out.dtype == self.dtype and out.shape == self._shape
        is_separate = fits and not any(np.may_share_memory(out, array) for array in arrays)
        if not (is_separate and out.flags.c_contiguous and out.flags.writeable):
            description = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
            raise InvalidValueError(
                "`out` has the wrong type or shape",
                where=self.spec.quantity,
                given=description,
                allowed=f"writable C-contiguous {self.dtype} {self._shape}, apart from the arguments",
            )
        return out


class CompiledModel(Summarised):
    """A compiled library and its manifest.

    Parameters
    ----------
    path : Path or str
        The shared library.
    manifest : Manifest, optional
        By default read from ``manifest.json`` beside the library.
    precision : str, optional
        ``"double"`` or ``"single"``: raise LibraryError if the library has the other precision.
    structure : Structure or BodySystem, optional
        What the library was made from, with its actuators, sensors and limits, which the library and its
        manifest do not contain.

    Attributes
    ----------
    path, manifest, library
        As given, and the loaded library.
    structure : Structure, BodySystem or None
        As given; set in models of compile_scene and build_library, None in a library that was loaded alone.
    build_twin : callable or None
        What makes `rigid_twin`; set in models for motions of compile_scene and build_library.

    Raises
    ------
    LibraryError
        The library cannot be loaded, or does not match its manifest.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene
    >>> model = compile_scene("two_nodes.toml")
    >>> float(model.compute("total_energy"))
    -4.905
    """

    def __init__(
        self,
        path: Path | str,
        manifest: Manifest | None = None,
        *,
        precision: str | None = None,
        structure: Structure | BodySystem | None = None,
    ) -> None:
        check_path(path, "path")
        if manifest is not None:
            check_instance(manifest, Manifest, "manifest", "a Manifest, or None")
        if structure is not None:
            check_instance(
                structure, (Structure, BodySystem), "structure", "a Structure or BodySystem, or None"
            )
        self.path = Path(path)
        self.structure = structure
        self.build_twin: Callable[[], CompiledModel | None] | None = None
        self.manifest = manifest or Manifest.read(self.path.parent / "manifest.json")
        if precision is not None:
            require_precision(self.manifest, precision, str(self.path))
        self.library = LoadedLibrary(self.path, self.manifest)
        self._kept: dict[Hashable, Any] = {}
        specs = {argument.name: argument for argument in self.manifest.arguments}
        self._nominal = {
            name: np.array(spec.nominal, dtype=self.dtype).reshape(spec.shape) for name, spec in specs.items()
        }
        self._functions = {
            spec.quantity: CompiledFunction(self.library, spec, specs) for spec in self.manifest.functions
        }

    def keep(self, key: Hashable, find: Callable[[], Any]) -> Any:
        """Return what `find` found at the first call with this key: facts that no argument changes."""
        if key not in self._kept:
            self._kept[key] = find()
        return self._kept[key]

    def __reduce__(self) -> tuple[Any, ...]:
        """Return path, manifest and structure: the library is loaded again, from the same path."""
        return _load, (self.path, self.manifest, self.structure, self.build_twin)

    @cached_property
    def rigid_twin(self) -> "CompiledModel | None":
        """The model of the same structure with corrected rigid bars, built when first asked for.

        None where bars are not stiff, or something else keeps `auto` from choosing it. It has the coordinates
        and run-time arguments of this one.
        """
        return None if self.build_twin is None else self.build_twin()

    def stepper(self, n: int = 1, **options: Any) -> Any:
        """Return a `Stepper`: n copies of the motion that are advanced sample by sample, see there."""
        from importlib import import_module  # a room above this one

        return import_module("tensegrity_codegen.runtime.stepper.stepper").Stepper(self, n, **options)

    def headline(self) -> str:
        """Return name, formulation and precision."""
        return f"{self.manifest.name}, {self.manifest.formulation}, {self.manifest.precision} precision"

    def facts(self) -> list[Fact]:
        """Return sizes, names and quantities, for `repr` and notebooks."""
        manifest = self.manifest
        runs = [argument.name for argument in manifest.integrators] + [
            argument.name for argument in manifest.solvers
        ]
        inputs = count_names(manifest.input_name)
        bodies = [body.name for body in manifest.body_places]
        named = [("bodies", count_names(bodies))] if bodies else []
        return [
            ("nodes", count_names(show_nodes(manifest.node_name, manifest.body_places))),
            ("members", count_names(show_members(manifest.member_name, manifest.body_places))),
            *named,
            ("coordinates", f"{len(manifest.coordinate_name)}; inputs: {inputs}"),
            ("quantities", ", ".join(self.quantities)),
            ("integrators and solvers", ", ".join(runs) or "none"),
            ("library", str(self.path)),
        ]

    @property
    def dtype(self) -> np.dtype[Any]:
        """NumPy's type of every number that the library takes and returns."""
        return self.library.precision.dtype

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that the library computes."""
        return tuple(self._functions)

    def has(self, quantity: str) -> bool:
        """Return whether the library computes `quantity`."""
        return isinstance(quantity, str) and quantity in self._functions

    def function(self, quantity: str) -> CompiledFunction:
        """Return the function of `quantity`; raises UnknownNameError listing the ones there are."""
        if not self.has(quantity):
            raise UnknownNameError(
                "the library does not compute this quantity",
                where=str(self.path),
                given=quantity,
                hint=f"{suggest(quantity, self._functions)}; or add it to the quantities and build again",
            )
        return self._functions[quantity]

    def nominal(self, argument: str) -> FloatArray:
        """Return a copy of the scene's own value of an argument, in its shape."""
        if not isinstance(argument, str) or argument not in self._nominal:
            raise UnknownNameError(
                "the library has no such argument",
                where=str(self.path),
                given=argument,
                hint=suggest(argument, self._nominal),
            )
        return self._nominal[argument].copy()

    def compute(self, quantity: str, /, *, out: FloatArray | None = None, **arguments: ArrayLike) -> Any:
        """Compute a quantity for one state.

        Parameters
        ----------
        quantity : str
            Name of the quantity.
        out : ndarray, optional
            Array for the result, or for the non-zeros of a sparse result.
        **arguments : array_like
            Values by name, inputs also by their own names; by default those of the scene. Arguments of the
            library on which the quantity does not depend are ignored.

        Returns
        -------
        float, ndarray or scipy.sparse.csc_array
            In the shape that the manifest states.

        Raises
        ------
        UnknownNameError
            An unknown quantity or argument.
        InvalidValueError
            A wrong shape.
        NonFiniteError
            An argument or the result is not finite.
        """
        function = self.function(quantity)
        return function.wrap(function.values(self._complete(function, arguments, is_batch=False), out))

    def compute_entries(
        self, quantity: str, /, **arguments: ArrayLike
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
        """Compute a sparse quantity for one state, without SciPy, which takes longer to import.

        Parameters
        ----------
        quantity : str
            Name of a quantity that is a sparse matrix.
        **arguments : array_like
            As for `compute`.

        Returns
        -------
        row, column : ndarray of int, shape (n_entries,)
            Places of the entries, column by column.
        value : ndarray, shape (n_entries,)
            The entries.

        Raises
        ------
        InvalidValueError
            The quantity is not sparse, or as for `compute`.
        """
        function = self.function(quantity)
        pattern = function.spec.pattern
        if pattern is None:
            raise InvalidValueError("not a sparse matrix", where="quantity", given=quantity)
        value = function.values(self._complete(function, arguments, is_batch=False), None)
        column = np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.column_start))
        return np.array(pattern.row, dtype=np.int64), column, value

    def compute_rows(
        self, quantity: str, rows: Mapping[str, FloatArray], shared: Mapping[str, Any], count: int
    ) -> FloatArray:
        """Compute a dense quantity for a few states, one call of C after the other, NAN where not finite.

        Parameters
        ----------
        quantity : str
            Name of the quantity.
        rows : mapping of str to ndarray, shape (count, ...)
            Arguments that change from state to state.
        shared : mapping
            Other arguments that are not the scene's.
        count : int
            Number of states.

        Returns
        -------
        ndarray, shape (count, ...)

        Raises
        ------
        UnknownNameError
            An unknown quantity.
        InvalidValueError
            A wrong shape.
        """
        return self.function(quantity).rows(rows, {**self._nominal, **shared}, count)

    def compute_batch(
        self, quantity: str, /, *, threads: int = 1, on_error: str = "raise", **arguments: ArrayLike
    ) -> Any:
        """Compute a quantity for many states or parameter sets.

        Parameters
        ----------
        quantity : str
            Name of the quantity.
        threads : int
            Number of threads; the results do not depend on it.
        on_error : str
            ``"raise"``, or ``"status"`` to return (result, status of each element), with rows of NAN if it
            failed.
        **arguments : array_like
            Values by name, with a leading axis (n_batch,) or without it where all elements share them. At
            least one has that axis.

        Returns
        -------
        ndarray or SparseBatch
            Shape (n_batch, ...) of the quantity.

        Raises
        ------
        LibraryError
            The library has no batch functions.
        UnknownNameError, InvalidValueError, NonFiniteError
            As for compute; the message names the first element that failed.
        """
        function = self.function(quantity)
        values = self._complete(function, arguments, is_batch=True)
        return function.batch(*values, threads=threads, on_error=on_error)

    def _complete(
        self, function: CompiledFunction, arguments: Mapping[str, ArrayLike], *, is_batch: bool
    ) -> list[Any]:
        """Return the values of all arguments of a function, in its order, the omitted ones at the scene's."""
        nominal = self._nominal
        if any(name not in nominal for name in arguments):
            check_argument_names(self.manifest, arguments, states=STATE)
            arguments = merge_inputs(self.manifest, arguments, is_batch=is_batch, dtype=self.dtype)
        return [arguments[name] if name in arguments else nominal[name] for name in function.arguments]


def _load(
    path: Path, manifest: Manifest, structure: Structure | BodySystem | None, build_twin: Any = None
) -> CompiledModel:
    model = CompiledModel(path, manifest, structure=structure)
    model.build_twin = build_twin
    return model


def require_precision(manifest: Manifest, precision: str, where: str, hint: str = "") -> None:
    """Raise LibraryError unless the library is of that precision, FormulationError for an unknown word."""
    wanted = find_precision(precision).name
    if manifest.precision != wanted:
        raise LibraryError(
            f"a library of {manifest.precision} precision, where {wanted} precision is asked for",
            where=where,
            given=f"precision {manifest.precision!r}",
            allowed=f"precision {wanted!r}",
            hint=hint or f'build it with model.precision = "{wanted}"',
        )
