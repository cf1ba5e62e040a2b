import math
import re
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.write import write_scene
from tests.cases import thorough
from tests.cli.conftest import Run, write_example
from tests.cli.scenes import FRAME, HANGING, TRUSS_REST, write, write_truss
from tests.reference import ReferenceModel
from tests.report.page_html import check_static
from tests.rigid_scenes import HANGING as RODS

# A bar of 2 kg hangs on a spring: half of its weight acts on each end.
BAR_ON_SPRING = """\
name = "bar_on_spring"
gravity = [0, 0, -10]
[nodes]
top = { position = [0, 0, 0], anchored = true }
middle = { position = [0, 0, -1], mass = 0.5 }
end = { position = [0, 0, -2] }
[members]
s1 = { kind = "cable", spring_constant = 100, rest_length = 1, nodes = ["top", "middle"] }
rod = { kind = "bar", spring_constant = 1000, rest_length = 1, mass = 2, nodes = ["middle", "end"] }
"""
# 1 N/m and EA 1000 N over 10 m.
SPAN = """\
name = "span"
axes = "xz"
gravity = [0, -10]
[nodes]
a = { position = [0, 0], anchored = true }
b = { position = [10, 0], anchored = true }
[members.line]
kind = "cable"
nodes = ["a", "b"]
axial_stiffness = 1000
rest_length = 10.5
mass_per_length = 0.1
segments = 8
[[inputs]]
name = "winch"
kind = "rest_length"
members = ["line"]
"""
FREE = """\
name = "free"
[classes.cable]
kind = "cable"
spring_constant = 200
[classes.bar]
kind = "bar"
spring_constant = 2e4
[shape]
kind = "prism"
bars = 3
bottom_radius = 0.2
top_radius = 0.2
height = 0.3
node_mass = 0.1
prestress = 10
"""


def settled(path: Path) -> ReferenceModel:
    return ReferenceModel(load_scene(path)[0])


