"""The verb load-path: events, files, exit codes, wrong usage."""

import csv
import json
import math
from pathlib import Path

import pytest

from tests.cli.conftest import Run, write_example
from tests.cli.scenes import FRAME, GOOD, TRUSS_REST, write, write_truss
from tests.report.page_html import check_static

DOWN = ("--load", "t1=0,0,-1")


@pytest.mark.thorough
def test_the_path_ends_at_the_first_contact(run: Run, prism: Path) -> None:
    ended = run.good("load-path", prism, *DOWN, "--most", 20, "--json")
    data = ended.data
    assert data["status"] == "stopped"
    (event,) = data["events"]
    assert (event["kind"], event["names"]) == ("contact", ["bar1_bar2"])
    assert data["load_factor"][-1] == event["load_factor"] == pytest.approx(7.560387, abs=1e-6)
    assert len(data["load_factor"]) == len(data["smallest_eigenvalue"]) == data["n_points"]
    said = run("load-path", prism, *DOWN, "--most", 20)
    assert said.code == 0
    assert "contact" in said.out
    assert "7.5603868" in said.out


def write_levy_dome(folder: Path) -> None:
    """Write tables of a Levy dome of ten sectors over an ellipse."""
    nodes = ["node,x,y,z,anchored"]
    members = ["member,kind,class,node_i,node_j,axial_stiffness,mass"]

    def node(name: str, radius: float, height: float, sector: float, anchored: str = "no") -> None:
        x, y = 13 * radius * math.cos(math.pi * sector / 5), 10.5 * radius * math.sin(math.pi * sector / 5)
        nodes.append(f"{name},{x!r},{y!r},{height},{anchored}")

    def member(name: str, start: str, end: str, diameter: float = 0.03) -> None:
        stiffness = 7e8 if name[0] == "p" else 4e10 * math.pi * diameter**2
        kind, mass = ("bar", 100) if name[0] == "p" else ("cable", "")
        members.append(f"{name},{kind},{name[:2]},{start},{end},{stiffness!r},{mass}")

    for k in range(10):
        after, before = (k + 1) % 10, (k - 1) % 10
        node(f"E{k}", 1, 0, k, "yes")
        node(f"TA{k}", 0.62, 2, k + 0.5)
        node(f"LA{k}", 0.62, -1.5, k + 0.5)
        node(f"TB{k}", 0.3, 3, k)
        node(f"LB{k}", 0.3, 0.4, k)
        for side, outer, inner in (("l", k, before), ("r", after, k)):
            member(f"rA{k}{side}", f"E{outer}", f"TA{k}")
            member(f"dA{k}{side}", f"E{outer}", f"LA{k}", 0.04)
            member(f"rB{k}{side}", f"TA{inner}", f"TB{k}", 0.024)
            member(f"dB{k}{side}", f"TA{inner}", f"LB{k}", 0.024)
        member(f"rC{k}", f"TB{k}", "PEAK", 0.024)
        member(f"dC{k}", f"TB{k}", "KEEL", 0.016)
        member(f"hA{k}", f"LA{k}", f"LA{after}", 0.05)
        member(f"hB{k}", f"LB{k}", f"LB{after}")
        member(f"pA{k}", f"TA{k}", f"LA{k}")
        member(f"pB{k}", f"TB{k}", f"LB{k}")
    node("PEAK", 0, 3.6, 0)
    node("KEEL", 0, 1.1, 0)
    member("pC0", "PEAK", "KEEL")
    (folder / "nodes.csv").write_text("\n".join(nodes), encoding="utf-8")
    (folder / "members.csv").write_text("\n".join(members), encoding="utf-8")


@pytest.mark.thorough
def test_a_path_does_not_go_back_over_two_cables_that_go_slack_at_once(run: Run, folder: Path) -> None:
    """Long steps behind the kink ended on another branch: no equilibrium beyond 2.2538 was found."""
    write_levy_dome(folder)
    run.good("import", "nodes.csv", "members.csv", "--name", "levy", "--out", "levy.toml")
    run.good("analyse", "levy.toml", "--prestress", "300e3", "--scene-out", "tense.toml")
    loads = [word for load in ("TA*=0,0,-20e3", "TB*=0,0,-9e3", "PEAK=0,0,-7e3") for word in ("--load", load)]
    paths = [
        run.good("load-path", "tense.toml", *loads, "--most", 2.6, "--step", step, "--json").data
        for step in (0.1, 0.02)
    ]
    assert [path["status"] for path in paths] == ["completed", "completed"]
    kinds = [[(event["kind"], event["names"]) for event in path["events"]] for path in paths]
    assert kinds[0] == kinds[1]
    assert "limit" not in [kind for kind, _ in kinds[0]]
    factors = [[event["load_factor"] for event in path["events"]] for path in paths]
    assert factors[0] == pytest.approx(factors[1], rel=1e-7)
    assert paths[0]["stable_up_to"] == pytest.approx(paths[1]["stable_up_to"], rel=1e-7)


