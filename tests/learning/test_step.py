"""Progress, effort and limits by the arrays of a step."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import EnvironmentStep
from tensegrity_codegen.system.errors import InvalidValueError

N = 3


def make_step(**changes: Any) -> EnvironmentStep:
    places = {name: np.zeros((N, 3)) for name in ("start", "before", "after")}
    rows = {name: np.zeros((N, 2)) for name in ("observation", "action", "command", "last_command")}
    values = {"member_tension": np.zeros((N, 4))}
    fields: dict[str, Any] = {"time": np.ones(N), "sample": 0.1, "work": np.zeros(N), "values": values}
    return EnvironmentStep(**{**places, **rows, **fields, **changes})


def test_progress_is_the_way_along_a_direction() -> None:
    before, after = np.array([[0, 0, 1.0]] * N), np.array([[0.1, 0, 1], [0, 0.1, 2], [0.1, 0.1, 1]])
    step = make_step(before=before, after=after)
    np.testing.assert_allclose(step.progress(), [0.1, 0.0, 0.1], atol=1e-15)
    np.testing.assert_allclose(step.progress([0, -2, 0]), [0.0, -0.2, -0.2], atol=1e-15)
    with pytest.raises(InvalidValueError, match="direction"):
        step.progress([1, 0])


def test_work_costs_where_inputs_pull() -> None:
    step = make_step(work=np.array([2.0, 0.0, -3.0]))
    assert step.effort().tolist() == [2.0, 0.0, 0.0]


def test_episodes_end_outside_of_limits() -> None:
    tension = np.array([[0, 0, 0, -40.0], [10, 0, 0, 0], [0, 0, 0, 0]])
    after = np.array([[0, 0, 1.0], [3, 4, 0.5], [1, 0, 0.2]])
    step = make_step(start=np.array([[0, 0, 9.0]] * N), after=after, values={"member_tension": tension})
    assert step.is_outside(height=0.4).tolist() == [False, False, True]
    assert step.is_outside(distance=4.9).tolist() == [False, True, False]
    assert step.is_outside(tension=30).tolist() == [True, False, False]
    assert step.is_outside(0.4, 4.9, 30).tolist() == [True, True, True]
    assert step.is_outside().tolist() == [False] * 3
