"""Surfaces of rigid bodies: closed, of the right volume, and moving with the nodes that carry a body."""

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.body_meshes import build_mesh
from tensegrity_codegen.structure.free_bodies import BodyPart, FreeBody
from tests.rigid_scenes import HANGING

TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])  # a rotation


@pytest.mark.parametrize(
    ("kind", "size", "volume", "error"),
    [
        ("ball", (0.1,), 4 / 3 * np.pi * 1e-3, 0.06),
        ("cylinder", (0.1, 0.7), np.pi * 0.01 * 0.7, 0.02),
        ("tube", (0.1, 0.06, 0.7), np.pi * (0.01 - 0.0036) * 0.7, 0.02),
        ("capsule", (0.1, 0.7), np.pi * 0.01 * 0.7 + 4 / 3 * np.pi * 1e-3, 0.03),
        ("box", (0.1, 0.2, 0.3), 0.006, 1e-12),
    ],
)
def test_parts_are_closed_surfaces(kind: str, size: tuple[float, ...], volume: float, error: float) -> None:
    part = BodyPart(kind, size, np.array([0.3, -0.2, 0.1]), TURN)
    body = FreeBody(
        "rod", 1.0, np.diag([0.01, 0.02, 0.025]), np.array([0.1, 0.0, 0.0]), (0, 1, 2, 3), parts=(part,)
    )
    mesh, corner = build_mesh([body]), body.corner_local
    spots = mesh.compute_places(corner)
    a, b, c = (spots[mesh.triangle[:, k]] for k in range(3))
    outward = np.cross(b - a, c - a)
    assert abs(outward.sum(axis=0)).max() < 1e-15  # closed
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=error)
    normal = mesh.normal @ corner
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-13)
    assert (np.einsum("ij,ij->i", outward, normal[mesh.triangle].mean(axis=1)) > 0).all()
    # A motion of the corners moves all of it alike.
    step = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(mesh.compute_places(corner @ TURN.T + step), spots @ TURN.T + step, atol=1e-13)


def test_a_body_without_parts_is_lines_and_balls() -> None:
    points = {"a": [0.3, 0, 0], "b": {"position": [0, 0.2, 0], "radius": 0.05}}
    stone = {"kind": "rigid", "mass": 1, "inertia": [0.1, 0.1, 0.1], "centre": [0, 0, 1], "points": points}
    structure, _ = assemble(parse_scene({"name": "stone", "bodies": {"stone": stone}}))
    spots = build_mesh(structure.bodies).compute_places(structure.node_position)
    thin = 0.012 * 0.3
    np.testing.assert_allclose(spots.max(axis=0), [0.3 + thin, 0.25, 1.05], atol=1e-12)
    np.testing.assert_allclose(spots.min(axis=0), [-0.05, -thin, 0.95], atol=1e-3)
    assert not len(build_mesh([]).triangle)
    assert len(build_mesh(assemble(parse_scene(HANGING))[0].bodies).triangle) > 100
