"""The solver of equilibria in the generated C: minima, paths, and every status."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.paths.c_equilibrium import EquilibriumSolver
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.lin.events import follow_load
from tensegrity_codegen.studies.papers.lin.tables import compile_prism, place_load
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    UnknownNameError,
    UnstableError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.models import EXAMPLES, load
from tests.runtime.build import cable, make_structure, prism, spring

SOLVER = ("equilibrium",)
FEET = {0: "xz", 1: "xz"}


def compiled(structure: Structure, **parameters: tuple[int, ...]) -> CompiledModel:
    return load(structure, *EQUILIBRIUM_QUANTITIES, parameters=parameters, solvers=SOLVER)


def hung_mass(load: float = -3.0) -> Structure:
    """A node on two springs of a truss: -F and geometry are known in closed form."""
    members = [spring(0, 2, 1.0, 50.0), spring(1, 2, 1.0, 50.0)]
    place = [[-0.8, 0, 0], [0.8, 0, 0], [0, 0, -0.7]]
    return make_structure(place, members, anchored=FEET, axes="xz", load={2: (0.0, 0.0, load)})


def arch() -> Structure:
    """Two springs that meet above their anchors: pressed down, they snap through (von Mises truss)."""
    members = [spring(0, 2, 1.0, 100.0), spring(1, 2, 1.0, 100.0)]
    place = [[-0.95, 0, 0], [0.95, 0, 0], [0, 0, np.sqrt(1 - 0.95**2)]]
    return make_structure(place, members, anchored=FEET, axes="xz")


@pytest.fixture(scope="module")
def truss() -> CompiledModel:
    return compiled(arch(), node_load=(2,))


def test_equilibrium_of_two_springs_in_closed_form() -> None:
    found = EquilibriumSolver(compiled(hung_mass())).find()
    assert found.status == "ok"
    x, z = found.coordinate[0]
    length = np.hypot(0.8, z)
    assert x == pytest.approx(0.0, abs=1e-12)
    assert -2 * 50.0 * (length - 1.0) * z / length == pytest.approx(3.0, abs=1e-9)
    assert found.residual[0] <= 1e-9
    assert found.smallest_pivot[0] > 0
    assert found.potential_energy[0] == pytest.approx(50.0 * (length - 1.0) ** 2 + 3.0 * z, abs=1e-12)


def test_it_is_the_equilibrium_that_python_finds() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"}, load={3: (0.0, 1.0, -2.0)})
    model = compiled(structure)
    found, slow = EquilibriumSolver(model).find(tolerance=1e-7), find_equilibrium(model)
    place = slow.node_position[3:].ravel()
    np.testing.assert_allclose(found.check().coordinate[0], place, atol=1e-8, rtol=0)


def test_cables_that_go_slack() -> None:
    """A node on two opposite cables, pulled so far that one of them carries nothing."""
    members = [cable(0, 2, 0.9, 100.0), cable(1, 2, 0.9, 100.0)]
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, 0]]
    structure = make_structure(
        place, members, anchored={0: "x", 1: "x"}, axes="x", load={2: (30.0, 0.0, 0.0)}
    )
    found = EquilibriumSolver(compiled(structure)).find().check()
    assert found.coordinate[0] == pytest.approx([0.2], abs=1e-12)  # 100 (1 + x - 0.9) = 30, the other slack


def test_bodies_are_solved_in_three_steps_a_load() -> None:
    model = compile_prism()
    loads = np.array([place_load(3, (0.0, 0.0, -k)) for k in range(11)])
    path = EquilibriumSolver(model).follow(loads).check()
    assert path.coordinate.shape == (11, 6)
    assert path.iterations.max() <= 4
    assert path.residual.max() <= 1e-9
    for place, pull in zip(path.coordinate, loads, strict=True):
        force = model.compute("coordinate_force", coordinate=place, node_load=pull)
        assert np.abs(force).max() <= 1e-9


def test_a_path_is_its_equilibria_one_after_the_other(truss: CompiledModel) -> None:
    loads = np.array([[[0.0, -k]] for k in np.linspace(0.0, 0.3, 5)])
    solver = EquilibriumSolver(truss)
    path = solver.follow(loads).check()
    place: Any = None
    for row, pull in zip(path.coordinate, loads, strict=True):
        place = solver.find(place, node_load=pull).check().coordinate[0]
        np.testing.assert_array_equal(row, place)


def test_no_load_at_all_is_an_empty_path(truss: CompiledModel) -> None:
    path = EquilibriumSolver(truss).follow(np.zeros((0, 1, 2)))
    assert path.status == "ok"
    assert path.coordinate.shape == (0, 2)


def test_a_path_on_which_cables_go_slack_is_that_of_the_continuation() -> None:
    model = compile_prism(tension_only=True)
    loads = np.array([place_load(1, (k, 0.0, 0.0)) for k in np.linspace(0, 48, 13)])
    path = EquilibriumSolver(model).follow(loads).check()
    _, slow = follow_load(model, 1, "+x", max_load=48.0)
    assert slow.status == "completed"
    assert slow.find_events("slack")
    np.testing.assert_allclose(path.coordinate[-1], slow.coordinate[-1], atol=1e-8, rtol=0)


def test_large_steps_of_the_load_lead_where_small_ones_lead() -> None:
    solver = EquilibriumSolver(compile_prism())
    for top, force in ((3, (0.0, 0.0, -35.0)), (1, (54.0, 0.0, 0.0)), (2, (0.0, 60.0, 0.0))):
        loads = [place_load(top, force * np.array(part)) for part in (0.0, 1.0)]
        fine = [place_load(top, force * np.array(part)) for part in np.linspace(0, 1, 201)]
        coarse, small = (solver.follow(np.array(row)).check() for row in (loads, fine))
        np.testing.assert_allclose(coarse.coordinate[-1], small.coordinate[-1], atol=1e-6, rtol=0)


def test_a_load_beyond_the_limit_point_loses_the_branch(truss: CompiledModel) -> None:
    """The load of the truss is F = 2 k (1/l - 1) z, l = |(0.95, z)|; its largest value is the limit load."""
    z = np.linspace(0, np.sqrt(1 - 0.95**2), 200001)
    length = np.hypot(0.95, z)
    limit = float((2 * 100.0 * (1 / length - 1) * z).max())
    solver = EquilibriumSolver(truss)
    below = solver.follow(np.array([[[0.0, -f]] for f in np.linspace(0, 0.999 * limit, 30)]))
    assert below.status == "ok"
    for count in (2, 10, 100):
        path = solver.follow(np.array([[[0.0, -f]] for f in np.linspace(0, 1.2 * limit, count)]))
        assert path.status == "branch_lost"
        reached = np.linspace(0, 1.2 * limit, count)[len(path.coordinate) - 1]
        assert reached <= limit < reached + 1.2 * limit / (count - 1) + 1e-12
        assert path.failed["shifted"] > 0 or path.failed["contraction"] > 0.5
        with pytest.raises(ConvergenceError, match="branch_lost") as caught:
            path.check()
        assert caught.value.evidence["n_found"] == len(path.coordinate)
        assert caught.value.exit_code == 3


def test_a_prism_beyond_its_limit_load_loses_the_branch() -> None:
    """LIN: 35.0917 N on B_3 with linear springs, whose bars may pass through each other here."""
    solver = EquilibriumSolver(compile_prism())
    loads = np.array([place_load(3, (0.0, 0.0, -k)) for k in range(41)])
    path = solver.follow(loads)
    assert (path.status, len(path.coordinate)) == ("branch_lost", 36)


def test_an_equilibrium_that_is_no_minimum_is_unstable(truss: CompiledModel) -> None:
    """The truss with its springs in line is in balance and would snap either way."""
    found = EquilibriumSolver(truss).find([0.0, 0.0])
    assert found.status == "unstable"
    assert found.coordinate.shape == (0, 2)
    assert found.failed["smallest_pivot"] < 0
    with pytest.raises(UnstableError):
        found.check()


def test_a_structure_that_nothing_holds_is_unstable() -> None:
    found = EquilibriumSolver(compiled(prism())).find(tolerance=1e-6)
    assert found.status == "unstable"


def test_from_beside_an_unstable_place_it_falls_to_a_minimum(truss: CompiledModel) -> None:
    found = EquilibriumSolver(truss).find([0.0, 1e-3]).check()
    assert abs(found.coordinate[0, 1]) == pytest.approx(np.sqrt(1 - 0.95**2), abs=1e-9)


def test_too_few_iterations(truss: CompiledModel) -> None:
    found = EquilibriumSolver(truss).find(node_load=[[0.0, -0.4]], most_iterations=1)
    assert found.status == "not_converged"
    assert found.failed["iterations"] == 1
    assert found.failed["residual"] > 1e-9
    with pytest.raises(ConvergenceError, match="not_converged"):
        found.check()


def test_a_tolerance_below_rounding_is_not_reached() -> None:
    assert EquilibriumSolver(compiled(hung_mass())).find(tolerance=1e-300).status in ("not_converged", "ok")


def test_weights_that_hang_at_one_place_with_a_slack_cable_between_them() -> None:
    members = [cable(0, 1, 0.9), cable(0, 2, 0.9), cable(1, 2, 0.5)]
    load = {1: (0.0, 0.0, -5.0), 2: (0.0, 0.0, -5.0)}
    place = [[0, 0, 0], [0, 0, -1], [0, 0, -1]]
    folded = make_structure(place, members, anchored={0: "xz"}, axes="xz", load=load)
    found = EquilibriumSolver(compiled(folded)).find().check()
    np.testing.assert_allclose(found.coordinate[0], [0, -0.95, 0, -0.95], atol=1e-9)  # 0.9 m + 5 N / 100 N/m


def test_coincident_nodes_are_a_status(truss: CompiledModel) -> None:
    found = EquilibriumSolver(truss).find([-0.95, 0.0])
    assert found.status == "non_finite_result"
    with pytest.raises(ConvergenceError):
        found.check()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(truss: CompiledModel, bad: float) -> None:
    solver = EquilibriumSolver(truss)
    with pytest.raises(NonFiniteError, match="coordinate"):
        solver.find([0.0, bad])
    with pytest.raises(NonFiniteError, match="node_load"):
        solver.find(node_load=[[bad, 0.0]])
    with pytest.raises(NonFiniteError, match="node_load"):
        solver.follow([[[0.0, 0.0]], [[bad, 0.0]]])
    with pytest.raises(InvalidValueError, match="is out of range"):
        solver.find(tolerance=bad)


CALLS: tuple[tuple[Callable[[EquilibriumSolver], Any], type[Exception], str], ...] = (
    (lambda s: s.find(tolerance=0.0), InvalidValueError, "is out of range"),
    (lambda s: s.find(most_iterations=-1), InvalidValueError, "is out of range"),
    (lambda s: s.find([0.0]), InvalidValueError, "wrong shape"),
    (lambda s: s.find(node_load=[0.0]), InvalidValueError, "wrong shape"),
    (lambda s: s.follow([[0.0, 0.0]]), InvalidValueError, "wrong shape"),
    (lambda s: s.find(node_lode=1.0), UnknownNameError, "no such argument"),
)


@pytest.mark.parametrize(("call", "kind", "words"), CALLS)
def test_wrong_arguments(
    truss: CompiledModel, call: Callable[[EquilibriumSolver], Any], kind: type[Exception], words: str
) -> None:
    with pytest.raises(kind, match=words):
        call(EquilibriumSolver(truss))


def test_inputs_are_left_as_they_are(truss: CompiledModel) -> None:
    start, loads = np.array([0.0, 0.3]), np.array([[[0.0, -0.1]], [[0.0, -0.2]]])
    kept = start.copy(), loads.copy()
    EquilibriumSolver(truss).find(start)
    EquilibriumSolver(truss).follow(loads, start)
    np.testing.assert_array_equal(start, kept[0])
    np.testing.assert_array_equal(loads, kept[1])


def test_threads_do_not_disturb_each_other() -> None:
    model = compile_prism()
    loads = np.array([place_load(3, (0.0, 0.0, -k)) for k in range(11)])
    alone = EquilibriumSolver(model).follow(loads).coordinate

    def run(_: int) -> np.ndarray:
        return EquilibriumSolver(model).follow(loads).coordinate

    with ThreadPoolExecutor(8) as pool:
        for found in pool.map(run, range(64)):
            np.testing.assert_array_equal(found, alone)


def test_a_library_without_the_solver_says_so() -> None:
    model = load(arch(), "potential_energy")
    with pytest.raises(FormulationError, match="no solver 'equilibrium'"):
        EquilibriumSolver(model)


def test_a_path_needs_loads_that_may_change() -> None:
    with pytest.raises(FormulationError, match="may change at run time"):
        EquilibriumSolver(compiled(arch())).follow(np.zeros((1, 1, 2)))


def test_what_the_solver_cannot_serve_is_refused() -> None:
    structure = arch()
    with pytest.raises(FormulationError, match="not wanted") as caught:
        build_library(structure, ModelRequest(("potential_energy",), solvers=SOLVER))
    assert "node_residual, tangent_stiffness" in caught.value.hint
    with pytest.raises(FormulationError, match="unknown solver"):
        build_library(structure, ModelRequest(EQUILIBRIUM_QUANTITIES, solvers=("equilibrum",)))
    large = prism(sides=11, twist=90 + 180 / 11)
    with pytest.raises(FormulationError, match="too large") as caught:
        build_library(large, replace(ModelRequest(EQUILIBRIUM_QUANTITIES), solvers=SOLVER))
    assert caught.value.given == "66 coordinates"


@pytest.mark.parametrize("ratio", [1e7, *thorough(1e2, 1e3, 1e5)])
def test_iterations_do_not_grow_with_the_stiffness_of_bars(ratio: float, tmp_path: Path) -> None:
    """The shipped tower on held feet, from its stated shape and from far away (decision 0068)."""
    text = (EXAMPLES / "tower.toml").read_text(encoding="utf-8")
    text = text.replace("axial_stiffness = 5e5", f"axial_stiffness = {500 * ratio}")
    path = tmp_path / "tower.toml"
    path.write_text(text.replace('anchor_bottom = "z"', "anchor_bottom = true"), encoding="utf-8")
    model = compile_scene(path, for_="equilibrium", solvers=SOLVER)
    solver, place = EquilibriumSolver(model), model.nominal("coordinate").ravel()
    expected = find_equilibrium(model)
    size, rng = np.ptp(place), np.random.default_rng(0)
    for displacement, most in ((0.0, 6), (0.02, 15), (0.2, 40)):
        start = place + displacement * size * rng.standard_normal(len(place))
        found = solver.find(start, tolerance=1e-6)
        assert found.status == "ok"
        assert found.iterations[0] <= most
        if displacement < 0.1:  # from far away there are several equilibria
            np.testing.assert_allclose(found.coordinate[0], expected.coordinate.ravel(), atol=1e-6 * size)
