"""Models of several files."""

from pathlib import Path

import pytest

from tensegrity_codegen.scene.formats.import_mjcf import WHAT, import_mjcf
from tensegrity_codegen.scene.formats.mjcf.include import read_model
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, SceneError
from tests.scene.formats.mjcf.models import ROBOT, load


def write(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        path = folder / name.replace("__", "/").replace("_xml", ".xml")
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(text, encoding="utf-8")
    return folder / "main.xml"


def test_included_files_stand_in_place_of_their_elements(tmp_path: Path) -> None:
    head, _, tail = ROBOT.partition(" <tendon>")
    tendons, _, actuators = tail.partition("</tendon>")
    main = head + '<include file="parts/tendons.xml"/>' + actuators
    path = write(
        tmp_path / "main", main_xml=main,
        parts__tendons_xml='<mujocoinclude><tendon><include file="deep.xml"/></tendon></mujocoinclude>',
        deep_xml=f"<mujoco>{tendons}</mujoco>",
    )  # fmt: skip
    own, whole = import_mjcf(path, name="robot"), load(tmp_path, ROBOT, name="robot")
    assert own.document == whole.document
    assert own.notes == whole.notes


@pytest.mark.parametrize(
    ("included", "words"),
    [
        ({}, "cannot be read"),
        ({"part_xml": '<mujoco><include file="part.xml"/></mujoco>'}, "included twice, or includes itself"),
        ({"part_xml": '<mujoco><include file="main.xml"/></mujoco>'}, "included twice, or includes itself"),
        ({"part_xml": "<robot/>"}, "no part of a model"),
        ({"part_xml": "<mujoco>"}, "not valid XML"),
    ],
)
def test_files_that_cannot_be_included_are_refused(
    included: dict[str, str], words: str, tmp_path: Path
) -> None:
    path = write(tmp_path, main_xml='<mujoco><include file="part.xml"/></mujoco>', **included)
    with pytest.raises(SceneError, match=words) as caught:
        read_model(path, WHAT)
    assert "main.xml" in caught.value.where or "part.xml" in caught.value.where
    with pytest.raises(InvalidValueError, match="not a model"):
        read_model(write(tmp_path, main_xml="<robot/>"), WHAT)


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ('name="rod1_out"', 'name="rod0_out"', "site"),
        ('<body name="rod1"', '<body name="rod0"', "body"),
        ('name="low_rod1"', 'name="low_rod0"', "geom"),
        ("<freejoint/>", '<freejoint name="j"/>', "freejoint"),
        ('name="b" class', 'name="a" class', "spatial"),
        ('<motor name="winch"', '<motor name="servo"', "motor"),
        ('<gyro name="g"', '<gyro name="p"', "gyro"),
    ],
)
def test_a_name_that_two_elements_of_a_kind_have_is_refused_as_in_mujoco(
    old: str, new: str, kind: str, tmp_path: Path
) -> None:
    assert old in ROBOT
    with pytest.raises(DuplicateNameError, match=f"two elements <{kind}> with one name") as caught:
        load(tmp_path, ROBOT.replace(old, new))
    assert f"model.xml: {kind} " in caught.value.where
    named = new.rpartition('name="')[2].partition('"')[0]
    assert caught.value.given == named


def test_elements_of_different_kinds_may_have_one_name(tmp_path: Path) -> None:
    text = ROBOT.replace('name="low_rod0"', 'name="rod0"').replace('name="rod0_out"', 'name="rod0"')
    assert load(tmp_path, text.replace('site="rod0_out"', 'site="rod0"')).document["bodies"]
