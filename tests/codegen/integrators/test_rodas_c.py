"""The generated C of the Rosenbrock method compiles without a warning, with events and profiles."""

from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, run, write_files
from tests.codegen.compilers import require_compiler
from tests.runtime.build import prism

CASES: tuple[dict[str, Any], ...] = (
    {"emitter": "unrolled"},
    {"emitter": "table"},
    {"formulation": "rigid_bar", "options": {"bars": "all"}},
)


@pytest.mark.parametrize("options", [CASES[0], *thorough(*CASES[1:])], ids=str)
def test_it_compiles_without_a_warning(options: dict[str, Any], tmp_path: Path) -> None:
    structure = prism().with_changes(inputs=(ActuatedInput("winch", "rest_length", (1,)),))
    events = ("cable", "condition")
    request = ModelRequest(("acceleration",), integrators=("rodas",), events=events, **options)
    folder = write_files(tmp_path, emit(structure, request).files)
    compiler = require_compiler("gcc")
    strict = (*STRICT, "-Wshadow", "-O1")
    run([*compiler.command, "-std=c99", *strict, "-c", "small.c", "-o", "small.o"], folder, compiler)
    text = (folder / "small.c").read_text(encoding="utf-8")
    assert "profile_set_stage" in text
    assert "rodas_is_cut_short" in text
