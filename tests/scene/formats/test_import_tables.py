"""Import of CSV tables: the contract, what spreadsheets do to files, and bad cells named by place."""

import math
import time
from pathlib import Path

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.import_tables import MEMBER_COLUMNS, NODE_COLUMNS, import_tables
from tensegrity_codegen.scene.formats.imported import NameBook
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidNameError,
    InvalidValueError,
    NonFiniteError,
    SceneError,
    SceneSyntaxError,
    StructureError,
    UnknownKeyError,
    UnknownNameError,
)

NODES = "node,x,y,z,vx,vy,vz,mass,anchored\na,0,0,0,,,,,1\nb,1,0,0,0,0.5,0,0.2,\nc,0,1,0,,,,0.1,xz\n"
MEMBERS = (
    "member,kind,node_i,node_j,rest_length,spring_constant,axial_stiffness,damping,mass\n"
    "ab,bar,a,b,,,,,0.3\nbc,cable,b,c,1.2,100,,0.5,\nca,cable,c,a,,,2e3,,\n"
)


@pytest.fixture
def load(tmp_path):
    def load(nodes=NODES, members=MEMBERS, **options):
        paths = tmp_path / "frame.csv", tmp_path / "members.csv"
        for path, content in zip(paths, (nodes, members), strict=True):
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return import_tables(*paths, **options)

    return load


def test_the_contract(load):
    result = load(gravity=(0, 0, -9.81))
    assert result.document == {
        "name": "frame",
        "gravity": [0.0, 0.0, -9.81],
        "nodes": {
            "a": {"position": [0.0, 0.0, 0.0], "anchored": True},
            "b": {"position": [1.0, 0.0, 0.0], "mass": 0.2, "velocity": [0.0, 0.5, 0.0]},
            "c": {"position": [0.0, 1.0, 0.0], "mass": 0.1, "anchored": "xz"},
        },
        "members": {
            "ab": {"kind": "bar", "nodes": ["a", "b"], "mass": 0.3},
            "bc": {
                "kind": "cable",
                "nodes": ["b", "c"],
                "rest_length": 1.2,
                "spring_constant": 100.0,
                "damping": 0.5,
            },
            "ca": {"kind": "cable", "nodes": ["c", "a"], "axial_stiffness": 2000.0},
        },
    }
    structure, _ = assemble(parse_scene(result.document))
    assert structure.is_rigid.tolist() == [True, False, False]
    assert structure.rest_length.tolist() == [1.0, 1.2, 1.0]
    assert any(
        "members without a rest length, which is their present length: 2" in note for note in result.notes
    )
    assert any("bars without a stiffness, which are rigid: 1" in note for note in result.notes)


def test_import_is_deterministic(load):
    assert load() == load()


def test_only_the_needed_columns(load):
    result = load("node,x,y,z\na,0,0,0\nb,1,0,0\n", "kind,node_i,node_j\nbar,a,b\n")
    assert result.document["members"] == {"m1": {"kind": "bar", "nodes": ["a", "b"]}}
    assert any("names no members" in note for note in result.notes)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: "\n\n" + text.replace("\n", "\n\n,,,\n"),
        lambda text: text.replace("\n", ",\n"),
        lambda text: text.replace("\n", ",,\n"),
        lambda text: text.encode("utf-16"),
        lambda text: "\n".join(",".join(f'"{c}"' for c in line.split(",")) for line in text.splitlines()),
    ],
    ids=[
        "bom",
        "crlf",
        "cr",
        "spaces",
        "semicolon",
        "tab",
        "blank",
        "trailing",
        "trailing2",
        "utf16",
        "quoted",
    ],
)
def test_spreadsheet_habits_change_nothing(load, spoil):
    assert load(spoil(NODES), spoil(MEMBERS)) == load()


@pytest.mark.parametrize(
    ("cell", "held"),
    [("TRUE", True), ("yes", True), ("no", None), ("0", None), ("false", None), ("Z", "z"), ("xyz", "xyz")],
)
def test_anchored(load, cell, held):
    result = load(NODES.replace(",xz", f",{cell}"))
    assert result.document["nodes"]["c"].get("anchored") == held


def test_numeric_names_are_renamed_with_a_note(load):
    nodes = "node,x,y,z\n1,0,0,0\n2,1,0,0\nn1,0,1,0\n"
    members = "member,kind,node_i,node_j\n1,bar,1,2\nfor,bar,2,n1\n"
    result = load(nodes, members)
    assert list(result.document["nodes"]) == ["n1_2", "n2", "n1"]
    assert list(result.document["members"]) == ["m1", "m_for"]
    assert result.document["members"]["m1"]["nodes"] == ["n1_2", "n2"]
    assert any("'1' is n1_2" in note and "'2' is n2" in note for note in result.notes)
    parse_scene(result.document)


