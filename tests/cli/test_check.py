import json
import math
import re
from pathlib import Path

import pytest

from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.ground_support import MAX_CONTACTS
from tests.cli.conftest import Run, write_example
from tests.cli.scenes import GOOD, HANGING, write
from tests.rigid_scenes import HANGING as RODS


def test_it_says_what_a_scene_holds(run: Run, prism: Path) -> None:
    data = run("check", prism, "--json").data
    assert data["status"] == "ok"
    assert data["name"] == "prism"
    assert (data["n_nodes"], data["n_bars"], data["n_cables"]) == (6, 3, 9)
    assert data["n_coordinates"] == 15  # three nodes slide on a table
    assert data["axes"] == "xyz"
    assert data["formulation"] == "node_position"
    assert "member_tension" in data["quantities"]
    assert data["warnings"] == []


def test_a_planar_scene_has_its_axes(run: Run, folder: Path) -> None:
    data = run("check", write_example(folder, "planar"), "--json").data
    assert len(data["axes"]) == 2


def test_one_thing_is_in_the_singular(run: Run, two_nodes: Path) -> None:
    assert run("check", two_nodes).out.startswith(
        "two_nodes: no mistake found; 2 nodes, 0 bars, 1 cable, 3 free coordinates\n"
    )


def test_nothing_is_written(run: Run, folder: Path, prism: Path) -> None:
    ended = run("check", prism)
    assert ended.out.startswith("prism: no mistake found; 6 nodes, 3 bars, 9 cables, 15 free coordinates\n")
    assert list(folder.iterdir()) == [prism]


def test_fixed_steps_across_slack_cables_are_a_hint(run: Run, two_nodes: Path) -> None:
    (hint,) = run("check", two_nodes, "--json").data["hints"]
    assert hint.startswith("rk4 ")
    assert "1 cable" in hint
    assert 'events = ["auto"] under [model]' in hint
    text = two_nodes.read_text()
    for integrators, key in ((["rk4"], "events = []\n"), (["rk4"], 'events = ["cable"]\n'), (["rk54"], "")):
        stated = f"integrators = {json.dumps(integrators)}\n{key}"
        path = write(two_nodes, re.sub(r"integrators = .*\n", stated, text))
        assert run("check", path, "--json").data["hints"] == []


def test_a_sound_scene_is_described(run: Run, prism: Path) -> None:
    data, text = run("check", prism, "--json").data, run("check", prism).out
    assert (data["n_selfstress"], data["n_mechanisms"], data["n_rigid_motions"]) == (1, 1, 3)
    assert "1 self-stress, 1 mechanism, 3 rigid motions" in text
    assert data["mass"] == pytest.approx(0.347215, abs=1e-6)
    assert data["cable_tension"] == pytest.approx([3.87858, 10], abs=1e-5)
    assert data["size"][2] == pytest.approx(0.3)


def test_a_scene_without_prestress_is_told_how_to_find_one(run: Run, prism: Path) -> None:
    text = "\n".join(line for line in prism.read_text().splitlines() if "prestress" not in line)
    slack = write(prism.with_name("slack.toml"), text)
    ended = run.good("check", slack)
    assert ended.out.startswith("prism: 1 probable mistake; 6 nodes")
    assert "none of the 9 cables starts in tension" in ended.err
    assert "--prestress FORCE" in ended.err


GROUND = (
    HANGING
    + """
[ground]
offset = -1.5
stiffness = 1e4
friction = 0.5
"""
)


