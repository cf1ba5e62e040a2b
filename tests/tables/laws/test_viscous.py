"""The law of viscous members by hand: springs and dashpot, rest, scenes, bad input."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.laws.viscous import Viscous
from tests.tables.laws.test_plastic import SCENE

LAW, MU, TIME, FRACTION = Viscous(), 1e4, 0.5, 0.3
VALUES = {"relaxation_time": TIME, "relaxed_fraction": FRACTION}


def read(folder: Path, values: str, kind: str = "cable") -> Structure:
    path = folder / "weight.toml"
    path.write_text(SCENE.format(values=values, kind=kind), encoding="utf-8")
    structure, _ = load_scene(path)
    assert isinstance(structure, Structure)
    return structure


@pytest.mark.parametrize("slack", [False, True])
def test_both_halves_of_a_member_carry_the_same_force(slack: bool) -> None:
    """Spring mu in series with k beside c: t = mu (x - p) = k p + c p', and t = 0 of a slack cable."""
    k = FRACTION * MU / (1.0 - FRACTION)
    c = TIME * (MU + k)
    for x, p in np.random.default_rng(2).uniform(-0.03, 0.03, (40, 2)):
        moving = VALUES | {"viscous": p}
        tension = MU * float(LAW.effective_elongation(x, moving, np.where))
        if slack:
            tension = max(tension, 0.0)
        (rate,) = LAW.rates((x, 7.0), moving, np.where, slack)
        assert k * p + c * float(rate) == pytest.approx(tension, abs=1e-11)
        # What goes in is stored or lost in the dashpot: t x' = E' + c p'^2 at any x'
        step, speed = 1e-7, 0.4

        def energy(s: float, x: float = x, p: float = p, rate: float = float(rate)) -> float:
            values = VALUES | {"viscous": p + s * rate}
            at = x + s * 0.4
            return float(
                LAW.energy(MU, LAW.limit_slack(at, values, np.where) if slack else at, values, np.where)
            )

        gained = (energy(step) - energy(-step)) / (2 * step)
        assert gained + c * float(rate) ** 2 == pytest.approx(tension * speed, abs=1e-4)


def test_a_relaxed_member_is_a_softer_spring() -> None:
    for x in (0.02, -0.01):
        (p,) = LAW.settle(x, VALUES, np.where)
        moving = VALUES | {"viscous": p}
        assert LAW.rates((x, 0.0), moving, np.where, False)[0] == pytest.approx(0.0, abs=1e-16)
        rest = LAW.effective_elongation(x, VALUES, np.where)
        assert (
            LAW.effective_elongation(x, moving, np.where)
            == pytest.approx(rest)
            == pytest.approx(FRACTION * x)
        )
        assert LAW.energy(MU, x, moving, np.where) == pytest.approx(0.5 * FRACTION * MU * x * x)
        assert LAW.slope(MU, x, VALUES, np.where) == FRACTION * LAW.slope(MU, x, moving, np.where)


@pytest.mark.parametrize("stiffness", ["axial_stiffness = 100", "spring_constant = 100"])
def test_a_viscous_member_survives_a_scene_file(tmp_path: Path, stiffness: str) -> None:
    """Prestress is the relaxed tension, which a motion of the scene starts with."""
    structure = read(tmp_path, f"{stiffness}, relaxation_time = 2, relaxed_fraction = 0.4, prestress = 6")
    assert structure.static_tension() == pytest.approx([6.0], rel=1e-14)
    assert structure.internal_name == ("rope_viscous", "viscous_work")
    path = tmp_path / "again.toml"
    write_scene(describe_structure(structure), path)
    again, _ = load_scene(path)
    for name in ("relaxation_time", "relaxed_fraction"):
        assert np.array_equal(structure.law_parameter[name], again.law_parameter[name])


@pytest.mark.parametrize(
    ("values", "kind", "word"),
    [
        ("spring_constant = 9, relaxation_time = 0, relaxed_fraction = 0.5", "cable", "relaxation_time"),
        ("spring_constant = 9, relaxation_time = -1, relaxed_fraction = 0.5", "cable", "relaxation_time"),
        ("spring_constant = 9, relaxation_time = nan, relaxed_fraction = 0.5", "cable", "relaxation_time"),
        ("spring_constant = 9, relaxation_time = inf, relaxed_fraction = 0.5", "cable", "relaxation_time"),
        ("spring_constant = 9, relaxation_time = 1, relaxed_fraction = 0", "cable", "relaxed_fraction"),
        ("spring_constant = 9, relaxation_time = 1, relaxed_fraction = 1", "cable", "relaxed_fraction"),
        ("spring_constant = 9, relaxation_time = 1, relaxed_fraction = nan", "cable", "relaxed_fraction"),
        ("spring_constant = 9, relaxation_time = 1", "cable", "without relaxed_fraction"),
        ("spring_constant = 9, relaxed_fraction = 0.5", "cable", "without relaxation_time"),
        ("relaxation_time = 1, relaxed_fraction = 0.5", "bar", "a rigid bar"),
        (
            "spring_constant = 9, relaxation_time = 1, relaxed_fraction = 0.5, yield_force = 1",
            "cable",
            "two laws",
        ),
    ],
)
def test_what_no_viscous_member_can_have_is_refused(
    tmp_path: Path, values: str, kind: str, word: str
) -> None:
    with pytest.raises(InvalidValueError, match=word) as caught:
        read(tmp_path, values, kind)
    assert "rope" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("relaxation_time", -1.0),
        ("relaxation_time", np.nan),
        ("relaxed_fraction", 1.0),
        ("relaxed_fraction", 0.0),
    ],
)
def test_parameters_out_of_range_are_refused_in_arrays_too(tmp_path: Path, name: str, value: float) -> None:
    structure = read(tmp_path, "spring_constant = 100, relaxation_time = 1, relaxed_fraction = 0.5")
    changed = structure.with_changes(law_parameter={**structure.law_parameter, name: np.array([value])})
    with pytest.raises((InvalidValueError, NonFiniteError), match=name):
        check_structure(changed)
