"""A file's ending says what is in it: a foreign one is refused before any work, and nothing is written."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import GOOD, write

NODES = "node,x,y,z,mass,anchored\na,0,0,0,,1\nb,1,0,0,1,\n"
MEMBERS = "kind,node_i,node_j,spring_constant\ncable,a,b,10\n"


@pytest.mark.parametrize(
    ("words", "ending"),
    [
        (("simulate", "s.toml", "--t-end", 1, "-o", "x.txt"), ".npz"),
        (("linearize", "s.toml", "-o", "x.txt"), ".npz"),
        (("load-path", "s.toml", "--load", "b=0,0,1", "--most", 1, "--out", "x.txt"), ".csv"),
        (("reconfigure", "s.toml", "--from", "55,40,1", "--to", "65,35", "--tau", 5, "-o", "x.txt"), ".npz"),
        (("equilibrium", "s.toml", "--out", "x.json"), ".toml"),
        (("show", "s.toml", "--out", "x.npz"), ".png"),
        (("schema", "--out", "x.toml"), ".json"),
        (("import", "nodes.csv", "members.csv", "-o", "x.yaml"), ".toml"),
        (("examples", "prism", "-o", "x.txt"), ".toml"),
        (("new", "x.csv"), ".toml"),
    ],
)
def test_a_foreign_ending_is_refused(run: Run, folder: Path, words: tuple[object, ...], ending: str) -> None:
    write(folder / "s.toml", GOOD)
    write(folder / "nodes.csv", NODES)
    write(folder / "members.csv", MEMBERS)
    ended = run.refused(*words, "--json")
    assert ending in ended.data["allowed"]
    assert not list(folder.glob("x.*"))
