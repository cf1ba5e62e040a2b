"""The law of plastic members by hand: loops, return mapping, energy, bad input.

k = 1e4 N/m, Fy = 50 N, h = 0.1: Hp = h k / (1 - h); Simo and Hughes, Computational Inelasticity, 1998, 1.4.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.laws.plastic import Plastic

LAW, K = Plastic(), 1e4
START = {"yield_elongation": 0.005, "hardening": 0.1, "isotropic": 0.0, "plastic": 0.0, "accumulated": 0.0}


def follow(elongations: Any, *, slack: bool = False, **changes: float) -> list[tuple[float, float, float]]:
    """Return t, q and a at elongations reached one after the other."""
    values: dict[str, Any] = {**START, **changes}
    found = []
    for x in elongations:
        at = LAW.limit_slack(x, values, np.where) if slack else x
        tension = K * float(LAW.effective_elongation(at, values, np.where))
        q, a = LAW.settle(at, values, np.where)
        values |= {"plastic": float(q), "accumulated": float(a)}
        found.append((tension, float(q), float(a)))
    return found


def test_the_loop_of_kinematic_hardening_has_its_corners_and_area() -> None:
    loop = follow([0.02, -0.02, 0.0])
    assert [t for t, _, _ in loop] == pytest.approx([65.0, -65.0, 45.0], rel=1e-13)
    assert [q for _, q, _ in loop] == pytest.approx([0.0135, -0.0135, -0.0045], rel=1e-13)
    way = np.concatenate([np.linspace(0.02, -0.02, 4001), np.linspace(-0.02, 0.02, 4001)])
    tension = np.array([t for t, _, _ in follow(np.concatenate([[0.02], way]))])[1:]
    area = float(np.sum((tension[1:] + tension[:-1]) / 2 * np.diff(way)))
    assert area == pytest.approx(2.7, rel=1e-5)
    start, end = follow([0.02, -0.02, 0.02])[::2]
    assert 50.0 * (end[2] - start[2]) == pytest.approx(2.7, rel=1e-13)  # Fy times accumulated flow


def test_isotropic_hardening_widens_the_range() -> None:
    loop = follow([0.02, -0.02], isotropic=1.0)
    assert loop[0][0] == pytest.approx(65.0, rel=1e-13)
    assert loop[1][0] == pytest.approx(-92.0, rel=1e-13)


def test_a_straight_way_in_one_step_or_in_many_ends_the_same() -> None:
    for share in (0.0, 0.3, 1.0):
        whole = follow([0.02, -0.013], isotropic=share)[-1]
        parts = follow([*np.linspace(0, 0.02, 7), *np.linspace(0.02, -0.013, 9)], isotropic=share)[-1]
        assert whole == pytest.approx(parts, rel=1e-12)


def test_without_hardening_the_force_stays() -> None:
    assert [t for t, _, _ in follow([0.02, 0.5, 0.495], hardening=0.0)] == pytest.approx([50.0, 50.0, 0.0])


def test_a_cable_that_yields_and_slackens_has_grown() -> None:
    """q = 0.0135 after 65 N; slack until the elongation is q again."""
    way = follow([0.02, 0.0165, -0.5, 0.0135, 0.0145], slack=True)
    assert [t for t, _, _ in way] == pytest.approx([65.0, 30.0, 0.0, 0.0, 10.0], abs=1e-11)
    assert {round(q, 12) for _, q, _ in way} == {0.0135}


def test_a_cable_that_hardens_much_yields_back_before_it_is_slack() -> None:
    """X = Hp q above Fy: flow goes back until t = 0, where X = Fy, q = Fy / Hp = 0.045."""
    way = follow([0.2, -1.0, 0.05], slack=True)
    assert way[0][1] == pytest.approx(0.9 * 0.195, rel=1e-13)
    assert way[1][:2] == (pytest.approx(0.0, abs=1e-11), pytest.approx(0.045, rel=1e-13))
    assert way[2][0] == pytest.approx(K * 0.005, rel=1e-13)


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("hardening", [0.0, 0.1])
def test_the_tension_at_rest_is_the_slope_of_the_energy(share: float, hardening: float) -> None:
    random = np.random.default_rng(4)
    for q, x in random.uniform(-0.03, 0.03, (20, 2)):
        values = {
            **START,
            "isotropic": share,
            "hardening": hardening,
            "plastic": q,
            "accumulated": abs(q) + 0.01,
        }
        step = 1e-7
        ends = [float(LAW.energy(K, x + s * step, values, np.where)) for s in (1, -1)]
        tension = K * float(LAW.effective_elongation(x, values, np.where))
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(tension, abs=2e-4)
        rise = [float(LAW.effective_elongation(x + s * step, values, np.where)) for s in (1, -1)]
        slope = float(LAW.slope(K, x, values, np.where))
        assert K * (rise[0] - rise[1]) / (2 * step) == pytest.approx(slope, rel=1e-6)


SCENE = """
name = "weight"
[nodes]
top = {{ position = [0, 0, 1], anchored = true }}
mass = {{ position = [0, 0, 0], mass = 1, anchored = "xy" }}
[members]
rope = {{ kind = "{kind}", nodes = ["top", "mass"], {values} }}
[model]
quantities = ["member_tension"]
"""


def read(folder: Path, values: str, kind: str = "cable") -> Structure:
    path = folder / "weight.toml"
    path.write_text(SCENE.format(values=values, kind=kind), encoding="utf-8")
    structure, _ = load_scene(path)
    assert isinstance(structure, Structure)
    return structure


def test_a_plastic_member_survives_a_scene_file(tmp_path: Path) -> None:
    structure = read(tmp_path, "axial_stiffness = 100, yield_force = 7, isotropic = 0.5, prestress = 6")
    assert structure.law_parameter["yield_elongation"] * structure.mu == pytest.approx(7.0, rel=1e-14)
    assert structure.static_tension() == pytest.approx([6.0], rel=1e-14)
    assert structure.internal_name == (
        *("rope_plastic", "rope_accumulated"),
        *("rope_pulled_yields", "rope_pushed_yields"),
    )
    path = tmp_path / "again.toml"
    write_scene(describe_structure(structure), path)
    again, _ = load_scene(path)
    for name in ("yield_elongation", "hardening", "isotropic"):
        assert np.array_equal(structure.law_parameter[name], again.law_parameter[name])


@pytest.mark.parametrize(
    ("values", "kind", "word"),
    [
        ("spring_constant = 9, yield_force = 0", "cable", "yield_force"),
        ("spring_constant = 9, yield_force = nan", "cable", "yield_force"),
        ("spring_constant = 9, yield_force = 1, hardening = 1", "cable", "hardening"),
        ("spring_constant = 9, yield_force = 1, hardening = -0.1", "cable", "hardening"),
        ("spring_constant = 9, yield_force = 1, isotropic = 1.5", "cable", "isotropic"),
        ("spring_constant = 9, hardening = 0.5", "cable", "without yield_elongation or yield_force"),
        ("spring_constant = 9, yield_force = 1, yield_elongation = 1", "cable", "cannot be given together"),
        (
            "spring_constant = 9, yield_force = 1, prestress = 2",
            "cable",
            "no rest length gives this prestress",
        ),
        ("yield_force = 1", "bar", "a rigid bar"),
        (
            "spring_constant = 9, yield_force = 1, stiffness_ratio = 2, switch_elongation = 1",
            "cable",
            "two laws",
        ),
    ],
)
def test_what_no_plastic_member_can_have_is_refused(
    tmp_path: Path, values: str, kind: str, word: str
) -> None:
    with pytest.raises(InvalidValueError, match=word) as caught:
        read(tmp_path, values, kind)
    assert "rope" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [("yield_elongation", -1.0), ("hardening", 1.0), ("isotropic", 2.0), ("hardening", np.nan)],
)
def test_parameters_out_of_range_are_refused_in_arrays_too(tmp_path: Path, name: str, value: float) -> None:
    structure = read(tmp_path, "spring_constant = 100, yield_force = 7, hardening = 0.1, isotropic = 0.5")
    changed = structure.with_changes(law_parameter={**structure.law_parameter, name: np.array([value])})
    with pytest.raises((InvalidValueError, NonFiniteError), match=r"hardening|yield|share"):
        check_structure(changed)
