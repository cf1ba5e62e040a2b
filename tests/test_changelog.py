"""CHANGELOG.md says what changed in a line each, and what to write now exists."""

import ast
import inspect
import re
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import tensegrity_codegen
from tensegrity_codegen.cli.app import Commands
from tensegrity_codegen.pipeline.tuning import build_tuned
from tensegrity_codegen.scene.schema.model_schema import ModelOptions

TEXT = (Path(__file__).resolve().parent.parent / "CHANGELOG.md").read_text(encoding="utf-8")
MOST_WORDS, MOST_WORDS_A_LINE = 5000, 25
ENTRIES = [line for line in TEXT.splitlines() if line.startswith("- ")]
# What stands in the right column and is no Python: keys of scenes and JSON, C, CMake, the shell.
OTHER = {"[model]", "radius", "find_package(tensegrity_NAME 3)", "OPENBLAS_NUM_THREADS", "git grep"}
OTHER |= {"t_asked", "t_stopped", "took_seconds", "n_not_computed"}


def right_columns() -> Iterator[str]:
    """Yield each piece of code in the right columns of the tables on upgrading."""
    for table in re.findall(r"^### Upgrading from .*?\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL):
        for line in re.findall(r"^\| (?!moved).* \| (.*) \|$", table, re.MULTILINE):
            yield from re.findall(r"`(.*?)`", line)


def find(name: str) -> Any:
    """Return the object of a name of the package, or of a full one below it."""
    if name == "build_tuned":
        return build_tuned
    parts = name.removeprefix("tensegrity_codegen.").split(".")
    if parts == ["tensegrity_codegen"]:
        return tensegrity_codegen
    if hasattr(tensegrity_codegen, parts[0]) and not inspect.ismodule(getattr(tensegrity_codegen, parts[0])):
        found = getattr(tensegrity_codegen, parts[0])
        fields = getattr(found, "__dataclass_fields__", {})
        return found if len(parts) == 1 or parts[1] in fields else getattr(found, parts[1])
    try:
        return import_module(f"tensegrity_codegen.{'.'.join(parts)}")
    except ModuleNotFoundError:
        return getattr(import_module(f"tensegrity_codegen.{'.'.join(parts[:-1])}"), parts[-1])


def check_python(code: str) -> None:
    """Find each name, call and argument of an expression, or of `argument=expression`."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call):
            known = inspect.signature(find(ast.unparse(node.func))).parameters
            assert [word.arg for word in node.keywords if word.arg not in known] == [], code
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Name | ast.Attribute):
            find(code)


def check_option(word: str, options: str) -> None:
    verbs = Commands()
    commands = [verbs[word]] if word in verbs else [verbs[name] for name in verbs]
    known = {name for command in commands for option in command.params for name in option.opts}
    assert set(re.findall(r"--[a-z-]+", options)) <= known, (word, options)


@pytest.mark.parametrize("code", sorted(set(right_columns())))
def test_what_upgrading_says_to_write_exists(code: str) -> None:
    verb, _, options = code.partition(" ")
    if code in OTHER:
        return
    if "--" in code:
        check_option(verb, options or code)
    elif re.match(r"\w+ = ", code):
        assert tomllib.loads(code).keys() <= ModelOptions.model_fields.keys()
    else:
        check_python(code)


def test_each_change_is_one_short_line() -> None:
    long = [line for line in ENTRIES if len(re.sub(r"\]\(.*?\)", "]", line).split()) - 1 > MOST_WORDS_A_LINE]
    assert long == []
    assert [line for line in TEXT.splitlines() if line.startswith("  ")] == []
    assert len(TEXT.split()) <= MOST_WORDS
