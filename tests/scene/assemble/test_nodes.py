import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.nodes import spread_vectors
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.scene.samples import WHERE, build, changed

PLACES = [("nodes", "a", "position"), ("nodes", "b", "position")]


def test_vectors_are_spread_over_the_modelled_axes():
    table = spread_vectors([(1.0, 2.0, 3.0), None], (0, 1, 2), PLACES, "")
    assert table.tolist() == [[1, 2, 3], [0, 0, 0]]
    table = spread_vectors([(1.0, 2.0), (3.0, 4.0, 5.0)], (0, 2), PLACES, "")
    assert table.tolist() == [[1, 0, 2], [3, 4, 5]]
    assert spread_vectors([], (0,), [], "").shape == (0, 3)


@pytest.mark.parametrize(("axes", "allowed"), [((0, 1, 2), "3 numbers"), ((0, 2), "3 or 2 numbers")])
def test_a_vector_of_the_wrong_size(axes, allowed):
    with pytest.raises(InvalidValueError) as caught:
        spread_vectors([(1.0, 2.0, 3.0), (1.0,)], axes, PLACES, WHERE)
    assert caught.value.where == f"{WHERE}: nodes.b.position"
    assert caught.value.given == [1.0]
    assert caught.value.allowed == allowed


def test_anchors_and_masses():
    structure, _ = build(changed("loads", to=[]))
    assert structure.node_anchored.tolist() == [[True] * 3, [True, False, True], [False] * 3]
    assert structure.node_mass.tolist() == [0, 0, 0.5]


def test_loads_on_one_node_add_up():
    loads = [{"node": "c", "force": [1, 0, 0]}, {"node": "c", "force": [1, 2, 0]}]
    structure, _ = build(changed("loads", to=loads))
    np.testing.assert_array_equal(structure.node_load, [[0, 0, 0], [0, 0, 0], [2, 2, 0]])


def test_a_load_on_an_unknown_node():
    with pytest.raises(UnknownNameError) as caught:
        build(changed("loads", 0, "node", to="cc"))
    assert caught.value.where == f"{WHERE}: loads[0].node"
    assert caught.value.given == "cc"
    assert "'c'" in caught.value.hint


def test_anchored_on_an_axis_that_is_not_modelled():
    document = changed("axes", to="xz")
    document["nodes"]["b"]["anchored"] = "yz"
    with pytest.raises(InvalidValueError) as caught:
        build(document)
    assert caught.value.where == f"{WHERE}: nodes.b.anchored"
    assert caught.value.given == "yz"
    assert "'xz'" in caught.value.allowed