def test_scene_name(load, tmp_path):
    assert load(name="mine").document["name"] == "mine"
    with pytest.raises(InvalidNameError):
        load(name="a;b")
    load()
    (tmp_path / "frame.csv").rename(tmp_path / "3 frames.csv")
    result = import_tables(tmp_path / "3 frames.csv", tmp_path / "members.csv")
    assert result.document["name"] == "scene_3_frames"
    assert any("scene_3_frames" in note for note in result.notes)


def edit(text, old, new):
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("old", "new", "error", "place", "text"),
    [
        ("b,1,0,0", "b,1,zero,0", InvalidValueError, "frame.csv: line 3, column y", "zero"),
        ("b,1,0,0", "b,1,nan,0", NonFiniteError, "line 3, column y", "nan"),
        ("b,1,0,0", "b,-inf,0,0", NonFiniteError, "line 3, column x", "inf"),
        ("b,1,0,0", "b,1e999,0,0", NonFiniteError, "line 3, column x", "1e999"),
        ("b,1,0,0", "b,0x1,0,0", InvalidValueError, "line 3, column x", "0x1"),
        ("b,1,0,0", "b,1_0,0,0", InvalidValueError, "line 3, column x", "1_0"),
        ("b,1,0,0", "b,,0,0", InvalidValueError, "line 3, column x", "empty"),
        ("b,1,0,0", ",1,0,0", InvalidValueError, "line 3, column node", "empty"),
        ("b,1,0,0", 'b,"1,5",0,0', InvalidValueError, "line 3, column x", "decimal comma"),
        ("b,1,0,0", "b,1,5,0,0", SceneSyntaxError, "line 3", "too many cells"),
        ("b,1,0,0,", "b,1,0,", SceneSyntaxError, "line 3", "too few cells"),
        ("b,1,0,0", "a,1,0,0", DuplicateNameError, "line 3, column node", "line 2"),
        ("0.2", "0", InvalidValueError, "line 3, column mass", "greater than 0"),
        ("0.2", "-1", InvalidValueError, "line 3, column mass", "greater than 0"),
        (",xz", ",zx", InvalidValueError, "line 4, column anchored", "zx"),
        ("mass,", "weight,", UnknownKeyError, "line 1", "anchored"),
        (",vx,", ",x,", DuplicateNameError, "line 1", "twice"),
        ("node,x,", "node,vz,", DuplicateNameError, "line 1", "twice"),
        ("b,1,0,0", 'b,"1,0,0', SceneSyntaxError, "line", "CSV"),
    ],
)
def test_bad_node_tables(load, old, new, error, place, text):
    with pytest.raises(error) as caught:
        load(nodes=edit(NODES, old, new))
    assert place in caught.value.where
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "error", "place", "text"),
    [
        ("bc,cable,b,c", "bc,cable,b,q", UnknownNameError, "members.csv: line 3, column node_j", "'q'"),
        ("bc,cable,b,c", "bc,rope,b,c", InvalidValueError, "line 3, column kind", "bar, cable"),
        ("bc,cable,b,c", "bc,cable,b,b", StructureError, "line 3, column node_j", "itself"),
        ("bc,cable,b,c", "bc,cable,b,a", DuplicateNameError, "line 3, column node_j", "line 2"),
        ("bc,cable,b,c", "ab,cable,b,c", DuplicateNameError, "line 3, column member", "ab"),
        ("bc,cable,b,c", ",cable,b,c", InvalidValueError, "line 3, column member", "empty"),
        ("1.2,100", "1.2,", InvalidValueError, "line 3, column spring_constant", "without stiffness"),
        ("1.2,100,,", "1.2,100,5,", InvalidValueError, "line 3, column axial_stiffness", "two stiffnesses"),
        ("a,b,,,,,", "a,b,,10,20,,", InvalidValueError, "line 2, column axial_stiffness", "two stiffnesses"),
        ("1.2,100", "-1.2,100", InvalidValueError, "line 3, column rest_length", "greater than 0"),
        ("1.2,100", "1.2,0", InvalidValueError, "line 3, column spring_constant", "greater than 0"),
        (",0.5,", ",-0.5,", InvalidValueError, "line 3, column damping", "0 or more"),
        ("kind,", "sort,", UnknownKeyError, "line 1", "kind"),
        ("node_i,", "damping,", DuplicateNameError, "line 1", "twice"),
    ],
)
def test_bad_member_tables(load, old, new, error, place, text):
    with pytest.raises(error) as caught:
        load(members=edit(MEMBERS, old, new))
    assert place in caught.value.where
    assert text in str(caught.value)


@pytest.mark.parametrize("content", ["", " \n\n", b"\xff\xfe"])
def test_empty_files(load, content):
    with pytest.raises(SceneSyntaxError, match="empty"):
        load(nodes=content)


