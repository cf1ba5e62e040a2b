"""Warnings of a start without prestress, of bars that cross or buckle, of values unlike their neighbours."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.plausible_start import warn_of_crossing, warn_of_outliers, warn_of_slack
from tensegrity_codegen.scene.checks.scene_warnings import find_scene_warnings, find_warnings
from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, cable, make_structure
from tests.scene.checks.test_plausible import build

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def crossed(height: float, radius: float = 0.0, axes: str = "xyz") -> Structure:
    """Two bars of 1.4 m that cross `height` above each other, and four cables."""
    place = np.array(SQUARE, dtype=float)
    place[[1, 3], 2] = height
    members = [bar(0, 2, 1.5), bar(1, 3, 1.5), *(cable(k, (k + 1) % 4, 0.9) for k in range(4))]
    structure = make_structure(place.tolist(), members, anchored={0: axes}, axes=axes)
    return structure.with_changes(radius=np.where(structure.is_bar, radius, 0.0))


@pytest.mark.parametrize(("rest", "which"), [(1.0, "all start at their rest length"), (1.1, "4 are slack")])
def test_cables_without_any_tension(rest: float, which: str) -> None:
    structure = crossed(0.0, axes="xy")
    (text,) = warn_of_slack(structure.with_changes(rest_length=np.where(structure.is_bar, 1.5, rest)))
    assert which in text
    assert "--prestress" in text
    assert warn_of_slack(structure) == []


@pytest.mark.parametrize(
    ("height", "radius", "crosses"),
    [(0.0, 0.0, True), (0.01, 0.0, False), (0.01, 0.004, False), (0.01, 0.006, True)],
)
def test_bars_that_cross(height: float, radius: float, crosses: bool) -> None:
    found = warn_of_crossing(crossed(height, radius))
    assert [text.endswith(": e0 and e1") for text in found] == [True] * crosses
    assert warn_of_crossing(crossed(0.0, radius, axes="xy")) == []


def test_a_load_along_an_axis_without_anchors() -> None:
    structure = crossed(0.1).with_changes(node_anchored=np.zeros((4, 3), dtype=bool))
    load = np.zeros((4, 3))
    load[1, 0] = 3.0
    (text,) = [text for text in find_warnings(structure.with_changes(node_load=load)) if "slides" in text]
    assert "loads add up to 3 N along x" in text
    load[2, 0] = -3.0
    assert not any("slides" in text for text in find_warnings(structure.with_changes(node_load=load)))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"node_mass": (2, 2e3)}, "n2 (2e+03 kg against 1 kg)"),
        ({"spring_constant": (4, 1e-6)}, "e4 ("),
        ({"spring_constant": (0, 1e9)}, "e0 (1.5e+09 N"),
    ],
)
def test_a_value_a_thousand_times_off_its_neighbours(changes: dict[str, Any], named: str) -> None:
    structure = crossed(0.1)
    structure = structure.with_changes(node_mass=np.ones(4))
    assert warn_of_outliers(structure) == []
    ((key, (row, value)),) = changes.items()
    array = getattr(structure, key).copy()
    array[row] = value
    (text,) = warn_of_outliers(structure.with_changes(**{key: array}))
    assert named in text


def test_bars_that_buckle_and_strain_at_the_start() -> None:
    structure = build()
    rest = structure.rest_length.copy()
    rest[0] *= 1.02
    found = find_warnings(structure.with_changes(rest_length=rest, radius=0.1 * structure.radius))
    assert any("at the start mast buckles" in text for text in found)
    assert any("at the start mast has a strain of -1.98 %" in text for text in found)
    # A search for the equilibrium does not start from these tensions.
    squeezed = structure.with_changes(rest_length=rest)
    assert not any("strain" in text for text in find_scene_warnings(squeezed, settles=True))


def test_a_hung_chain_needs_no_prestress() -> None:
    """Its loads pull it taut; without any, nothing does."""
    chain = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [cable(k, k + 1, 1.0) for k in range(3)]
    )
    chain = chain.with_changes(rest_length=chain.member_length())
    assert len(warn_of_slack(chain.with_changes(gravity=np.zeros(3)))) == 1
    assert warn_of_slack(chain.with_changes(gravity=np.array([0.0, 0.0, -9.81]))) == []