def test_a_mass_on_a_cord_hangs_where_it_must(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("equilibrium", path, "--json").data
    assert data["status"] == "converged"
    assert data["node_position"]["b"] == pytest.approx([0, 0, -0.9 - 0.0981], rel=1e-9, abs=1e-9)
    assert data["member_length"]["s1"] == pytest.approx(0.9981, rel=1e-9)
    assert data["member_tension"]["s1"] == pytest.approx(9.81, rel=1e-9)
    assert data["smallest_eigenvalue"] == pytest.approx(9.81 / 0.9981, rel=1e-6)
    assert data["displaced_node"] == "b"
    assert data["displacement"] == pytest.approx(0.0019, rel=1e-6)


def test_loads_are_added_to_those_of_the_scene(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING + '\n[[loads]]\nnode = "b"\nforce = [0, 0, -1]\n')
    words = ["--load", "b=0,0,-10", "--load", "b=0,0,-2.5"]
    data = run("equilibrium", path, *words, "--json").data
    assert data["member_tension"]["s1"] == pytest.approx(9.81 + 13.5, rel=1e-9)


@pytest.mark.thorough
def test_a_load_may_start_with_a_minus(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("equilibrium", path, "--load", "b=-1,0,0", "--json").data
    x, _, z = data["node_position"]["b"]
    assert x / z == pytest.approx(1 / 9.81, rel=1e-8)
    assert data["member_tension"]["s1"] == pytest.approx(math.hypot(1, 9.81), rel=1e-8)


def test_the_weight_of_a_bar_rests_on_both_ends(run: Run, folder: Path) -> None:
    path = write(folder / "bar_on_spring.toml", BAR_ON_SPRING)
    data = run("equilibrium", path, "--json").data
    assert data["member_tension"]["s1"] == pytest.approx(25.0, rel=1e-8)
    assert data["member_tension"]["rod"] == pytest.approx(10.0, rel=1e-8)
    assert data["node_position"]["end"][2] == pytest.approx(-2 - 0.25 - 0.01, rel=1e-8)


def test_a_free_floating_prism_settles(run: Run, folder: Path) -> None:
    path = write(folder / "free.toml", FREE)
    ended = run.good("equilibrium", path, "--json")
    assert ended.data["neutral_motions"] == 6
    assert ended.data["smallest_eigenvalue"] > 0
    assert max(ended.data["member_tension"].values()) == pytest.approx(10.0, rel=1e-6)


@pytest.mark.parametrize("load", ["b1=0,0,-1", "t2=3,0,0"])
def test_a_free_floating_prism_holds_no_load(load: str, run: Run, folder: Path) -> None:
    path = write(folder / "free.toml", FREE)
    ended = run("equilibrium", path, "--load", load, "--out", "settled.toml", "--json")
    assert ended.code == 3
    assert ended.data["status"] == "no_equilibrium"
    assert "nothing is anchored" in ended.data["message"]
    assert ended.data["residual"] > 0
    assert ended.data["out"] is None
    assert not Path("settled.toml").exists()


def test_names_and_balance_of_the_settled_prism(run: Run, folder: Path, prism: Path) -> None:
    data = run("equilibrium", prism, "--out", "settled.toml", "--json").data
    structure, _ = load_scene("settled.toml")
    assert tuple(data["node_position"]) == structure.node_name
    assert tuple(data["member_length"]) == tuple(data["member_tension"]) == structure.member_name
    model = settled(folder / "settled.toml")
    assert np.abs(model.compute("node_residual")).max() <= 1e-9 * data["largest_force"]
    for quantity in ("member_length", "member_tension"):
        np.testing.assert_allclose(model.compute(quantity), list(data[quantity].values()), rtol=1e-12)
    np.testing.assert_array_equal(structure.node_position, list(data["node_position"].values()))


@pytest.mark.thorough
def test_a_settled_scene_stays_where_it_is(run: Run, folder: Path, prism: Path) -> None:
    run("equilibrium", prism, "--out", "settled.toml")
    data = run("equilibrium", "settled.toml", "--json").data
    assert data["displacement"] < 1e-9
    simulated = run("simulate", "settled.toml", "--t-end", 0.05, "--json").data
    assert simulated["status"] == "ok"
    assert simulated["largest_kinetic_energy"] < 1e-12


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["newton", "relaxation"])
def test_both_methods_find_it(method: str, run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    data = run("equilibrium", path, "--method", method, "--tolerance", 1e-8, "--json").data
    assert data["method"] == method
    assert data["member_tension"]["s1"] == pytest.approx(9.81, rel=1e-6)


@pytest.mark.parametrize(
    ("load", "error"),
    [
        ("c=0,0,1", "UnknownNameError"),
        ("b=0,0", "InvalidValueError"),
        ("b=0,0,1,2", "InvalidValueError"),
        ("b=0,0,down", "InvalidValueError"),
        ("b", "InvalidValueError"),
        ("", "InvalidValueError"),
        ("b=0,0,nan", "NonFiniteError"),
        ("b=0,0,1e999", "NonFiniteError"),
    ],
)
def test_a_load_that_is_none_is_refused(load: str, error: str, run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    ended = run.refused("equilibrium", path, "--load", load, "--json")
    assert ended.data["error"] == error
    assert ended.data["where"].startswith("--load")
    assert ended.data["allowed"]


@pytest.mark.thorough
def test_a_load_into_a_support_is_told(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    loaded = run("equilibrium", path, "--load", "a=0,3,-5", "--json")
    assert loaded.data["held_load"] == ["a.y", "a.z"]
    assert "a.y, a.z" in loaded.err
    assert run("equilibrium", path, "--load", "b=0,0,-5", "--json").data["held_load"] == []


def test_a_load_off_the_plane_is_refused(run: Run, folder: Path) -> None:
    path = write_example(folder, "planar")
    structure, _ = load_scene(path)
    force = ["0", "0", "0"]
    force[next(axis for axis in range(3) if axis not in structure.axes)] = "1"
    ended = run.refused(
        "equilibrium", path, "--load", f"{structure.node_name[-1]}={','.join(force)}", "--json"
    )
    assert "axis" in ended.data["problem"]


@pytest.mark.parametrize("tolerance", ["0", "-1", "nan", "inf", "1"])
def test_a_tolerance_out_of_range_is_refused(tolerance: str, run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    ended = run.refused("equilibrium", path, f"--tolerance={tolerance}", "--json")
    assert "tolerance" in ended.data["where"]


def test_a_file_is_kept_unless_told_otherwise(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING)
    run.refused("equilibrium", path, "--out", path, "--json")
    assert path.read_text(encoding="utf-8") == HANGING
    run.good("equilibrium", path, "--out", path, "--overwrite")
    assert path.read_text(encoding="utf-8") != HANGING


def test_a_snap_is_told(run: Run, folder: Path) -> None:
    path = write_truss(folder, 0)
    held = run("equilibrium", path, "--load", "c=0,-2", "--json")
    assert (held.code, held.data["snapped"], held.err) == (0, False, "")
    through = run("equilibrium", path, "--load", "c=0,-20", "--json")
    assert (through.code, through.data["status"], through.data["snapped"]) == (0, "converged", True)
    assert through.data["limit_load_factor"] == pytest.approx(0.15095737, rel=1e-6)
    assert "snapped" in through.err


def test_own_weight_snaps_a_truss_as_the_same_force_does(run: Run, folder: Path) -> None:
    heavy = write_truss(folder, -10, name="heavy")
    light = write_truss(folder, 0, name="light")
    ends = [
        run("equilibrium", heavy, "--json"),
        run("equilibrium", light, "--load", "c=0,-5", "--json"),
        run("equilibrium", heavy, "--load", "c=0,-5", "--json"),
    ]
    rise = math.sqrt(TRUSS_REST ** (2 / 3) - 1)
    most = 2000 * rise * (TRUSS_REST / math.sqrt(1 + rise * rise) - 1)
    for ended, total in zip(ends, (5.0, 5.0, 10.0), strict=True):
        assert (ended.code, ended.data["snapped"]) == (0, True)
        assert ended.data["limit_load_factor"] == pytest.approx(most / total, rel=1e-8)
        assert "warning: snapped" in ended.err
        assert any("of the structure's size" in text for text in ended.data["warnings"])
    # The weight alone is too much already: what the added load does then is another matter.
    assert ends[2].data["limit_added_load_factor"] is None
    slight = write_truss(folder, -2, name="slight")
    both = run("equilibrium", slight, "--load", "c=0,-5", "--json").data
    assert both["limit_load_factor"] == pytest.approx(most / 6, rel=1e-8)
    assert both["limit_added_load_factor"] == pytest.approx((most - 1) / 5, rel=1e-8)
    # A load path tells what its factor multiplies, and has the same limit where that is the same.
    load = ("load-path", slight, "--load", "c=0,-5", "--events", "limit")
    for options, kind, grows, factor in (
        (("--ramp", "all"), "all", "all loads and weights", most / 6),
        ((), "load", "the loads of --load; those of the scene and weights act in full", (most - 1) / 5),
    ):
        data = run.good(*load, *options, "--json").data
        assert (data["ramp"], data["events"][0]["load_factor"]) == (kind, pytest.approx(factor, rel=1e-8))
        assert f"the load factor multiplies {grows}" in run.good(*load, *options).out
    assert "the path of the increasing load and weight turns back" in ends[0].err


def test_free_motions_are_named_and_taken_out(run: Run, prism: Path) -> None:
    data = run("equilibrium", prism, "--json").data
    assert data["neutral_motion_names"] == ["slide along x", "slide along y", "turn about z"]
    assert len(data["neutral_motion_names"]) == data["neutral_motions"]
    assert 0 < data["change"] <= 1.001 * data["displacement"]
    said = run("equilibrium", prism).out
    assert "free to slide along x, y; turn about z" in said
    assert f"{data['change']:.6g} m" in said


@pytest.mark.parametrize("words", ["linearize", *thorough("analyse", "simulate --t-end 0.01 --samples 2")])
def test_verbs_that_settle_first_warn_of_a_far_equilibrium_and_of_a_snap(
    run: Run, folder: Path, words: str
) -> None:
    verb, *options = words.split()
    said = run(verb, write_truss(folder, -10, name="heavy"), "--settle", *options).err
    assert "of the structure's size" in said
    assert "snapped: the path of the increasing load and weight turns back" in said
    beside = run(verb, write_truss(folder, -1, name="light"), "--settle", *options).err
    assert "of the structure's size" not in beside
    assert "snapped" not in beside


def test_without_an_equilibrium_the_reason_is_the_text(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", HANGING.replace(", anchored = true", ", mass = 1"))
    ended = run("equilibrium", path)
    assert ended.code == 3
    assert ended.out.lstrip().startswith("no_equilibrium: nothing is anchored along z")
    found = run("equilibrium", write(folder / "held.toml", HANGING.replace('"small"', '"held"')))
    assert "converged\n" in found.out or re.search(r"converged: \S", found.out)


PAIRS = """\
name = "pairs"
[nodes]
a = { position = [0, 0, 0], anchored = true }
b = { position = [1, 0, 0], mass = 1 }
d = { position = [5, 0, 0], mass = 1 }
e = { position = [6, 0, 0], mass = 1 }
[members]
c = { kind = "cable", nodes = ["a", "b"], spring_constant = 10, rest_length = 0.3 }
f = { kind = "cable", nodes = ["d", "e"], spring_constant = 10, rest_length = 1.3 }
"""


def test_a_move_of_no_length_has_no_node(run: Run, folder: Path) -> None:
    result = run("equilibrium", write(folder / "pairs.toml", PAIRS))
    assert "farthest, 0 m" not in result.out
    assert "no node moved, without these motions (with them: node " in result.out


def test_pieces_are_said_once_and_no_snap_without_equilibrium(run: Run, folder: Path) -> None:
    result = run("analyse", write(folder / "pairs.toml", PAIRS))
    assert result.err.count("unconnected pieces") == 1
    assert "no members join" not in result.err
    loose = PAIRS.replace("anchored = true", "mass = 1") + '[[loads]]\nnode = "b"\nforce = [5, 0, 0]\n'
    result = run("equilibrium", write(folder / "loose.toml", loose))
    assert result.code == 3
    assert "snapped" not in result.err


def test_the_error_of_cables_in_segments_is_stated(run: Run, folder: Path) -> None:
    path = write(folder / "span.toml", SPAN)
    data = run("equilibrium", path, "--json").data
    (item,) = data["segments"]
    assert (item["cable"], item["n_segments"]) == ("line", 8)
    assert item["extrapolated_sag"] == pytest.approx(1.52249673979, rel=4e-4)
    assert item["sag"] - item["extrapolated_sag"] == pytest.approx(1.1e-2, rel=0.05)
    assert data["snapped"] is None
    text = run("equilibrium", path, "--load", "line_node_4=0,-1").out
    assert "cables in segments" in text
    settled = folder / "settled.toml"
    run("equilibrium", path, "--input", "winch=0.2", "--out", settled)
    again = run("equilibrium", settled, "--json").data
    assert again["displacement"] < 1e-6
    assert again["segments"][0]["sag"] > item["sag"] + 0.2


@pytest.mark.parametrize(("radius", "beyond"), [(0.002, True), (0.02, False)])
def test_members_beyond_their_limits_are_the_first_word(
    radius: float, beyond: bool, run: Run, folder: Path
) -> None:
    """A column of 1 m and E = 2e11 Pa under 100 N: pi^3 E r^4 / (4 l^2) is 25 N, or 250 kN."""
    text = f"""
name = "column"
axes = "z"
[nodes]
foot = {{ position = [0], anchored = true }}
top = {{ position = [1], mass = 1 }}
[members]
rod = {{ kind = "bar", youngs_modulus = 2e11, radius = {radius}, rest_length = 1, nodes = ["foot", "top"] }}
[[loads]]
node = "top"
force = [-100]
[limits]
yield_stress = 1e9
"""
    path = write(folder / "column.toml", text)
    np.savez(folder / "starts.npz", coordinate=[[1.0], [0.999999]])
    motion = ("--t-end", 0.01, "--samples", 2, "--method", "rk853")
    for verb, words in (
        ("equilibrium", ()),
        ("analyse", ("--settle",)),
        ("simulate", motion),
        ("simulate", (*motion, "--batch", "starts.npz")),
    ):
        ended = run(verb, path, *words)
        assert (ended.code, "exceeds limits; " in ended.out.splitlines()[0]) == (0, beyond)
        assert run(verb, path, *words, "--strict").code == (3 if beyond else 0)
    data = run("equilibrium", path, "--json").data
    assert data["status"] == "converged"
    assert [item["limit"] for item in data["limits"]["doubtful"]] == ["buckling"] * beyond
    assert data["limits"]["use"]["yield_stress"]["rod"] == pytest.approx(100 / (np.pi * radius**2 * 1e9))
    assert run("analyse", path, "--settle", "--json").data["limits"].keys() >= data["limits"].keys()


def test_bodies_hang_with_their_centres_below_what_holds_them(run: Run, folder: Path) -> None:
    write_scene(RODS, folder / "rods.toml", overwrite=False)
    ended, data = run.good("equilibrium", "rods.toml"), run("equilibrium", "rods.toml", "--json").data
    assert "corner" not in ended.out + ended.err
    assert "edge" not in ended.out
    assert "bars" not in ended.out
    assert data["displaced_node"] in ("rod_top", "rod_foot", "block_eye")
    centre, axes = np.array(data["body_position"]["block"]), np.array(data["body_axes"]["block"])
    eye = np.array(data["node_position"]["block_eye"])
    np.testing.assert_allclose(centre, eye - [0, 0, math.hypot(0.01, 0.03)], atol=1e-9)
    np.testing.assert_allclose(eye - centre, axes @ [0, -0.01, 0.03], atol=1e-12)


def test_a_page_of_a_load_case_has_loads_supports_and_members(run: Run, folder: Path) -> None:
    """A mass of 1 kg with 5 N on it: 14.81 N in its cable and of its support."""
    path = write(folder / "small.toml", HANGING + "[limits]\nmost_tension = 20\n")
    run.good("equilibrium", path, "--load", "b=0,0,-5", "--page", "case.html")
    text = (folder / "case.html").read_text(encoding="utf-8").replace("\N{NO-BREAK SPACE}", " ")
    check_static(text, [])
    assert "In balance: cables 14.81 N; s1 takes 74 % of its limit of most tension" in text
    assert "loads 0, 0, −5 N; weights 0, 0, −9.81 N; supports 0, 0, 14.81 N" in text
    assert "b moved farthest, 48.1 mm" in text  # (9.81 + 5) / 100 + 0.9 - 1 m
    assert run("equilibrium", path, "--load", "b=0,0,-12", "--strict", "--page", "over.html").code == 3
    assert "Exceeds limits; in balance" in (folder / "over.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("scene", "words"), [(FRAME, "2 nodes on the ground"), (None, "no limits are stated")]
)
def test_a_page_of_feet_and_of_bodies(run: Run, folder: Path, scene: str | None, words: str) -> None:
    path = write_example(folder, "lin_prism") if scene is None else write(folder / "frame.toml", scene)
    run.good("equilibrium", path, "--page", "state.html")
    text = (folder / "state.html").read_text(encoding="utf-8")
    check_static(text, [])
    assert words in text
