"""The options of a formulation, in a scene file."""

import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, UnknownKeyError, UnknownNameError
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.request import complete_options
from tests.scene.samples import ARCH, WHERE, build, changed

ASKED = {"pairs": "full", "order": "uvec123", "basis": "orthonormal"}


def asking(options: object, formulation: str = "node_distance") -> dict:
    return changed("model", to={"formulation": formulation, "options": options})


def test_options_reach_the_request_and_come_back_in_the_document() -> None:
    structure, request = build(asking(ASKED))
    assert dict(request.options) == ASKED
    again = assemble(parse_scene(describe_structure(structure, request), WHERE))[1]
    assert again == request
    assert dict(build(ARCH)[1].options) == {}


def test_omitted_options_are_the_first_words() -> None:
    assert complete_options("node_distance", {"order": "uvec123"}) == {
        "pairs": "connected",
        "order": "uvec123",
        "basis": "cycles",
    }
    assert complete_options("node_position", {}) == {}
    for options in (item.options for item in FORMULATIONS.values()):
        assert all(len(set(words)) == len(words) >= 2 for words in options.values())


@pytest.mark.parametrize(
    ("options", "formulation", "error", "where", "words"),
    [
        ({"pair": "full"}, "node_distance", UnknownKeyError, "model.options", "did you mean 'pairs'?"),
        ({"pairs": "all"}, "node_distance", UnknownNameError, "model.options.pairs", "connected, full"),
        ({"pairs": "full"}, "node_position", UnknownKeyError, "model.options", "no options"),
        ({"pairs": 3}, "node_distance", InvalidValueError, "model.options.pairs", "text in quotes"),
        ("full", "node_distance", InvalidValueError, "model.options", "table"),
    ],
)
def test_wrong_options_are_refused(
    options: object, formulation: str, error: type[SceneError], where: str, words: str
) -> None:
    with pytest.raises(error) as caught:
        build(asking(options, formulation))
    assert caught.value.where == f"{WHERE}: {where}"
    assert words in str(caught.value)


@pytest.mark.parametrize("width", [0, 2, 8, 64])
def test_a_batch_width_reaches_the_request_and_comes_back(width: int) -> None:
    structure, request = build(changed("model", to={"batch_width": width}))
    assert request.batch_width == width
    again = assemble(parse_scene(describe_structure(structure, request), WHERE))[1]
    assert again == request
    assert build(ARCH)[1].batch_width == 0


def test_an_interface_reaches_the_request_and_comes_back() -> None:
    structure, request = build(changed("model", to={"interfaces": ["casadi"]}))
    assert request.interfaces == ("casadi",)
    assert assemble(parse_scene(describe_structure(structure, request), WHERE))[1] == request
    assert build(ARCH)[1].interfaces == ()
    with pytest.raises(UnknownNameError) as caught:
        build(changed("model", to={"interfaces": ["casady"]}))
    assert caught.value.where == f"{WHERE}: model.interfaces[0]"
    assert "casadi" in caught.value.hint


@pytest.mark.parametrize("width", [1, 3, 12, 128, -8, 8.0, "8", True])
def test_a_batch_width_that_is_no_power_of_two_is_refused(width: object) -> None:
    with pytest.raises(InvalidValueError) as caught:
        build(changed("model", to={"batch_width": width}))
    assert caught.value.where == f"{WHERE}: model.batch_width"
    assert "a power of two from 2 to 64" in caught.value.allowed