def test_a_pattern_loads_every_node_that_it_names(run: Run, prism: Path) -> None:
    one_by_one = [word for node in ("t1", "t2", "t3") for word in ("--load", f"{node}=0,0,-1")]
    runs = [
        run.good("load-path", prism, *words, "--most", 2, "--json").data
        for words in (one_by_one, ("--load", "t*=0,0,-1"))
    ]
    assert runs[0]["smallest_eigenvalue"] == runs[1]["smallest_eigenvalue"]
    assert runs[0]["load_factor"] == runs[1]["load_factor"]


@pytest.mark.thorough
def test_the_path_goes_on_where_it_is_told_to(run: Run, prism: Path) -> None:
    data = run("load-path", prism, *DOWN, "--most", 8, "--past-contact", "--json").data
    assert data["status"] == "completed"
    assert data["load_factor"][-1] == 8
    assert "contact" in [event["kind"] for event in data["events"]]
    chosen = run("load-path", prism, *DOWN, "--most", 9, "--past-contact", "--events", "slack", "--json")
    assert {event["kind"] for event in chosen.data["events"]} <= {"slack", "taut"}


def test_bars_that_cross_at_the_start_are_named_with_the_way_out(run: Run, folder: Path) -> None:
    scene = write_example(folder, "planar")
    text = scene.read_text(encoding="utf-8").replace('kind = "bar"', 'kind = "bar"\nradius = 0.01', 1)
    scene.write_text(text, encoding="utf-8")
    words = ("load-path", scene, "--load", "c=0,0,-1", "--most", 1)
    data = run(*words, "--json").data
    assert (data["status"], data["n_points"]) == ("stopped", 1)
    assert "ac_bd" in data["hint"]
    assert "--past-contact" in data["hint"]
    assert "--past-contact" in run(*words).out
    followed = run(*words, "--past-contact", "--json").data
    assert (followed["status"], followed["hint"]) == ("completed", None)


@pytest.mark.thorough
def test_a_planar_scene_takes_two_numbers_or_three(run: Run, folder: Path) -> None:
    scene = write_example(folder, "planar")
    ends = [
        run("load-path", scene, "--load", load, "--most", 1, "--json").data["smallest_eigenvalue_end"]
        for load in ("c=1,-2", "c=1,0,-2")
    ]
    assert ends[0] == ends[1]
    settled = [
        run("equilibrium", scene, "--load", load, "--json").data["node_position"]
        for load in ("c=1,-2", "c=1,0,-2")
    ]
    assert settled[0] == settled[1]
    wrong = run("equilibrium", scene, "--load", "c=1,2,3,4", "--json")
    assert wrong.code == 2
    assert wrong.data["allowed"] == "three numbers, x,y,z, or x,z"


