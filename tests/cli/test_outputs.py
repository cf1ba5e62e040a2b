"""No verb replaces an input, and without --overwrite none replaces a file that exists."""

from pathlib import Path

import pytest

from tests.cases import thorough
from tests.cli.conftest import Run

# What writes a file: the words before --out, the name of the result.
FILES = {
    "simulate": (("simulate", "prism.toml", "--t-end", 0.01, "--samples", 3), "a.npz"),
    "linearize": (("linearize", "prism.toml"), "a.npz"),
    "analyse": (("analyse", "prism.toml"), "a.npz"),
    "plan": (("plan", "prism.toml", "--to", "height=0.29", "--steps", 1, "--actuate", "cables"), "a.npz"),
    "show": (("show", "prism.toml"), "a.png"),
    "show-svg": (("show", "prism.toml"), "a.svg"),
    "show-pdf": (("show", "prism.toml"), "a.pdf"),
    "load-path-csv": (("load-path", "prism.toml", "--load", "t1=0,0,-1", "--most", 1), "a.csv"),
    "load-path-json": (("load-path", "prism.toml", "--load", "t1=0,0,-1", "--most", 1), "a.json"),
    "schema": (("schema",), "a.json"),
    "equilibrium": (("equilibrium", "prism.toml"), "a.toml"),
    "import": (("import", "n.csv", "m.csv"), "a.toml"),
    "examples": (("examples", "two_nodes"), "a.toml"),
}
QUICK = ("show", "load-path-csv", "schema", "equilibrium", "import", "examples")
TABLES = {
    "n.csv": "node,x,y,z,mass,anchored\na,0,0,0,,1\nb,0,0,-1,1,\n",
    "m.csv": "member,kind,node_i,node_j,spring_constant\ns,cable,a,b,100\n",
}


@pytest.fixture(autouse=True)
def tables(folder: Path) -> None:
    for name, text in TABLES.items():
        (folder / name).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("kind", [*QUICK, *thorough(*(kind for kind in FILES if kind not in QUICK))])
def test_a_file_that_exists_is_replaced_with_overwrite_only(
    kind: str, run: Run, prism: Path, folder: Path
) -> None:
    words, name = FILES[kind]
    path = folder / name
    ended = run.good(*words, "--out", name)
    assert run(*words, "--out", name).code == 2  # a result of the same command too
    path.write_bytes(b"precious")
    ended = run.refused(*words, "--out", name, "--json")
    assert (ended.data["error"], ended.data["where"]) == ("OutputError", name)
    assert "--overwrite" in ended.data["hint"]
    assert path.read_bytes() == b"precious"
    run.good(*words, "--out", name, "--overwrite")
    assert path.read_bytes() != b"precious"


@pytest.mark.parametrize("verb", ["simulate", "linearize", "equilibrium"])
def test_a_scene_is_not_replaced_by_what_is_made_of_it(verb: str, run: Run, prism: Path) -> None:
    text = prism.read_text(encoding="utf-8")
    more = ("--t-end", 0.01) if verb == "simulate" else ()
    ended = run.refused(verb, prism, *more, "--out", prism, "--json")
    assert ended.data["where"] == str(prism)
    if verb != "equilibrium":  # which can settle a scene in its place
        run.refused(verb, prism, *more, "--out", prism, "--overwrite")
    assert prism.read_text(encoding="utf-8") == text


def test_no_table_or_motion_is_replaced_by_what_is_made_of_it(run: Run, folder: Path, prism: Path) -> None:
    before = (folder / "n.csv").read_bytes()
    ended = run("import", "n.csv", "m.csv", "--gravity", "-1,0,0", "-o", "n.csv", "--overwrite", "--json")
    assert (ended.code, ended.data["error"]) == (2, "OutputError")
    assert (folder / "n.csv").read_bytes() == before
    run.good("simulate", prism, "--t-end", 0.01, "--samples", 3, "--out", "a.npz")
    before = (folder / "a.npz").read_bytes()
    ended = run("show", prism, "--trajectory", "a.npz", "--out", "a.npz", "--overwrite", "--json")
    assert (ended.code, ended.data["error"]) == (2, "OutputError")
    assert (folder / "a.npz").read_bytes() == before


def test_build_keeps_the_files_of_its_folder(run: Run, folder: Path, two_nodes: Path) -> None:
    for name in ("Makefile", "example.c"):
        (folder / name).write_text("precious", encoding="utf-8")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    ended = run.refused("build", two_nodes, "--out", ".", "--json")
    assert ended.data["given"] == "'Makefile, example.c'"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    run.good("build", two_nodes, "--out", ".", "--overwrite")
    assert (folder / "Makefile").read_text(encoding="utf-8") != "precious"
    run.good("build", two_nodes, "--out", ".")
    assert two_nodes.exists()


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("report", "two_nodes.toml", "--t-end", 0.1, "--no-peers"), "report.csv"),
        (("stability", "two_nodes.toml", "--t-end", 0.1, "--no-peers"), "stability.json"),
        (("reproduce", "lin", "--quick"), "reproduce.html"),
    ],
)
def test_a_foreign_file_is_found_before_the_long_work(
    words: tuple[object, ...], name: str, run: Run, folder: Path, two_nodes: Path
) -> None:
    (folder / "made").mkdir()
    (folder / "made" / name).write_text("precious", encoding="utf-8")
    ended = run.refused(*words, "--out", "made", "--json")
    assert ended.data["given"] == repr(name)
    assert [path.name for path in (folder / "made").iterdir()] == [name]
    assert (folder / "made" / name).read_text(encoding="utf-8") == "precious"
