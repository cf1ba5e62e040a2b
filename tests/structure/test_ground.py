"""The ground as data: which numbers make one, and its basis of the plane."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError, SceneError
from tests.ground_cases import make_block, make_rod


def make_ground(**changes: Any) -> Ground:
    values: dict[str, Any] = {
        "normal": np.array([0.0, 0.0, 1.0]),
        "offset": 0.0,
        "velocity": np.zeros(3),
        "node": np.array([0, 2]),
        "radius": np.zeros(2),
        "stiffness": 1e4,
        "exponent": 1.0,
        "dissipation": 0.3,
        "friction": 0.5,
        "static_friction": None,
        "stick_stiffness": 1e4,
        "stick_damping": 10.0,
    }
    return Ground(**{**values, **changes})


@pytest.mark.parametrize("seed", range(5))
def test_tangents_are_an_orthonormal_basis_of_the_plane(seed: int) -> None:
    normal = np.random.default_rng(seed).normal(size=3)
    normal /= np.linalg.norm(normal)
    basis = np.vstack([make_ground(normal=normal).tangents((0, 1, 2)), normal])
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-15)


def test_tangents_of_a_level_ground_are_the_axes() -> None:
    np.testing.assert_array_equal(make_ground().tangents((0, 1, 2)), np.eye(3)[:2])
    np.testing.assert_array_equal(make_ground().tangents((0, 2)), np.eye(3)[:1])


def test_a_plane_model_has_one_tangent() -> None:
    slope = make_ground(normal=np.array([-0.5, 0.0, np.sqrt(0.75)]))
    (tangent,) = slope.tangents((0, 2))
    np.testing.assert_allclose([tangent @ slope.normal, tangent @ tangent], [0, 1], atol=1e-15)
    with pytest.raises(InvalidValueError, match="leaves the axes"):
        slope.tangents((1, 2))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("friction", -0.1),
        ("friction", np.nan),
        ("static_friction", 0.4),
        ("stiffness", 0.0),
        ("stick_stiffness", 0.0),
        ("stick_damping", -1.0),
        ("dissipation", -1.0),
        ("exponent", 2.0),
        ("normal", np.array([0.0, 0.0, 2.0])),
        ("velocity", np.array([0.0, 0.0, 1.0])),
        ("velocity", np.array([np.inf, 0.0, 0.0])),
        ("node", np.array([2, 0])),
        ("node", np.array([], dtype=np.int64)),
        ("radius", np.zeros(3)),
        ("radius", np.array([0.0, -1.0])),
    ],
)
def test_invalid_values_are_named(key: str, value: Any) -> None:
    with pytest.raises(InvalidValueError, match=key):
        make_ground(**{key: value})


def test_equal_grounds_are_equal_and_read_only() -> None:
    ground = make_ground()
    assert ground == make_ground()
    assert hash(ground) == hash(make_ground())
    assert ground != make_ground(friction=0.4)
    assert not ground.normal.flags.writeable


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"node": np.array([0, 9]), "radius": np.zeros(2)}, "out of range"),
        ({"node": np.array([1]), "radius": np.zeros(1)}, "anchored node"),
    ],
)
def test_contacts_are_nodes_that_can_move(changes: dict[str, Any], words: str) -> None:
    block = make_block([0.0, 0.0, 0.1])
    check_structure(block)
    with pytest.raises(SceneError, match=words):
        check_structure(block.with_changes(ground=make_ground(**changes)))


def test_the_normal_lies_in_the_axes_of_the_scene() -> None:
    tilted = make_ground(normal=np.array([0.0, 0.6, 0.8]), node=np.array([0, 1]))
    with pytest.raises(SceneError, match="an axis that the scene does not model"):
        check_structure(make_rod().with_changes(ground=tilted))
