"""Import of the tensegrity document format (TDF, XML): rods and cables of classes between positioned nodes.

<tdf><rod_class id="r" stiffness="100" rest_length="0.5"/> <cable_class id="c" .../>
  <composition><rod class="r" node1="1" node2="2"/> <cable class="c" node1="2" node2="3"/></composition>
  <initial_positions><node id="1" xyz="0 0 0"/> ...</initial_positions></tdf>
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from tensegrity_codegen.scene.formats.files.documents import (
    find_root,
    read_attribute,
    read_number,
    read_numbers,
    read_xml,
)
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import ImportResult, Network, NetworkMember, build_result
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

WHAT = "a tensegrity document (TDF)"
KINDS = {"rod": "bar", "cable": "cable"}


def import_tdf(
    path: str | Path, *, name: str | None = None, gravity: Sequence[float] | None = None
) -> ImportResult:
    """Return the scene document of a TDF file, and notes."""
    path = Path(path)
    root, where = read_xml(path, WHAT), str(path)
    if root.tag != "tdf":
        problem = "not a tensegrity document"
        raise InvalidValueError(problem, where=where, given=root.tag[:80], allowed="<tdf>")
    for element in root.iter():
        macros = [text for text in (element.tag, *element.attrib.values()) if text.startswith(("{", "${"))]
        if macros:
            problem, allowed = "macros are not expanded", "elements of TDF, and numbers"
            hint = f"expand the file first: xacro {path.name} > {path.name.partition('.')[0]}.tdf.xml"
            raise InvalidValueError(problem, where=where, given=macros[0][:80], allowed=allowed, hint=hint)
    network = Network()
    classes = {kind: _read_classes(root, kind, where) for kind in KINDS}
    for number, element in enumerate(root.iterfind("initial_positions/node")):
        location = f"{where}: initial_positions.node[{number}]"
        key = read_attribute(element, "id", location)
        if key in network.nodes:
            raise DuplicateNameError("two nodes with one id", where=location, given=key[:80])
        xyz = read_attribute(element, "xyz", location)
        network.nodes[key] = {"position": read_numbers(xyz, f"{location}.xyz", (3,))}
    _read_members(network, root, classes, where)
    network.notes.append(
        "the file has no masses: the scene serves statics, motions need masses of nodes or bars"
    )
    return build_result(network, path, name, gravity)


def _read_classes(root: Element, kind: str, file: str) -> dict[str, dict[str, float]]:
    """Return stiffness and rest length by class."""
    classes: dict[str, dict[str, float]] = {}
    for number, element in enumerate(root.iterfind(f"{kind}_class")):
        location = f"{file}: {kind}_class[{number}]"
        key = read_attribute(element, "id", location)
        if key in classes:
            raise DuplicateNameError("two classes with one id", where=location, given=key[:80])
        classes[key] = {
            target: read_number(read_attribute(element, source, location), f"{location}.{source}")
            for source, target in (("stiffness", "spring_constant"), ("rest_length", "rest_length"))
        }
    return classes


def _read_members(
    network: Network, root: Element, classes: Mapping[str, Mapping[str, Any]], file: str
) -> None:
    """Add rods and cables; one that is given again with the same class counts once."""
    seen: dict[tuple[str, frozenset[str]], str | None] = {}
    repeated = 0
    for number, element in enumerate(root.iterfind("composition/*")):
        location = f"{file}: composition[{number}]"
        if element.tag not in KINDS:
            problem = "neither a rod nor a cable"
            raise InvalidValueError(problem, where=location, given=element.tag[:80], allowed="rod, cable")
        start, end = (read_attribute(element, key, location) for key in ("node1", "node2"))
        class_name = element.get("class")
        pair = (element.tag, frozenset((start, end)))
        if pair in seen and seen[pair] == class_name:
            repeated += 1
            continue
        seen[pair] = class_name
        if class_name is not None:
            allowed = f"a {element.tag}_class of the file"
            check_known(class_name, classes[element.tag], "unknown class", allowed, f"{location}.class")
        values = {} if class_name is None else classes[element.tag][class_name]
        member = {"kind": KINDS[element.tag], **values}
        name = network.name_member(f"{element.tag}_{start}_{end}")
        network.members.append(NetworkMember(name, (start, end), member, location))
    if repeated:
        network.notes.append(f"{repeated} rods and cables are given again, and count once")


FORMAT = Format(
    title="tensegrity documents (TDF, XML)", sources=("structure.tdf.xml",),
    endings=(".xml", ".tdf", ".xacro"), read=import_tdf, order=6,
    recognises=lambda path: find_root(path) == "tdf",
)  # fmt: skip
