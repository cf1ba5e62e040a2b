"""Names of run-time arguments, and inputs by their own: {"motor": 0.01} beside {"input": [0.01, 0.0]}."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arrays import agree_on_rows, to_doubles
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import ARGUMENTS, STATE

DOUBLE: np.dtype[Any] = np.dtype(np.float64)
INPUT = "input"  # the argument that holds all inputs


def merge_inputs(
    manifest: Manifest,
    arguments: Mapping[str, Any] | None,
    base: ArrayLike | None = None,
    *,
    is_batch: bool = False,
    dtype: np.dtype[Any] = DOUBLE,
) -> dict[str, Any]:
    """Return run-time arguments where inputs given by their names are one array `input`.

    arguments: with `is_batch` also (n_batch,). Returns (n_inputs,). Raises UnknownNameError for a word that
    is no argument of the library; InvalidValueError where an input is no; number, or inputs are given by name
    and as an array too; NonFiniteError for a number that is not finite.
    """
    given = read_arguments(arguments)
    check_argument_names(manifest, [name for name in given if name not in STATE])
    named = [name for name in given if unify_name(manifest, name) == INPUT and name != INPUT]
    if not named:
        return given
    if INPUT in given:
        raise InvalidValueError(
            "an input is given twice",
            where=f"arguments.{named[0]}",
            given=f"{named[0]}, and the array {INPUT} of all inputs",
            allowed=f"names of inputs, or {INPUT}: {', '.join(manifest.input_name)}",
        )
    values = {name: _number(name, given.pop(name), is_batch=is_batch) for name in named}
    lengths = {name: len(value) for name, value in values.items() if value.ndim}
    rows = (agree_on_rows(lengths, "arguments", "one number for a single motion"),) if lengths else ()
    start = _stated(manifest) if base is None else np.asarray(base, dtype=np.float64)
    merged = np.array(np.broadcast_to(start, (*rows, len(manifest.input_name))), dtype=dtype)
    for name, value in values.items():
        merged[..., manifest.input_name.index(name)] = value
    return given | {INPUT: merged}


def check_argument_names(manifest: Manifest, names: Iterable[str], states: Iterable[str] = ()) -> None:
    """Raise UnknownNameError for a word that is no argument of the model at run time or one of `states`."""
    known = [item.name for item in manifest.arguments if item.name not in ("coordinate", "velocity")]
    known += states
    for name in names:
        if name not in (*known, *manifest.input_name):
            raise UnknownNameError(
                "the model has no such argument at run time",
                where="arguments",
                given=name,
                allowed=", ".join([*known, *manifest.input_name]) or "none",
                hint=_explain_missing(name, [*known, *manifest.input_name]),
            )


def _explain_missing(name: str, known: list[str]) -> str:
    """Return what to do about a word that is no argument at run time."""
    if name in ("coordinate", "velocity"):
        return "pass the initial state as coordinate= and velocity=, outside of arguments"
    if name == INPUT:
        return "the scene has no inputs: state them under [[inputs]] and build again"
    if name in ARGUMENTS:
        return (
            f"it is a constant of this library: list it under [parameters] {name}, or in parameters= of "
            "compile_scene or of a ModelRequest, and build again"
        )
    return suggest(name, known)


def read_arguments(arguments: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return run-time arguments by name as a new dictionary; raises InvalidValueError for anything else."""
    is_named = isinstance(arguments, Mapping) and all(isinstance(name, str) for name in arguments)
    if arguments is not None and not is_named:
        raise InvalidValueError(
            "not values by name",
            where="arguments",
            given=arguments,
            allowed='a dictionary, such as {"gravity": [0, 0, -9.81]}',
        )
    return dict(arguments or {})


def unify_name(manifest: Manifest, name: str) -> str:
    """Return the run-time argument that a word stands for: `input` for the name of an input."""
    return INPUT if name in manifest.input_name and name not in ARGUMENTS else name


def _stated(manifest: Manifest) -> NDArray[np.float64]:
    """Return the scene's inputs, (n_inputs,)."""
    spec = next((item for item in manifest.arguments if item.name == INPUT), None)
    return np.zeros(len(manifest.input_name)) if spec is None else np.array(spec.nominal, dtype=np.float64)


def _number(name: str, value: Any, *, is_batch: bool) -> NDArray[np.float64]:
    allowed = "a number, or one for each element of the batch: (n_batch,)" if is_batch else "a number"
    array = np.zeros((0, 0)) if value is None else to_doubles(value, f"arguments.{name}", allowed)
    if array.shape == (1,) and not is_batch:
        array = array.reshape(())
    if array.ndim > int(is_batch):
        raise InvalidValueError(
            "not the value of one input", where=f"arguments.{name}", given=value, allowed=allowed
        )
    if not np.all(np.isfinite(array)):
        raise NonFiniteError(
            "not a finite number", where=f"arguments.{name}", given=value, allowed="a finite number"
        )
    return array
