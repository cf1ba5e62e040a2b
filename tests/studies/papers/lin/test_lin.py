"""LIN: Tables 1 to 3, Fig. 4, the largest load, work, spring constants, and what is wrong in print.

The oracle is the derivation in docs/derivations, which has nothing in common with the generated C.
"""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from tensegrity_codegen.runtime.paths.continuation import StepControl
from tensegrity_codegen.studies.papers.lin.events import (
    DIRECTIONS,
    compare_stiffness,
    find_force,
    find_load_events,
    follow_load,
    survey_directions,
)
from tensegrity_codegen.studies.papers.lin.tables import (
    compare_sensitivity,
    compare_tables,
    compare_unloaded,
    compile_prism,
    compute_extensions,
    read_tables,
)
from tests.cases import thorough
from tests.studies.papers.lin.prism_checks import check_errata, compare_work

ROOT = Path(__file__).resolve().parents[4]
START = np.repeat(np.radians([-165.5, 39.6]), 3)


@pytest.fixture(scope="module")
def derivation() -> ModuleType:
    path = ROOT / "docs/derivations/prism_under_load.py"
    spec = importlib.util.spec_from_file_location("prism_under_load", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def tables() -> dict[str, Any]:
    return compare_tables()


def down(force: float) -> np.ndarray:
    return np.diag([0.0, 0.0, -force])


# --- the tables --------------------------------------------------------------------------------------


def test_the_tables_are_those_of_the_paper() -> None:
    printed = read_tables()
    assert printed["load"].tolist() == [-k for k in range(11)]
    assert printed["measured"][3].tolist() == [36.0226, 38.3626, 32.2730, 51.5185, 59.1224, 37.0855]
    assert printed["computed"][-1].tolist() == [43.7094, 57.3025, 33.6127, 54.2537, 75.5889, 10.150407]
    assert printed["error"][0].tolist() == [4.07, 2.75, 0.57, 0.66, 4.64, 4.06]


def test_table_2_is_computed_as_by_the_derivation(tables: dict[str, Any], derivation: ModuleType) -> None:
    np.testing.assert_allclose(tables["ours"], derivation.Prism().table(), atol=1e-9, rtol=0)


def test_the_last_row_of_table_2(tables: dict[str, Any]) -> None:
    last = dict(zip(tables["columns"], tables["ours"][-1], strict=True))
    expected = {
        "B1B2": 44.7043, "B2B3": 34.4045, "B3B1": 58.5089, "A1B2": 55.2701, "A2B3": 11.4843, "A3B1": 77.5274,
    }  # fmt: skip
    assert {name: round(value, 4) for name, value in last.items()} == expected
    assert tables["largest_difference_to_paper"] == pytest.approx(1.94, abs=0.005)


def test_mean_errors_against_the_measurements(tables: dict[str, Any]) -> None:
    assert tables["mean_error_ours"] == pytest.approx(0.0250, abs=5e-5)
    assert tables["mean_error_paper"] == pytest.approx(0.0262, abs=5e-5)


def test_table_3_follows_from_tables_1_and_2(tables: dict[str, Any]) -> None:
    assert tables["largest_difference_of_table_3"] < 1e-4  # 0.01 %, the last digit in print
    assert tables["error_paper"].max() < 0.05  # as the paper says below Table 3
    ratio = np.abs(tables["paper"] - tables["measured"]) / tables["paper"]
    np.testing.assert_allclose(tables["error_paper"], ratio, rtol=1e-15)


def test_figure_4_has_the_three_curves_of_each_spring(tables: dict[str, Any]) -> None:
    assert tuple(tables["figure_4"]) == tables["columns"]
    curves = tables["figure_4"]["A2B3"]
    assert curves["ours"].tolist() == tables["ours"][:, 5].tolist()
    assert (np.diff(curves["ours"]) < 0).all()  # the loaded spring shortens


def test_the_prism_without_load() -> None:
    found = {row["name"]: row for row in compare_unloaded()}
    expected = {
        "extension of side springs": (51.781, 1e-3),
        "extension of top springs": (32.045, 1e-3),
        "azimuth alpha": (-165.527, 1e-3),
        "elevation beta": (39.611, 1e-3),
        "smallest eigenvalue of the Hessian": (8.170, 1e-3),
    }
    for name, (value, tolerance) in expected.items():
        assert found[name]["ours"] == pytest.approx(value, abs=tolerance)
    side = found["extension of side springs"]
    assert side["difference"] == pytest.approx(side["ours"] - side["paper"], abs=1e-12)


@pytest.mark.thorough
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("top", [1, 2, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_loads_in_any_direction_on_any_top(derivation: ModuleType, axis: int, top: int, sign: float) -> None:
    prism = derivation.Prism()
    load, q, expected = np.zeros((3, 3)), START, []
    for newton in range(11):
        load[top - 1, axis] = sign * newton
        q = prism.settle(q, load)
        expected.append(1e3 * prism.extensions(q))
    ours = compute_extensions(sign * np.arange(11.0), top=top, axis=axis)
    np.testing.assert_allclose(ours, expected, atol=1e-9, rtol=0)


# --- the largest load --------------------------------------------------------------------------------


def distance_of_axes(prism: Any, q: np.ndarray, i: int, j: int) -> float:
    """Return the distance of the axes of two bars by minimisation over a box."""
    tops, feet = prism.tops(q), prism.a

    def square(x: np.ndarray) -> float:
        gap = feet[i] + x[0] * (tops[i] - feet[i]) - feet[j] - x[1] * (tops[j] - feet[j])
        return float(gap @ gap)

    found = optimize.minimize(square, [0.5, 0.5], bounds=[(0, 1)] * 2, options={"ftol": 1e-16, "gtol": 1e-12})
    return float(np.sqrt(found.fun))


@pytest.mark.thorough
def test_slack_load_and_contact_load_by_another_way(derivation: ModuleType) -> None:
    """Linear springs: both loads by bracketing on the equilibria of the derivation."""
    prism, found = derivation.Prism(), find_load_events()
    near = np.array([prism.settle(START, down(0.0))])
    for force in np.linspace(1, 13, 13):
        near = np.append(near, [prism.settle(near[-1], down(force))], axis=0)

    def extension(force: float) -> float:
        return float(prism.extensions(prism.settle(near[-1], down(force)))[5])  # A2B3

    slack = optimize.brentq(extension, 13.0, 13.4, xtol=1e-12)
    assert found["slack"] == {"load": pytest.approx(slack, abs=1e-9), "of": ("side2",)}

    def gap(force: float) -> float:
        return distance_of_axes(prism, prism.settle(near[-1], down(force)), 1, 2) - 0.008

    contact = optimize.brentq(gap, 13.4, 13.8, xtol=1e-10)
    assert found["contact"] == {"load": pytest.approx(contact, abs=1e-6), "of": ("bar2_bar3",)}
    assert (found["maximum"], found["because"]) == (found["contact"]["load"], "contact")
    assert found["is_stable"]


@pytest.mark.thorough
def test_limit_load_by_the_extended_system(derivation: ModuleType) -> None:
    """g = 0, H v = 0, v . v = 1 in (q, v, F), solved beside the continuation."""
    prism, found = derivation.Prism(), find_load_events()
    q = START
    for force in np.linspace(0, 35, 141):
        q = prism.settle(q, down(force))
    mode = np.linalg.eigh(prism.hessian(q, down(35.0)))[1][:, 0]

    def system(x: np.ndarray) -> np.ndarray:
        load = down(x[12])
        singular = prism.hessian(x[:6], load) @ x[6:12]
        return np.concatenate([prism.residual(x[:6], load), singular, [x[6:12] @ x[6:12] - 1]])

    solved = optimize.root(system, np.concatenate([q, mode, [35.0]]), tol=1e-14)
    assert np.abs(solved.fun).max() < 1e-9
    assert found["limit"]["load"] == pytest.approx(solved.x[12], abs=1e-8)


@pytest.mark.parametrize("largest", [0.1, *thorough(0.02)])
@pytest.mark.parametrize(
    ("tension_only", "slack", "contact", "limit"),
    [(False, 13.168844, 13.611547, 35.091716), (True, 13.168844, 13.576837, 35.487415)],
)
def test_loads_to_six_digits_whatever_the_step(
    tension_only: bool, slack: float, contact: float, limit: float, largest: float
) -> None:
    control = StepControl(largest=largest, most_steps=5000)
    found = find_load_events(tension_only=tension_only, control=control)
    loads = [found[kind]["load"] for kind in ("slack", "contact", "limit")]
    assert loads == pytest.approx([slack, contact, limit], abs=6e-7)


@pytest.mark.thorough
def test_the_three_tops_are_alike_under_vertical_loads() -> None:
    rows = survey_directions(directions=("-z",))
    for law in ("linear", "tension_only"):
        loads = [row["maximum"] for row in rows if row["law"] == law]
        assert loads == pytest.approx([loads[0]] * 3, rel=1e-10)


@pytest.mark.thorough
def test_loads_along_x_and_y_on_each_top() -> None:
    rows = survey_directions(directions=("+x", "-x", "+y", "-y"))
    assert len(rows) == 24
    found = {(row["law"], row["top"], row["direction"]): row for row in rows}
    # The load turns back before bars touch, springs are slack by then.
    first = found["linear", 1, "+x"]
    assert (first["because"], first["maximum"]) == ("limit", pytest.approx(54.536392, abs=6e-7))
    assert first["slack"]["load"] < first["maximum"]
    assert found["linear", 3, "+y"]["contact"]["load"] == pytest.approx(12.792982, abs=6e-7)
    assert found["linear", 1, "-x"]["contact"]["load"] == pytest.approx(14.932393, abs=6e-7)
    assert found["linear", 2, "+x"]["contact"]["load"] == pytest.approx(13.752722, abs=6e-7)
    assert found["tension_only", 1, "+x"]["contact"]["load"] == pytest.approx(48.397137, abs=6e-7)
    assert all(row["is_stable"] for row in rows)


@pytest.mark.thorough
def test_up_to_the_first_slack_spring_the_law_does_not_matter() -> None:
    for top, direction in ((1, "+x"), (2, "-y"), (3, "-z")):
        pair = [find_load_events(tension_only=law, top=top, direction=direction) for law in (False, True)]
        assert pair[0]["slack"]["load"] == pytest.approx(pair[1]["slack"]["load"], rel=1e-10)


# --- work --------------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("tension_only", [False, True])
@pytest.mark.parametrize("top", [1, 2, 3])
def test_work_is_the_change_of_potential(tension_only: bool, top: int) -> None:
    model = compile_prism(tension_only=tension_only)
    for direction in DIRECTIONS:
        found = compare_work(*follow_load(model, top, direction, max_load=20.0))
        assert abs(found["difference"]) < 1e-10
        assert found["work"] > 0.05


@pytest.mark.thorough
def test_work_is_the_change_of_potential_through_a_limit_point() -> None:
    problem, path = follow_load(compile_prism(), past_contact=True)
    assert path.find_events("limit")
    found = compare_work(problem, path)
    assert found["work"] > 10
    assert abs(found["difference"]) < 1e-10


def test_a_path_that_skips_a_kink_has_another_work() -> None:
    """The check can fail: without the point at the kink the quadrature is only good to its order."""
    problem, path = follow_load(compile_prism(), max_load=10.0)
    assert abs(compare_work(problem, path, nodes=1)["difference"]) > 1e-10


# --- spring constants, sensitivity ---------------------------------------------------------------------


@pytest.mark.thorough
def test_force_against_spring_constants() -> None:
    found = compare_stiffness(factors=(0.5, 1.0, 2.0), descents=(0.02,))
    for name in ("all", "side", "top"):
        assert (np.diff(found[name]["force"][:, 0]) > 0).all()
        assert (np.diff(found[name]["maximum"]) > 0).all()
        assert found[name]["force_10"][1] == pytest.approx(10.0, abs=1e-8)
        assert found[name]["maximum"][1] == pytest.approx(13.611547, abs=6e-7)
    # All springs twice as stiff: twice the force, but for the weight of the bars.
    force = found["all"]["force"][:, 0]
    assert force[2] / force[1] == pytest.approx(2.0, abs=0.01)
    assert force[2] / force[1] != pytest.approx(2.0, abs=1e-4)


def test_the_force_brings_the_top_down_as_far_as_was_asked(derivation: ModuleType) -> None:
    model, prism = compile_prism(), derivation.Prism()
    force = find_force(model, 0.03, model.nominal("spring_constant"))
    rest = prism.settle(START, down(0.0))
    moved = prism.settle(prism.settle(rest, down(force / 2)), down(force))
    assert prism.tops(rest)[2, 2] - prism.tops(moved)[2, 2] == pytest.approx(0.03, abs=1e-10)


def test_sensitivity_to_side_and_bar_length() -> None:
    printed, wider, shorter = compare_sensitivity()
    found = [row["largest_difference"] for row in (printed, wider, shorter)]
    assert found == pytest.approx([1.94, 1.14, 0.86], abs=0.006)
    assert printed["nearest"] == pytest.approx(1.39, abs=0.005)
    assert max(wider["nearest"], shorter["nearest"]) < 1e-6


# --- errata ------------------------------------------------------------------------------------------


def test_errata_of_the_prism() -> None:
    found = check_errata()
    order = found["column_order"]
    assert order["best"] == ("B1B2", "B3B1", "B2B3", "A1B2", "A3B1", "A2B3")
    assert order["second_mean"] > 2 * order["best_mean"]
    assert order["stated_mean"] > 20
    forces = found["generalised_forces"]
    assert (forces["printed"][:2] > 0.5).all()
    assert forces["printed"][2] < 1e-15  # vertical loads
    assert forces["with_radius_angle"].max() < 1e-15
    row = found["unloaded_row"]
    assert row["distance"] == pytest.approx(1.39, abs=0.005)
    assert row["spread"] == pytest.approx(0.0072, abs=1e-6)
