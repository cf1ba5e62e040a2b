"""Attributes of MJCF elements with those of their default classes."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError

MAIN = "main"
# Elements that change what a file says and are not read.
REFUSED = ("include", "attach", "replicate", "composite", "flexcomp", "frame", "extension", "model")


class Defaults:
    """Attributes by class and element; a class has those of the classes around it too."""

    def __init__(self, classes: Mapping[str, Mapping[str, Mapping[str, str]]], file: str) -> None:
        self._classes, self._file = classes, file

    def complete(self, element: Element, kind: str, around: str = MAIN) -> dict[str, str]:
        """Return the attributes of an element; kind: its name in classes; around: class of its body."""
        chosen = element.get("class", around)
        if chosen not in self._classes:
            raise UnknownNameError(
                "unknown class",
                where=f"{self._file}: {element.tag} {element.get('name', '')[:60]}",
                given=chosen[:80],
                allowed="a default class of the file",
            )
        return {**self._classes[chosen].get(kind, {}), **element.attrib}


def read_defaults(root: Element, file: str) -> Defaults:
    """Return the default classes of a model; raises InvalidValueError for elements that are not read."""
    for element in root.iter():
        if element.tag in REFUSED:
            raise InvalidValueError(
                f"the element <{element.tag}> is not read",
                where=file,
                given=element.tag,
                allowed="bodies, joints, sites and spatial tendons",
                hint="let MuJoCo write the model (mj_saveLastXML), which expands it",
            )
    classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}

    def visit(element: Element, name: str, inherited: Mapping[str, dict[str, str]]) -> None:
        own = {key: dict(value) for key, value in inherited.items()}
        for item in element:
            if item.tag != "default":
                own[item.tag] = {**own.get(item.tag, {}), **item.attrib}
        classes[name] = own
        for item in element.iterfind("default"):
            visit(item, item.get("class", ""), own)

    for element in root.iterfind("default"):
        visit(element, element.get("class", MAIN), classes[MAIN])
        if element.get("class", MAIN) != MAIN:
            classes.setdefault(MAIN, {})
    return Defaults(classes, file)