def test_header_without_rows_and_missing_column(load):
    with pytest.raises(StructureError, match="no members"):
        load(members="kind,node_i,node_j\n")
    with pytest.raises(InvalidValueError, match="lacks the column z"):
        load(nodes="node,x,y\na,0,0\n")


def test_unreadable_files(tmp_path, load):
    with pytest.raises(SceneError, match="cannot be read") as caught:
        import_tables(tmp_path / "none.csv", tmp_path / "none.csv")
    assert "none.csv" in caught.value.where
    with pytest.raises(SceneError, match="cannot be read"):
        import_tables(tmp_path, tmp_path)
    with pytest.raises(SceneSyntaxError, match="UTF-8"):
        load(nodes=b"node,x,y,z\n\xe4,0,0,0\n")


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("tower - final (2)", "tower_final_2"),
        ("example", "scene_example"),
        ("int", "scene_int"),
        ("__", "scene"),
    ],
)
def test_names_of_files_become_names_that_every_verb_takes(tmp_path, file, name):
    paths = tmp_path / f"{file}.csv", tmp_path / "m.csv"
    for path, content in zip(paths, (NODES, MEMBERS), strict=True):
        path.write_text(content, encoding="utf-8")
    assert import_tables(*paths).document["name"] == name


def test_renaming_thousands_of_nodes_to_one_stem_is_linear():
    book, start = NameBook("n"), time.process_time()
    names = [book.add(f"node{'-' * (k % 40)}+{k // 40 * ' '}") for k in range(40_000)]
    assert time.process_time() - start < 10
    assert len(set(names)) == len(names)
    assert names[:2] == ["node", "node_2"]


MORE_NODES = "node,x,y,z,anchored,fx,fy,fz\na,0,0,0,1,,,\nb,1,0,0,,0,-2.5,1\nc,0,1,0,1,,0,\n"
MORE = (
    "kind,node_i,node_j,spring_constant,axial_stiffness,prestress,density,radius,tension_only\n"
    "bar,a,b,,2e4,-12,1800,0.01,\ncable,b,c,100,,5,,0.001,no\ncable,c,a,100,,,,,yes\n"
)


def test_loads_prestress_density_radius_and_two_sided_cables(load):
    result = load(MORE_NODES, MORE)
    structure, _ = assemble(parse_scene(result.document))
    assert result.document["loads"] == [{"node": "b", "force": [0.0, -2.5, 1.0]}]
    assert structure.node_load[1].tolist() == [0.0, -2.5, 1.0]
    assert structure.static_tension() == pytest.approx([-12, 5, 0])
    assert structure.member_mass == pytest.approx([1800 * math.pi * 1e-4, 0, 0])
    assert structure.radius.tolist() == [0.01, 0.001, 0]
    assert structure.tension_only.tolist() == [False, False, True]
    assert any(
        "members without a rest length, which is their present length: 1" in note for note in result.notes
    )


@pytest.mark.parametrize(
    ("old", "new", "column", "text"),
    [
        ("2e4,-12", ",-12", "prestress", "rigid bar"),
        ("100,,5,,0.001,no", "100,,-5,,0.001,", "prestress", "push"),
        ("100,,5,,", "100,,5,700,", "density", "no density"),
        ("1800,0.01", "1800,", "density", "without a radius"),
        ("1800,0.01", "-1800,0.01", "density", "out of range"),
        ("0.001,no", "0,no", "radius", "out of range"),
        ("1800,0.01,", "1800,0.01,yes", "tension_only", "both signs"),
        ("0.001,no", "0.001,perhaps", "tension_only", "neither yes nor no"),
    ],
)
def test_bad_cells_of_the_further_columns(load, old, new, column, text):
    with pytest.raises(InvalidValueError, match=text) as caught:
        load(MORE_NODES, MORE.replace(old, new, 1))
    assert caught.value.where.endswith(f"column {column}")


def test_one_thing_is_stated_once(load):
    table = "kind,node_i,node_j,spring_constant,rest_length,prestress,mass,density,radius\nbar,a,b,100,{}\n"
    for cells, column in (("1.1,5,,,", "prestress"), (",,2,700,0.1", "density")):
        with pytest.raises(InvalidValueError, match="define the same value") as caught:
            load(MORE_NODES, table.format(cells))
        assert caught.value.where.endswith(f"column {column}")


def test_the_page_names_every_column():
    page = (Path(__file__).parents[3] / "docs" / "import.md").read_text(encoding="utf-8")
    for column in (*NODE_COLUMNS, *MEMBER_COLUMNS):
        assert f"`{column}`" in page


