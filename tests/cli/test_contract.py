"""What holds for every verb: help with an example, one JSON object, exit codes, nothing else on stdout."""

import inspect
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import typer

from tensegrity_codegen.cli.app import app, find_verbs, main
from tensegrity_codegen.system.files import plain
from tensegrity_codegen.system.version import VERSION
from tests.cases import thorough
from tests.cli.conftest import Run
from tests.cli.scenes import FRAME, write
from tests.doc_tables import check_table

VERBS = [
    "analyse",
    "build",
    "cache",
    "check",
    "control",
    "doctor",
    "equilibrium",
    "examples",
    "export",
    "form",
    "identify",
    "import",
]
VERBS += [
    "linearize",
    "load-path",
    "new",
    "plan",
    "play",
    "reactions",
    "reconfigure",
    "report",
    "reproduce",
    "schema",
    "sensitivity",
    "show",
    "simulate",
    "size",
    "stability",
    "stand",
    "sweep",
]
# A good call of each verb.
GOOD_CALLS = {
    "analyse": ["analyse", "two_nodes.toml"],
    "build": ["build", "two_nodes.toml"],
    "cache": ["cache"],
    "check": ["check", "two_nodes.toml"],
    "doctor": ["doctor"],
    "equilibrium": ["equilibrium", "two_nodes.toml"],
    "examples": ["examples"],
    "form": ["form", "two_nodes.toml", "--density", "cables=5"],
    "import": ["import", "nodes.csv", "members.csv", "-o", "new.toml", "--gravity", "-1,0,0"],
    "linearize": ["linearize", "two_nodes.toml", "--settle"],
    "reactions": ["reactions", "two_nodes.toml"],
    "new": ["new", "fresh.toml"],
    "report": [
        "report",
        "two_nodes.toml",
        "--t-end",
        "0.1",
        "--samples",
        "2",
        "--no-peers",
        "--longest",
        "0.01",
    ],
    "identify": ["identify", "two_nodes.toml", "fall.csv", "--by", "classes.cord.spring_constant"],
    "schema": ["schema", "--out", "scene.json"],
    "sensitivity": ["sensitivity", "two_nodes.toml"],
    "simulate": ["simulate", "two_nodes.toml", "--t-end", "0.1"],
    "size": [
        "size",
        "two_nodes.toml",
        "--density",
        "7850",
        "--yield-stress",
        "2e8",
        "--case",
        "pull:n2=0,0,-5",
    ],
    "stability": ["stability", "two_nodes.toml", "--t-end", "0.1", "--no-peers", "--limit", "10"],
    "stand": ["stand", "frame.toml"],
}
WRONG_USE = {
    "no verb": [],
    "unknown verb": ["bake", "prism.toml"],
    "missing argument": ["check"],
    "missing option": ["simulate", "two_nodes.toml"],
    "not a number": ["simulate", "two_nodes.toml", "--t-end", "soon"],
    "not an integer": ["simulate", "two_nodes.toml", "--t-end", "1", "--samples", "1.5"],
    "unknown option": ["build", "two_nodes.toml", "--fast"],
    "option without value": ["build", "two_nodes.toml", "--out"],
    "too many arguments": ["check", "two_nodes.toml", "prism.toml"],
    "not a choice": ["equilibrium", "two_nodes.toml", "--method", "guessing"],
}


@pytest.fixture
def tables(folder: Path) -> None:
    (folder / "nodes.csv").write_text("node,x,y,z,mass,anchored\na,0,0,0,,1\nb,0,0,-1,1,\n", encoding="utf-8")
    write(folder / "frame.toml", FRAME)
    (folder / "fall.csv").write_text(
        "time,n2.z\n" + "".join(f"{t},{-1 - 0.5 * 9.81 * t**2}\n" for t in (0.1, 0.2, 0.3)), encoding="utf-8"
    )
    (folder / "members.csv").write_text(
        "member,kind,node_i,node_j,spring_constant\ns,cable,a,b,100\n", encoding="utf-8"
    )


def test_no_option_of_a_verb_is_lost() -> None:
    """The stored names are the contract: options are added beside them."""
    stored = json.loads((Path(__file__).parent / "options.json").read_text(encoding="utf-8"))
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for verb, names in stored.items():
        params = commands[verb].params
        known = {word for item in params for word in (*item.opts, *item.secondary_opts)}
        assert set(names) <= known, verb


def test_these_are_all_verbs() -> None:
    names = set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
    assert names == set(VERBS)


def test_the_table_of_verbs_is_written_from_their_help(update_golden: bool) -> None:
    rows = []
    for verb in find_verbs():
        sentence = re.split(r"\n\n|(?<=\.)\s", inspect.cleandoc(verb.run.__doc__ or ""))[0]
        rows.append((f"`{verb.word}`", " ".join(sentence.split()).removesuffix(".")))
    check_table("reference/command_line.md", "verbs", ("verb", "what it does"), rows, update_golden)


