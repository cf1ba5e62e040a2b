"""The force between bars: which numbers it takes, and what refuses it."""

from typing import Any

import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.collision import Collision
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.symbolic.node_forces.test_bar_collision import make_crossed


@pytest.mark.parametrize(
    "numbers",
    [(0.0, 1.0, 0.0), (1e4, 2.0, 0.0), (1e4, 1.0, -1.0), (float("inf"), 1.0, 0.0), (float("nan"), 1.0, 0.0)],
)
def test_impossible_numbers_are_refused(numbers: tuple[float, float, float]) -> None:
    with pytest.raises(InvalidValueError, match=r"interference\."):
        Collision(*numbers)


@pytest.mark.parametrize(
    "request_",
    [
        ModelRequest(("node_residual",)),
        ModelRequest(("acceleration",), formulation="node_distance"),
        ModelRequest(("acceleration",), emitter="table"),
    ],
)
def test_what_does_not_know_forces_between_bars_refuses_them(request_: Any) -> None:
    with pytest.raises(FormulationError, match=r"interference\.stiffness"):
        build_library(make_crossed(), request_)
