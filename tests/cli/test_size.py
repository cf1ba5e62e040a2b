"""The verb `size`: verdict first, sections, the written scene, exit codes, wrong input."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run

D_BAR = """name = "dbar"
axes = "xy"

[nodes]
n1 = { position = [-1.0, 0.0] }
n2 = { position = [0.0, -1.0] }
n3 = { position = [1.0, 0.0] }
n4 = { position = [0.0, 1.0] }

[classes]
rod = { kind = "bar", axial_stiffness = 1e6 }
rope = { kind = "cable", axial_stiffness = 1e5 }

[members]
b1 = { class = "rod", nodes = ["n1", "n2"] }
b2 = { class = "rod", nodes = ["n2", "n3"] }
b3 = { class = "rod", nodes = ["n3", "n4"] }
b4 = { class = "rod", nodes = ["n4", "n1"] }
across = { class = "rope", nodes = ["n2", "n4"] }
"""
MATERIAL = ["--youngs-modulus", "60e9", "--density", "2700", "--yield-stress", "110e6"]
PRESS = ["--case", "press:n1=1e4,0", "--case", "press:n3=-1e4,0"]


@pytest.fixture
def scene(folder: Path) -> Path:
    path = folder / "dbar.toml"
    path.write_text(D_BAR, encoding="utf-8")
    return path


def test_the_d_bar_is_sized_and_written(run: Run, folder: Path, scene: Path) -> None:
    ended = run.good("size", scene, *MATERIAL, *PRESS, "-o", folder / "sized.toml")
    assert ended.out.startswith("optimal: 8.85802309 kg")
    assert "buckling" in ended.out
    assert "proved: no sections carry the loads below 8.858023" in ended.out
    again = run.good("size", folder / "sized.toml", *MATERIAL[4:], *PRESS, "--json")
    assert again.data["total_mass"] == pytest.approx(8.85802309, abs=1e-7)
    assert again.data["members"]["b1"]["tension"] == {"press": pytest.approx(-7071.0678)}
    assert again.data["members"]["across"]["limit"] == "yield"
    assert again.data["mass_gradient"]["n1"][1] is None


def test_the_written_scene_has_the_mass_that_is_stated(run: Run, folder: Path, scene: Path) -> None:
    """8.367114 kg of bars, 0.490909 kg of the cable; a cable without force stays and is named."""
    along = 'along = { class = "rope", nodes = ["n1", "n3"], mass = 0.25 }\n'
    scene.write_text(D_BAR + along, encoding="utf-8")
    ended = run.good("size", scene, *MATERIAL, *PRESS, "-o", folder / "sized.toml")
    assert "1 member without force: along;" in ended.out
    assert ended.out.rstrip().endswith("sized.toml: 0.25 kg more, of members without force")
    assert "mass 9.10802 kg" in run.good("check", folder / "sized.toml").out


def test_the_bound_beside_a_catalogue_is_of_any_sections(run: Run, scene: Path) -> None:
    ended = run.good("size", scene, *MATERIAL, *PRESS, "--sections", "1e-3")
    assert ended.out.startswith("local: ")
    assert "kg, proved 8.85802 kg with sections of any area after" in ended.out


def test_a_member_comes_before_all(run: Run, scene: Path) -> None:
    data = run.good("size", scene, *MATERIAL, "--density", "across=1", *PRESS, "--json").data
    assert data["members"]["across"]["mass"] == pytest.approx(0.490909091 / 2700)
    assert data["members"]["b1"]["mass"] == pytest.approx(2.0917785)


def test_a_catalogue_a_prestress_and_factors_are_stated(run: Run, scene: Path) -> None:
    words = ("press:loads=0", "press:weight=1.2", "press:across=1e4")
    cases = [*PRESS, *(word for text in words for word in ("--case", text))]
    data = run.good("size", scene, *MATERIAL, *cases, "--sections", "1e-4,6e-4", "--json").data
    assert data["members"]["b1"]["area"] == 6e-4
    assert data["members"]["across"]["area"] == 1e-4
    assert data["members"]["across"]["tension"]["press"] == pytest.approx(1e4)
    ended = run("size", scene, *MATERIAL, *PRESS, "--sections", "thick")
    assert ended.code == 2
    assert "not areas" in ended.err


def test_loads_that_nothing_carries_end_with_code_3(run: Run, folder: Path, scene: Path) -> None:
    words = ["--case", "pull:n1=-1,0", "--case", "pull:n3=1,0"]
    ended = run("size", scene, *MATERIAL, *words, "-o", folder / "sized.toml", "--json")
    assert ended.code == 3
    assert ended.data["error"] == "InfeasibleError"
    assert ended.data["where"] == "dbar: load case pull"
    assert "--bars-pull" in ended.data["hint"]
    assert ended.data["evidence"]["unbalanced_force"] == pytest.approx(2.0)
    assert not (folder / "sized.toml").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([*MATERIAL[:4], *PRESS], "no yield stress of some members"),
        ([*MATERIAL[:4], "--yield-stress=-1", *PRESS], "not a yield stress"),
        ([*MATERIAL[:4], "--yield-stress", "nan", *PRESS], "not a yield stress"),
        ([*MATERIAL[:4], "--yield-stress", "strong", *PRESS], "VALUE or NAME=VALUE"),
        ([*MATERIAL, "--density", "1", *PRESS], "a name twice"),
        ([*MATERIAL, "--case", "n1=1,0"], "CASE:NODE=fx,fy,fz"),
        ([*MATERIAL, "--case", "a:n9=1,0"], "unknown node"),
        ([*MATERIAL], "no load and no least tension"),
    ],
)
def test_wrong_input_is_code_2_and_leaves_nothing(
    run: Run, folder: Path, scene: Path, words: list[str], says: str
) -> None:
    ended = run("size", scene, *words, "-o", folder / "sized.toml")
    assert ended.code == 2
    assert says in ended.err
    assert not (folder / "sized.toml").exists()
