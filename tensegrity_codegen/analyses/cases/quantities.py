"""Arguments of a chunk of cases, checked, and quantities for every case, in batches if possible.

Rows with numbers that are not finite fail alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.statuses import encode_status
from tensegrity_codegen.runtime.model.arguments import INPUT, unify_name
from tensegrity_codegen.runtime.model.arrays import to_array, to_batch
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.condition_text import POSITION
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.tables.manifest import FunctionSpec
from tensegrity_codegen.tables.quantities import ARGUMENTS

GUST, GUST_TIME = "gust", "gust_time"  # forces on nodes for a limited time, in closed loops
GUST_TIMES = {"start": 0.0, "duration": 0.2}  # [s], unless a key states them
# Arguments that only closed loops have: properties of actuators and sensors, and a gust.
OF_LOOPS = ("actuator_delay", "actuator_rate", "sensor_noise", GUST, GUST_TIME)
NOT_FINITE = "the value of {name} is not finite"


def build_no_gust(subject: Subject) -> dict[str, FloatArray]:
    """Return forces of no gust (n_nodes, 3) [N], and its start and duration (2,) [s]."""
    return {GUST: np.zeros((subject.n_nodes, 3)), GUST_TIME: np.array([*GUST_TIMES.values()])}


@dataclass(frozen=True, eq=False)
class CaseArguments:
    """Run-time arguments of a chunk: one row a case, or one value for all.

    rows: arrays (count, ...) by argument, those of cases in `is_bad` replaced by the scene's values; shared:
    arrays without the leading axis; messages: why a case is bad, by its number; loops: rows that only
    closed loops have, delays of the actuators (count, n_actuators) [s] and noise of the sensors.
    """

    count: int
    rows: Mapping[str, NDArray[Any]]
    shared: Mapping[str, NDArray[Any]]
    messages: Mapping[int, str]
    loops: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def all(self) -> dict[str, NDArray[Any]]:
        """All arguments, as batch functions take them."""
        return {**self.shared, **self.rows}

    def select_case(self, k: int) -> dict[str, NDArray[Any]]:
        """Return the arguments of case `k`."""
        return {**self.shared, **{name: array[k] for name, array in self.rows.items()}}

    def outcomes(self) -> "Outcomes":
        """Return the outcomes before the computation: "non_finite_input" for bad cases, else "ok"."""
        outcomes = Outcomes(np.full(self.count, encode_status("ok"), dtype=np.int8), [""] * self.count)
        for k, message in self.messages.items():
            outcomes.mark(k, "non_finite_input", message)
        return outcomes


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Codes of `STATUSES` (count,) and messages of the cases of a chunk."""

    codes: NDArray[np.int8]
    messages: list[str]

    @property
    def is_ok(self) -> NDArray[np.bool_]:
        """Which cases have not failed, (count,)."""
        return np.asarray(self.codes == encode_status("ok"))

    def mark(self, case: int, status: str, message: str) -> None:
        """Note the status of a case."""
        self.codes[case], self.messages[case] = encode_status(status), message

    def mark_ok(self, statuses: Sequence[str], messages: Sequence[str], start: int = 0) -> None:
        """Note the statuses of consecutive cases, from case `start` on, of those that are ok so far."""
        for k, (status, message) in enumerate(zip(statuses, messages, strict=True), start):
            if self.codes[k] == encode_status("ok"):
                self.mark(k, status, message)


def read_case_arguments(model: CompiledModel, arguments: Mapping[str, Any], count: int) -> CaseArguments:
    """Return the arguments of `count` cases; inputs by their names become one array `input`."""
    if count < 1:
        raise InvalidValueError("no cases", where="count", given=count, allowed="1 or more")
    rows: dict[str, NDArray[Any]] = {}
    shared: dict[str, NDArray[Any]] = {}
    loops = {name: np.asarray(arguments[name]) for name in OF_LOOPS if name in arguments}
    model_arguments = {name: value for name, value in arguments.items() if name not in loops}
    for name, value in _merge_inputs(model, model_arguments, count).items():
        shape = model.nominal(name).shape
        array, is_batched = to_batch(value, shape, model.library.precision, name)
        if is_batched and len(array) != count:
            raise InvalidValueError(
                "another number of cases",
                where=name,
                given=f"{len(array)} rows",
                allowed=f"{count} rows, or one value without a leading axis",
            )
        (rows if is_batched else shared)[name] = array
    return _replace_bad_rows(model, CaseArguments(count, rows, shared, {}, loops))


