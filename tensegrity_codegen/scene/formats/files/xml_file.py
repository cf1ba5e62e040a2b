"""XML files that are read without trust: no DTD, no entities of their own, of limited size and depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, XMLPullParser

from tensegrity_codegen.errors import InvalidValueError, NonFiniteError, SceneSyntaxError, UnknownKeyError
from tensegrity_codegen.scene.formats.imported import read_text

__all__ = ["LARGEST_XML", "find_root", "read_attribute", "read_number", "read_numbers", "read_xml"]

LARGEST_XML = 32 * 2**20  # bytes
MOST_ELEMENTS = 500_000
DEEPEST = 200


def read_xml(path: Path, what: str) -> Element:
    """Return the root of an XML file, which holds `what`.

    Raises SceneError where it cannot be read, SceneSyntaxError where it is not well-formed, too large or too
    deep, or has a document type: entities that stand for each other could grow without limit.
    """
    where, text = str(path), read_text(path, LARGEST_XML, what)
    for word in ("<!DOCTYPE", "<!ENTITY"):
        if word in text:
            line = text.count("\n", 0, text.index(word)) + 1
            raise SceneSyntaxError(
                "document types and entities are not read",
                where=f"{where}: line {line}",
                given=word,
                allowed="XML without a document type",
            )
    parser: Any = XMLPullParser(("start", "end"))
    root: Element | None = None
    depth = count = 0
    try:
        for start in range(0, len(text), 2**16):
            parser.feed(text[start : start + 2**16])
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                count += event == "start"
                if depth > DEEPEST or count > MOST_ELEMENTS:
                    allowed = f"up to {DEEPEST} levels and {MOST_ELEMENTS} elements"
                    raise SceneSyntaxError("too many or too deep elements", where=where, allowed=allowed)
        parser.close()
    except ParseError as error:
        line, column = error.position
        raise SceneSyntaxError(
            f"not valid XML: {str(error).partition(':')[0]}",
            where=f"{where}: line {line}, column {column + 1}",
        ) from None
    if root is None:
        raise SceneSyntaxError("the file has no element", where=where, allowed=what)
    return root


def find_root(path: Path) -> str:
    """Return the name of the first element of a file, "" where there is none, without reading the rest."""
    text = read_text(path, LARGEST_XML, "XML")
    parser: Any = XMLPullParser(("start",))
    try:
        for start in range(0, len(text), 2**12):
            parser.feed(text[start : start + 2**12])
            for _, element in parser.read_events():
                return str(getattr(element, "tag", ""))
    except ParseError:
        return ""
    return ""


def read_attribute(element: Element, key: str, where: str) -> str:
    """Return an attribute; raises UnknownKeyError where it is missing."""
    value = element.get(key)
    if value is None:
        raise UnknownKeyError(f"the element has no attribute {key}", where=where, allowed=f'{key}="..."')
    return value


def read_numbers(text: str, where: str, counts: Sequence[int] = ()) -> list[float]:
    """Return numbers with spaces between them; counts: how many are allowed, empty: any."""
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if not found or (counts and len(found) not in counts):
        wanted = " or ".join(str(count) for count in counts) or "some"
        raise InvalidValueError(
            "not numbers", where=where, given=text[:80], allowed=f"{wanted} numbers with spaces between them"
        )
    if not all(math.isfinite(value) and abs(value) < 1e300 for value in found):
        raise NonFiniteError("not finite numbers", where=where, given=text[:80], allowed="up to 1e300")
    return found


def read_number(text: str, where: str) -> float:
    """Return one number."""
    return read_numbers(text, where, (1,))[0]
