"""Generated C is read by people: short lines, names of the scene beside the numbers, safe comments."""

from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.print.printer import name_local, plain_comment
from tensegrity_codegen.codegen.print.render import LONGEST
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.subjects import bare, everything

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "tensegrity_codegen/scene/examples").glob("*.toml"))
EMITTERS = ("unrolled", "table")
SMALL = [path for path in EXAMPLES if path.stem in ("planar", "lin_prism")]


def assert_readable(files: dict[str, str]) -> None:
    for name, text in files.items():
        if name.endswith((".c", ".h")):
            long = [line for line in text.splitlines() if len(line) > LONGEST]
            assert long == [], name
            assert "??" not in text
            assert not [line for line in text.splitlines() if line.rstrip() != line], name


@pytest.mark.parametrize("emitter", EMITTERS)
@pytest.mark.parametrize(
    "scene",
    [*SMALL, *thorough(*(path for path in EXAMPLES if path not in SMALL))],
    ids=lambda path: path.stem,
)
def test_no_line_of_an_example_is_long(scene: Path, emitter: str) -> None:
    structure, request = load_scene(scene)
    try:
        found = emit(structure, replace(request, emitter=emitter))
    except FormulationError:
        pytest.skip(f"the emitter {emitter} does not serve this scene")
    assert_readable(found.files)


@pytest.mark.parametrize("emitter", EMITTERS)
@pytest.mark.parametrize("subject", [bare, *thorough(everything)], ids=["bare", "everything"])
def test_no_line_is_long_with_all_there_is(subject: object, emitter: str) -> None:
    structure, request = subject()  # type: ignore[operator]
    solvers = ("equilibrium",) if {"tangent_stiffness", "node_residual"} <= set(request.quantities) else ()
    wider = replace(
        request, emitter=emitter, flags="native", interfaces=("casadi",), batch_width=8, solvers=solvers
    )
    try:
        found = emit(structure, wider)
    except FormulationError:
        found = emit(structure, replace(wider, emitter="unrolled"))
    assert_readable(found.files)


def prism(*quantities: str, emitter: str = "unrolled") -> str:
    structure, _ = load_scene(next(path for path in EXAMPLES if path.stem == "prism"))
    return emit(structure, ModelRequest(quantities, emitter=emitter)).files["prism.c"]


def test_members_have_their_names_before_their_loop() -> None:
    text = prism("member_tension", "node_residual")
    for member in ("bar1", "bottom2", "top3", "vertical1"):
        assert f"{member}: " in text
    assert "/* bar1: b1 to t1, bar2: b2 to t2, " in text
    assert "const double length_e = sqrt(" in text
    assert "/* b1_x */" in text


def test_the_prism_is_short() -> None:
    structure, request = load_scene(next(path for path in EXAMPLES if path.stem == "prism"))
    assert len(emit(structure, request).files["prism.c"].splitlines()) <= 1700


@pytest.mark.parametrize("name", ["a" * 41, "no name", "a*/b", "1a", ""])
def test_a_name_that_is_no_short_identifier_has_its_number(name: str) -> None:
    assert name_local("length", name, 7) == "length_7"
    assert name_local("length", "bar_1", 7) == "length_bar_1"


def test_a_comment_holds_nothing_that_ends_it() -> None:
    assert plain_comment("a*/ b ??/ c\\\n/* d") == "a__ b ___ c____ d"
    assert plain_comment("bar1: b1 to t1, (2.5-3)") == "bar1: b1 to t1, (2.5-3)"
