"""Sections of a page as JSON and back, so that finished ones can be kept."""

import dataclasses
import functools
import json
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from tensegrity_codegen.report.pages.page import Command, Figure, Paragraph, Remark, Section
from tensegrity_codegen.report.pages.page_table import Table

KINDS: dict[str, type[Any]] = {
    "section": Section,
    "paragraph": Paragraph,
    "command": Command,
    "remark": Remark,
    "table": Table,
    "figure": Figure,
}


def section_as_json(section: Section) -> dict[str, Any]:
    """Return all of a section in JSON's types, pictures included."""
    text = json.dumps(dataclasses.asdict(section), allow_nan=False, default=_plain)
    result: dict[str, Any] = json.loads(text)
    return result


def read_section(data: Any) -> Section | None:
    """Return the section that section_as_json wrote, None if `data` is no such thing."""
    try:
        blocks = tuple(_adapter(item["kind"]).validate_python(item) for item in data["blocks"])
        section: Section = _adapter("section").validate_python({**data, "blocks": ()})
    except (ValidationError, ValueError, KeyError, TypeError):
        return None
    return dataclasses.replace(section, blocks=blocks)


@functools.cache
def _adapter(kind: str) -> TypeAdapter[Any]:
    return TypeAdapter(KINDS[kind])


def _plain(value: Any) -> Any:
    """Return NumPy's numbers and arrays in JSON's types."""
    return np.asarray(value).tolist()
