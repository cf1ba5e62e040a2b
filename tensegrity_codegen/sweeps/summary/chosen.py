"""The results that a summary describes: one number a case, chosen by name or by default."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.summary.results import KeptQuantity, SweepResults
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest


def _compute_mean(values: FloatArray, axis: int) -> FloatArray:
    """Return the mean along an axis of what is there; NaN where nothing is."""
    known = ~np.isnan(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    mean: FloatArray = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return mean


# Over the entries that are there: rows of natural frequencies, for example, are filled up with NaN.
REDUCTIONS: dict[str, Callable[..., FloatArray]] = {
    "max": np.fmax.reduce,
    "min": np.fmin.reduce,
    "mean": _compute_mean,
}
DEFAULT_COUNT = 4
# What states how a result was computed; described by default where nothing else was kept.
DIAGNOSTICS = (
    "residual", "residual_rate", "energy_drift", "error_estimate", "n_steps", "steps", "rejected",
    "iterations", "neutral_motions", "saddles_left", "zero_eigenvalues",
)  # fmt: skip
_SPEC = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(?:\[(.*)\])?\s*")


@dataclass(frozen=True)
class ChosenResult:
    """One number a case: its name as on the command line, unit, sentence, values (count,), NaN if none."""

    name: str
    unit: str
    sentence: str
    values: FloatArray

    @property
    def label(self) -> str:
        """Name and unit, for axes and headings."""
        return f"{self.name} [{self.unit}]" if self.unit not in ("", "1") else self.name


def choose_results(results: SweepResults, names: Sequence[str] = ()) -> tuple[ChosenResult, ...]:
    """Return the results that are named, else the first few of the sweep.

    names: "NAME", or for a quantity with dimensions "NAME[PART,...]": a part for each dimension, which is a
        label, a place from 0 on (-1: the last) or max, min, mean; one of these three alone is over all
        dimensions. NAME without parts stands for NAME[max] and NAME[min].
    Raises UnknownNameError for a quantity or label that the sweep does not have; InvalidValueError for a text
    that is no such name, or another number of parts.
    """
    picks: dict[str, tuple[KeptQuantity, tuple[str, ...]]] = {}
    for text in names or _default_specs(results):
        for name, quantity, parts in _read_spec(results, text):
            picks[name] = (quantity, parts)
    if not names:
        picks = dict(list(picks.items())[:DEFAULT_COUNT])
    good = results.is_good
    return tuple(_compute(name, quantity, parts, good) for name, (quantity, parts) in picks.items())


def _default_specs(results: SweepResults) -> list[str]:
    """Return tensions first, then numbers, then quantities with dimensions; diagnostics last.

    Where the user chose what is kept, its order is kept. What is the largest or smallest of something already
    is described by this alone, an array of one entry once, and arrays of two dimensions, such as positions,
    where nothing else was kept.
    """
    order = sorted(
        (item for item in results.kept.values() if item.shape == () or min(item.shape) > 0),
        key=lambda item: (
            item.name in DIAGNOSTICS,
            item.name == "displacement" and "change" in results.kept,  # almost the same
            _find_rank(item.name, results.keep),
            not item.name.startswith("member_tension"),
            len(item.dims),
        ),
    )
    few = [item for item in order if len(item.dims) < 2]
    return [spec for item in few or order for spec in _list_parts(item)]


def _find_rank(name: str, keep: Sequence[str]) -> int:
    """Return the place of a result among what was kept, written NAME or NAME = EXPRESSION."""
    written = [text.partition("=")[0].strip() for text in keep]
    return written.index(name) if name in written else len(written)


def _list_parts(item: KeptQuantity) -> list[str]:
    """Return the descriptions of a quantity by one number a case that are not the same."""
    if not item.dims:
        return [item.name]
    if math.prod(item.shape) == 1:
        return [f"{item.name}[{','.join(str(labels[0]) for labels in item.labels)}]"]
    word = item.name.rpartition("_")[2]
    return [f"{item.name}[{part}]" for part in ([word] if word in ("max", "min") else ["max", "min"])]


def _read_spec(results: SweepResults, text: str) -> list[tuple[str, KeptQuantity, tuple[str, ...]]]:
    """Return name, quantity and parts of each result that a text stands for."""
    found = _SPEC.fullmatch(text)
    if found is None:
        raise InvalidValueError(
            "not the name of a result", where="result", given=text, allowed="NAME or NAME[PART,...]"
        )
    name, inside = found[1], found[2]
    if name not in results.kept:
        raise UnknownNameError(
            "unknown result",
            where="result",
            given=name,
            allowed="a quantity that the sweep kept",
            hint=suggest(name, results.kept),
        )
    quantity = results.kept[name]
    if not quantity.dims and inside is None:
        return [(name, quantity, ())]
    if inside is None:
        return [(f"{name}[{word}]", quantity, (word,)) for word in ("max", "min")]
    parts = tuple(part.strip() for part in inside.split(","))
    alone = len(parts) == 1 and parts[0] in REDUCTIONS and quantity.dims
    if len(parts) != len(quantity.dims) and not alone:
        raise InvalidValueError(
            f"{len(parts)} parts for a quantity with {len(quantity.dims)} dimensions",
            where="result",
            given=text,
            allowed=_describe_parts(quantity),
        )
    for place, part in enumerate(parts):
        if part not in REDUCTIONS:
            _find_place(quantity, place, part)
    return [(f"{name}[{','.join(parts)}]", quantity, parts)]


def _describe_parts(quantity: KeptQuantity) -> str:
    """Return how parts of this quantity are written."""
    if not quantity.dims:
        return f"{quantity.name} alone: it is one number a case"
    return f"{quantity.name}[{','.join(dim.upper() for dim in quantity.dims)}], or max, min, mean"


def _find_place(quantity: KeptQuantity, place: int, part: str) -> int:
    """Return the index along a dimension that a label or number means."""
    labels = [str(label) for label in quantity.labels[place]]
    if part in labels:
        return labels.index(part)
    size = quantity.shape[place]
    if re.fullmatch(r"-?\d{1,9}", part) and -size <= int(part) < size:
        return int(part)
    raise UnknownNameError(
        f"unknown {quantity.dims[place]} of {quantity.name}",
        where="result",
        given=part,
        allowed=f"a label, a place from 0 to {size - 1}, or max, min, mean",
        hint=suggest(part, labels),
    )


def _compute(
    name: str, quantity: KeptQuantity, parts: tuple[str, ...], good: NDArray[np.bool_]
) -> ChosenResult:
    """Return the result, read in pieces; cases that are not good have NaN."""
    values = np.full(len(good), np.nan)
    for first, block in quantity.blocks():
        values[first : first + len(block)] = _reduce(quantity, parts, block)
    values[~good] = np.nan
    return ChosenResult(name, quantity.unit, quantity.sentence, values)


def _reduce(quantity: KeptQuantity, parts: tuple[str, ...], block: FloatArray) -> FloatArray:
    """Return one number for each row of a block (rows, *shape)."""
    if not quantity.dims:
        return block
    if len(parts) == 1 and parts[0] in REDUCTIONS:
        flat = block.reshape(len(block), -1)
        return np.asarray(REDUCTIONS[parts[0]](flat, axis=1), dtype=np.float64)
    for place in reversed(range(len(parts))):
        axis = place + 1
        if parts[place] in REDUCTIONS:
            block = np.asarray(REDUCTIONS[parts[place]](block, axis=axis))
        else:
            block = np.take(block, _find_place(quantity, place, parts[place]), axis=axis)
    return block