def test_tables_of_points(run: Run, prism: Path, folder: Path) -> None:
    ended = run("load-path", prism, *DOWN, "--most", 5, "--out", "path.csv", "--json")
    assert ended.data["out"] == "path.csv"
    with (folder / "path.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == ended.data["n_points"]
    assert float(rows[-1]["load_factor"]) == 5
    assert {"t1_z", "tension_top1", "length_bar1", "distance_bar1_bar2"} <= set(rows[0])
    assert float(rows[-1]["t1_z"]) < float(rows[0]["t1_z"])
    run("load-path", prism, *DOWN, "--most", 5, "--out", "path.json")
    data = json.loads((folder / "path.json").read_text(encoding="utf-8"))
    assert data["points"]["t1_z"] == [float(row["t1_z"]) for row in rows]


def test_a_load_beyond_the_limit_point_ends_with_evidence(run: Run, folder: Path) -> None:
    scene = write_example(folder, "lin_prism")
    words = (
        "load-path",
        scene,
        "--load",
        "bar3_B=0,0,-1",
        "--most",
        40,
        "--past-contact",
        "--floor",
        0,
        "--json",
    )
    ended = run(*words)
    assert ended.code == 3
    assert ended.data["status"] == "returned"
    limit = [event for event in ended.data["events"] if event["kind"] == "limit"]
    assert limit[0]["load_factor"] == pytest.approx(ended.data["load_factor_most"])
    assert "turned back at load factor 35.09" in ended.data["message"]


def test_a_page_has_the_curve_events_and_shapes(run: Run, folder: Path) -> None:
    pytest.importorskip("matplotlib")
    for scene, words in (
        (write_truss(folder, -10), ()),
        (write_example(folder, "lin_prism"), ("--load", "bar3_B=0,0,-1", "--past-contact", "--most", 2)),
    ):
        ended = run.good("load-path", scene, *words, "--page", "path.html", "--overwrite", "--json")
        assert ended.data["page"] == "path.html"
        text = (folder / "path.html").read_text(encoding="utf-8")
        check_static(text, [])
        assert "displacement of" in text
        assert "Load factor 0: start." in text
        assert all(f"{event['kind']}</text>" in text for event in ended.data["events"])


LIMIT = 2000 * math.sqrt(TRUSS_REST ** (2 / 3) - 1) * (TRUSS_REST ** (2 / 3) - 1)
OWN = '[[loads]]\nnode = "c"\nforce = [0, -2]\n'


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("gravity", "own", "words", "grows", "stays"),
    [
        (0, "", ("--load", "c=0,-5"), 5.0, 0.0),
        (-10, "", ("--ramp", "gravity"), 5.0, 0.0),
        (-10, "", (), 5.0, 0.0),
        (0, OWN, (), 2.0, 0.0),
        (-10, OWN, ("--ramp", "all"), 7.0, 0.0),
        (-1, OWN, ("--ramp", "loads", "--load", "c=0,-3"), 5.0, 0.5),
        (-8, OWN, ("--ramp", "gravity", "--load", "c=0,1"), 4.0, 1.0),
    ],
)
def test_the_path_of_a_truss_goes_through_zero_to_the_far_branch(
    run: Run, folder: Path, gravity: float, own: str, words: tuple[str, ...], grows: float, stays: float
) -> None:
    scene = write_truss(folder, gravity, load=own)
    ended = run("load-path", scene, *words, "--most", 3, "--json")
    assert (ended.code, ended.data["status"]) == (0, "completed")
    limits = [event["load_factor"] for event in ended.data["events"] if event["kind"] == "limit"]
    assert limits == pytest.approx([(LIMIT - stays) / grows, (-LIMIT - stays) / grows], rel=1e-8)
    back = run("load-path", scene, *words, "--most", 3, "--floor", 0, "--json")
    assert (back.code, back.data["status"]) == (3, "returned")
    assert back.data["load_factor"][-1] == pytest.approx(0, abs=1e-12)


def test_a_path_may_begin_without_any_stiffness(run: Run, folder: Path) -> None:
    scene = write_truss(folder, -10, rise=0.0)
    run("load-path", scene, "--ramp", "gravity", "--most", 1, "--out", "path.csv")
    with (folder / "path.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    settled = run("equilibrium", scene, "--json").data
    assert float(rows[-1]["c_z"]) == pytest.approx(settled["node_position"]["c"][1 + 1], rel=1e-8)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--ramp", "gravity"), "no gravity"),
        (("--ramp", "loads"), "the scene has no loads"),
        ((), "no loads and no gravity"),
        (("--ramp", "load"), "no load is given"),
        (("--load", "c=0,-1", "--floor", "0.5"), "--floor"),
    ],
)
def test_what_cannot_grow(run: Run, folder: Path, words: tuple[str, ...], said: str) -> None:
    ended = run.refused("load-path", write_truss(folder, 0), *words, "--most", 1)
    assert said in ended.err


def test_a_load_that_nothing_holds_ends_with_evidence(run: Run, prism: Path) -> None:
    ended = run("load-path", prism, "--load", "t1=1,0,0", "--most", 5, "--out", "path.csv", "--json")
    assert ended.code == 3
    assert ended.data["status"] == "no_start"
    assert "without stiffness" in ended.data["message"]
    assert ended.data["out"] is None
    assert not Path("path.csv").exists()


def test_a_scene_of_one_cable(run: Run, folder: Path) -> None:
    scene = write(folder / "one.toml", GOOD)
    data = run("load-path", scene, "--load", "b=0,0,-1", "--most", 10, "--json").data
    assert (data["status"], data["events"]) == ("completed", [])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--load", "t9=0,0,1", "--most", "5"), "unknown node"),
        (("--load", "t1=0,0,0", "--most", "5"), "the load is zero"),
        (("--load", "t1=0,0,1", "--most", "5", "--events", "slack,touch"), "unknown event"),
        (("--load", "t1=0,0,1", "--most", "5", "--step", "0"), "the step is out of range"),
        (("--load", "t1=0,0,1", "--most", "5", "--out", "path.txt"), "cannot have the ending"),
        (("--load", "t1=0,0,1", "--most", "5", "--out", "none/path.csv"), "no folder"),
        (("--most", "5", "--ramp", "load"), "--load"),
    ],
)
def test_wrong_usage_is_refused(run: Run, prism: Path, words: tuple[str, ...], said: str) -> None:
    ended = run.refused("load-path", prism, *words, "--json")
    assert said in ended.err
    assert ended.data["status"] == "error"