def _merge_inputs(model: CompiledModel, arguments: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Return the arguments with one array (count, n_inputs) for inputs by name, numbers as they are."""
    manifest, merged = model.manifest, dict(arguments)
    valid_names = [argument.name for argument in manifest.arguments] + list(manifest.input_name)
    for name in arguments:
        if unify_name(manifest, name) not in ARGUMENTS or name not in valid_names:
            raise UnknownNameError(
                "the library has no such argument",
                where=manifest.name,
                given=name,
                allowed=", ".join(valid_names),
                hint=suggest(name, valid_names),
            )
    named = [name for name in arguments if name != INPUT and unify_name(manifest, name) == INPUT]
    if not named:
        return merged
    if INPUT in arguments:
        raise InvalidValueError(
            "an input is given twice",
            where=f"arguments.{named[0]}",
            given=f"{named[0]}, and the array {INPUT} of all inputs",
            allowed=f"names of inputs, or {INPUT}",
        )
    values = np.tile(model.nominal(INPUT), (count, 1))
    for name in named:
        column = to_array(merged.pop(name), model.library.precision, name, f"a number, or ({count},)")
        if column.shape not in ((), (count,)):
            raise InvalidValueError(
                "another number of cases", where=name, given=column.shape, allowed=f"({count},)"
            )
        values[:, manifest.input_name.index(name)] = column
    return merged | {INPUT: values}


def _replace_bad_rows(model: CompiledModel, arguments: CaseArguments) -> CaseArguments:
    """Return the arguments with the scene's values in rows that are not finite, and messages of these."""
    messages: dict[int, str] = {}
    rows, shared = dict(arguments.rows), dict(arguments.shared)
    for name, array in arguments.shared.items():
        if not np.isfinite(array).all():
            shared[name] = model.nominal(name)
            messages |= dict.fromkeys(range(arguments.count), NOT_FINITE.format(name=name))
    for name, array in arguments.rows.items():
        bad = np.flatnonzero(~np.isfinite(array.reshape(arguments.count, -1)).all(axis=1))
        if len(bad):
            rows[name] = array.copy()
            rows[name][bad] = model.nominal(name)
            messages |= {int(k): NOT_FINITE.format(name=name) for k in bad}
    return replace(arguments, rows=rows, shared=shared, messages=messages)


RealArray = NDArray[Any]


def compute_rows(
    model: CompiledModel, quantity: str, case_arguments: CaseArguments, threads: int = 1
) -> tuple[RealArray, BoolArray]:
    """Return a quantity (count, ...) and whether each row is finite; sparse matrices as dense arrays."""
    function = model.function(quantity)
    if not any(name in case_arguments.rows for name in function.arguments):
        values, is_good = _compute_each(model, quantity, replace(case_arguments, count=1, rows={}))
        values = np.repeat(values, case_arguments.count, axis=0)
        is_good = np.repeat(is_good, case_arguments.count)
    elif model.library.batch_width:
        answer, status = model.compute_batch(
            quantity, threads=threads, on_error="status", **case_arguments.all
        )
        values, is_good = np.asarray(answer), status == 0
    else:
        values, is_good = _compute_each(model, quantity, case_arguments)
    return _fill_pattern(values, function.spec), is_good


def compute_values(
    model: CompiledModel, names: Iterable[str], case_arguments: CaseArguments, threads: int = 1
) -> dict[str, tuple[RealArray, BoolArray]]:
    """Return quantities by name, each as `compute_rows` does, positions of nodes as (count, n_nodes, 3)."""
    return {
        name: place_rows(model, case_arguments, threads)
        if name == POSITION
        else compute_rows(model, name, case_arguments, threads)
        for name in names
    }


def place_rows(
    model: CompiledModel, case_arguments: CaseArguments, threads: int = 1
) -> tuple[RealArray, BoolArray]:
    """Return positions of all nodes (count, n_nodes, 3) [m], and whether each row is finite."""
    manifest = model.manifest
    axes, node_axis = list(manifest.axes), manifest.coordinate_place
    result = np.tile(manifest.stated_position.astype(model.dtype), (case_arguments.count, 1, 1))
    if not manifest.coordinate_node_axis:
        position, is_good = compute_rows(model, POSITION, case_arguments, threads)
        result[..., axes] = position
        return result, is_good
    arguments = case_arguments.all
    changeable = manifest.find_argument("anchor_position")
    if changeable is not None and "anchor_position" in arguments:
        nodes = np.array([manifest.node_name.index(name) for name in changeable.over])
        result[:, nodes[:, None], axes] = arguments["anchor_position"]
    result[:, node_axis[:, 0], node_axis[:, 1]] = arguments.get("coordinate", model.nominal("coordinate"))
    return result, np.isfinite(result).all(axis=(1, 2))


def _compute_each(
    model: CompiledModel, quantity: str, case_arguments: CaseArguments
) -> tuple[RealArray, BoolArray]:
    """Return the values one case after the other; of sparse matrices the non-zeros, (count, n_nonzeros)."""
    function, rows, shared = model.function(quantity), case_arguments.rows, case_arguments.shared
    row_names = [name for name in function.arguments if name in rows]
    values = [shared[name] if name in shared else model.nominal(name) for name in function.arguments]
    indices = {name: function.arguments.index(name) for name in row_names}
    pattern = function.spec.pattern
    shape = (len(pattern.row),) if pattern else function.spec.shape
    result = np.full((case_arguments.count, *shape), np.nan, dtype=model.dtype)
    is_good = np.ones(case_arguments.count, dtype=np.bool_)
    for k in range(case_arguments.count):
        for name in row_names:
            values[indices[name]] = rows[name][k]
        try:
            result[k] = function.values(values, None).reshape(shape)
        except NonFiniteError:
            is_good[k] = False
    return result, is_good


def _fill_pattern(values: RealArray, spec: FunctionSpec) -> RealArray:
    """Return dense matrices of the non-zeros of sparse ones, anything else as it is."""
    if spec.pattern is None:
        return values
    column = np.repeat(np.arange(spec.shape[1]), np.diff(spec.pattern.column_start))
    dense = np.zeros((len(values), *spec.shape), dtype=values.dtype)
    dense[:, spec.pattern.row, column] = values
    return dense


OF_STIFFNESS = ("spring_constant", "axial_stiffness", "rest_length")
BEYOND = "members buckle, are strained by more than 1 %, or exceed a limit"


def compute_limit_use(
    model: CompiledModel, case_arguments: CaseArguments, rows: slice, tension: FloatArray, length: FloatArray
) -> FloatArray:
    """Return the largest use of a limit in each case, (count,); NaN with a library that was loaded alone."""
    structure, count = model.structure, len(tension)
    if structure is None or not structure.n_members:
        return np.full(count, np.nan)
    values = {name: getattr(structure, name) for name in OF_STIFFNESS}
    for argument in model.manifest.arguments:
        if argument.name in values and argument.name in case_arguments.all:
            array = np.tile(values[argument.name], (count, 1))
            members = [structure.member_name.index(name) for name in argument.over]
            array[:, members] = (
                case_arguments.rows[argument.name][rows]
                if argument.name in case_arguments.rows
                else case_arguments.shared[argument.name]
            )
            values[argument.name] = array
    elastic = values["axial_stiffness"] + values["spring_constant"] * values["rest_length"]
    if elastic.ndim == 2:
        elastic = elastic.reshape(count, *(1,) * (tension.ndim - 2), -1)
    use = check_members(structure, tension, length, elastic=elastic).largest_use
    return np.asarray(np.fmax.reduce(use.reshape(count, -1), axis=1))
