"""Sweeps made up of arrays: grids, samples, tables, with and without failures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.sweeps.summary.results import KeptQuantity, SweepResults

FloatArray = NDArray[np.float64]

MESSAGES = ("", "", "nothing balances the loads", "no convergence in 100 steps", "")
WORDS = ("ok", "converged", "no_equilibrium", "not_converged", "not_computed")


def split(values: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Yield blocks of a few cases."""
    size = max(1, len(values) // 3)
    for first in range(0, len(values), size):
        yield first, values[first : first + size]


def keep(
    name: str,
    values: FloatArray,
    unit: str = "N",
    dims: Sequence[str] = (),
    labels: Sequence[Sequence[Any]] = (),
) -> KeptQuantity:
    """Return a quantity with these values (count, ...)."""
    return KeptQuantity(
        name, tuple(dims), values.shape[1:], unit, f"{name} of the structure", tuple(labels),
        lambda: split(values),
    )  # fmt: skip


def make_sweep(
    key_values: FloatArray,
    keys: Sequence[str],
    kept: Sequence[KeptQuantity],
    *,
    status: Sequence[int] | NDArray[Any] | None = None,
    axes: Mapping[str, FloatArray] | None = None,
    method: str = "random",
    operation: str = "equilibrium",
    message: Callable[[int], str] = lambda case: "",
    options: Mapping[str, Any] | None = None,
    kept_names: Sequence[str] = (),
) -> SweepResults:
    """Return a sweep of which all cases converged unless `status` states otherwise."""
    codes = np.full(len(key_values), 1) if status is None else np.asarray(status)
    return SweepResults(
        Path("made.zarr"), "prism", operation, options or {}, tuple(kept_names), tuple(keys),
        tuple((axes or {}).items()), method, {key: f"range of {key}" for key in keys},
        7, key_values, codes.astype(np.int64), WORDS, message, {item.name: item for item in kept},
    )  # fmt: skip


def make_grid(n: int = 12, m: int = 9, failed: int = 0) -> SweepResults:
    """Return a grid of two keys whose result is 3 x + y^2; the last cases failed."""
    x, y = np.linspace(-1, 1, n), np.geomspace(1, 1000, m)
    values = np.array([(a, b) for a in x for b in y])
    status = np.full(n * m, 1)
    status[n * m - failed :] = 2
    tension = 3 * values[:, 0] + np.log(values[:, 1]) ** 2
    table = tension[:, None] + np.arange(3.0)
    labels = [("s1", "s2", "s3")]
    return make_sweep(
        values, ("loads[0].force[2]", "classes.cable.spring_constant"),
        [keep("elastic_energy", tension, "J"), keep("member_tension", table, "N", ["member"], labels)],
        status=status, axes={"loads[0].force[2]": x, "classes.cable.spring_constant": y}, method="grid",
        message=lambda case: "nothing balances the loads" if case >= n * m - failed else "",
    )  # fmt: skip


def make_sample(count: int = 2000, failed: bool = True) -> SweepResults:
    """Return a random sample of three keys; where the first two are large, cases failed."""
    rng = np.random.default_rng(5)
    values = np.column_stack([rng.normal(0, 1, count), rng.lognormal(3, 1, count), rng.uniform(2, 3, count)])
    status = np.where(failed & (values[:, 0] > 0.8) & (values[:, 1] > 25), 2, 1)
    status[:2] = [3, 1] if failed else [1, 1]
    energy = np.exp(values[:, 0]) * values[:, 1]
    height = 0.3 + 0.01 * values[:, 2] + 0.002 * rng.normal(size=count)
    return make_sweep(
        values, ("loads[0].force[2]", "classes.cable.spring_constant", "shape.height"),
        [keep("elastic_energy", energy, "J"), keep("height", height, "m")], status=status,
        message=lambda case: MESSAGES[status[case]],
        options={"input": "motor=0.1"} if not failed else {},
    )  # fmt: skip


def make_saltelli(count: int = 512, seed: int = 3) -> SweepResults:
    """Return a sample in the layout of Saltelli, rows A, AB_1, ..., AB_n, B, of a linear function.

    Its keys are uniform on (0, 1), its factors 1, 2, 3: the indices are 1/14, 4/14, 9/14.
    """
    base = np.random.default_rng(seed).uniform(size=(2, count, 3))
    rows = []
    for a, b in zip(base[0], base[1], strict=True):
        mixed = [np.where(np.arange(3) == j, b, a) for j in range(3)]
        rows += [a, *mixed, b]
    values = np.array(rows)
    return make_sweep(
        values, ("a", "b", "c"), [keep("sum", values @ np.array([1.0, 2.0, 3.0]), "m")], method="saltelli"
    )
