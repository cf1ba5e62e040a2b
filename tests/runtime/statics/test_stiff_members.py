"""Members much stiffer than the others: which they are, the curves that steps follow, the number of steps."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium import build_problem
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.runtime.statics.stiff_members import choose_stiff, find_spring_constants
from tests.cases import thorough
from tests.models import EXAMPLES

RATIOS = [1e3, 1e9, *thorough(1e2, 1e5, 1e7)]


def stiff_tower(folder: Path, ratio: float, stages: int = 3):
    """The shipped tower with bars so many times as stiff as its cables."""
    text = (EXAMPLES / "tower.toml").read_text(encoding="utf-8")
    text = text.replace("axial_stiffness = 5e5", f"axial_stiffness = {500 * ratio}")
    path = folder / "tower.toml"
    path.write_text(text.replace("stages = 3\n", f"stages = {stages}\n"), encoding="utf-8")
    return compile_scene(path, for_="equilibrium")


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> StaticProblem:
    """The tower with bars 1,000 times as stiff as cables, which it watches from its stated positions on."""
    problem = build_problem(stiff_tower(tmp_path_factory.mktemp("tower"), 1e3))
    problem.watch_stiff_members(problem.model.nominal("coordinate").ravel())
    return problem


@pytest.mark.parametrize(
    ("spring_constant", "stiff"),
    [
        ([1.0, 2.0, 3.0], []),
        ([1e3, 1.0, 2.0, 5e3], [0, 3]),
        ([1e9, 0.0, 1.0, 9.0], [0]),
        ([0.0, 0.0, 7.0], []),
        ([1.0, 12.0, 13.0, 1300.0], [3]),
    ],
)
def test_stiff_members_are_those_above_the_widest_gap(spring_constant, stiff) -> None:
    assert choose_stiff(np.array(spring_constant)).tolist() == stiff


def test_spring_constants_are_those_of_the_scene(problem: StaticProblem) -> None:
    structure = problem.model.structure
    found = find_spring_constants(problem.compute, problem.model.nominal("coordinate").ravel())
    stated = structure.spring_constant + structure.axial_stiffness / structure.rest_length
    np.testing.assert_allclose(found, stated, rtol=1e-4)
    assert problem.stiff is not None
    np.testing.assert_array_equal(problem.stiff.row, np.flatnonzero(structure.is_bar))


def test_hessian_is_that_of_the_energy_along_the_curves_of_steps(problem: StaticProblem) -> None:
    """Off equilibrium: U(R(s)) = U - f.s + s.K* s / 2 + O(s^3) (Absil, Baker, Gallivan 2007, section 2)."""
    rng = np.random.default_rng(1)
    point = problem.find_point(problem.model.nominal("coordinate").ravel() + 0.01 * rng.normal(size=51))
    assert point is not None
    hessian = problem.find_path_stiffness(problem.stiffness(point.coordinate), point)
    for _ in range(5):
        step = 2e-3 * rng.normal(size=51)
        ways = [problem.find_displaced_point(point.coordinate, way) for way in (step, -step)]
        curved = sum(way.energy for way in ways) - 2 * point.energy
        assert curved == pytest.approx(step @ (hessian @ step), rel=1e-3)


def test_steps_keep_the_predicted_lengths_of_stiff_members(problem: StaticProblem) -> None:
    rng, start = np.random.default_rng(2), problem.model.nominal("coordinate").ravel()
    step = 0.05 * rng.normal(size=51)
    reached = problem.find_displaced_point(start, step)
    assert reached is not None
    assert problem.stiff is not None
    row, lengths = problem.stiff.row, problem.stiff.lengths
    before, after = (problem.compute("member_length", q)[row] for q in (start, reached.coordinate))
    predicted = before + lengths.jacobian(problem.node_position(start)) @ step
    np.testing.assert_allclose(after, predicted, atol=1e-14)


@pytest.mark.parametrize("ratio", RATIOS)
def test_search_takes_as_many_steps_at_any_stiffness(tmp_path: Path, ratio: float) -> None:
    model = stiff_tower(tmp_path, ratio)
    found = find_equilibrium(model)
    assert found.status == "converged"
    assert found.iterations <= 8
    assert found.residual <= 1e-9 * found.largest_force
    assert found.smallest_eigenvalue == pytest.approx(22.47, abs=0.03)
    # Forces as the laws state them balance as exactly as positions can be rounded.
    stated = np.abs(model.compute("node_residual", coordinate=found.coordinate)).max()
    assert stated <= max(1e-9 * found.largest_force, 64 * np.finfo(float).eps * 500 * ratio)


@pytest.mark.parametrize("ratio", thorough(1e2, 1e5, 1e9))
def test_long_tower_that_falls_under_its_weight_comes_to_rest(tmp_path: Path, ratio: float) -> None:
    found = find_equilibrium(stiff_tower(tmp_path, ratio, stages=50))
    assert found.status == "converged"
    assert found.iterations <= 100
    assert found.energy == pytest.approx(-1741.7, abs=1.5)
