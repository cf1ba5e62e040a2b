"""What a structure says of itself: free coordinates and pairs of bars, counted and listed."""

import numpy as np
import pytest

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.random_structures import make_structure
from tests.runtime.build import bar
from tests.runtime.build import make_structure as node_structure

WISHES = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")


def random_structure(seed: int) -> Structure:
    return make_structure(np.random.default_rng(seed), 12, (0, 1, 2), dict.fromkeys(WISHES, True))


def many_bars(count: int) -> Structure:
    """Return `count` parallel bars with a radius, which share no node, each with its first node anchored."""
    position = np.zeros((2 * count, 3))
    position[:, 0] = np.repeat(np.arange(count), 2)
    position[1::2, 2] = 1.0
    members = [bar(2 * k, 2 * k + 1, 1.0, 1.0, mass=1.0) for k in range(count)]
    forest = node_structure(position, members, anchored=dict.fromkeys(range(0, 2 * count, 2), "xyz"))
    names = tuple(f"m{k}" for k in range(count))
    return forest.with_changes(name="forest", member_name=names, radius=np.full(count, 0.1))


@pytest.mark.parametrize("seed", range(5))
def test_coordinates_are_the_axes_that_are_not_held_node_by_node(seed: int) -> None:
    rng = np.random.default_rng(seed)
    structure = random_structure(seed).with_changes(axes=((0, 1, 2), (0, 2), (1,))[seed % 3])
    structure = structure.with_changes(node_anchored=rng.random((structure.n_nodes, 3)) < 0.3)
    expected = [
        [node, axis]
        for node in range(structure.n_nodes)
        for axis in structure.axes
        if not structure.node_anchored[node, axis]
    ]
    assert structure.coordinate_node_axis.tolist() == expected
    assert structure.n_coordinates == len(expected)
    with pytest.raises(ValueError, match="read-only"):
        structure.coordinate_node_axis[:] = 0


def test_a_changed_copy_has_coordinates_of_its_own() -> None:
    structure = many_bars(2)
    assert structure.n_coordinates == 6
    assert structure.with_changes(node_anchored=np.zeros((4, 3), dtype=bool)).n_coordinates == 12


@pytest.mark.parametrize("seed", range(5))
def test_pairs_of_bars_are_counted_as_they_are_listed(seed: int) -> None:
    structure = random_structure(seed)
    bars = np.random.default_rng(seed).random(structure.n_members) < 0.6
    structure = structure.with_changes(is_bar=bars, radius=np.where(np.arange(bars.size) % 4, 0.01, 0.0))
    assert structure.n_bar_pairs == len(structure.bar_pairs)
    assert structure.with_changes(interference=((0, 1),)).n_bar_pairs == 1


def test_too_many_pairs_of_bars_are_refused_before_they_are_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    structure = many_bars(40)
    assert structure.n_bar_pairs == 780

    def refuse(_: Structure) -> None:
        raise AssertionError("listed")

    model = build_model(structure, ModelRequest(()))
    monkeypatch.setattr(Structure, "bar_pairs", property(refuse))
    assert prune(model, ("member_tension",))
    with pytest.raises(FormulationError, match="too many pairs of bars"):
        prune(model, ("bar_distance",))
