"""What readers choose of a picture: words, numbers, and what is refused."""

from typing import Any

import pytest

from tensegrity_codegen.report.pictures.view import PictureChoices, read_labels, read_size, read_view
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError


@pytest.mark.parametrize(
    ("given", "eye"),
    [
        ("iso", (-45.0, 35.264389682754654)),
        ("FRONT", (-90.0, 0.0)),
        ("-60,16", (-60.0, 16.0)),
        (" 30 , -90 ", (30.0, -90.0)),
        ((400, 10), (400.0, 10.0)),
    ],
)
def test_views_are_names_or_angles(given: Any, eye: tuple[float, float]) -> None:
    found = read_view(given)
    assert found is not None
    assert (found.azimuth, found.elevation) == pytest.approx(eye)
    assert read_view(None) is None


@pytest.mark.parametrize(
    "given", ["", "back", "1", "1,2,3", "1,91", "nan,3", "inf,0", "a,b", (1,), 5, "0,-90.1"]
)
def test_other_views_are_refused(given: Any) -> None:
    with pytest.raises(InvalidValueError, match="unknown view") as caught:
        read_view(given)
    assert caught.value.where == "view"
    assert "iso" in caught.value.allowed


@pytest.mark.parametrize(
    ("given", "size"), [("1200x900", (1200, 900)), (" 300 X 200 ", (300, 200)), ((640, 480.0), (640, 480))]
)
def test_sizes_are_pixels(given: Any, size: tuple[int, int]) -> None:
    assert read_size(given) == size
    assert read_size(None) is None


@pytest.mark.parametrize(
    "given",
    ["", "1200", "0x0", "1200x", "-3x400", "1e3x400", "99999999x400", (300,), (300.5, 300), 7, "400x10001"],
)
def test_other_sizes_are_refused(given: Any) -> None:
    with pytest.raises(InvalidValueError, match="not a size"):
        read_size(given)


@pytest.mark.parametrize(
    ("given", "labels"),
    [
        (True, ("nodes", "members")),
        (False, ()),
        ("none", ()),
        ("members", ("members",)),
        ("members, nodes", ("nodes", "members")),
        (["nodes"], ("nodes",)),
        ([], ()),
    ],
)
def test_labels_are_kinds_of_names(given: Any, labels: tuple[str, ...]) -> None:
    assert read_labels(given) == labels


@pytest.mark.parametrize("given", ["node", "none,nodes", "", ",", ["nodes", 3], 4])
def test_other_labels_are_refused(given: Any) -> None:
    with pytest.raises(InvalidValueError, match="unknown labels"):
        read_labels(given)


def test_other_colours_are_refused() -> None:
    with pytest.raises(TensegrityError, match="colour") as caught:
        PictureChoices(color="strain")
    assert "force_density" in caught.value.allowed
