"""Attributes of MJCF elements with those of their default classes."""

from collections.abc import Mapping
from xml.etree.ElementTree import Element

from tensegrity_codegen.scene.formats.files.xml_file import check_attributes
from tensegrity_codegen.scene.formats.mjcf.attributes import list_unread
from tensegrity_codegen.scene.names import name_list
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError

MAIN = "main"
MOST_NAMED = 10
# Elements of classes; all others there are actuators, whose attributes are those of one element.
KINDS = ("joint", "geom", "site", "tendon", "mesh", "material", "camera", "light", "pair", "equality")
# Elements that change what a file says and are not read.
REFUSED = ("include", "attach", "replicate", "composite", "flexcomp", "frame", "extension", "model")


class Defaults:
    """Attributes by class and element; a class has those of the classes around it too.

    unread: by element and attribute, the elements whose attribute acts in MuJoCo and is not read.
    """

    def __init__(
        self, classes: Mapping[str, Mapping[str, Mapping[str, str]]], file: str, by_range: bool
    ) -> None:
        self._classes, self._file, self._by_range = classes, file, by_range
        self.unread: dict[str, list[str]] = {}

    def complete(self, element: Element, kind: str, around: str = MAIN, owner: str = "") -> dict[str, str]:
        """Return the attributes of an element, and record those that are not read.

        kind: its name in classes; around: class of its body; owner: what has it, where it has no name.
        """
        self.record(element.tag, values := self.inherit(element, kind, around), owner)
        return values

    def record(self, tag: str, values: Mapping[str, str], owner: str = "") -> None:
        """Record the attributes of an element that act in MuJoCo and are not read."""
        for key in list_unread(tag, values, self._by_range):
            names = self.unread.setdefault(f"{tag} {key[:40]}", [])
            is_named = len(names) < MOST_NAMED  # of the others only the number is told
            text = f"{values.get('name', owner)[:60]} ({values[key][:40]})" if is_named else ""
            names.append(text.lstrip())

    def describe_unread(self) -> list[str]:
        """Return notes on the attributes that act in MuJoCo and are not read."""
        return [
            f"{what} is not read, though it acts in MuJoCo: {name_list(names, MOST_NAMED)}"
            for what, names in self.unread.items()
        ]

    def inherit(self, element: Element, kind: str, around: str = MAIN) -> dict[str, str]:
        """Return the attributes of an element with those of its class."""
        chosen = element.get("class", around)
        if chosen not in self._classes:
            location = f"{self._file}: {element.tag} {element.get('name', '')[:60]}"
            allowed = "a default class of the file"
            raise UnknownNameError("unknown class", where=location, given=chosen[:80], allowed=allowed)
        return {**self._classes[chosen].get(kind, {}), **element.attrib}


def read_defaults(root: Element, file: str) -> Defaults:
    """Return the default classes of a model; raises InvalidValueError for elements that are not read."""
    for element in root.iter():
        if element.tag in REFUSED:
            problem = f"the element <{element.tag}> is not read"
            allowed = "bodies, joints, sites and spatial tendons"
            hint = "let MuJoCo write the model (mj_saveLastXML), which expands it"
            raise InvalidValueError(problem, where=file, given=element.tag, allowed=allowed, hint=hint)
    classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}

    def visit(element: Element, name: str, inherited: Mapping[str, dict[str, str]]) -> None:
        own = dict(inherited)
        for item in element:
            if item.tag != "default":
                kind = item.tag if item.tag in KINDS else "actuator"
                own[kind] = {**own.get(kind, {}), **item.attrib}
                check_attributes(own[kind], item.tag, file)
        classes[name] = own
        for item in element.iterfind("default"):
            visit(item, item.get("class", ""), own)

    for element in root.iterfind("default"):
        visit(element, element.get("class", MAIN), classes[MAIN])
        if element.get("class", MAIN) != MAIN:
            classes.setdefault(MAIN, {})
    by_range = [element.get("autolimits") for element in root.iterfind("compiler[@autolimits]")]
    return Defaults(classes, file, by_range[-1:] != ["false"])
