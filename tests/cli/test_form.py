"""The verb `form`: verdict first, the written scene, exit codes, wrong input."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.live.pages import GALLERY, require_three


def write_arch(folder: Path) -> Path:
    """Four bars in a row, 1 N down at each joint, as JSON of nodes and members."""
    nodes = {f"n{k}": {"position": [float(k), 0.0, 0.0], "anchored": "y"} for k in range(5)}
    nodes["n0"]["anchored"] = nodes["n4"]["anchored"] = True
    members = [{"from": f"n{k}", "to": f"n{k + 1}", "kind": "bar", "axial_stiffness": 1e4} for k in range(4)]
    loads = {f"n{k}": [0.0, 0.0, -1.0] for k in (1, 2, 3)}
    path = folder / "arch.json"
    path.write_text(json.dumps({"nodes": nodes, "members": members, "loads": loads}), encoding="utf-8")
    return path


def test_a_plan_of_nodes_and_members_becomes_a_hanging_net(run: Run, folder: Path) -> None:
    """The architect's way: import, form, settle; a string of equal densities hangs in a parabola."""
    nodes = "node,x,y,z,anchored,fz\na,0,0,0,yes,0\nb,1,0,0,,-2\nc,2,0,0,,-2\nd,3,0,0,yes,0\n"
    members = (
        "member,kind,node_i,node_j,axial_stiffness\nm1,cable,a,b,500\nm2,cable,b,c,500\nm3,cable,c,d,500\n"
    )
    (folder / "nodes.csv").write_text(nodes, encoding="utf-8")
    (folder / "members.csv").write_text(members, encoding="utf-8")
    run.good("import", folder / "nodes.csv", folder / "members.csv", "-o", folder / "plan.toml")
    text = run.good("form", folder / "plan.toml", "--density", "cables=10", "-o", folder / "net.toml").out
    assert text.startswith("stable: 3 members in balance")
    assert "every member pulls" in text
    found = run.good("equilibrium", folder / "net.toml", "--json").data
    assert [found["node_position"][name][2] for name in ("b", "c")] == pytest.approx([-0.2, -0.2])


def test_what_leaves_its_shape_ends_with_code_3_and_is_written(run: Run, folder: Path) -> None:
    path = write_arch(folder)
    run.good("import", path, "-o", folder / "arch.toml")
    ended = run("form", folder / "arch.toml", "--density", "bars=-2", "-o", folder / "formed.toml", "--json")
    assert ended.code == 3
    assert ended.data["status"] == "unstable"
    height = [ended.data["node_position"][f"n{k}"][2] for k in range(5)]
    np.testing.assert_allclose(height, [0.0, 0.75, 1.0, 0.75, 0.0], atol=1e-12)
    assert ended.data["members"]["m1"]["force_density"] == pytest.approx(-2.0)
    assert (folder / "formed.toml").exists()


def test_targets_and_ranges_are_options(run: Run, folder: Path) -> None:
    """The span is 4 m: bars of 1.05 to 1.2 m, the load path as small as these allow."""
    run.good("import", write_arch(folder), "-o", folder / "arch.toml")
    words = ["--density", "bars=-2", "--length-range", "bars=1.05,1.2", "--least-load-path"]
    ended = run("form", folder / "arch.toml", *words, "--target-length", "m1=1.1,0.5", "--json")
    assert ended.code == 3  # pinned bars fall over
    lengths = [member["length"] for member in ended.data["members"].values()]
    assert 1.05 - 1e-7 <= min(lengths) <= max(lengths) <= 1.2 + 1e-7
    assert ended.data["message"].endswith(f"load path {ended.data['load_path']:.9g} N m")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--density", "cables"], "NAME=VALUE"),
        (["--density", "cables=1", "--density", "cables=2"], "a name twice"),
        (["--density", "rope=1"], "unknown member, group, class or kind"),
        (["--force", "cables=-1"], "above 0"),
        ([], "nothing is stated of some cables"),
        (["--density", "cables=1", "--length-range", "cables=1"], "NAME=VALUE,VALUE"),
        (["--density", "cables=1", "--length-range", "cables=2,1"], "not a length range"),
        (["--density", "cables=1", "--least-load-path"], "of every member"),
    ],
)
def test_wrong_input_is_code_2_and_leaves_nothing(
    run: Run, folder: Path, words: list[str], says: str
) -> None:
    run.good("new", folder / "prism.toml")
    ended = run("form", folder / "prism.toml", *words, "-o", folder / "formed.toml")
    assert ended.code == 2
    assert says in ended.err
    assert not (folder / "formed.toml").exists()


def test_a_page_takes_the_place_of_the_scene(run: Run, folder: Path) -> None:
    require_three()
    words = ("--density", "cables=3000", "--density", "edge=20000")
    page = folder / "net.html"
    found = run.good("form", GALLERY / "cable_net.toml", *words, "-o", page, "--json").data
    assert found["out"] == str(page)
    groups = [{"label": "cables", "density": 3000.0}, {"label": "edge", "density": 20000.0}]
    assert json.dumps({"groups": groups}, separators=(",", ":"))[1:-1] in page.read_text(encoding="utf-8")
