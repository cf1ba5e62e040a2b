"""Arguments of a chunk of cases, checked: rows with numbers that are not finite fail alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.arrays import to_array, to_batch
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT, unify_name
from tensegrity_codegen.sweeps.statuses import encode_status
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest
from tensegrity_codegen.tables.quantities import ARGUMENTS

NOT_FINITE = "the value of {name} is not finite"


@dataclass(frozen=True, eq=False)
class CaseArguments:
    """Run-time arguments of a chunk: one row a case, or one value for all.

    rows: arrays (count, ...) by argument, those of cases in `is_bad` replaced by the scene's values; shared:
    arrays without the leading axis; messages: why a case is bad, by its number.
    """

    count: int
    rows: Mapping[str, NDArray[Any]]
    shared: Mapping[str, NDArray[Any]]
    messages: Mapping[int, str]

    @property
    def all(self) -> dict[str, NDArray[Any]]:
        """All arguments, as batch functions take them."""
        return {**self.shared, **self.rows}

    def outcomes(self) -> "Outcomes":
        """Return how the cases ended before anything was computed: good but for bad values."""
        found = Outcomes(np.full(self.count, encode_status("ok"), dtype=np.int8), [""] * self.count)
        for k, message in self.messages.items():
            found.mark(k, "non_finite_input", message)
        return found


@dataclass(frozen=True, eq=False)
class Outcomes:
    """How the cases of a chunk end: codes of `sweeps.statuses` (count,), and a sentence for each case."""

    codes: NDArray[np.int8]
    messages: list[str]

    @property
    def is_ok(self) -> NDArray[np.bool_]:
        """Which cases nothing is known against, (count,)."""
        return np.asarray(self.codes == encode_status("ok"))

    def mark(self, case: int, word: str, message: str) -> None:
        """Note the status of a case."""
        self.codes[case], self.messages[case] = encode_status(word), message

    def mark_ok(self, words: Sequence[str], messages: Sequence[str], first: int = 0) -> None:
        """Note the statuses of consecutive cases, from case `first` on, where none is known yet."""
        for k, (word, message) in enumerate(zip(words, messages, strict=True), first):
            if self.codes[k] == encode_status("ok"):
                self.mark(k, word, message)


def read_case_arguments(model: CompiledModel, arguments: Mapping[str, Any], count: int) -> CaseArguments:
    """Return the arguments of `count` cases; inputs by their names become one array `input`.

    Raises UnknownNameError for an argument that the library does not have, InvalidValueError for a wrong
    shape or inputs that are given twice.
    """
    if count < 1:
        raise InvalidValueError("no cases", where="count", given=count, allowed="1 or more")
    rows: dict[str, NDArray[Any]] = {}
    shared: dict[str, NDArray[Any]] = {}
    for name, value in _merge_inputs(model, arguments, count).items():
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
    return _replace_bad_rows(model, CaseArguments(count, rows, shared, {}))


def _merge_inputs(model: CompiledModel, arguments: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Return the arguments with one array (count, n_inputs) for inputs by name, numbers as they are."""
    manifest, merged = model.manifest, dict(arguments)
    known = [item.name for item in manifest.arguments] + list(manifest.input_name)
    for name in arguments:
        if unify_name(manifest, name) not in ARGUMENTS or name not in known:
            raise UnknownNameError(
                "the library has no such argument",
                where=manifest.name,
                given=name,
                allowed=", ".join(known),
                hint=suggest(name, known),
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
    return CaseArguments(arguments.count, rows, shared, messages)
