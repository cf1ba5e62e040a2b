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
}


QUICK = ("show", "load-path-csv")


@pytest.mark.parametrize("kind", [*QUICK, *thorough(*(kind for kind in FILES if kind not in QUICK))])
def test_a_file_that_exists_is_replaced_with_overwrite_only(
    kind: str, run: Run, prism: Path, folder: Path
) -> None:
    words, name = FILES[kind]
    path = folder / name
    ended = run(*words, "--out", name)
    assert ended.code == 0, ended.err
    assert run(*words, "--out", name).code == 2  # a result of the same command too
    path.write_bytes(b"precious")
    ended = run(*words, "--out", name, "--json")
    assert ended.code == 2
    assert (ended.data["error"], ended.data["where"]) == ("OutputError", name)
    assert "--overwrite" in ended.data["hint"]
    assert path.read_bytes() == b"precious"
    assert run(*words, "--out", name, "--overwrite").code == 0
    assert path.read_bytes() != b"precious"


@pytest.mark.parametrize("verb", ["simulate", "linearize", "equilibrium"])
def test_a_scene_is_not_replaced_by_what_is_made_of_it(verb: str, run: Run, prism: Path) -> None:
    text = prism.read_text(encoding="utf-8")
    more = ("--t-end", 0.01) if verb == "simulate" else ()
    ended = run(verb, prism, *more, "--out", prism, "--json")
    assert ended.code == 2
    assert ended.data["where"] == str(prism)
    if verb != "equilibrium":  # which can settle a scene in its place
        assert run(verb, prism, *more, "--out", prism, "--overwrite").code == 2
    assert prism.read_text(encoding="utf-8") == text


def test_no_table_or_motion_is_replaced_by_what_is_made_of_it(run: Run, folder: Path, prism: Path) -> None:
    (folder / "n.csv").write_text("node,x,y,z,mass,anchored\na,0,0,0,,1\nb,0,0,-1,1,\n", encoding="utf-8")
    (folder / "m.csv").write_text("member,kind,node_i,node_j,spring_constant\ns,cable,a,b,100\n", "utf-8")
    before = (folder / "n.csv").read_bytes()
    ended = run("import", "n.csv", "m.csv", "--gravity", "-1,0,0", "-o", "n.csv", "--overwrite", "--json")
    assert (ended.code, ended.data["error"]) == (2, "OutputError")
    assert (folder / "n.csv").read_bytes() == before
    assert run("simulate", prism, "--t-end", 0.01, "--samples", 3, "--out", "a.npz").code == 0
    before = (folder / "a.npz").read_bytes()
    ended = run("show", prism, "--trajectory", "a.npz", "--out", "a.npz", "--overwrite", "--json")
    assert (ended.code, ended.data["error"]) == (2, "OutputError")
    assert (folder / "a.npz").read_bytes() == before


def test_build_keeps_the_files_of_its_folder(run: Run, folder: Path, two_nodes: Path) -> None:
    for name in ("Makefile", "example.c"):
        (folder / name).write_text("precious", encoding="utf-8")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    ended = run("build", two_nodes, "--out", ".", "--json")
    assert ended.code == 2
    assert ended.data["given"] == "'Makefile, example.c'"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert run("build", two_nodes, "--out", ".", "--overwrite").code == 0
    assert (folder / "Makefile").read_text(encoding="utf-8") != "precious"
    assert run("build", two_nodes, "--out", ".").code == 0
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
    ended = run(*words, "--out", "made", "--json")
    assert ended.code == 2
    assert ended.data["given"] == repr(name)
    assert [path.name for path in (folder / "made").iterdir()] == [name]
    assert (folder / "made" / name).read_text(encoding="utf-8") == "precious"
