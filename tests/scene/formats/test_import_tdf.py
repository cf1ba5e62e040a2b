"""Tensegrity documents (TDF), and XML files that must not be trusted."""

from pathlib import Path
from xml.etree.ElementTree import XMLParser

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.files import documents
from tensegrity_codegen.scene.formats.files.documents import read_xml
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.import_tdf import import_tdf
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)
from tests.cases import thorough

TEXT = """<?xml version="1.0"?>
<tdf>
  <rod_class id="r1" stiffness="1000" rest_length="1.4"/>
  <cable_class id="c1" stiffness="10" rest_length="0.9"/>
  <cable_class id="c2" stiffness="20" rest_length="0.8"/>
  <composition>
    <rod class="r1" node1="1" node2="3"/>
    <cable class="c1" node1="1" node2="2"/>
    <cable class="c2" node1="2" node2="3"/>
    <cable class="c2" node1="3" node2="2"/>
  </composition>
  <initial_positions>
    <node id="1" xyz="0 0 0"/>
    <node id="2" xyz="1 0 0"/>
    <node id="3" xyz=" 1 1e0
       0"/>
  </initial_positions>
</tdf>
"""


def load(tmp_path: Path, text: str | bytes) -> ImportResult:
    path = tmp_path / "triangle.tdf.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return import_tdf(path, name="triangle")


def test_rods_and_cables_become_a_scene(tmp_path: Path) -> None:
    result = load(tmp_path, TEXT)
    structure, _ = assemble(parse_scene(result.document))
    assert structure.node_position.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert structure.member_name == ("rod_1_3", "cable_1_2", "cable_2_3")
    assert structure.spring_constant.tolist() == [1000, 10, 20]
    assert structure.rest_length.tolist() == [1.4, 0.9, 0.8]
    assert structure.is_bar.tolist() == [True, False, False]
    assert any("1 rods and cables are given again" in note for note in result.notes)
    assert any("no masses" in note for note in result.notes)
    assert read_files([tmp_path / "triangle.tdf.xml"], up="y").document["nodes"]["n3"]["position"] == [
        1,
        0,
        1,
    ]


def test_files_of_xacro_are_read_where_they_have_no_macros(tmp_path: Path) -> None:
    path = tmp_path / "triangle.tdf.xacro"
    path.write_text(TEXT, encoding="utf-8")
    assert read_files([path], name="triangle").document == load(tmp_path, TEXT).document
    for text in (
        TEXT.replace("<tdf>", '<tdf xmlns:xacro="x"><xacro:property name="k" value="3"/>'),
        TEXT.replace('stiffness="10"', 'stiffness="${k}"'),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InvalidValueError, match="macros are not expanded") as caught:
            read_files([path])
        assert "xacro triangle.tdf.xacro > triangle.tdf.xml" in caught.value.hint


def test_names_of_nodes_that_give_one_name_twice_are_told_apart(tmp_path: Path) -> None:
    rods = '<rod class="r1" node1="p_q" node2="r"/><rod class="r1" node1="p" node2="q_r"/>'
    nodes = "".join(f'<node id="{name}" xyz="0 {k} 3"/>' for k, name in enumerate(("p_q", "r", "p", "q_r")))
    text = TEXT.replace("</composition>", f"{rods}</composition>").replace("</initial", f"{nodes}</initial")
    members = load(tmp_path, text).document["members"]
    assert members["rod_p_q_r"]["nodes"] == ["p_q", "r"]
    assert members["rod_p_q_r_2"]["nodes"] == ["p", "q_r"]


