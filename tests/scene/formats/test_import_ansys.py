"""Texts of TsgFEM for ANSYS: a small structure with all that is read, and wrong lines named by number."""

import math
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.formats.imported import ImportResult
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, StructureError, UnknownNameError

TEXT = """!a strut and two stays
finish
/clear
/title,a = b
/prep7
 et,1,link180
 es=7.6e10
 eg=2.06d11
 mp,ex,1,es  !strings
 mp,prxy,1,0.3
 mp,dens,1,1000
 mp,ex,2,eg
 mp,dens,2,7870
K,1,0.0,0.0,0.0  !foot
K,2,0.0,0.0,2.0
K,3,1.5,0.0,
L,   1,   2
L,   2,   3
*dim,area,,2
area(1)=4e-4
area(2)=1e-6
sectype,1,link
secdata,area(1)
seccontrol,,0
sectype,2,link
secdata,area(2)
seccontrol,,1
lsel,s,,,1
latt,2,,1,,,,1
lsel,s,,,2
latt,1,,1,,,,2
*dim,prestress,,2
 prestress(1)=-1.5e5
 prestress(2)=2e7
 LSEL,ALL
LMESH,ALL
/SOLU
ANTYPE,0
DK,1,ALL
DK,3,UX
DK,3,UZ
acel,0,0,9.81
FK,2,X,10
fk,2,FZ,-20
frobnicate,1
*DO,J,1,2
 INISTATE,DEFINE,J,,,,PRESTRESS(J)
*ENDDO
SOLVE
"""


def load(tmp_path: Path, text: str | bytes, **options: Any) -> ImportResult:
    path = tmp_path / "mast_ansys.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return read_files([path], **options)


@pytest.mark.parametrize("line", [",1,2", " , ", ",", ",,,,"])
def test_a_line_that_begins_with_a_comma_is_no_command(line: str, tmp_path: Path) -> None:
    result = load(tmp_path, f"{line}\n{TEXT}")
    assert result.document == load(tmp_path, TEXT).document
    assert any("commands that are not read: , (1)" in note for note in result.notes)


@pytest.mark.parametrize("ending", ["", "!Unit:m\xa3\xacN"])
def test_all_that_is_read_becomes_a_scene(ending: str, tmp_path: Path) -> None:
    result = load(tmp_path, (TEXT + ending).encode("latin-1"))  # some versions write texts that are not UTF-8
    structure, _ = assemble(parse_scene(result.document))
    assert structure.node_name == ("n1", "n2", "n3")
    assert structure.node_position.tolist() == [[0, 0, 0], [0, 0, 2], [1.5, 0, 0]]
    assert structure.is_bar.tolist() == [True, False]
    assert structure.axial_stiffness.tolist() == pytest.approx([2.06e11 * 4e-4, 7.6e10 * 1e-6])
    assert structure.static_tension().tolist() == pytest.approx([-60.0, 20.0], rel=1e-6)
    assert structure.member_mass.tolist() == pytest.approx([7870 * 4e-4 * 2, 0.0])
    assert structure.radius[0] == pytest.approx(math.sqrt(4e-4 / math.pi))
    assert structure.node_mass.tolist() == pytest.approx([0, 1000 * 1e-6 * 2.5 / 2, 1000 * 1e-6 * 2.5 / 2])
    assert structure.node_anchored.tolist() == [[True] * 3, [False] * 3, [True, False, True]]
    assert structure.gravity.tolist() == [0, 0, -9.81]
    assert structure.node_load.tolist() == [[0, 0, 0], [10, 0, -20], [0, 0, 0]]
    assert any("frobnicate (1)" in note for note in result.notes)
    assert any("cables have no mass here: 0.0025 kg" in note for note in result.notes)


@pytest.mark.parametrize(
    ("old", "new", "error", "line"),
    [
        ("K,2,0.0,0.0,2.0", "K,2,0.0,zero,2.0", UnknownNameError, 15),
        ("K,2,0.0,0.0,2.0", "K,1,0.0,0.0,2.0", InvalidValueError, 15),
        ("K,2,0.0,0.0,2.0", "K,2,0.0,1+1,2.0", InvalidValueError, 15),
        ("K,2,0.0,0.0,2.0", "K,2.5,0.0,0.0,2.0", InvalidValueError, 15),
        ("L,   2,   3", "L,   2,   9", UnknownNameError, 18),
        ("L,   2,   3", "L,   2,   2", StructureError, 18),
        ("area(2)=1e-6", "area(2)=nan", UnknownNameError, 21),
        ("area(2)=1e-6", "area(2)=-1e-6", InvalidValueError, 18),
        ("secdata,area(2)", "secdata,area(7)", UnknownNameError, 26),
        ("lsel,s,,,2", "lsel,s,,,7", InvalidValueError, 31),
        ("latt,1,,1,,,,2", "latt,3,,1,,,,2", InvalidValueError, 18),
        ("DK,3,UX", "DK,3,ROTX", InvalidValueError, 40),
        ("FK,2,X,10", "FK,2,MX,10", InvalidValueError, 43),
        (" es=7.6e10", " es=1e400", InvalidValueError, 7),
        (" es=7.6e10", "secdata,1", InvalidValueError, 7),
    ],
)
def test_a_wrong_line_is_named(
    old: str, new: str, error: type[SceneError], line: int, tmp_path: Path
) -> None:
    assert old in TEXT
    with pytest.raises(error) as caught:
        load(tmp_path, TEXT.replace(old, new, 1))
    assert f"mast_ansys.txt: line {line}" in caught.value.where


def test_an_unknown_keypoint_of_an_anchor_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown keypoint"):
        load(tmp_path, TEXT.replace("DK,3,UX", "DK,8,UX"))


@pytest.mark.parametrize("text", ["nothing\n", "K,1,0,0,0\n", "\x00\xff", "=" * 1000, "(" * 10000])
def test_other_texts_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        load(tmp_path, text.encode("latin-1"))


def test_an_input_of_abaqus_is_refused_as_one(tmp_path: Path) -> None:
    text = "** truss\n*Heading\n two bars\n*NODE\n1, 0., 0.\n*ELEMENT, TYPE=T2D2\n1, 1, 2\n"
    (tmp_path / "truss.inp").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidValueError, match="input of Abaqus") as caught:
        read_files([tmp_path / "truss.inp"])
    assert caught.value.where.endswith("truss.inp: line 2")
    assert "nodes.csv and members.csv" in caught.value.hint
