"""SCS Figs 4 to 11 and equations (44), (45), (52), (53): ours beside the print, and the errata."""

import math

import numpy as np
import pytest

from tensegrity_codegen.studies.papers.scs.figures import (
    check_errata,
    compare_equilibria,
    compare_tracking,
    compute_figures,
    compute_paper_maps,
    find_prestressable,
    map_regions,
)
from tensegrity_codegen.studies.papers.scs.printed import PAPER_POSES, PrintedTower
from tensegrity_codegen.system.errors import InvalidValueError
from tests.studies.papers.scs.subjects import determinant_condition, pose, tower


def test_every_printed_number_is_met() -> None:
    rows = compare_equilibria(tower())
    assert len(rows) == 13
    for row in rows:
        assert row["difference"] == row["ours"] - row["paper"]
        # delta_f is printed with its digits cut.
        assert abs(row["difference"]) < 0.006, row


def test_printed_data_miss_the_printed_tensions() -> None:
    rows = [row for row in compare_equilibria(tower()) if row["unit"] == "N"]
    relative = [abs(row["with_printed_data"] / row["paper"] - 1.0) for row in rows]
    assert max(relative) > 0.08


def test_all_figures_have_their_curves() -> None:
    figures = compute_figures(tower(), n_t=21)
    assert list(figures) == [f"Fig. {number}" for number in range(4, 12)]
    names = {key: list(figure["curves"]) for key, figure in figures.items()}
    assert names["Fig. 4"] == names["Fig. 8"] == ["alpha", "delta"]
    assert names["Fig. 5"] == names["Fig. 9"] == ["S_0", "V_0", "D_0"]
    assert names["Fig. 6"] == names["Fig. 10"] == ["T_S", "T_V", "T_D"]
    assert names["Fig. 7"] == names["Fig. 11"] == ["M_3"]
    for figure in figures.values():
        assert all(np.isfinite(curve).all() and curve.shape == (21,) for curve in figure["curves"].values())


def test_maps_hold_the_printed_configurations() -> None:
    maps = compute_paper_maps(tower(), step_deg=5.0)
    assert maps["(44)"].feasible[7, 11]  # delta = 40, alpha = 55 deg
    assert maps["(52)"].feasible[5, 14]  # delta = 30, alpha = 70 deg


@pytest.mark.thorough
def test_tracking_has_both_controls_of_every_motion() -> None:
    rows = compare_tracking(tower(), rtol=1e-8, samples=11)
    errors = {(row["motion"], row["controls"]): row["angle_error_deg"] for row in rows}
    for name in ("with_torque", "zero_torque", "prescribed"):
        assert errors[name, "ours"] < 1e-7
        assert errors[name, "as printed"] > 5e-5


def test_every_erratum_is_one_and_its_correction_is_right() -> None:
    rows = {row["name"]: row for row in check_errata(tower())}
    assert len(rows) == 4
    for name, row in rows.items():
        assert row["error_as_printed"] > 0.1, name
        assert row["error_as_corrected"] < (0.006 if name == "rounded b and Z" else 1e-12), name


def test_errata_hold_for_every_draw() -> None:
    first, second = (check_errata(tower(), samples=5, seed=seed) for seed in (2, 3))
    assert first[0]["error_as_printed"] != pytest.approx(second[0]["error_as_printed"])


@pytest.mark.parametrize("key", ["44", "45", "52"])
def test_the_printed_equilibria_are_in_the_feasible_region(key: str) -> None:
    item = PAPER_POSES[key]
    grid = {"alpha_deg": np.array([item.alpha_deg]), "delta_deg": np.array([item.delta_deg])}
    found = map_regions(tower(), item.height, item.force, **grid)
    assert found.feasible.all()
    assert found.tension[0, 0] == pytest.approx(tower().equilibrium(item.pose, item.force), rel=1e-10)


def test_codes_say_which_tendons_push() -> None:
    alpha, delta = np.array([20.0, 30.0, 55.0, 80.0, 200.0]), np.array([10.0, 40.0, 70.0])
    found = map_regions(tower(), 0.9, -50.0, alpha_deg=alpha, delta_deg=delta)
    assert (found.code[0] == -1).all()  # Z < l cos(10 deg)
    assert (found.code[:, 1] == -1).all()  # alpha = 30 deg
    for row, column in zip(*np.nonzero(found.code >= 0), strict=True):
        tension = tower().equilibrium(pose(alpha[column], delta[row], 0.9), -50.0)
        assert found.code[row, column] == sum(
            bit for bit, t in zip((1, 2, 4), tension, strict=True) if t <= 0
        )
        assert found.tension[row, column] == pytest.approx(tension, rel=1e-9)
    assert np.isnan(found.determinant[0]).all()


def test_the_opposite_force_reverses_every_tension() -> None:
    up, down = (map_regions(tower(), 1.3, force, alpha_deg=np.arange(0, 360, 7.0)) for force in (50.0, -50.0))
    inside = up.code >= 0
    assert (up.code[inside] + down.code[inside] == 7).all()


def test_prestressable_configurations_balance_without_load() -> None:
    (found,) = find_prestressable(tower(), math.radians(40.0), 1.11066)
    matrix = tower().matrix(found.pose.parameter[None])[0]
    assert np.abs(matrix @ found.tension).max() < 1e-13
    assert (found.tension > 0).all()
    assert np.linalg.norm(found.tension) == pytest.approx(1.0)
    # SCS (42) holds there, by its closed form.
    assert abs(determinant_condition(PrintedTower.of(tower()), *found.pose.parameter)) < 1e-14


def test_prestressable_configurations_border_on_the_feasible_ones_of_both_forces() -> None:
    (found,) = find_prestressable(tower(), math.radians(40.0), 1.11066)
    degrees = found.pose.in_degrees
    sides = [degrees[0] - 0.01, degrees[0] + 0.01]
    grids = [
        map_regions(tower(), 1.11066, force, alpha_deg=np.array(sides), delta_deg=np.array([40.0])).feasible[
            0
        ]
        for force in (50.0, -50.0)
    ]
    assert sorted(grid.tolist() for grid in grids) == [[False, True], [True, False]]


def test_no_prestressable_configuration_where_no_null_vector_has_one_sign() -> None:
    assert find_prestressable(tower(), math.radians(55.0), 1.2) == ()


@pytest.mark.parametrize(
    ("height", "force", "more", "where"),
    [
        (1.2, 0.0, {}, "force"),
        (1.2, math.inf, {}, "force"),
        (-1.0, 50.0, {}, "height"),
        (1.2, 50.0, {"alpha_deg": np.array([])}, "alpha_deg, delta_deg"),
        (1.2, 50.0, {"alpha_deg": np.array([math.nan])}, "alpha_deg, delta_deg"),
        (1.2, 50.0, {"alpha_deg": np.linspace(0, 1, 20000)}, "alpha_deg, delta_deg"),
    ],
)
def test_wrong_maps_are_refused(height: float, force: float, more: dict[str, np.ndarray], where: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        map_regions(tower(), height, force, **more)
    assert caught.value.where == where
