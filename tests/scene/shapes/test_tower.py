"""Long towers: their twist of self-stress follows from shorter ones, their tensions balance on every node."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.shapes import expand_shape, tower
from tensegrity_codegen.scene.shapes.tower import TowerShape, find_long_twist, find_tower_twist
from tensegrity_codegen.system.errors import StructureError


def shape(stages: int, bars: int = 3, overlap: float = 0.2) -> dict[str, Any]:
    return {
        "kind": "tower", "stages": stages, "bars": bars, "radius": 0.5, "height": 1.0, "overlap": overlap,
        "prestress": 10.0,
    }  # fmt: skip


def unbalanced(document: dict[str, Any]) -> tuple[float, np.ndarray, np.ndarray]:
    """Largest force left on a node [N], tensions, and which members are bars."""
    index = {name: number for number, name in enumerate(document["nodes"])}
    position = np.array([node["position"] for node in document["nodes"].values()])
    members = document["members"].values()
    i, j = np.array([[index[name] for name in member["nodes"]] for member in members]).T
    tension = np.array([member["prestress"] for member in members])
    pull = position[j] - position[i]
    pull *= (tension / np.linalg.norm(pull, axis=1))[:, None]
    force = np.zeros_like(position)
    np.add.at(force, i, pull)
    np.add.at(force, j, -pull)
    return float(np.abs(force).max()), tension, np.array([member["class"] == "bar" for member in members])


@pytest.mark.parametrize(("stages", "bars", "overlap"), [(31, 4, 0.15), (401, 3, 0.1)])
def test_tensions_balance_and_all_cables_are_taut(stages: int, bars: int, overlap: float) -> None:
    left, tension, is_bar = unbalanced(expand_shape(shape(stages, bars, overlap)))
    assert left < 1e-9
    assert tension[~is_bar].max() == pytest.approx(10.0)
    assert tension[~is_bar].min() > 0 > tension[is_bar].max()


def test_the_twist_is_the_one_that_a_scan_finds() -> None:
    known = {k: find_tower_twist(TowerShape(**shape(k))) for k in (4, 8)}
    found = find_long_twist(lambda twist: tower._frame_equations(4, 3, 0.2, twist), known, 12)
    assert found == pytest.approx(find_tower_twist(TowerShape(**shape(12))), abs=1e-9)


def test_a_twist_of_no_selfstress_is_refused() -> None:
    with pytest.raises(StructureError, match="no twist was found"):
        expand_shape(shape(40) | {"twist": 160.0})
    with pytest.raises(StructureError, match="no twist was found"):
        expand_shape(shape(40, overlap=0.3))
