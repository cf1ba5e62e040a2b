"""Results of a stored sweep: cases and statuses at once, quantities piece by piece, scenes of cases."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.statuses import GOOD, NOT_COMPUTED, STATUSES
from tensegrity_codegen.scene.describe import describe_bodies, describe_structure
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.sweeps.apply.array_keys import INPUT, ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import build_assembler
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.folder import (
    ATTRIBUTE,
    MESSAGE,
    RECORD,
    STATUS,
    check_not_damaged,
    read_stored_sweep,
)
from tensegrity_codegen.sweeps.store.store import NOT_COMPUTED_CODE, open_group
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

MOST_LETTERS = 36  # of a key along an axis


@dataclass(frozen=True)
class KeptQuantity:
    """A quantity of all cases.

    name, unit, sentence: what it is; blocks: blocks() yields (first, values): the first case and the
    values (n, *shape) of consecutive cases, read one after the other; cases that are not computed need
    not be among them.
    """

    name: str
    dims: tuple[str, ...]  # names of its dimensions after that of the case
    shape: tuple[int, ...]  # their lengths
    unit: str
    sentence: str
    labels: tuple[Sequence[Any], ...]  # labels along each dimension, texts or numbers
    blocks: Callable[[], Iterator[tuple[int, FloatArray]]]


@dataclass(frozen=True)
class SweepResults:
    """A sweep as it is stored.

    scene, operation: name of the scene; what was done with each case.
    scene_file: name of the file that was swept.
    """

    path: Path  # the store
    scene: str
    operation: str
    options: Mapping[str, Any]  # options of the operation, by the names of Python arguments
    keep: tuple[str, ...]  # results to keep, as on the command line
    keys: tuple[str, ...]  # names of varied numbers
    axes: tuple[tuple[str, FloatArray], ...]  # axes of the grid; empty without a grid
    method: str  # how cases were made: grid, random, latin_hypercube, sobol, saltelli, table
    ranges: Mapping[str, str]  # how each key varies, as it was written on the command line
    seed: int | None  # of the samples
    key_values: FloatArray  # values of the keys
    status: NDArray[np.int64]  # place of the status of each case in `words`
    words: tuple[str, ...]  # statuses
    message: Callable[[int], str]  # message(case) returns the message of a case, "" if there is none
    kept: Mapping[str, KeptQuantity]  # quantities by name
    key_units: Mapping[str, str] = field(default_factory=dict)  # units of keys, if known
    scene_file: str = ""

    @property
    def count(self) -> int:
        """Number of cases."""
        return len(self.status)

    @property
    def is_good(self) -> NDArray[np.bool_]:
        """Which cases have a result, shape (count,)."""
        return np.isin(self.status, [k for k, status in enumerate(self.words) if status in GOOD])

    @property
    def is_computed(self) -> NDArray[np.bool_]:
        """Which cases are computed, shape (count,)."""
        return np.isin(self.status, [k for k, status in enumerate(self.words) if status != NOT_COMPUTED])

    def label_key(self, key: str) -> str:
        """Return a key with its unit, for axes; of a long key the end, in which keys differ."""
        short, unit = shorten_key(key, MOST_LETTERS), self.key_units.get(key, "")
        return f"{short} [{unit}]" if unit not in ("", "1") else short


def shorten_key(key: str, length: int) -> str:
    """Return the end of a long key, in which keys differ."""
    return key if len(key) <= length else "…" + key[1 - length :]


def read_results(path: str | Path) -> SweepResults:
    """Return a stored sweep, finished or not."""
    stored = read_stored_sweep(path)
    check_not_damaged(stored)
    group, layout, scene = open_group(stored), stored.layout, stored.identity.get("scene")
    name = scene.get("name") if isinstance(scene, Mapping) else None
    sweep = stored.attributes[ATTRIBUTE]
    status = group[STATUS]
    cases = stored.identity.get("cases", {})
    keys: Mapping[str, str] = sweep["keys"]
    # Values of keys and statuses are read at once, results in blocks when they are used.
    columns = [np.asarray(group[name][...], dtype=np.float64) for name in keys.values()]
    n_axes = len(cases.get("axes", ()))
    codes = np.asarray(status[...]).ravel().astype(np.int64)
    operation = dict(stored.identity.get("operation", {}))
    return SweepResults(
        path=stored.path,
        scene=str(name or stored.path.stem),
        operation=str(operation.pop("do", "")),
        options={name: value for name, value in operation.items() if name != "keep"},
        keep=tuple(operation.get("keep", ())),
        keys=tuple(keys),
        axes=tuple(zip(list(keys)[:n_axes], columns[:n_axes], strict=True)),
        method=str(cases.get("method", "")),
        ranges=_describe_ranges(cases),
        seed=cases.get("points", {}).get("seed"),
        key_values=_spread(columns, n_axes, layout),
        status=np.where(codes == NOT_COMPUTED_CODE, len(STATUSES), codes),
        words=(*STATUSES, NOT_COMPUTED),
        message=lambda case: str(group[MESSAGE][np.unravel_index(case, layout.shape)]),
        kept=_find_kept(group, set(keys.values()), layout),
        scene_file=str(stored.attributes.get("scene_file") or ""),
        key_units={key: str(group[name].attrs.get("units", "")) for key, name in keys.items()},
    )


def _describe_ranges(cases: Mapping[str, Any]) -> dict[str, str]:
    """Return how each key varies, as on the command line."""
    ranges = {}
    for axis in cases.get("axes", ()):
        values = axis.get("values")
        short = values is not None and len(values) <= 6
        ends = (values[0], values[-1]) if values else (axis.get("first", 0.0), axis.get("last", 0.0))
        ranges[axis["key"]] = (
            ", ".join(f"{value:g}" for value in values)
            if short
            else f"{axis['count']} values from {ends[0]:g} to {ends[1]:g}"
        )
    return ranges | dict(cases.get("points", {}).get("distributions", {}))


def _spread(columns: list[FloatArray], n_axes: int, layout: CaseLayout) -> FloatArray:
    """Return the values of all keys for all cases, (count, n_keys)."""
    values = np.empty((layout.count, len(columns)))
    for index, column in enumerate(columns):
        dim = index if index < n_axes else len(layout.shape) - 1
        inner = math.prod(layout.shape[dim + 1 :])
        values[:, index] = np.tile(np.repeat(column, inner), layout.count // max(inner * len(column), 1))
    return values


def _find_kept(group: Any, coordinates: set[str], layout: CaseLayout) -> dict[str, KeptQuantity]:
    """Return the arrays whose first dimensions are those of the cases."""
    lead = len(layout.shape)
    dims = tuple(group[STATUS].metadata.dimension_names)
    quantities = {}
    for name, array in sorted(group.arrays()):
        names = tuple(array.metadata.dimension_names or ())
        if name in coordinates or name in (STATUS, MESSAGE, RECORD) or names[:lead] != dims:
            continue
        shape = tuple(array.shape[lead:])
        quantities[name] = KeptQuantity(
            name=name,
            dims=names[lead:],
            shape=shape,
            unit=str(array.attrs.get("units", "")),
            sentence=str(array.attrs.get("long_name", "")),
            labels=tuple(
                list(group[dim][...].tolist()) if dim in group else list(range(size))
                for dim, size in zip(names[lead:], shape, strict=True)
            ),
            blocks=_Blocks(array, layout),
        )
    return quantities


class _Blocks:
    """The blocks of an array, one a task: consecutive cases."""

    def __init__(self, array: Any, layout: CaseLayout) -> None:
        self._array, self._layout = array, layout

    def __call__(self) -> Iterator[tuple[int, FloatArray]]:
        for task in range(self._layout.n_tasks):
            start, stop = self._layout.cases_of(task)
            values = np.asarray(self._array[self._layout.box_of(task)], dtype=np.float64)
            yield start, values.reshape(stop - start, *values.shape[len(self._layout.shape) :])


def check_case(results: SweepResults, case: int) -> None:
    """Raise InvalidValueError unless the sweep has a case with this number."""
    if not 0 <= case < results.count:
        allowed = f"whole numbers from 0 to {results.count - 1}"
        raise InvalidValueError("no such case", where=str(results.path), given=case, allowed=allowed)


def build_case_scene(path: str | Path, keys: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the scene of a case; keys of arrays write out nodes and members, inputs are left out."""
    document = read_stored_sweep(path).identity["scene"]
    assembler = build_assembler(document, list(keys), source=str(path))
    values = list(keys.values())
    case = assembler.assemble(values)
    if not any(isinstance(key, ArrayKey) and key.array != INPUT for key in assembler.keys):
        return assembler.write(values)
    if isinstance(case.subject, BodySystem):
        return describe_bodies(case.subject, case.request)
    return describe_structure(case.subject, case.request)
