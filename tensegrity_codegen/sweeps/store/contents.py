"""The content of a store: its arrays with dimensions, chunks and attributes, and the attributes of all."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.record import Output
from tensegrity_codegen.analyses.cases.statuses import NOT_COMPUTED, STATUSES
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.folder import ATTRIBUTE, FORMAT, MESSAGE, RECORD, STATUS

TASK = "task"
NOT_COMPUTED_CODE = -1  # status of a case whose task is not finished
OWN_NAMES = (STATUS, MESSAGE, RECORD, TASK, "case", "sample")
TEXT = "string"


@dataclass(frozen=True, eq=False)
class StoredArray:
    """One array of a store.

    name: its name.
    dims: names of its dimensions.
    shape, chunks: its size, and the size of its chunks, along each.
    dtype: ``"string"``, or a type of NumPy.
    fill: the value where nothing was written.
    attributes: units and description.
    values: what it holds from the beginning; None for results.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    fill: Any
    attributes: dict[str, Any]
    values: NDArray[Any] | None = None


@dataclass(frozen=True, eq=False)
class StoreContents:
    """Cases and results of a sweep, as they are stored.

    layout: how they lie in the arrays.
    outputs: results of a case.
    identity: what the results follow from, JSON-ready: another sweep has another identity.
    facts: what else is known of it, JSON-ready: attributes of the data set.
    """

    cases: Cases
    layout: CaseLayout
    outputs: tuple[Output, ...]
    identity: Mapping[str, Any]
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def case_dims(self) -> tuple[str, ...]:
        """Dimensions of the cases: the axes of the grid, then "sample"; "case" without a grid."""
        axes = tuple(self.name_key(axis.key) for axis in self.cases.axes)
        if self.cases.points is None:
            return axes
        return (*axes, "sample") if axes else ("case",)

    @property
    def output_dims(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of each result besides the cases; where two differ under one name, the name is added."""
        found: dict[str, tuple[int, tuple[Any, ...]]] = {}
        named = {}
        for output in self.outputs:
            dims = []
            for dim, size in zip(output.dims, output.shape, strict=True):
                axis = (size, tuple(output.coordinates.get(dim, ())))
                dims.append(dim if found.setdefault(dim, axis) == axis else f"{dim}_of_{output.name}")
            named[output.name] = tuple(dims)
        return named

    def name_key(self, key: str) -> str:
        """Return the name of the coordinate of a key: the key, unless a result has that name."""
        taken = {*OWN_NAMES, *(name for output in self.outputs for name in (output.name, *output.dims))}
        return f"varied.{key}" if key in taken else key

    def list_arrays(self) -> list[StoredArray]:
        """Return all arrays but the values of a sample or table."""
        sentence = {"long_name": "JSON of each finished task: its cases, time, attempts and machine"}
        return [
            *self._axes(),
            *self._labels(),
            *self._results(),
            StoredArray(RECORD, (TASK,), (self.layout.n_tasks,), (1,), TEXT, "", sentence),
        ]

    def list_key_arrays(self) -> list[StoredArray]:
        """Return the arrays of the values of a sample or table, one a key."""
        points = self.cases.points
        if points is None:
            return []
        chunk = (max(self.layout.chunk[-1], min(points.count, 2**16)),)
        return [
            StoredArray(
                name, self.case_dims[-1:], (points.count,), chunk, "float64", np.nan, self._describe_key(key)
            )
            for key, name in zip(points.keys, map(self.name_key, points.keys), strict=True)
        ]

    def list_attributes(self) -> dict[str, Any]:
        """Return the attributes of the data set."""
        names = [array.name for array in self.list_key_arrays()]
        coordinates = {"coordinates": " ".join(names)} if names else {}
        own = {
            "format": FORMAT,
            "identity": dict(self.identity),
            "task_size": self.layout.task_size,
            "case_dims": list(self.case_dims),
            "keys": {key: self.name_key(key) for key in self.cases.keys},
        }
        return {**self.facts, **coordinates, ATTRIBUTE: own}

    def _describe_key(self, key: str) -> dict[str, Any]:
        known: Mapping[str, dict[str, Any]] = self.facts.get("key_attributes", {})
        return dict(known.get(key, {"long_name": f"{key} of the scene"}))

    def _axes(self) -> Iterator[StoredArray]:
        for axis in self.cases.axes:
            name = self.name_key(axis.key)
            yield _whole(name, (name,), axis.values, self._describe_key(axis.key))

    def _labels(self) -> Iterator[StoredArray]:
        done = set()
        for output in self.outputs:
            for dim, name in zip(output.dims, self.output_dims[output.name], strict=True):
                labels = output.coordinates.get(dim)
                if labels is not None and name not in done:
                    done.add(name)
                    unit = {"units": "s"} if dim == "time" else {}
                    yield _whole(name, (name,), np.asarray(labels), unit)

    def _results(self) -> Iterator[StoredArray]:
        shape, chunk, dims = self.layout.shape, self.layout.chunk, self.case_dims
        words = [NOT_COMPUTED, *STATUSES]
        flags = {"flag_values": list(range(-1, len(STATUSES))), "flag_meanings": " ".join(words)}
        sentence = {"long_name": "how the case ended", **flags}
        yield StoredArray(STATUS, dims, shape, chunk, "int8", NOT_COMPUTED_CODE, sentence)
        sentence = {"long_name": "why the case ended so, where there is something to say"}
        yield StoredArray(MESSAGE, dims, shape, chunk, TEXT, "", sentence)
        for output in self.outputs:
            attributes = {"units": output.unit, "long_name": output.sentence}
            attributes |= {"expression": output.expression} if output.expression else {}
            is_float = np.dtype(output.dtype).kind == "f"
            yield StoredArray(
                output.name,
                (*dims, *self.output_dims[output.name]),
                (*shape, *output.shape),
                (*chunk, *(max(size, 1) for size in output.shape)),
                output.dtype,
                np.nan if is_float else -1,
                attributes,
            )


def _whole(name: str, dims: tuple[str, ...], values: NDArray[Any], attributes: dict[str, Any]) -> StoredArray:
    is_text = values.dtype.kind in "UO"
    dtype, fill = (TEXT, "") if is_text else (values.dtype.name, np.nan if values.dtype.kind == "f" else 0)
    chunks = tuple(max(size, 1) for size in values.shape)
    return StoredArray(name, dims, values.shape, chunks, dtype, fill, attributes, values)
