"""Elements of XML files with numbers in them; the library quotes names and texts."""

from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

import numpy as np
from numpy.typing import ArrayLike


def add(above: Element, tag: str, **attributes: str) -> Element:
    """Return a new element below `above`."""
    return SubElement(above, tag, attributes)


def number(value: float) -> str:
    """Return the shortest text that reads back bit-equal; zero without a sign."""
    return repr(float(value) + 0.0)


def numbers(values: ArrayLike) -> str:
    """Return several numbers with spaces between them."""
    return " ".join(number(value) for value in np.asarray(values, dtype=np.float64).ravel())


def write_elements(root: Element, path: Path) -> None:
    """Write a document with line breaks, in UTF-8."""
    indent(root)
    ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
