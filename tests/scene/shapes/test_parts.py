"""Shapes that stand on a facet."""

import json
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.shapes import expand_shape
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError

BALL: dict[str, Any] = {"kind": "icosahedron", "bar_length": 0.62}


def place(shape: dict[str, Any]) -> np.ndarray:
    return np.array([node["position"] for node in expand_shape(shape)["nodes"].values()])


@pytest.mark.parametrize("names", [["n1", "n5", "n9"], ["n9", "n5", "n1"], ["n2", "n5", "n7"]])
def test_the_facet_lies_at_the_origin_and_all_else_is_above(names: list[str]) -> None:
    before, after = place(BALL), place(BALL | {"on_facet": names})
    down = [int(name[1:]) - 1 for name in names]
    np.testing.assert_allclose(after[down, 2], 0.0, atol=1e-15)
    np.testing.assert_allclose(after[down].mean(axis=0), 0.0, atol=1e-15)
    assert (np.delete(after[:, 2], down) > 0.1).all()
    # Turned, not mirrored: distances and volumes stay.
    away = [np.linalg.norm(p[:, None] - p[None], axis=2) for p in (before, after)]
    np.testing.assert_allclose(away[1], away[0], atol=1e-15)
    volumes = [np.linalg.det(p[[0, 2, 4]] - p[7]) for p in (before, after)]
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-12)


def test_a_prism_is_laid_on_its_top() -> None:
    prism = {"kind": "prism", "bottom_radius": 1.0, "height": 2.0, "on_facet": ["t1", "t2", "t3"]}
    np.testing.assert_allclose(place(prism)[:, 2], [2.0, 2.0, 2.0, 0.0, 0.0, 0.0], atol=1e-14)


def test_nodes_that_are_no_facet_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"shape\.on_facet: not a facet") as caught:
        expand_shape(BALL | {"on_facet": ["n1", "n3", "n5"]})
    named = json.loads(caught.value.hint.partition(" = ")[2])
    assert len({"n1", "n3", "n5"} & set(named)) == 2
    assert min(place(BALL | {"on_facet": named})[:, 2]) == pytest.approx(0.0, abs=1e-12)
    assert caught.value.given == "n1, n3, n5"
    with pytest.raises(InvalidValueError, match="not a facet"):
        expand_shape(BALL | {"on_facet": ["n1", "n1", "n5"]})
    with pytest.raises(UnknownNameError, match="n13"):
        expand_shape(BALL | {"on_facet": ["n1", "n13", "n5"]})