def test_columns_have_other_names_in_upper_and_lower_case(load):
    nodes = NODES.replace("node,x", "ID,X").replace("anchored", "Fixed")
    members = MEMBERS.replace("member,kind,node_i,node_j", "id,Type,from,to")
    assert load(nodes, members).document == load().document
    with pytest.raises(DuplicateNameError, match="a column appears twice"):
        load(nodes.replace("Y", "y").replace("ID,X,y", "id,node,y"))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_where_they_are_none_between_cells(load, separator):
    nodes, members = (text.replace(",", separator).replace(".", ",") for text in (NODES, MEMBERS))
    result = load(nodes, members)
    assert result.document == load().document
    assert sum("decimal commas" in note for note in result.notes) == 2
    # Beside a decimal point a comma may divide thousands.
    with pytest.raises(InvalidValueError, match="not a number") as caught:
        load(nodes.replace("0,2", "0.2"), members)
    assert caught.value.given == "0,5"
    assert "decimal comma as a point" in caught.value.hint


STEEL = (
    "member,class,kind,node_i,node_j,section,youngs_modulus,density,mass_per_length,radius,inner_radius,"
    "axial_stiffness,mass,least_tension,most_tension,yield_stress,buckling\n"
    "s1,strut 1,bar,a,b,CHS 60.3x3.2,2.1e11,7850,,,,,,,,3.55e8,1.5\n"
    "s2,strut 1,bar,b,c,tube 0.06 0.003,2.1e11,,,,,,2.5,,,,yes\n"
    "s3,,bar,a,c,,2.1e11,7850,,0.03,0.027,,,,,,no\n"
    "c1,rope,cable,c,d,rod 0.02,1.6e11,,2.4662,,,,,1000,2e5,7.5e8,\n"
    "c2,rope,cable,d,a,,,,,,,1e6,0.7,,,,\n"
)
FOUR = "node,x,y,z,anchored\na,0,0,0,1\nb,1,0,0,1\nc,0,1,0,1\nd,0,1,2,\n"


def test_sections_with_decimal_commas_are_those_with_points(load):
    comma = STEEL.replace(",", ";").replace(".", ",")
    assert load(FOUR, comma).document["members"] == load(FOUR, STEEL).document["members"]


def test_sections_classes_masses_of_cables_and_limits(load):
    document = load(FOUR, STEEL).document
    assert document["classes"] == {"strut_1": {"kind": "bar"}, "rope": {"kind": "cable"}}
    structure, _ = assemble(parse_scene(document))
    assert structure.member_class == ("strut_1", "strut_1", "", "rope", "rope")
    tube, rod = math.pi * (0.03**2 - 0.027**2), math.pi * 1e-4
    chs = math.pi * (0.03015**2 - 0.02695**2)
    assert structure.axial_stiffness == pytest.approx(
        [2.1e11 * chs, 2.1e11 * tube, 2.1e11 * tube, 1.6e11 * rod, 1e6]
    )
    assert structure.member_mass == pytest.approx([7850 * chs, 2.5, 7850 * tube, 2.4662 * 2, 0.7])
    assert structure.inner_radius == pytest.approx([0.02695, 0.027, 0.027, 0, 0])
    assert structure.limits.yield_stress.tolist() == [3.55e8, math.inf, math.inf, 7.5e8, math.inf]
    assert structure.limits.buckling.tolist()[:2] == [1.5, 1.0]
    assert structure.limits.buckling[2] < 0
    assert (structure.limits.least_tension[3], structure.limits.most_tension[3]) == (1000, 2e5)


@pytest.mark.parametrize(
    ("old", "new", "column", "text"),
    [
        ("c1,rope", "c1,strut 1", "class", "bars and cables"),
        ("tube 0.06 0.003", "tube 0.06", "section", "not numbers"),
        (",,,,,,2.5,,", ",,,0.03,,,2.5,,", "radius", "define the same value"),
        ("rod 0.02,", ",", "youngs_modulus", "without a section"),
        ("2.1e11,,,,,,2.5", "2.1e11,,3,,,,", "mass_per_length", "a bar has no mass_per_length"),
    ],
)
def test_bad_cells_of_sections_and_classes(load, old, new, column, text):
    with pytest.raises(InvalidValueError, match=text) as caught:
        load(FOUR, STEEL.replace(old, new, 1))
    assert caught.value.where.endswith(f"column {column}")


def test_tables_in_the_other_order_are_recognised(tmp_path):
    for name, text in (("n.csv", FOUR), ("m.csv", STEEL)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    plain = import_tables(tmp_path / "n.csv", tmp_path / "m.csv")
    swapped = import_tables(tmp_path / "m.csv", tmp_path / "n.csv")
    assert swapped.document == plain.document
    (note,) = set(swapped.notes) - set(plain.notes)
    assert note == f"the tables were given in the other order: {tmp_path / 'n.csv'} has the nodes"
    with pytest.raises(UnknownKeyError, match="unknown column"):
        import_tables(tmp_path / "m.csv", tmp_path / "m.csv")
