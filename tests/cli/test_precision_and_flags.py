"""Precision and compile flags from the scene and from the command line, which has the last word."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import GOOD, write


def scene_with(model: str) -> Path:
    return write(Path("small.toml"), GOOD.replace("[classes", f"[model]\n{model}\n\n[classes", 1))


def test_precision_and_flags_are_in_the_manifest(run: Run) -> None:
    scene = scene_with('precision = "single"\nflags = "native"')
    data = run("build", scene, "--out", "library", "--json").data
    manifest = json.loads(Path("library/manifest.json").read_text(encoding="utf-8"))
    assert (data["precision"], manifest["precision"], manifest["flags"]) == ("single", "single", "native")
    assert data["instruction_sets"] == manifest["instruction_sets"]
    assert "-DTENSEGRITY_NATIVE" in data["flags"]
    assert "float tension" not in Path("library/small.h").read_text(encoding="utf-8")
    assert "const float coordinate[3]" in Path("library/small.h").read_text(encoding="utf-8")
    checked = run("check", scene, "--json").data
    assert (checked["precision"], checked["flags"]) == ("single", "native")


def test_the_command_line_has_the_last_word(run: Run) -> None:
    scene = scene_with('precision = "single"\nflags = "native"')
    data = run("build", scene, "--precision", "double", "--flags", "reference", "--out", "out", "--json").data
    manifest = json.loads(Path("out/manifest.json").read_text(encoding="utf-8"))
    assert (data["precision"], manifest["precision"], manifest["flags"]) == ("double", "double", "reference")
    assert manifest["instruction_sets"] == []
    assert "-DTENSEGRITY_NATIVE" not in data["flags"]


@pytest.mark.parametrize(
    ("option", "word", "known"),
    [
        ("--precision", "singel", "single"),
        ("--precision", "float32", "double"),
        ("--flags", "natve", "native"),
        ("--flags", "-Ofast", "reference"),
    ],
)
def test_a_wrong_word_of_an_option_is_refused(run: Run, option: str, word: str, known: str) -> None:
    ended = run.refused("build", scene_with(""), f"{option}={word}", "--out", "library")
    assert word in ended.err
    assert option in ended.err
    assert known in ended.err
    assert not Path("library").exists()


@pytest.mark.parametrize(
    ("key", "word", "known"),
    [("precision", "singel", "single"), ("precision", "Double", "double"), ("flags", "nativ", "native")],
)
def test_a_wrong_word_of_the_scene_is_refused(run: Run, key: str, word: str, known: str) -> None:
    ended = run.refused("build", scene_with(f'{key} = "{word}"'))
    assert f"model.{key}" in ended.err
    assert word in ended.err
    assert known in ended.err


@pytest.mark.parametrize(
    "verb", [("simulate", "--t-end", "0.1"), ("equilibrium",), ("linearize",), ("sensitivity",), ("analyse",)]
)
def test_analyses_say_that_they_need_double_precision(run: Run, verb: tuple[str, ...]) -> None:
    ended = run.refused(verb[0], scene_with('precision = "single"'), *verb[1:])
    assert "double precision" in ended.err
    assert "model.precision" in ended.err


def test_a_number_beyond_single_precision_is_named(run: Run) -> None:
    text = GOOD.replace("spring_constant = 100.0", "spring_constant = 1e40")
    ended = run.refused("build", write(Path("stiff.toml"), text), "--precision", "single")
    assert "spring_constant of s1" in ended.err
    assert "1e+40" in ended.err


def test_solvers_in_single_precision_are_refused(run: Run) -> None:
    wanted = (
        'quantities = ["potential_energy", "tangent_stiffness", "node_residual"]\nsolvers = ["equilibrium"]'
    )
    ended = run.refused("build", scene_with(wanted), "--precision", "single")
    assert "model.solvers" in ended.err