def test_a_load_on_what_is_held_alone_is_refused_and_beside_others_told(run: Run, folder: Path) -> None:
    """With a pattern of which some nodes are anchored the path is that of the nodes that can move."""
    path = write(folder / "small.toml", GOOD)
    ended = run.refused("load-path", path, "--load", "a=0,0,-1", "--most", 1, "--json")
    assert (ended.data["error"], ended.data["given"]) == ("InvalidValueError", "'a'")
    some, one = (run.good("load-path", path, "--load", f"{name}=0,0,-1", "--json") for name in ("[ab]", "b"))
    assert some.data["load_factor"] == one.data["load_factor"]
    assert some.data["warnings"][-1].endswith("which counts in reactions alone: a.z")
    for verb in ("equilibrium", "reactions"):
        assert "which counts in reactions alone: a.z" in run(verb, path, "--load", "[ab]=0,0,-1").err


def test_a_page_names_limits_in_words(run: Run, prism: Path) -> None:
    pytest.importorskip("matplotlib")
    weak = write(prism.with_name("weak.toml"), prism.read_text() + "\n[limits]\nyield_stress = 6.5e5\n")
    ended = run("load-path", weak, "--page", "weak.html", "--json")
    event = ended.data["events"][0]
    assert "bar3 (yield_stress)" in event["names"]
    text = prism.with_name("weak.html").read_text(encoding="utf-8")
    assert "bar3 (yield stress)" in text
    assert "(yield_stress)" not in text
    heading = text.partition("<h1>")[2].partition("</h1>")[0]
    assert f"(yield stress) first exceeded at load factor {event['load_factor']:.5g}" in heading.replace(
        f" and {len(event['names']) - 1} more", ""
    )
    said = run("load-path", weak).out
    assert f"first exceeded at load factor {event['load_factor']:.10g}" in said


@pytest.mark.parametrize("most", ["inf", "nan", "0"])
def test_a_load_factor_that_cannot_be_reached_is_refused_by_its_option(
    run: Run, prism: Path, most: str
) -> None:
    ended = run.refused("load-path", prism, *DOWN, "--most", most, "--json")
    assert ended.data["where"] == "--most"
    assert ended.data["given"] == str(float(most))


def test_by_default_the_loads_of_the_scene_grow_to_their_full_size(run: Run, prism: Path) -> None:
    ended = run("load-path", prism, "--json")
    assert (ended.code, ended.data["load_factor_end"]) == (0, 1.0)
    settled = run("equilibrium", prism, "--json").data
    assert ended.data["smallest_eigenvalue_end"] == pytest.approx(settled["smallest_eigenvalue"], rel=1e-6)
    assert ended.data["limits"] == {"exceeded": [], "doubtful": []}


def test_members_that_buckle_are_events_and_belong_to_the_finding(run: Run, prism: Path) -> None:
    thin = write(
        prism.with_name("thin.toml"),
        prism.read_text().replace("0.004", "0.0026").replace("0.003\n", "0.0022\n"),
    )
    ended = run("load-path", thin, "--json")
    (event,) = ended.data["events"]
    assert event["kind"] == "exceeded"
    assert event["names"] == ["bar3 (buckling)"]
    assert 0 < event["load_factor"] < 1
    assert ended.data["limits"]["doubtful"][0]["member"] == "bar3"
    assert "; but bar3 buckles: its compression is" in run("load-path", thin).out.splitlines()[0]
    assert "; but bar3 buckles: its compression is" in run("equilibrium", thin).out.splitlines()[0]


def test_a_scene_without_loads_of_its_own_names_the_ramp(run: Run, folder: Path) -> None:
    scene = write_example(folder, "two_nodes")
    text = scene.read_text(encoding="utf-8").replace("gravity = [0, 0, -9.81]", "")
    scene.write_text(text, encoding="utf-8")
    for kind, problem in (("loads", "no loads"), ("all", "no loads and no gravity")):
        ended = run("load-path", scene, "--ramp", kind, "--most", 1, "--json")
        assert (ended.code, ended.data["where"]) == (2, "--ramp")
        assert problem in ended.data["problem"]
        assert "--load" in ended.data["hint"]


def test_on_the_ground_a_frame_tips(run: Run, folder: Path) -> None:
    """F h = m g b, 3 kg, 0.5 m, 1 m high; much friction."""
    path = write(folder / "frame.toml", FRAME.replace("friction = 0.5", "friction = 2"))
    data = run.good("load-path", path, "--load", "top=1,0", "--most", 30, "--json").data
    assert (data["status"], data["events"][-1]["kind"]) == ("stopped", "tips")
    assert data["events"][-1]["load_factor"] == pytest.approx(1.5 * 9.81, rel=0.01)
