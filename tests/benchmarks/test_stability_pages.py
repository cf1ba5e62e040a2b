"""The figures of docs/stability.md: counted from the JSON of runs."""

from pathlib import Path
from typing import Any

import pytest
import stability_pages
from stability_pages import write_figures

from tensegrity_codegen.pipeline.compile_scene import load_nodes


def row(contender: str, verdict: str, *, own: bool = True, rule: str = "") -> dict[str, Any]:
    words = {"group": "damping", "case": "10", "contender": contender, "is_own": own}
    return words | {"verdict": verdict, "rule": rule, "error": 12.0}


FOUND = {
    "prism": {
        "t_end": 0.1,
        "limits": {"run": 2.0, "reference": 4.0, "total": 540.0},
        "rows": [
            row("auto", "survived", rule="told"),
            row("rk54", "wrong"),
            row("radau", "not run"),
            row("CVODES", "wrong", own=False),
        ],
    }
}


def test_every_verdict_that_was_given_has_its_count() -> None:
    lines = write_figures(FOUND).splitlines()
    assert "| scene | right | wrong | not run | stated bound | positions |" in lines
    assert "| prism | 1 | 1 | 1 | 1 | 0 |" in lines
    assert "| CVODES | 1 |" in lines
    assert "| prism | damping: 10 | rk54 | 12 |" in lines  # wrong ones of ours are listed


@pytest.mark.parametrize("name", stability_pages.VARIANTS)
def test_variants_of_the_prism_are_what_they_are_named_for(name: str, tmp_path: Path) -> None:
    structure = load_nodes(stability_pages.write_variant(tmp_path, name))
    assert structure.name == name
    assert (structure.ground is not None) == (name == "standing")
    assert structure.node_anchored.any() == (name != "standing")
    assert structure.internal_name
    assert structure.is_linear.all() == (name == "standing")
