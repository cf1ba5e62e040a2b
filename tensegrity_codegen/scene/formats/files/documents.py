"""JSON and XML files that are read without trust: of limited size, each key once, no NaN, no DTD."""

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

from tensegrity_codegen.scene.formats.imported import read_text
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    SceneSyntaxError,
    UnknownKeyError,
)

MAX_JSON_BYTES = 32 * 2**20  # bytes
MAX_VALUES = 4_000_000  # of one file


def read_json(path: Path, what: str) -> Any:
    """Return the content of a JSON file, which holds `what`; each key once, no NaN, of limited size."""
    return parse_json(read_text(path, MAX_JSON_BYTES, what), path)


def parse_json(text: str, path: Path) -> Any:
    """Return the content of JSON text from a file, as `read_json` does."""
    count = sum(text.count(sign) for sign in ",[{")
    if count > MAX_VALUES:
        problem = "the file has too many values"
        raise SceneSyntaxError(problem, where=str(path), given=count, allowed=f"up to {MAX_VALUES}")

    def refuse(word: str) -> Any:
        raise NonFiniteError("not a finite number", where=str(path), given=word, allowed="finite numbers")

    def read_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        table: dict[str, Any] = {}
        for key, value in pairs:
            if key in table:
                problem = "a key is given twice in one object"
                raise DuplicateNameError(problem, where=str(path), given=key, allowed="each key once")
            table[key] = value
        return table

    try:
        return json.loads(text, object_pairs_hook=read_object, parse_constant=refuse)
    except json.JSONDecodeError as error:
        location = f"{path}: line {error.lineno}, column {error.colno}"
        raise SceneSyntaxError(f"not valid JSON: {error.msg}", where=location, allowed="JSON") from None
    except RecursionError:
        raise SceneSyntaxError("the file is nested too deeply", where=str(path)) from None
    except ValueError:  # an integer of thousands of digits
        raise SceneSyntaxError("a number has too many digits", where=str(path)) from None


MAX_XML_BYTES = 32 * 2**20  # bytes
MAX_ELEMENTS = 500_000
MAX_ATTRIBUTES = 64  # of an element
DEEPEST = 200


def read_xml(path: Path, what: str) -> Element:
    """Return the root of an XML file, which holds `what`."""
    where, text = str(path), read_text(path, MAX_XML_BYTES, what)
    for mark in ("<!DOCTYPE", "<!ENTITY"):  # entities that stand for each other could grow without limit
        if mark in text:
            line = text.count("\n", 0, text.index(mark)) + 1
            problem, location = "document types and entities are not read", f"{where}: line {line}"
            raise SceneSyntaxError(problem, where=location, given=mark, allowed="XML without a document type")
    parser = XMLParser(target=_LimitedBuilder(where))
    try:
        # At once: in pieces the parser would begin a long element again with every piece.
        parser.feed(text)
        root: Element = parser.close()
    except ParseError as error:
        line, column = error.position
        problem = f"not valid XML: {str(error).partition(':')[0]}"
        raise SceneSyntaxError(problem, where=f"{where}: line {line}, column {column + 1}") from None
    return root


def find_root(path: Path) -> str:
    """Return the name of the first element of a file, "" if there is none, without reading the rest."""
    with suppress(ParseError):
        try:
            XMLParser(target=_FirstElement()).feed(read_text(path, MAX_XML_BYTES, "XML"))
        except _FirstElementError as found:
            return str(found)
    return ""


class _LimitedBuilder(TreeBuilder):
    """Builds a tree of limited size and depth; `where` names the file in errors."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self._where, self._depth, self._count = where, 0, 0

    def start(self, tag: str, attrs: dict[str, str]) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > DEEPEST or self._count > MAX_ELEMENTS:
            allowed = f"up to {DEEPEST} levels and {MAX_ELEMENTS} elements"
            raise SceneSyntaxError("too many or too deep elements", where=self._where, allowed=allowed)
        check_attributes(attrs, tag, self._where)
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)


def check_attributes(attributes: Mapping[str, str], tag: str, where: str) -> None:
    """Raise SceneSyntaxError for too many attributes of an element, which others may have by their class."""
    if len(attributes) > MAX_ATTRIBUTES:
        allowed = f"up to {MAX_ATTRIBUTES} attributes"
        problem = "too many attributes"
        raise SceneSyntaxError(problem, where=f"{where}: {tag[:80]}", given=len(attributes), allowed=allowed)


class _FirstElementError(Exception):
    """The name of the first element, which ends the reading."""


class _FirstElement:
    def start(self, tag: str, attrs: dict[str, str]) -> None:
        raise _FirstElementError(tag)


def read_attribute(element: Element, key: str, where: str) -> str:
    """Return an attribute; raises UnknownKeyError if it is missing."""
    value = element.get(key)
    if value is None:
        raise UnknownKeyError(f"the element has no attribute {key}", where=where, allowed=f'{key}="..."')
    return value


def read_numbers(text: str, where: str, counts: Sequence[int] = ()) -> list[float]:
    """Return numbers with spaces between them; counts: how many are allowed, empty: any."""
    try:
        numbers = [float(number) for number in text.split()]
    except ValueError:
        numbers = []
    if not numbers or (counts and len(numbers) not in counts):
        count_text = " or ".join(str(count) for count in counts) or "some"
        allowed = f"{count_text} numbers with spaces between them"
        raise InvalidValueError("not numbers", where=where, given=text[:80], allowed=allowed)
    if not all(math.isfinite(value) and abs(value) < 1e300 for value in numbers):
        raise NonFiniteError("not finite numbers", where=where, given=text[:80], allowed="up to 1e300")
    return numbers


def read_number(text: str, where: str) -> float:
    """Return one number."""
    return read_numbers(text, where, (1,))[0]
