"""`analyse --prestress --scene-out`: the scene with the prestress found, read again and settled."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tests.cli.conftest import Run
from tests.cli.scenes import write
from tests.cli.test_analyse import PRISM, TWISTED

# A planar cross of two bars, 1,000 m from the origin; the members in another order than the nodes.
CROSS = """\
name = "cross"
axes = "xz"
[nodes]
d = { position = [1000.0, 0, 1001.0] }
a = { position = [1000.0, 0, 1000.0] }
c = { position = [1001.0, 0, 1001.0] }
b = { position = [1001.0, 0, 1000.0] }
[members]
top = { kind = "cable", nodes = ["c", "d"], axial_stiffness = 1e4 }
b2 = { kind = "bar", nodes = ["b", "d"], axial_stiffness = 1e6 }
low = { kind = "cable", nodes = ["a", "b"], axial_stiffness = 1e4 }
left = { kind = "cable", nodes = ["d", "a"], axial_stiffness = 1e4 }
b1 = { kind = "bar", nodes = ["a", "c"], axial_stiffness = 1e6 }
right = { kind = "cable", nodes = ["b", "c"], axial_stiffness = 1e4 }
"""

# A mast on a ball joint between three stays, as bodies.
MAST = """\
name = "mast"
[classes.stay]
kind = "cable"
axial_stiffness = 1000
[bodies.ground]
kind = "fixed"
points = { o = [0, 0, 0], p = [1, 0, 0], q = [-0.5, 0.8, 0], r = [-0.5, -0.8, 0] }
[bodies.pole]
kind = "bar"
length = 1
mass = 1
inertia = 1
anchor = "ground.o"
azimuth_deg = 20
declination_deg = 10
[tendons]
east = { class = "stay", points = ["ground.p", "pole.B"] }
north = { class = "stay", points = ["ground.q", "pole.B"] }
south = { class = "stay", points = ["ground.r", "pole.B"] }
"""


def check_balance(path: Path, largest: float) -> dict[str, float]:
    """Return the tensions of a flat scene, whose nodes are in balance on their free axes."""
    structure, _ = load_scene(path)
    assert isinstance(structure, Structure)
    i, j = np.asarray(structure.connectivity).T
    vector = structure.node_position[i] - structure.node_position[j]
    length = np.linalg.norm(vector, axis=1)
    tension = structure.compute_static_tension(length)
    force = np.zeros_like(structure.node_position)
    np.add.at(force, i, -(tension / length)[:, None] * vector)
    np.add.at(force, j, (tension / length)[:, None] * vector)
    free = ~structure.node_anchored[:, list(structure.axes)]
    assert np.abs(force[:, list(structure.axes)][free]).max() < 1e-6 * largest
    assert (tension[structure.tension_only] > 0).all()
    return dict(zip(structure.member_name, tension.tolist(), strict=True))


@pytest.mark.parametrize(
    ("text", "size", "name", "force"),
    [
        (PRISM, "50", "vertical1", 50.0),
        (PRISM, "least=7", "top2", 7.0),
        (PRISM, "bar2=-30", "bar2", -30.0),
        (CROSS, "500", "left", 500.0),
    ],
    ids=["largest", "least", "member", "planar"],
)
def test_the_scene_has_the_prestress(
    text: str, size: str, name: str, force: float, run: Run, folder: Path
) -> None:
    path = write(folder / "loose.toml", text)
    ended = run.good("analyse", path, "--prestress", size, "--scene-out", "tense.toml", "--json")
    tension = check_balance(folder / "tense.toml", abs(force) * 2)
    assert tension[name] == pytest.approx(force, rel=1e-6)
    stated = ended.data["prestressed"]
    assert stated["member_tension"] == pytest.approx(tension, rel=1e-6)
    assert stated["residual"] < 1e-6 * abs(force)
    assert stated["note"] == "the only self-stress"


def test_a_law_that_is_not_linear(folder: Path) -> None:
    """Tensions on both sides of the kink of bilinear cables."""
    law = "axial_stiffness = 300\nswitch_force = 20\nstiffness_ratio = 0.2"
    structure, _ = load_scene(write(folder / "bilinear.toml", PRISM.replace("spring_constant = 1000", law)))
    assert not structure.is_linear.all()
    length = np.full(structure.n_members, 0.3)
    tension = np.where(structure.is_bar, -20.0, np.linspace(5.0, 40.0, structure.n_members))
    rest = structure.find_rest_length(length, tension)
    found = structure.with_changes(rest_length=rest).compute_static_tension(length)
    np.testing.assert_allclose(found, tension, rtol=1e-9)


def test_of_several_self_stresses_the_choice_is_stated(run: Run, folder: Path) -> None:
    run("examples", "pinned_prism")
    ended = run.good(
        "analyse", "pinned_prism.toml", "--prestress", "12", "--scene-out", "tense.toml", "--json"
    )
    again = run("analyse", "tense.toml", "--json")
    assert max(again.data["member_tension"].values()) == pytest.approx(12.0, rel=1e-6)
    assert "of 3 self-stresses" in ended.data["prestressed"]["note"]


def test_tendons_of_bodies_have_the_tensions_of_the_file(folder: Path, run: Run) -> None:
    path = write(folder / "mast.toml", MAST)
    run.good("analyse", path, "--prestress", "least=12", "--scene-out", "tense.toml", "--json")
    again = run("analyse", "tense.toml", "--json")
    assert again.data["is_balanced"]
    assert min(again.data["member_tension"].values()) == pytest.approx(12.0, rel=1e-6)


def test_without_a_prestress_nothing_is_written(run: Run, folder: Path) -> None:
    path = write(folder / "twisted.toml", TWISTED)
    ended = run("analyse", path, "--prestress", "50", "--scene-out", "tense.toml", "--json")
    assert ended.code == 3
    assert (ended.data["status"], ended.data["prestressed"]) == ("infeasible", None)
    assert "equilibrium NEAR.toml --out" in ended.data["hint"]
    assert any("tense.toml is not written" in text for text in ended.data["warnings"])
    assert not (folder / "tense.toml").exists()


def test_a_rounded_shape_is_written_near_balance_and_settles(run: Run, folder: Path) -> None:
    """The hint, followed to its end, for a prism of 150 degrees whose twist is half a degree off."""
    path = write(folder / "rounded.toml", PRISM + "twist = 150.5\n")
    alone = run("analyse", path, "--json")
    assert (alone.code, alone.data["n_selfstress"]) == (3, 0)
    words = ("--rank-tolerance", "0.05", "--prestress", "100", "--scene-out", "near.toml")
    ended = run.good("analyse", path, *words, "--json")
    assert any("`equilibrium near.toml --out SETTLED.toml`" in text for text in ended.data["warnings"])
    assert ended.data["prestressed"]["residual"] > 1e-3
    run.good("equilibrium", "near.toml", "--out", "settled.toml")
    check_balance(folder / "settled.toml", 100.0)
    settled, _ = load_scene(folder / "settled.toml")
    rounded, _ = load_scene(path)
    assert isinstance(settled, Structure)
    assert isinstance(rounded, Structure)
    assert np.abs(settled.member_length() - rounded.member_length()).max() < 0.01
    assert run.good("analyse", "settled.toml", "--json").data["n_selfstress"] == 1


@pytest.mark.parametrize(
    ("size", "problem"),
    [
        ("much", "not a force"),
        ("nan", "not a finite force"),
        ("0", "a prestress without tension"),
        ("-5", "a prestress without tension"),
        ("bar1=30", "in compression"),
        ("vertical=3", "unknown member"),
        ("1e9", "no rest length"),
    ],
)
def test_sizes_that_are_none(size: str, problem: str, run: Run, folder: Path) -> None:
    path = write(folder / "loose.toml", PRISM)
    ended = run.refused("analyse", path, f"--prestress={size}", "--scene-out", "tense.toml", "--json")
    assert problem in ended.data["error"] + str(ended.data)
    assert not (folder / "tense.toml").exists()


def test_one_option_needs_the_other(run: Run, folder: Path) -> None:
    path = write(folder / "loose.toml", PRISM)
    run.refused("analyse", path, "--prestress", "5")
    run.refused("analyse", path, "--scene-out", "tense.toml")


def test_cables_with_next_to_no_prestress_are_named(run: Run, folder: Path) -> None:
    """Three cables at one node, two of them nearly in line: the third pulls as much as these rise, 0.1 %."""
    ends = {"a": "-1, 0", "b": "1, 0.001", "d": "0, -1"}
    nodes = "".join(f"{name} = {{ position = [{at}], anchored = true }}\n" for name, at in ends.items())
    members = "".join(f'c{name} = {{ class = "rope", nodes = ["m", "{name}"] }}\n' for name in ends)
    head = 'name = "fan"\naxes = "xy"\n[classes.rope]\nkind = "cable"\naxial_stiffness = 1e5\n[nodes]\n'
    scene = write(folder / "fan.toml", f"{head}m = {{ position = [0, 0] }}\n{nodes}[members]\n{members}")
    told = run("analyse", scene, "--prestress", 1000, "--scene-out", folder / "tense.toml").err
    assert "less than 1 % of the largest tension, as rounded positions may: 1 N and more in 1 (cd)" in told
    write(scene, scene.read_text().replace("0.001", "0.1"))
    assert (
        "of the largest tension"
        not in run("analyse", scene, "--prestress", 1000, "--scene-out", folder / "stiff.toml").err
    )