@pytest.mark.parametrize("verb", VERBS)
def test_help_has_an_example_that_calls_the_verb(verb: str, run: Run) -> None:
    ended = run.good(verb, "--help")
    assert f"Example: tensegrity-codegen {verb}" in ended.out
    assert "--json" in ended.out
    assert ended.err == ""
    assert run(verb, "-h").out == ended.out


@pytest.mark.parametrize("verb", VERBS)
def test_the_example_of_the_help_is_a_valid_command_line(verb: str, run: Run) -> None:
    text = " ".join(run(verb, "--help").out.split())
    example = text.partition("Example: tensegrity-codegen ")[2]
    for heading in (" Arguments:", " Options:", " Common options:"):
        example = example.partition(heading)[0]
    words = shlex.split(example)  # quotes as in a shell
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert words[0] == verb
    context = commands[verb].make_context(verb, words[1:])  # parses, does not run
    assert context.params


LONG_CALLS = ("report", "stability")
GOOD_CALLS_BY_TIME = [*(verb for verb in GOOD_CALLS if verb not in LONG_CALLS), *thorough(*LONG_CALLS)]


@pytest.mark.parametrize("verb", GOOD_CALLS_BY_TIME)
@pytest.mark.usefixtures("two_nodes", "tables")
def test_json_is_one_object_on_stdout(verb: str, run: Run) -> None:
    """The stored keys are the contract: others are added beside them."""
    ended = run.good(*GOOD_CALLS[verb], "--json")
    assert ended.data["status"] in ("ok", "converged", "stable", "optimal")
    stored = json.loads((Path(__file__).parent / "json_keys.json").read_text(encoding="utf-8"))
    assert set(stored[verb]) <= set(ended.data)


@pytest.mark.parametrize("verb", GOOD_CALLS_BY_TIME)
@pytest.mark.usefixtures("two_nodes", "tables")
def test_without_json_people_can_read_it(verb: str, run: Run) -> None:
    ended = run.good(*GOOD_CALLS[verb])
    assert ended.out.strip()
    assert not ended.out.startswith("{")


@pytest.mark.parametrize("case", WRONG_USE)
@pytest.mark.usefixtures("two_nodes")
def test_wrong_use_with_json_is_one_object_too(case: str, run: Run) -> None:
    words = list(WRONG_USE[case])
    ended = run.refused(*words[:2], "--json", *words[2:])
    assert ended.data["status"] == "error"
    assert ended.data["error"] == "CommandLineError"
    assert ended.data["problem"]
    assert "--help" in ended.data["hint"]


@pytest.mark.parametrize("case", WRONG_USE)
@pytest.mark.usefixtures("two_nodes")
def test_wrong_use_leaves_stdout_alone(case: str, run: Run) -> None:
    ended = run.refused(*WRONG_USE[case])
    assert ended.out == ""
    assert "Usage: tensegrity-codegen" in ended.err or ended.err.startswith("Error: ")


def test_an_error_is_said_to_people_and_programs(run: Run) -> None:
    text, both = run("check", "none.toml"), run("check", "none.toml", "--json")
    assert (text.code, both.code) == (2, 2)
    assert text.out == ""
    assert text.err == both.err
    assert both.data["problem"] in text.err
    assert set(both.data) == {"status", "error", "problem", "where", "given", "allowed", "hint"}


def test_the_version_is_printed(run: Run) -> None:
    assert run("--version").out == f"tensegrity-codegen {VERSION}\n"


def test_ctrl_c_ends_with_130(run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tensegrity_codegen.pipeline.compile_scene.load_scene", interrupt)
    ended = run("check", two_nodes)
    assert ended.code == 130
    assert ended.out == ""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            OSError(28, "No space left on device", "prism.toml"),
            "prism.toml: system error: No space left",
        ),
        (PermissionError(13, "Permission denied"), "Permission denied"),
        (MemoryError(), "not enough memory"),
    ],
)
def test_what_the_machine_refuses_is_said_without_traceback(
    error: Exception, words: str, run: Run, two_nodes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: object) -> None:
        raise error

    monkeypatch.setattr("tensegrity_codegen.pipeline.compile_scene.load_scene", refuse)
    ended = run.refused("check", two_nodes, "--json")
    assert words in ended.err
    assert ended.data["status"] == "error"


def test_a_defect_is_not_hidden(two_nodes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("tensegrity_codegen.pipeline.compile_scene.load_scene", fail)
    with pytest.raises(ZeroDivisionError):
        main(["check", str(two_nodes)])


def test_json_types_are_plain_and_finite() -> None:
    data = plain(
        {"a": np.float64(1.5), 2: (np.int64(3), float("nan")), "c": np.array([1.0, np.inf]), "d": True}
    )
    assert data == {"a": 1.5, "2": [3, None], "c": [1.0, None], "d": True}
    assert isinstance(data["2"][0], int)
