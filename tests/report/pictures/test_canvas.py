import tomllib
from pathlib import Path

import pytest

from tensegrity_codegen.report.pictures.canvas import check_suffix, new_figure, save_figure
from tensegrity_codegen.system.errors import InvalidValueError, MissingExtraError, OutputError
from tensegrity_codegen.system.extras import PACKAGES, import_extra
from tests.report.samples import png_size


def test_suffix_in_any_case_is_returned_in_lower_case():
    assert check_suffix(Path("a/b.PNG"), (".png", ".svg")) == ".png"


@pytest.mark.parametrize("name", ["picture.bmp", "picture", ".png"])
def test_other_suffix_lists_the_allowed_ones(name):
    with pytest.raises(InvalidValueError) as caught:
        check_suffix(Path("folder") / name, (".png", ".svg"))
    assert caught.value.allowed == "a name that ends in .png, .svg"
    assert caught.value.given == name
    assert "folder" in caught.value.where


def test_missing_package_names_the_extra():
    with pytest.raises(MissingExtraError) as caught:
        import_extra("package_that_nobody_has")
    assert caught.value.hint.startswith("pip install '.[plot]' in a checkout of tensegrity_codegen")
    assert caught.value.hint.endswith("elsewhere: pip install matplotlib pillow")
    assert "package_that_nobody_has" in caught.value.problem


def test_the_packages_of_extras_are_those_of_the_project():
    text = (Path(__file__).resolve().parents[3] / "pyproject.toml").read_text(encoding="utf-8")
    stated = tomllib.loads(text)["project"]["optional-dependencies"]
    for extra, packages in PACKAGES.items():
        assert list(packages) == [line.partition(">")[0] for line in stated[extra]]


def test_figure_is_saved_at_its_own_size_as_each_kind(tmp_path):
    figure = new_figure(3.0, 2.0, dpi=100)
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for kind, start in starts.items():
        save_figure(figure, tmp_path / f"a.{kind}", overwrite=False)
        assert (tmp_path / f"a.{kind}").read_bytes().startswith(start)
    assert png_size(tmp_path / "a.png") == (300, 200)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.pdf", "a.png", "a.svg"]


def test_the_same_picture_has_the_same_bytes(tmp_path):
    pictures = []
    for name in ("a.svg", "b.svg"):
        figure = new_figure(3.0, 2.0)
        figure.add_subplot().plot([0.0, 1.0], label="line")
        save_figure(figure, tmp_path / name, overwrite=False)
        pictures.append((tmp_path / name).read_bytes())
    assert pictures[0] == pictures[1]
    assert b"clip-path" in pictures[0]  # whose name matplotlib draws at random without a salt


def test_failing_to_save_keeps_what_was_there(tmp_path):
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OutputError):
        save_figure(new_figure(1.0, 1.0), tmp_path / "folder.png", overwrite=False)
    assert [path.name for path in tmp_path.iterdir()] == ["folder.png"]
    assert (tmp_path / "folder.png").is_dir()
