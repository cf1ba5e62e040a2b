"""Distances of bars in closed form, against rational arithmetic and the generated C."""

import numpy as np
import pytest

from tensegrity_codegen.structure.bar_distance import compute_bar_distance, compute_segment_distance
from tests.body_scenes import EVERYTHING, assemble_document
from tests.models import load
from tests.scene.samples import build
from tests.segments import exact_distance


def test_random_segments() -> None:
    rng = np.random.default_rng(5)
    ends = rng.normal(size=(200, 4, 3))
    ends[50:100] = np.round(ends[50:100])  # many parallel, touching and crossing ones
    ends[100:120, 3] = ends[100:120, 2] + (ends[100:120, 1] - ends[100:120, 0])  # parallel
    ends[120:140, 2:] = ends[120:140, :2]  # the same
    found = compute_segment_distance(*np.moveaxis(ends, 1, 0))
    expected = [exact_distance(*(list(map(float, point)) for point in item)) for item in ends]
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("axes", ["xyz", "xz"])
def test_bars_of_nodes(axes: str) -> None:
    places = {"a": [0, 0], "b": [1, 0], "c": [0.2, 0.5], "d": [0.9, 0.3]}
    scene = {
        "name": "bars",
        "axes": axes,
        "classes": {"tube": {"kind": "bar", "spring_constant": 1e3, "radius": 0.02}},
        "nodes": {
            name: {"position": [x, 0.0, z], "mass": 1.0, "anchored": name in "ab"}
            for name, (x, z) in places.items()
        },
        "members": {
            "m1": {"class": "tube", "nodes": ["a", "b"]},
            "m2": {"class": "tube", "nodes": ["c", "d"]},
            "m3": {"class": "tube", "nodes": ["a", "c"]},
        },
    }
    pairs, distance = compute_bar_distance(build(scene)[0])
    assert pairs == (("m1", "m2"),)
    np.testing.assert_allclose(distance, [0.3 - 0.04])


def test_bars_that_are_bodies_as_in_the_generated_code() -> None:
    bodies = {
        name: {**body, "radius": 0.01} if body["kind"] == "bar" else body
        for name, body in EVERYTHING["bodies"].items()
    }
    system, _ = assemble_document({**EVERYTHING, "bodies": bodies})
    model = load(system, "bar_distance", formulation="bodies")
    pairs, distance = compute_bar_distance(system)
    assert pairs == model.manifest.bar_pair
    np.testing.assert_allclose(distance, model.compute("bar_distance"), atol=1e-13)
