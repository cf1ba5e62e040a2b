"""A small sweep of made-up results."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.record import Output, TaskResult
from tensegrity_codegen.sweeps.cases.cases import Axis, Cases
from tensegrity_codegen.sweeps.cases.layout import CaseLayout
from tensegrity_codegen.sweeps.store.store import StoreContents
from tests.cases import thorough

OUTPUTS = (
    Output("energy", (), (), "float64", "J", "total energy"),
    Output("steps", (), (), "int32", "1", "number of steps"),
    Output("tension", ("member",), (3,), "float64", "N", "tensions", {"member": ("b1", "c1", "c2")}),
    Output(
        "position",
        ("time", "node", "axis"),
        (2, 4, 3),
        "float64",
        "m",
        "positions",
        {"time": (0.0, 0.5), "node": ("n1", "n2", "n3", "n4"), "axis": ("x", "y", "z")},
    ),
)


@dataclass(frozen=True)
class Rows:
    """Two columns of made-up values."""

    count: int
    keys: tuple[str, ...] = ("loads[0].force[2]", "shape.twist")
    method: str = "random"
    seed: int | None = 3

    def values(self, first: int, last: int) -> NDArray[np.float64]:
        rows = np.arange(first, last, dtype=float)
        return np.stack([rows / 7.0, -rows], axis=1)

    def describe(self) -> dict[str, Any]:
        return {"method": self.method, "seed": self.seed}


KINDS = {
    "grid": Cases((Axis("classes.cable.rest_length", np.arange(5.0)), Axis("gravity[2]", np.arange(7.0)))),
    "axis": Cases((Axis("energy", np.linspace(0.0, 1.0, 11)),)),
    "sample": Cases((), Rows(23)),
    "both": Cases((Axis("gravity[2]", [0.0, -9.81]),), Rows(9)),
}

# `both` has an axis and rows; `axis` has the name of a result.
CASES_OF_KINDS = ["axis", "both", *thorough("grid", "sample")]


def make_contents(cases: Cases, size: int = 4, **identity: Any) -> StoreContents:
    told = {"scene": {"name": "prism"}, "cases": cases.describe(), **identity}
    return StoreContents(cases, CaseLayout.of(cases.shape, size), OUTPUTS, told, {"title": "a sweep"})


def make_result(first: int, last: int) -> TaskResult:
    """Results by which each case is known; every third one did not converge."""
    n = np.arange(first, last)
    is_bad = n % 3 == 1
    arrays: dict[str, NDArray[Any]] = {"energy": n / 9.0, "steps": n.astype("int32")}
    arrays["tension"] = n[:, None] + np.array([0.1, 0.2, 0.3])
    arrays["position"] = np.arange(24.0).reshape(2, 4, 3) + n[:, None, None, None]
    for array in arrays.values():
        array[is_bad] = np.nan if array.dtype.kind == "f" else -1
    messages = tuple("no convergence: 2 µm" if bad else "" for bad in is_bad)
    return TaskResult(arrays, np.where(is_bad, 8, 0).astype("int8"), messages)


@pytest.fixture(params=CASES_OF_KINDS)
def contents(request: pytest.FixtureRequest) -> StoreContents:
    return make_contents(KINDS[request.param])
