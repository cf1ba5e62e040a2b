import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.targets import normalise
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, UnknownNameError
from tests.scene.samples import ARCH, REMOVE, WHERE, build, changed


def parameters(**choice):
    return build(changed("parameters", to=choice))[1].parameters


@pytest.mark.parametrize(
    ("chosen", "indices"),
    [
        ("all", (0, 1, 2)),
        (["ab"], (2,)),
        (["ab", "ac"], (0, 2)),
        (["strings"], (1, 2)),
        (["string", "ab", "strings"], (1, 2)),
        (["strut"], (0,)),
    ],
)
def test_members_by_name_group_and_class(chosen, indices):
    assert parameters(rest_length=chosen) == {"rest_length": indices}


def test_all_takes_what_the_parameter_means_something_for():
    assert parameters(spring_constant="all", axial_stiffness="all", damping="all") == {
        "spring_constant": (1, 2),
        "axial_stiffness": (0,),
        "damping": (0, 1, 2),
    }
    assert parameters(node_mass="all", node_load="all", anchor_position="all", gravity="all") == {
        "node_mass": (1, 2),
        "node_load": (1, 2),
        "anchor_position": (0, 1),
        "gravity": (),
    }


def test_default_is_no_parameters():
    assert build(changed("name", to="arch"))[1].parameters == {}


@pytest.mark.parametrize(
    ("key", "given", "hint"),
    [
        ("rest_length", "abb", "'ab'"),
        ("rest_length", "all", "not in a list"),
        ("damping", "strng", "'string'"),
        ("node_mass", "ab", "'a'"),
        ("anchor_position", "q", "'a'"),
    ],
)
def test_parameters_of_unknown_things(key, given, hint):
    with pytest.raises(UnknownNameError) as caught:
        parameters(**{key: [given]})
    assert caught.value.where == f"{WHERE}: parameters.{key}"
    assert caught.value.given == given
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("key", "names", "wrong"),
    [
        ("spring_constant", ["ab", "ac"], "ac"),
        ("axial_stiffness", ["string"], "bc"),
        ("anchor_position", ["a", "c"], "c"),
    ],
)
def test_parameters_without_effect(key, names, wrong):
    with pytest.raises(InvalidValueError) as caught:
        parameters(**{key: names})
    assert caught.value.where == f"{WHERE}: parameters.{key}"
    assert caught.value.given == wrong
    assert wrong in caught.value.problem


def test_parameters_of_rigid_bars():
    document = changed("classes", "strut", "axial_stiffness", to=REMOVE)
    document["parameters"] = {"rest_length": "all"}
    assert build(document)[1].parameters == {"rest_length": (1, 2)}
    for key in ("rest_length", "damping"):
        document["parameters"] = {key: ["ac"]}
        with pytest.raises(InvalidValueError, match="rigid"):
            build(document)
    document["parameters"] = {"axial_stiffness": "all"}
    with pytest.raises(InvalidValueError, match="selection is empty"):
        build(document)


@pytest.mark.parametrize(
    ("path", "value", "place"),
    [
        (("groups", "string"), ["ab"], "groups.string"),
        (("groups", "ab"), ["ab"], "groups.ab"),
        (("classes", "ab"), {"kind": "bar"}, "classes.ab"),
    ],
)
def test_one_name_for_two_things_is_ambiguous(path, value, place):
    with pytest.raises(DuplicateNameError) as caught:
        build(changed(*path, to=value))
    assert caught.value.where == f"{WHERE}: {place}"
    assert caught.value.given == path[-1]


def test_a_group_with_an_unknown_member():
    with pytest.raises(UnknownNameError) as caught:
        build(changed("groups", "strings", to=["ab", "cb"]))
    assert caught.value.where == f"{WHERE}: groups.strings"
    assert caught.value.given == "cb"
    assert "'bc'" in caught.value.hint


def test_inputs():
    structure, _ = build(changed("name", to="arch"))
    stretch, push = structure.inputs
    assert (stretch.name, stretch.kind, stretch.targets) == ("u1", "rest_length", (1, 2))
    assert (push.name, push.kind, push.targets) == ("push", "force", (2,))
    np.testing.assert_allclose(push.direction, [0, 0.6, 0.8], rtol=1e-15)


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_directions_of_any_size_are_normalised(size):
    structure, _ = build(changed("inputs", 1, "direction", to=[0.0, 3 * size, 4 * size]))
    np.testing.assert_allclose(structure.inputs[1].direction, [0, 0.6, 0.8], rtol=1e-15)


