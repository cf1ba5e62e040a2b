"""Equilibria of many cases: every row is what `find_equilibrium` finds alone."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.batch.equilibria import Equilibria
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError, UnknownNameError
from tests.analyses.cases.scenes import BODIES, PRISM, SINGLE, TRIANGLE

COUNT = 8


def check_rows(
    model: CompiledModel, found: Equilibria, arguments: dict[str, Any], coordinate: Any = None
) -> None:
    """Compare every row with the search for it alone."""
    for k in range(len(found)):
        alone = find_equilibrium(
            model,
            coordinate=None if coordinate is None else coordinate[k],
            arguments={name: value[k] for name, value in arguments.items()},
            raise_on_failure=False,
        )
        assert found.status[k] == alone.status, k
        if not alone.is_found:
            continue
        size = alone.extent
        assert alone.distance_of(found.node_position[k]) <= 1e-6 * size
        np.testing.assert_allclose(
            found.member_tension[k], alone.member_tension, rtol=1e-6, atol=1e-7 * alone.largest_force
        )
        np.testing.assert_allclose(found.member_length[k], alone.member_length, atol=1e-7 * size)
        assert found.neutral_motions[k] == alone.neutral_motions
        assert found.residual[k] <= max(1e-9 * found.largest_force[k], 2 * alone.residual)
        assert found.change[k] == pytest.approx(alone.change, rel=1e-5, abs=1e-6 * size)
        assert found.extent[k] == pytest.approx(alone.extent)
        assert found.energy_change[k] == pytest.approx(alone.energy_change, rel=1e-6, abs=1e-9)
        assert found.smallest_eigenvalue[k] == pytest.approx(alone.smallest_eigenvalue, rel=1e-4, abs=1e-6)


def vary_prism(model: CompiledModel, count: int, sideways: float = 0.0) -> dict[str, Any]:
    random = np.random.default_rng(3)
    load = np.zeros((count, 2, 3))
    load[:, 0, 2] = -random.uniform(0, 8, count)
    load[:, 1, 0] = sideways
    rest = np.tile(model.nominal("rest_length"), (count, 1)) * random.uniform(0.98, 1.005, (count, 1))
    return {"node_load": load, "rest_length": rest}


@pytest.mark.thorough
def test_prisms_that_slide_and_turn_on_a_table() -> None:
    model = compile_scene(PRISM, for_="equilibria")
    given = vary_prism(model, COUNT)
    given["node_load"][2, 1] = [0.5, 0, 0]  # nothing holds it
    found = find_equilibria(model, arguments=given)
    assert found.status[2] == "no_equilibrium"
    assert found.is_found.sum() == COUNT - 1
    check_rows(model, found, given)


@pytest.fixture(scope="module")
def triangle() -> CompiledModel:
    return compile_scene(TRIANGLE, for_="equilibria")


def vary_triangle(count: int) -> dict[str, Any]:
    random = np.random.default_rng(4)
    return {
        "rest_length": random.uniform(0.8, 1.3, (count, 2)),
        "node_load": random.normal(scale=30, size=(count, 1, 2)),
        "pull": random.uniform(-0.1, 0.1, count),
    }


def test_a_node_between_cables_that_go_slack(triangle: CompiledModel) -> None:
    random = np.random.default_rng(5)
    start = triangle.nominal("coordinate") + random.normal(scale=0.3, size=(COUNT, 2))
    given = vary_triangle(COUNT)
    found = find_equilibria(triangle, coordinate=start, arguments=given)
    assert found.is_found.any()
    assert (found.member_tension[found.is_found] == 0).any()
    check_rows(triangle, found, given, start)


def test_bodies() -> None:
    model = compile_scene(BODIES, for_="equilibria")
    random = np.random.default_rng(5)
    given = {"rest_length": model.nominal("rest_length") * random.uniform(0.9, 1.1, (3, 1))}
    check_rows(model, find_equilibria(model, arguments=given), given)


def test_threads_and_progress_change_nothing(triangle: CompiledModel) -> None:
    model = triangle
    given, seen = vary_triangle(COUNT), []
    one = find_equilibria(model, arguments=given)
    two = find_equilibria(model, arguments=given, threads=2, progress=seen.append)
    np.testing.assert_array_equal(one.coordinate, two.coordinate)
    assert (one.status, seen[-1]) == (two.status, 1.0)
    assert seen == sorted(seen)


def test_a_case_that_is_not_finite_fails_alone(triangle: CompiledModel) -> None:
    given = vary_triangle(3)
    given["rest_length"][1, 0] = np.nan
    found = find_equilibria(triangle, arguments=given)
    assert found.status == ("converged", "non_finite_input", "converged")
    assert np.isnan(found.node_position[1]).all()
    assert "rest_length" in found.message[1]


def test_what_a_result_says(triangle: CompiledModel) -> None:
    found = find_equilibria(triangle, arguments={"pull": np.array([0.0, 0.01])})
    assert len(found) == 2
    assert "2 cases: 2 converged" in repr(found)
    assert found.position("m").shape == (2, 3)
    assert found.tension("top").shape == (2,)


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        ({"arguments": {"node_load": np.zeros((3, 3))}}, InvalidValueError, "wrong shape"),
        (
            {"arguments": {"pull": np.zeros(2), "rest_length": np.ones((3, 2))}},
            InvalidValueError,
            "different",
        ),
        ({"arguments": {"pull": 0.0}}, InvalidValueError, "no argument has a batch axis"),
        ({"arguments": {"push": np.zeros(2)}}, UnknownNameError, "pull"),
        ({"coordinate": np.zeros((2, 2)), "tolerance": 2.0}, InvalidValueError, "tolerance"),
        ({"coordinate": np.zeros((2, 2)), "method": "bfgs"}, UnknownNameError, "newton"),
        ({"coordinate": np.zeros((2, 2)), "threads": 0}, InvalidValueError, "threads"),
        ({"arguments": {"coordinate": np.zeros((2, 2))}}, UnknownNameError, "coordinate"),
    ],
)
def test_wrong_arguments_are_refused(
    triangle: CompiledModel, options: dict[str, Any], error: type[Exception], word: str
) -> None:
    with pytest.raises(error, match=word):
        find_equilibria(triangle, **options)


def test_single_precision_is_refused() -> None:
    model = compile_scene(SINGLE, for_="equilibria")
    with pytest.raises(LibraryError, match="double precision"):
        find_equilibria(model, coordinate=np.zeros((2, 2), dtype=np.float32))
