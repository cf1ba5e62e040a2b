"""Sections as JSON: what is not one is refused."""

import json
from typing import Any

import pytest

from tensegrity_codegen.report.pages.page import (
    Figure,
    Paragraph,
    Remark,
    Section,
    read_section,
    section_as_json,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import Picture

BLOCKS = (
    Paragraph("words"),
    Remark("differs", "why", ("entry",)),
    Table("caption", (Column("a"), Column("b", "m")), ((text_cell("x"), number_cell(0.1, ".1f")),)),
    Figure(Picture(3, 4, svg="<svg/>"), "caption", "alt", {"x": [1.0, 0.1]}),
)
SECTION = Section("anchor", "Fig. 1", "title", "new", "result", BLOCKS)


def test_a_section_comes_back_as_it_was() -> None:
    assert read_section(json.loads(json.dumps(section_as_json(SECTION)))) == SECTION


@pytest.mark.parametrize(
    "wrong",
    [
        {"verdict": "good"},
        {"blocks": 3},
        {"blocks": [{"kind": "film"}]},
        {"blocks": [{"kind": "table", "caption": "c", "columns": [], "rows": [[1]]}]},
        {"blocks": [{"kind": "figure", "picture": {"width": "wide"}, "caption": "", "alt": ""}]},
        {"title": None},
    ],
)
def test_what_is_no_section_is_none(wrong: dict[str, Any]) -> None:
    assert read_section(section_as_json(SECTION) | wrong) is None
    assert read_section(None) is None
    assert read_section([]) is None
