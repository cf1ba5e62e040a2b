import ast
import re
from pathlib import Path

import pytest
import typer

import tensegrity_codegen
from tensegrity_codegen.cli.app import app
from tensegrity_codegen.cli.verb import name_options
from tests.cli.conftest import Run

PACKAGE = Path(tensegrity_codegen.__file__).parent
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


def options_of_verbs() -> dict[str, set[str]]:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    return {
        verb: {word for item in command.params for word in item.opts} for verb, command in commands.items()
    }


def test_the_library_does_not_know_the_options_of_the_command_line() -> None:
    """It names arguments as Python has them; whole commands of another verb are named with this verb."""
    verbs, found = options_of_verbs(), []
    for path in sorted(PACKAGE.rglob("*.py")):
        if path.is_relative_to(PACKAGE / "cli") or path.is_relative_to(PACKAGE / "analyses"):
            continue  # verbs are made of both
        if "--" not in (text := path.read_text(encoding="utf-8")):
            continue
        for part in ast.parse(text).body:
            nodes = [node for node in ast.walk(part) if isinstance(node, ast.Constant)]
            texts = [node.value for node in nodes if isinstance(node.value, str)]
            named = {verb for verb in verbs if re.search(rf"\b{verb}\b", " ".join(texts))}
            known = set().union(*(options - set().union(*map(verbs.get, named))
                                  for options in verbs.values()))  # fmt: skip
            found += [
                f"{path.relative_to(PACKAGE)}:{part.lineno}: {word}"
                for word in known.intersection(*[OPTION.findall(" ".join(texts))])
            ]
    assert found == []


def test_a_hint_names_the_option_of_the_verb(run: Run, two_nodes: Path) -> None:
    ended = run("simulate", two_nodes, "--t-end", 1, "--method", "rk4", "--json")
    assert (ended.data["where"], ended.data["hint"]) == ("--step", "--method auto")


def test_an_option_without_a_value_is_named_alone(run: Run, two_nodes: Path) -> None:
    ended = run("new", two_nodes, "--json")
    assert ended.data["hint"].endswith("or pass --overwrite to replace it")


@pytest.mark.parametrize("text", ["a `word`", "no name", "`1x`", "`unknown_argument=3`"])
def test_other_texts_stay(text: str, run: Run, two_nodes: Path) -> None:
    run("check", two_nodes)  # a verb without such options
    assert name_options(text) == text
    assert name_options({"a": [text, 1, None]}) == {"a": [text, 1, None]}
