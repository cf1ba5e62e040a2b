"""The figures of S&K and what lies beyond them, in small (MODEL 2 and 3)."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.papers.sk.chapter import (
    compare_stored_numbers,
    count_stored_numbers,
    find_difference_pattern,
)
from tensegrity_codegen.studies.papers.sk.inverse_time import compare_inverse_times
from tensegrity_codegen.studies.papers.sk.motion import (
    compare_trajectories,
    measure_constraint_drift,
    sample_prism,
    sample_structure,
)
from tensegrity_codegen.studies.papers.sk.offset import (
    compare_offset_trajectories,
    compare_offsets,
    evaluate_in,
)
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import find_quantity
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import dense, run_in_casadi
from tests.random_structures import structures

TOLERANCES = (1e-3, 1e-6, 1e-9)


# --- Fig. 2 -------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_three_ways_to_the_acceleration_agree_and_have_times() -> None:
    found = compare_inverse_times((6, 8, 12))
    assert found["largest_difference"] < 1e-14
    for table in (found["form"], found["apply"]):
        assert set(table) == {"pseudo_inverse", "dense", "sparse", "factored"}
        assert all(np.all(seconds > 0) for seconds in table.values())
    assert all(np.isfinite(value) for value in found["form_exponent"].values())
    assert np.all(found["form"]["factored"] < found["form"]["pseudo_inverse"])


# --- Figs. 3 and 4 ------------------------------------------------------------------------------------


def test_difference_pattern_is_that_of_fig_3() -> None:
    pattern = find_difference_pattern(6)
    assert pattern.shape == (45, 18)
    assert np.count_nonzero(pattern) == 90
    position = np.random.default_rng(0).normal(size=(6, 3))
    expected = [position[i] - position[j] for i in range(6) for j in range(i + 1, 6)]
    np.testing.assert_array_equal(pattern @ position.ravel(), np.ravel(expected))
    other = find_difference_pattern(6, "uvec123") @ position.ravel()
    np.testing.assert_array_equal(other, np.array(expected).T.ravel())


def test_stored_numbers_follow_their_formulas() -> None:
    """MODEL 3: 6k + 3a, or 2k + 3k; S&K 6: n (n + m)."""
    found = compare_stored_numbers(range(6, 31, 6))
    k, a, n = found["n_members"], found["n_actuated"], found["n_nodes"]
    np.testing.assert_array_equal(k, 2 * n)
    np.testing.assert_array_equal(found["sorted_blocks"], 6 * k + 3 * a)
    np.testing.assert_array_equal(found["sorted_scalars"], 5 * k)
    np.testing.assert_array_equal(found["as_printed"], n * (n + a))
    np.testing.assert_array_equal(found["node_position_dense"], 3 * n * (3 * n + a))
    np.testing.assert_array_equal(found["node_position_sparse"], 9 * (n + 2 * k) + 6 * a)


def test_the_stored_numbers_of_a_linear_model_are_enough() -> None:
    """F and G have 9k and 3a non-zeros, of which 3k are there twice; two scalars and d make all of F."""
    structure = sample_structure(8)
    model = build_model(structure, ModelRequest((), formulation="node_distance"))
    functions = prune(model, ("force_jacobian", "control_jacobian", "member_vector"))
    nominal = {name: item.nominal for name, item in model.arguments.items()}
    block, control, vector = (
        dense(run_in_casadi(f, {a: nominal[a] for a in f.arguments})) for f in functions
    )
    taut = structure.static_tension() != 0
    pattern = functions[0].sparsity.nnz(), functions[1].sparsity.nnz()
    counts = count_stored_numbers(structure)
    k, a = structure.n_members, len(structure.inputs)
    assert counts["sorted_blocks"] == pattern[0] - 3 * k + pattern[1]
    actuated = [item.targets[0] for item in structure.inputs]
    order = [*actuated, *(e for e in range(k) if e not in actuated)]
    mu = structure.spring_constant
    for place, e in enumerate(order):
        d, rows = vector[e], slice(3 * place, 3 * place + 3)
        ratio = structure.rest_length[e] / np.linalg.norm(d)
        first, second = -mu[e] * (1 - ratio) * taut[e], -mu[e] * ratio / (d @ d) * taut[e]
        np.testing.assert_allclose(block[rows, rows], first * np.eye(3) + second * np.outer(d, d), atol=1e-9)
        if place < a:
            assert np.count_nonzero(control[:, place]) == np.count_nonzero(control[rows, place])


# --- Fig. 5 -------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_trajectories_agree_at_equal_steps_and_at_the_tolerance_at_others() -> None:
    found = compare_trajectories(t_end=2.0, tolerances=TOLERANCES, samples=41)
    assert found["equal_steps"].max() < 1e-10
    for tolerance in TOLERANCES:
        for kind in ("adaptive", "auto"):
            row = found[kind][tolerance]
            assert row["difference"].max() < tolerance
            assert max(error.max() for error in row["error"].values()) < tolerance
    assert found["adaptive"][1e-3]["difference"].max() > 1e-5  # what the paper shows is the step control


@pytest.mark.thorough
@pytest.mark.parametrize("pairs", ["connected", "full"])
@pytest.mark.parametrize("basis", ["cycles", "orthonormal"])
def test_constraints_stay_put_for_a_thousand_seconds(pairs: str, basis: str) -> None:
    found = measure_constraint_drift(t_end=1000.0, step=0.01, pairs=pairs, basis=basis)
    assert found["status"] == "ok"
    assert found["n_steps"] == 100_000
    assert found["drift"].max() < 1e-15


@pytest.mark.thorough
def test_constraints_of_stiff_bars_stay_put_too() -> None:
    stiff = sample_prism().with_changes(spring_constant=np.where(sample_prism().is_bar, 2e5, 200.0))
    found = measure_constraint_drift(stiff, t_end=2.0, step=1e-4)
    assert found["drift"].max() < 1e-15


# --- far from the origin, and in single precision ------------------------------------------------------


def test_node_positions_lose_digits_with_the_offset_and_distances_do_not() -> None:
    rows = {(row["precision"], row["offset"]): row for row in compare_offsets()}
    assert len(rows) == 8
    for (precision, offset), row in rows.items():
        digits = 1e-13 if precision == "double" else 1e-4
        assert row["node_distance_member_tension"] < digits
        assert row["node_distance_acceleration"] < digits
        lost = row["node_position_member_tension"]
        if offset:
            spacing = np.finfo(np.float64 if precision == "double" else np.float32).eps * offset
            assert lost > spacing / 10
    assert rows["single", 1e6]["node_position_member_tension"] > 1
    assert rows["single", 1e9]["node_position_acceleration"] is None  # all nodes coincide


@pytest.mark.thorough
def test_simulations_far_from_the_origin_are_those_at_the_origin() -> None:
    found = compare_offset_trajectories(offsets=(0.0, 1e6), t_end=0.2, samples=11)
    assert found["node_distance"][1e6].max() == 0.0
    assert found["node_position"][0.0].max() < 1e-10
    assert found["node_position"][1e6].max() > 1e-8


# --- samples ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [6, 14, 30])
def test_sample_structures_hang_together(n: int) -> None:
    for kind, members in (("sparse", 2 * n), ("complete", n * (n - 1) // 2)):
        structure = sample_structure(n, kind, seed=n)
        assert structure.n_members == members
        assert structure.is_bar.sum() == n // 2
        model = build_model(structure, ModelRequest((), formulation="node_distance"))
        assert sum(name.startswith("centre") for name in model.frame.coordinate_name) == 3
        pairs = {frozenset(pair) for pair in structure.connectivity.tolist()}
        assert len(pairs) == members


@given(structures(most_nodes=8))
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
def test_double_is_bit_equal_and_single_and_extended_are_near(structure: Structure) -> None:
    model = build_model(structure, ModelRequest(()))
    (function,) = prune(model, ("member_tension",))
    arguments = {name: model.arguments[name].nominal for name in function.arguments}
    expected = run_in_casadi(function, arguments)
    np.testing.assert_array_equal(evaluate_in(np.float64, function, arguments), expected)
    single = evaluate_in(np.float32, function, arguments)
    assert single.dtype == np.float32
    scale = (structure.spring_constant + structure.axial_stiffness / structure.rest_length).max()
    np.testing.assert_allclose(single, expected, rtol=0, atol=3e-5 * max(scale, np.abs(expected).max()))
    more = evaluate_in(np.longdouble, function, arguments)
    np.testing.assert_allclose(more.astype(float), expected, rtol=0, atol=1e-12 * scale)


def test_an_unknown_operation_is_refused() -> None:
    x = ca.SX.sym("x", 2)
    function = ca.Function("f", [x], [ca.sin(x)], ["coordinate"], ["y"])
    pruned = PrunedFunction(find_quantity("member_length"), function, ("coordinate",))
    with pytest.raises(FormulationError, match="no meaning in other precisions"):
        evaluate_in(np.float32, pruned, {"coordinate": np.ones(2)})