@pytest.mark.parametrize(
    ("path", "value", "error", "place"),
    [
        (("inputs", 0, "members"), ["cb"], UnknownNameError, "inputs[0].members"),
        (("inputs", 1, "nodes"), ["ab"], UnknownNameError, "inputs[1].nodes"),
        (("inputs", 1, "name"), "u1", DuplicateNameError, "inputs[1].name"),
        (("inputs", 1, "direction"), [0, 0, 0], InvalidValueError, "inputs[1].direction"),
        (("inputs", 1, "direction"), [0, 1], InvalidValueError, "inputs[1].direction"),
    ],
)
def test_inputs_that_are_refused(path, value, error, place):
    with pytest.raises(error) as caught:
        build(changed(*path, to=value))
    assert caught.value.where == f"{WHERE}: {place}"


def test_inputs_that_pull_on_nothing_or_on_a_rigid_bar():
    document = changed("classes", "spare", to={"kind": "bar"})
    document["inputs"][0]["members"] = ["spare"]
    with pytest.raises(InvalidValueError, match="selection is empty"):
        build(document)
    document["members"]["ac"]["class"] = "spare"
    with pytest.raises(InvalidValueError, match="rigid"):
        build(document)


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_a_direction_of_any_size_is_normalised(size):
    assert normalise(size * np.array([3.0, 0.0, -4.0]), (), WHERE) == pytest.approx(
        (0.6, 0.0, -0.8), rel=1e-15
    )


def test_a_direction_of_length_zero_is_refused():
    with pytest.raises(InvalidValueError, match="length zero"):
        normalise(np.zeros(3), (0, 0, 0), WHERE)


PAIR = {"name": "u1", "kind": "rest_length", "members": ["bc", "ab"], "gain": [0.5, 2.0]}


def heated(**changes):
    """Return the arch with an input of temperature on its strut and strings."""
    document = changed(
        "inputs", to=[{"kind": "temperature", "name": "sun", "members": ["ac", "ab"], **changes}]
    )
    for name, alpha in (("strut", 1.2e-5), ("string", -1e-4)):
        document["classes"][name]["thermal_expansion"] = alpha
    return document


def test_gains_of_temperature_are_rest_lengths_times_expansion():
    structure, _ = build(heated())
    rest = structure.rest_length
    assert structure.thermal_expansion.tolist() == [1.2e-5, -1e-4, -1e-4]
    assert structure.inputs[0].rest_length_gain == {0: rest[0] * 1.2e-5, 2: 1.5 * -1e-4}
    assert structure.inputs[0].kind == "temperature"


@pytest.mark.parametrize("inputs", [heated(), changed("inputs", 0, to=PAIR)])
def test_gains_are_the_same_after_writing_and_reading(inputs):
    structure, request = build(inputs)
    again, _ = build(describe_structure(structure, request))
    assert again.inputs[0] == structure.inputs[0]
    assert again.inputs[0].gain
    np.testing.assert_array_equal(again.member_value("rest_length"), structure.member_value("rest_length"))


def test_gains_of_one_are_none():
    assert build(changed("inputs", 0, "gain", to=[1]))[0].inputs == build(ARCH)[0].inputs


def test_a_gain_of_one_name_may_stand_alone():
    alone, listed = (build(changed("inputs", 0, "gain", to=gain))[0].inputs for gain in (2.5, [2.5]))
    assert alone == listed
    assert alone != build(ARCH)[0].inputs


@pytest.mark.parametrize(
    ("document", "key", "problem"),
    [
        (heated(members=["bc", "string"]), "inputs[0].members", "without thermal_expansion"),
        (heated(), "inputs[0].members", "a rigid bar has no rest length"),
        (changed("inputs", 0, "gain", to=[1.0, 2.0]), "inputs[0].gain", "not one gain for each name"),
    ],
)
def test_gains_that_are_refused(document, key, problem):
    if "thermal" in problem:
        del document["classes"]["string"]["thermal_expansion"]
    if "rigid" in problem:
        del document["classes"]["strut"]["axial_stiffness"]
    with pytest.raises(InvalidValueError) as caught:
        build(document)
    assert caught.value.where == f"{WHERE}: {key}"
    assert problem in caught.value.problem
