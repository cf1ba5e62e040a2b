"""Models of several files."""

from pathlib import Path

import pytest

from tensegrity_codegen.scene.formats.import_mjcf import WHAT, import_mjcf
from tensegrity_codegen.scene.formats.mjcf.include import read_model
from tensegrity_codegen.system.errors import InvalidValueError, SceneError
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
