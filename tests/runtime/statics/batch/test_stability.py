"""Distances apart from neutral motions: closed forms against the fit for one case."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.runtime.statics.batch.stability import find_distances
from tensegrity_codegen.runtime.statics.neutral_motion import NeutralMotions

AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
ACROSS = np.array([[2.0, -2.0, 1.0], [2.0, 1.0, -2.0]]) / 3.0
TURN, SLIDE = np.append(AXIS, np.zeros(3)), np.hstack([np.zeros((3, 3)), np.eye(3)])
KNOWN = {
    "none": np.zeros((0, 6)),
    "slide": SLIDE[:1],
    "slides": SLIDE[1:],
    "turn and slides across": np.vstack([TURN, np.hstack([np.zeros((2, 3)), ACROSS])]),
    "turn and all slides": np.vstack([TURN, SLIDE]),
    "all": np.eye(6),
}
UNKNOWN = {
    "turn": TURN[None],
    "turn and a slide along it": np.vstack([TURN, np.append(np.zeros(3), AXIS)]),
    "two turns": np.eye(6)[:2],
}


def make_case(twist: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return start, a neighbour of it that was moved far along the motions, and mixed motions."""
    random = np.random.default_rng(seed)
    start = random.normal(size=(5, 3))
    part = random.normal(size=len(twist)) @ twist
    centre = start.mean(axis=0)
    turned = Rotation.from_rotvec(part[:3]).apply(start - centre) + centre + part[3:]
    mixed = np.linalg.qr(random.normal(size=(len(twist), len(twist))))[0] @ twist
    return start, turned + random.normal(scale=0.01, size=start.shape), mixed


@pytest.mark.parametrize("name", KNOWN)
def test_closed_forms_are_the_best_fit(name: str) -> None:
    cases = [make_case(KNOWN[name], seed) for seed in range(6)]
    twist = np.zeros((6, 6, 6))
    for k, (_, _, mixed) in enumerate(cases):
        twist[k, : len(mixed)] = mixed
    start, found = (np.array([case[place] for case in cases]) for place in (0, 1))
    distance, is_known = find_distances(start, found, np.full(6, len(KNOWN[name])), twist)
    assert is_known.all()
    for k, (_, _, mixed) in enumerate(cases):
        motions = NeutralMotions(found[k].mean(axis=0), mixed, np.zeros((5, 3, 0)))
        alone = motions.distance(start[k], found[k])
        assert np.linalg.norm(distance[k]) <= np.linalg.norm(alone) * (1 + 1e-9)
        np.testing.assert_allclose(distance[k], alone, atol=1e-6)


@pytest.mark.parametrize("name", UNKNOWN)
def test_other_motions_are_left_to_the_fit(name: str) -> None:
    start, found, mixed = make_case(UNKNOWN[name], 1)
    twist = np.zeros((1, 6, 6))
    twist[0, : len(mixed)] = mixed
    distance, is_known = find_distances(start[None], found[None], np.array([len(mixed)]), twist)
    assert not is_known.any()
    assert np.isnan(distance).all()
