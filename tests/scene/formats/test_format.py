from pathlib import Path

import pytest

from tensegrity_codegen.scene.formats.format import find_format, find_formats, read_files
from tensegrity_codegen.system.errors import InvalidValueError, SceneError

ROOT = Path(__file__).resolve().parents[3]


def test_every_format_has_a_place_of_its_own_and_a_section_in_the_documentation() -> None:
    formats = find_formats()
    assert len({item.order for item in formats}) == len(formats)
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    assert [item.title for item in formats if f"import {item.example} " not in page] == []


SAMPLES = {
    "scene.json": '{"format": "tensegrity_codegen scene 1"}',
    "network.json": '{"dtype": "compas.datastructures/Network", "data": {}}',
    "structure.json": '{"nodes": {}}',
    "structure.tdf.xml": "<tdf/>",
    "model.xml": "<mujoco/>",
}


def test_every_format_finds_its_own_files(tmp_path: Path) -> None:
    for item in find_formats():
        paths = [tmp_path / name for name in item.sources]
        for path in paths:
            path.write_text(SAMPLES.get(path.name, ""), encoding="utf-8")
        assert find_format(paths) is item


def test_files_that_several_formats_could_have_are_distinguished_by_their_content(tmp_path: Path) -> None:
    for text in ("<html/>", "no xml", "<a"):
        path = tmp_path / "other.xml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InvalidValueError, match="no known format"):
            find_format([path])
    with pytest.raises(SceneError, match="cannot be read"):
        find_format([tmp_path / "missing.xml"])


def test_files_of_no_format_are_refused_with_the_formats() -> None:
    with pytest.raises(InvalidValueError) as caught:
        find_format([Path("a.step")])
    assert all(item.example in caught.value.allowed for item in find_formats())


def test_an_option_of_another_format_is_refused() -> None:
    with pytest.raises(InvalidValueError) as caught:
        read_files([Path("nodes.csv"), Path("members.csv")], pretension_scale=2.0)
    assert caught.value.where == "pretension_scale"
    assert "NTRT" in caught.value.allowed