def test_a_ground_is_described(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", GROUND)
    text, data = run.good("check", path).out, run("check", path, "--json").data["ground"]
    assert (
        "ground: 1 contact, penetration at rest 0.000981 m (weight 9.81 N), contact frequency 15.92 Hz, "
        "stick offset at rest up to 0.000491 m\n"
    ) in text
    assert data["contacts"] == ["b"]
    assert data["penetration"] == data["largest_penetration"] == pytest.approx(9.81e-4)
    assert data["frequency"] == pytest.approx(15.9154943)
    assert data["stick_offset"] == pytest.approx(0.5 * 9.81e-4)
    assert run("check", write(folder / "free.toml", HANGING), "--json").data["ground"] is None


def test_several_contacts_share_the_weight(run: Run, prism: Path) -> None:
    moving = re.sub(r"quantities = \[.*?\]\n", "", prism.read_text(), flags=re.DOTALL)
    text = moving + "\n[ground]\npenetration = 1e-4\n"
    out = run.good("check", write(prism.with_name("standing.toml"), text)).out
    shown = "0.0001 m (weight 1.703 N in equal parts; 0.0003 m where one contact carries all)"
    assert f"ground: 3 contacts, penetration at rest {shown}, contact frequency" in out
    assert "stick offset" not in out  # without friction


def test_events_of_more_contacts_than_steps_can_end_at_are_refused(run: Run, folder: Path) -> None:
    count = MAX_CONTACTS + 1
    nodes = "\n".join(f"n{k} = {{ position = [0, 0, {k}], mass = 1 }}" for k in range(count))
    bar = "kind = 'bar', axial_stiffness = 1e5"
    members = "\n".join(f"m{k} = {{ {bar}, nodes = ['n{k}', 'n{k + 1}'] }}" for k in range(count - 1))
    model = "[model]\nintegrators = ['rk54']\nevents = ['ground']\n"
    text = f"name = 'tower'\n{model}[ground]\nstiffness = 1e5\n[nodes]\n{nodes}\n[members]\n{members}\n"
    ended = run("check", write(folder / "tower.toml", text), "--json")
    assert ended.code == 2
    assert f"events of {count} contacts, more than {MAX_CONTACTS}" in ended.data["problem"]


def test_a_structure_on_an_edge_is_named(run: Run, folder: Path) -> None:
    """An icosahedron as its shape is, and on a facet; a corner of it."""
    text = "name = 'ball'\ngravity = [0, 0, -9.81]\n[ground]\nstiffness = 1e4\noffset = -1\n"
    text += "[classes]\nbar = { kind = 'bar', spring_constant = 1e5 }\n"
    text += "cable = { kind = 'cable', spring_constant = 100 }\n"
    text += "[shape]\nkind = 'icosahedron'\nbar_length = 0.6\nnode_mass = 0.1\nprestress = 5\n"
    path = write(folder / "ball.toml", text)
    assert run("check", path, "--json").data["ground"]["stands_on_edge"] == ["n1", "n3"]
    assert "stands on an edge, n1 and n3: it tips; on_facet of [shape]" in run.good("check", path).out
    path = write(folder / "facet.toml", text + "on_facet = ['n1', 'n5', 'n9']\n")
    assert run("check", path, "--json").data["ground"]["stands_on_edge"] == []
    assert "stands on" not in run.good("check", path).out


def test_nodes_below_the_ground_are_warned_of(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", GROUND.replace("-1.5", "-0.9"))
    ended = run("check", path, "--json")
    assert "nodes start below the ground: b (0.1 m)" in ended.data["warnings"][0]


CONTROL = """
[[actuators]]
name = "winch"
members = "s1"
rate = 0.1
range = [0.5, 0.8]

[[sensors]]
kind = "member_length"
members = "all"
noise = 1e-4

[limits]
least_tension = 12
"""


def test_actuators_sensors_and_limits_are_reported(run: Run, folder: Path) -> None:
    path = write(folder / "small.toml", GOOD + CONTROL)
    data = run("check", path, "--json").data
    assert data["inputs"] == ["winch"]
    assert data["actuators"] == [{"name": "winch", "members": ["s1"], "rate": 0.1, "range": [0.5, 0.8]}]
    assert data["sensors"] == [{"kind": "member_length", "members": ["s1"], "noise": 1e-4}]
    assert data["limits"] == {"least_tension": 12.0}
    assert data["warnings"] == [
        "the range of actuators does not contain the rest length of the scene: winch (s1: 0.9 m, by 0.1 m)",
        "at the start s1 has a tension of 10 N, allowed is at least 12 N",
    ]
    assert "actuators: winch\nsensors: member_length (1)\nlimits: least_tension\n" in run("check", path).out


def test_bodies_have_actuators_and_limits_too(run: Run, folder: Path) -> None:
    path = write_example(folder, "lin_prism")
    data = run("check", path, "--json").data
    assert (data["actuators"], data["sensors"], data["limits"]) == ([], [], {})
    with path.open("a", encoding="utf-8") as file:
        file.write('[limits]\nmost_tension = 1e9\n[[sensors]]\nkind = "node_position"\nnodes = "all"\n')
    data = run("check", path, "--json").data
    assert data["limits"] == {"most_tension": 1e9}
    assert all("." in point for point in data["sensors"][0]["points"])


def test_rigid_bodies_are_described(run: Run, folder: Path) -> None:
    ground = {"stiffness": 1e4, "contacts": ["rod.foot"], "offset": 0.4}
    write_scene({**RODS, "ground": ground}, folder / "rods.toml", overwrite=False)
    text, data = run.good("check", "rods.toml").out, run("check", "rods.toml", "--json").data
    assert "2 bodies, 4 nodes, 0 bars, 2 cables, 12 free coordinates" in text
    assert (data["n_bodies"], data["n_nodes"], data["n_bars"], data["n_cables"]) == (2, 4, 0, 2)
    assert data["bar_tension"] is None
    rod, block = data["bodies"]
    assert (rod["name"], rod["mass"], block["mass"]) == ("rod", pytest.approx(0.4), 0.5)
    # A cylinder and a ball about their common centre, which is 0.05 m above the middle.
    ball = 0.4 * 0.1 * 0.03**2
    along = 0.3 * 0.01**2 / 2 + ball
    across = 0.3 * (3 * 0.01**2 + 0.4**2) / 12 + 0.3 * 0.05**2 + ball + 0.1 * 0.15**2
    assert rod["principal_inertia"] == pytest.approx([along, across, across])
    # The foot, 0.2 m down the axis and turned by 30 degrees, is a ball of 0.01 m.
    assert rod["height"] == pytest.approx(0.6 - 0.2 * math.cos(math.pi / 6) - 0.01 - 0.4)
    lightest = 1 / (1 / 0.4 + 0.25**2 / across)
    assert rod["contact_frequency"] == pytest.approx(math.sqrt(1e4 / lightest) / (2 * math.pi))
    assert block["height"] is None
    assert "rod_foot is 0.0168 m above the ground" in text
    ground["offset"] = 0.42
    write_scene({**RODS, "ground": ground}, folder / "deep.toml", overwrite=False)
    assert "rod_foot touches the ground, 0.00321 m deep" in run.good("check", "deep.toml").out


def test_a_body_alone_is_checked(run: Run, folder: Path) -> None:
    stone = {"kind": "rigid", "mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [0, 0, 1]}
    write_scene({"name": "stone", "bodies": {"stone": stone}}, folder / "stone.toml", overwrite=False)
    assert "stone: no mistake found; 1 body, 0 nodes, 0 bars, 0 cables" in run.good("check", "stone.toml").out


def test_the_state_itself_is_no_quantity(run: Run, two_nodes: Path) -> None:
    """Another formulation would be no remedy: results have the positions anyway."""
    text = two_nodes.read_text()
    stated = re.sub(r"quantities = .*\n", 'quantities = ["node_position"]\n', text)
    ended = run.refused("check", write(two_nodes, stated), "--json")
    assert ended.data["hint"].startswith("omit it")