def test_an_element_of_any_length_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fed in pieces, the parser begins a long element again with every piece."""
    sizes = []

    class Parser(XMLParser):
        def feed(self, data: str) -> None:  # type: ignore[override]
            sizes.append(len(data))
            super().feed(data)

    monkeypatch.setattr(documents, "XMLParser", Parser)
    path = tmp_path / "a.xml"
    path.write_text(f'<tdf name="{"value " * 60_000}"/>')
    assert documents.find_root(path) == "tdf"
    assert len(read_xml(path, "XML").attrib["name"]) == 360_000
    assert sizes == [path.stat().st_size] * 2


def test_a_rod_without_class_is_rigid_and_a_cable_is_refused(tmp_path: Path) -> None:
    result = load(tmp_path, TEXT.replace('<rod class="r1"', "<rod"))
    assert result.document["members"]["rod_1_3"] == {"kind": "bar", "nodes": ["n1", "n3"]}
    with pytest.raises(InvalidValueError, match="a cable without stiffness"):
        load(tmp_path, TEXT.replace('<cable class="c1"', "<cable"))


@pytest.mark.parametrize(
    ("old", "new", "error", "where"),
    [
        ('class="r1"', 'class="r9"', UnknownNameError, "composition[0].class"),
        ('node1="1" node2="3"', 'node1="1" node2="9"', UnknownNameError, "composition[0]"),
        ('node1="1" node2="3"', 'node1="1" node2="1"', StructureError, "composition[0]"),
        ('node1="1" node2="3"', 'node1="1"', UnknownKeyError, "composition[0]"),
        ("<rod ", "<spring ", InvalidValueError, "composition[0]"),
        ('<node id="2"', '<node id="1"', DuplicateNameError, "initial_positions.node[1]"),
        ('id="c2"', 'id="c1"', DuplicateNameError, "cable_class[1]"),
        ('xyz="1 0 0"', 'xyz="1 0"', InvalidValueError, "initial_positions.node[1].xyz"),
        ('xyz="1 0 0"', 'xyz="1 0 nan"', SceneError, "initial_positions.node[1].xyz"),
        ('stiffness="10"', 'stiffness="ten"', InvalidValueError, "cable_class[0].stiffness"),
        ('stiffness="10"', "", UnknownKeyError, "cable_class[0]"),
        ('stiffness="10"', 'stiffness="-10"', InvalidValueError, "composition[1]"),
        ("tdf>", "urdf>", InvalidValueError, "triangle.tdf.xml"),
        ("</tdf>", "", SceneSyntaxError, "line"),
        ('<cable class="c1"', '<x:m xmlns:x="u"/><cable class="c1"', InvalidValueError, "triangle.tdf.xml"),
    ],
)
def test_wrong_documents_are_refused_by_their_place(
    old: str, new: str, error: type[SceneError], where: str, tmp_path: Path
) -> None:
    assert old in TEXT
    with pytest.raises(error) as caught:
        load(tmp_path, TEXT.replace(old, new))
    assert where in caught.value.where


def test_entities_that_grow_without_limit_are_refused(tmp_path: Path) -> None:
    rows = ['<!ENTITY a0 "ha">'] + [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12)]
    bomb = f"<!DOCTYPE tdf [{''.join(rows)}]><tdf>&a11;</tdf>"
    for text in (bomb, bomb.encode("utf-16"), '<!DOCTYPE tdf SYSTEM "file:///etc/hostname"><tdf/>'):
        with pytest.raises(SceneSyntaxError, match="document types and entities"):
            load(tmp_path, text)


@pytest.mark.parametrize(
    "text", ["<a>" * 100_000, *thorough("<tdf>" + "<a/>" * 600_000 + "</tdf>"), "", "<", "<tdf", "\x00"]
)
def test_deep_long_and_broken_files_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        load(tmp_path, text)


def test_a_declared_encoding_does_not_hide_a_document_type(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_bytes('<?xml version="1.0" encoding="utf-7"?><tdf>+ADwAIQ-DOCTYPE</tdf>'.encode("ascii"))
    try:
        root = read_xml(path, "XML")
    except SceneSyntaxError:
        return
    assert root.text == "+ADwAIQ-DOCTYPE"


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=30))
def test_hostile_names_become_names_of_a_scene(tmp_path: Path, word: str) -> None:
    from xml.sax.saxutils import quoteattr

    quoted = quoteattr(word + "x")
    text = TEXT.replace('node2="3"', f"node2={quoted}").replace('node1="3"', f"node1={quoted}")
    document = load(tmp_path, text.replace('id="3"', f"id={quoted}")).document
    scene = parse_scene(document)
    assert len(scene.nodes) == 3
    assert scene.members[next(iter(scene.members))].nodes[1] == list(scene.nodes)[2]
