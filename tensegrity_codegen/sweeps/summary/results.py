"""Results of a sweep for its summary: cases, statuses, and quantities that are read piece by piece."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.statuses import GOOD, NOT_COMPUTED
from tensegrity_codegen.system.arrays import FloatArray

MOST_LETTERS = 36  # of a key along an axis


@dataclass(frozen=True)
class KeptQuantity:
    """A quantity of all cases.

    Attributes
    ----------
    name, unit, sentence : str
        What it is.
    dims : tuple of str
        Names of its dimensions after that of the case.
    shape : tuple of int
        Their lengths.
    labels : tuple of sequences
        What stands along each dimension, as texts or numbers.
    blocks : callable
        blocks() yields (first, values): the first case and the values (n, *shape) of consecutive cases, read
        one after the other; cases that are not computed need not be among them.
    """

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    unit: str
    sentence: str
    labels: tuple[Sequence[Any], ...]
    blocks: Callable[[], Iterator[tuple[int, FloatArray]]]


@dataclass(frozen=True)
class SweepResults:
    """A sweep as it is stored.

    Attributes
    ----------
    path : Path
        The store.
    scene, operation : str
        Name of the scene; what was done with each case.
    options : mapping
        Options of the operation, by the names of Python arguments.
    keep : tuple of str
        What was kept, as on the command line.
    keys : tuple of str
        What varies.
    axes : tuple of (key, values)
        Axes of the grid; empty without a grid.
    method : str
        How cases were made: grid, random, latin_hypercube, sobol, saltelli, table.
    ranges : mapping
        How each key varies, as it was written on the command line.
    seed : int or None
        Of the samples.
    key_values : array (count, n_keys)
        Values of the keys.
    status : array (count,)
        Place of the status of each case in `words`.
    words : tuple of str
        Statuses.
    message : callable
        message(case) returns the message of a case, "" if there is none.
    kept : mapping
        Quantities by name.
    key_units : mapping
        Units of keys, where they are known.
    """

    path: Path
    scene: str
    operation: str
    options: Mapping[str, Any]
    keep: tuple[str, ...]
    keys: tuple[str, ...]
    axes: tuple[tuple[str, FloatArray], ...]
    method: str
    ranges: Mapping[str, str]
    seed: int | None
    key_values: FloatArray
    status: NDArray[np.int64]
    words: tuple[str, ...]
    message: Callable[[int], str]
    kept: Mapping[str, KeptQuantity]
    key_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of cases."""
        return len(self.status)

    @property
    def is_good(self) -> NDArray[np.bool_]:
        """Which cases have a result, shape (count,)."""
        return np.isin(self.status, [k for k, word in enumerate(self.words) if word in GOOD])

    @property
    def is_computed(self) -> NDArray[np.bool_]:
        """Which cases are computed, shape (count,)."""
        return np.isin(self.status, [k for k, word in enumerate(self.words) if word != NOT_COMPUTED])

    def label_key(self, key: str) -> str:
        """Return a key with its unit, for axes; of a long key the end, where keys differ."""
        short = key if len(key) <= MOST_LETTERS else "…" + key[1 - MOST_LETTERS :]
        unit = self.key_units.get(key, "")
        return f"{short} [{unit}]" if unit not in ("", "1") else short

    @property
    def is_grid(self) -> bool:
        """Whether all keys are axes of one grid."""
        return bool(self.axes) and len(self.axes) == len(self.keys)
