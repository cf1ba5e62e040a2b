"""`build --target`: what is refused before anything is built."""

from pathlib import Path

import pytest

from tensegrity_codegen.tables.targets import TARGETS
from tests.cli.conftest import Run


@pytest.mark.parametrize(
    ("words", "error", "where"),
    [
        (("--target", "aarch64-linx"), "UnknownNameError", "--target"),
        (("--target", "wasm32", "--tune"), "InvalidValueError", "--target"),
        (("--target", "wasm32", "--tune-for", "member_tension"), "InvalidValueError", "--target"),
        (("--target", "wasm32", "--flags", "native"), "FormulationError", "model.flags"),
    ],
)
def test_what_no_other_machine_can_do_is_refused(
    words: tuple[str, ...], error: str, where: str, run: Run, two_nodes: Path
) -> None:
    ended = run.refused("build", two_nodes, *words, "--out", "library", "--json")
    assert ended.data["error"] == error
    assert where in ended.data["where"]
    assert words[1] in ended.data["given"]
    assert ended.data["allowed"]
    assert not Path("library").exists()


def test_the_help_lists_all_targets(run: Run) -> None:
    text = run("build", "--help").out.replace("\n", " ")
    assert all(
        name.replace("-", "") in text.replace("-", "").replace("│", "") for name in ("wasm32", *TARGETS)
    )


def test_a_library_for_this_machine_names_no_target(run: Run, two_nodes: Path) -> None:
    assert run("build", two_nodes, "--json").data["target"] == ""


@pytest.mark.parametrize(
    ("words", "error", "where"),
    [
        (("--wheel",), "InvalidValueError", "--wheel"),
        (("--wheel", "--target", "wasm32", "--out", "library"), "FormulationError", "--target"),
    ],
)
def test_a_wheel_needs_a_place_and_a_library_that_python_loads(
    words: tuple[str, ...], error: str, where: str, run: Run, two_nodes: Path
) -> None:
    ended = run.refused("build", two_nodes, *words, "--json")
    assert ended.data["error"] == error
    assert where in ended.data["where"]
    assert not Path("library").exists()


def test_a_wheel_lies_beside_the_library(run: Run, two_nodes: Path) -> None:
    data = run("build", two_nodes, "--wheel", "--out", "library", "--json").data
    wheel = Path(data["wheel"])
    assert wheel.parent == Path("library")
    assert wheel.name.startswith("tensegrity_two_nodes-")
    assert wheel.name in (wheel.parent / "SHA256SUMS").read_text(encoding="utf-8")
    run.good("build", two_nodes, "--wheel", "--out", "library")
