"""The figures of docs/stability.md: counted from the JSON of runs, written between two marks."""

from pathlib import Path
from typing import Any

import pytest
import stability_pages
from stability_pages import DOCUMENT, replace_figures, write_figures

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


def test_figures_are_written_between_the_marks_alone(tmp_path: Path) -> None:
    file = tmp_path / "a.md"
    file.write_text(DOCUMENT.read_text(encoding="utf-8"), encoding="utf-8")
    replace_figures(file, stability_pages.BEGIN, stability_pages.END, "new figures\n")
    text, before = file.read_text(encoding="utf-8"), DOCUMENT.read_text(encoding="utf-8")
    assert f"{stability_pages.BEGIN}\nnew figures\n{stability_pages.END}" in text
    assert text.startswith(before.partition(stability_pages.BEGIN)[0])
    assert text.endswith(before.partition(stability_pages.END)[2])
    file.write_text("no marks", encoding="utf-8")
    with pytest.raises(SystemExit):
        replace_figures(file, stability_pages.BEGIN, stability_pages.END, "")
