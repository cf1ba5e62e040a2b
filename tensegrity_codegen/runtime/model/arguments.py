"""Run-time arguments: names, inputs by their own names, values that no scene has, loads and ground."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.runtime.model.arrays import agree_on_rows, to_doubles
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.quantities import ARGUMENTS, STATE
from tensegrity_codegen.tables.quantities.arguments import ABOVE_ZERO, FROM_ZERO, GROUND_FROM_ZERO

DOUBLE: np.dtype[Any] = np.dtype(np.float64)
INPUT = "input"  # the argument that holds all inputs
LOAD = "node_load"


def merge_inputs(
    manifest: Manifest,
    arguments: Mapping[str, Any] | None,
    base: ArrayLike | None = None,
    *,
    is_batch: bool = False,
    dtype: np.dtype[Any] = DOUBLE,
) -> dict[str, Any]:
    """Return run-time arguments by name, inputs given by their own names as one array `input`."""
    values = read_arguments(arguments)
    check_argument_names(manifest, [name for name in values if name not in STATE])
    named = [name for name in values if unify_name(manifest, name) == INPUT and name != INPUT]
    if not named:
        return values
    if INPUT in values:
        raise InvalidValueError(
            "an input is given twice",
            where=f"arguments.{named[0]}",
            given=f"{named[0]}, and the array {INPUT} of all inputs",
            allowed=f"names of inputs, or {INPUT}: {', '.join(manifest.input_name)}",
        )
    numbers = {name: _number(name, values.pop(name), is_batch=is_batch) for name in named}
    lengths = {name: len(value) for name, value in numbers.items() if value.ndim}
    rows = (agree_on_rows(lengths, "arguments", "one number for a single motion"),) if lengths else ()
    spec = manifest.find_argument(INPUT)
    stated = np.zeros(len(manifest.input_name)) if spec is None else np.array(spec.nominal, dtype=np.float64)
    start = stated if base is None else np.asarray(base, dtype=np.float64)
    merged = np.array(np.broadcast_to(start, (*rows, len(manifest.input_name))), dtype=dtype)
    for name, value in numbers.items():
        merged[..., manifest.input_name.index(name)] = value
    return values | {INPUT: merged}


def check_argument_names(manifest: Manifest, names: Iterable[str], states: Iterable[str] = ()) -> None:
    """Raise UnknownNameError for a word that is no argument of the model at run time or one of `states`."""
    valid_names = [entry.name for entry in manifest.arguments if entry.name not in ("coordinate", "velocity")]
    valid_names += [*states, *manifest.input_name]
    for name in names:
        if name not in valid_names:
            raise UnknownNameError(
                "the model has no such argument at run time",
                where="arguments",
                given=name,
                allowed=", ".join(valid_names) or "none",
                hint=_explain_missing(name, valid_names),
            )


def _explain_missing(name: str, valid_names: list[str]) -> str:
    """Return a hint for a word that is no argument at run time."""
    if name in ("coordinate", "velocity"):
        return "pass the initial state as coordinate= and velocity=, outside of arguments"
    if name == INPUT:
        return "the scene has no inputs: state them under [[inputs]] and build again"
    if name in ARGUMENTS:
        return (
            f"it is a constant of this library: list it under [parameters] {name}, or in parameters= of "
            "compile_scene or of a ModelRequest, and build again"
        )
    return suggest(name, valid_names)


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


def check_arguments(manifest: Manifest, arguments: Mapping[str, Any]) -> None:
    """Raise for words that are no run-time argument, and for values that no scene has; None is allowed."""
    check_argument_names(manifest, arguments)
    check_parameter_values(manifest, arguments)


def check_parameter_values(manifest: Manifest, arguments: Mapping[str, Any]) -> None:
    """Raise InvalidValueError for run-time parameters with values that no scene can have.

    Rest lengths and stiffnesses are above zero, dampings, masses, friction and dissipation not negative. A
    stiffness that is zero in the scene, since the member has the other kind, may stay zero. `compute`
    evaluates at any values.
    """
    for name in (*ABOVE_ZERO, *FROM_ZERO):
        spec = manifest.find_argument(name)
        if spec is None or arguments.get(name) is None:
            continue
        try:
            value = np.asarray(arguments[name], dtype=np.float64)
        except (TypeError, ValueError):  # no array of numbers: refused where shapes are checked
            continue
        wrong = value < 0
        if name in ABOVE_ZERO and value.shape[value.ndim - len(spec.shape) :] == spec.shape:
            is_above = ~np.isin(spec.over, GROUND_FROM_ZERO) if name == "ground" else True
            wrong = wrong | ((value == 0) & (np.reshape(spec.nominal, spec.shape) > 0) & is_above)
        if wrong.any():
            at = tuple(int(k) for k in np.argwhere(wrong)[0])
            element = spec.over[at[-1]] if spec.over and len(spec.over) == value.shape[-1] else str(list(at))
            raise InvalidValueError(
                "no structure has such a value",
                where=f"arguments.{name}: {element}",
                given=float(value[at]),
                allowed="above 0" if name in ABOVE_ZERO and element not in GROUND_FROM_ZERO else "0 or more",
            )
        if name == "body_inertia" and value.ndim and value.shape[-1] == 3:
            _check_inertia(value.reshape(-1, 3))


def _check_inertia(rows: NDArray[np.float64]) -> None:
    """Raise InvalidValueError for principal inertias (n, 3) that no body has."""
    low, middle, high = rows.T
    slack = 1e-12 * high
    wrong = (low > middle + slack) | (middle > high + slack) | (high > low + middle + slack)
    if wrong.any():
        problem, given = "no body has these principal inertias", rows[wrong.argmax()].tolist()
        raise InvalidValueError(
            problem, where="arguments.body_inertia", given=given, allowed="a <= b <= c <= a + b"
        )


def apply_ground(model: Model, arguments: Mapping[str, Any]) -> Ground | None:
    """Return the ground of a model under run-time arguments, None if it has none."""
    ground: Ground | None = getattr(getattr(model, "structure", None), "ground", None)
    values = arguments.get("ground")
    if ground is None or values is None:
        return ground
    names = model.manifest.argument("ground").over
    return replace(ground, **dict(zip(names, np.ravel(values).tolist(), strict=True)))


def apply_loads(model: Model, *values: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Return loads (n_t, n_nodes, 3) [N] under arguments `values`; None if they are the scene's."""
    spec = model.manifest.find_argument(LOAD)
    structure = getattr(model, "structure", None)
    if spec is None or structure is None:
        return None
    rows = [model.manifest.node_name.index(name) for name in spec.over]
    load: NDArray[np.float64] = np.tile(
        np.asarray(structure.node_load, dtype=np.float64), (len(values), 1, 1)
    )
    for k, row_values in enumerate(values):
        if row_values.get(LOAD) is not None:
            load[k][np.ix_(rows, list(model.manifest.axes))] = np.reshape(row_values[LOAD], spec.shape)
    return load
