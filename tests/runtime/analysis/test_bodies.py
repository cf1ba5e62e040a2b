"""Rigid bodies have six directions each: self-stresses, mechanisms, tensions without edges, frequencies."""

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.analysis.analyse import Analysis, analyse
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tests.codegen.quickly import without_optimisation
from tests.standing_robot import describe_robot


@pytest.fixture(scope="module")
def floating() -> tuple[CompiledModel, np.ndarray]:
    with without_optimisation():
        scene = describe_robot(on_ground=False, damping=0.0)
        model = compile_scene(scene, for_=("equilibrium", "analyse", "linearize"))
    return model, find_equilibrium(model).coordinate


@pytest.fixture(scope="module")
def found(floating: tuple[CompiledModel, np.ndarray]) -> Analysis:
    return analyse(floating[0], coordinate=floating[1], n_modes=12)


def test_three_rods_have_18_coordinates_and_9_members(found: Analysis) -> None:
    assert (found.rank.n_coordinates, found.rank.rank) == (18, 8)
    assert (found.n_selfstress, found.n_mechanisms, found.n_rigid_motions) == (1, 4, 6)
    assert found.status == "stable"


def test_the_self_stress_is_that_of_the_cables(found: Analysis) -> None:
    """Without loads the present tensions are the only self-stress, and edges have no part in it."""
    cables = found.member_tension[:9]
    np.testing.assert_allclose(found.prestress.tension[:9], cables / cables.max(), rtol=1e-9)
    assert (found.prestress.tension[9:] == 0.0).all()
    assert found.largest_force == pytest.approx(cables.max())


def test_mechanisms_have_the_stiffness_of_the_tensions(
    floating: tuple[CompiledModel, np.ndarray], found: Analysis
) -> None:
    """Along mechanisms cables keep their lengths, so that the present stiffness is that of the tensions.

    Turned bodies have it too: v . K v by differences of the energy along rigid motions of each body.
    """
    model, start = floating
    motion = np.moveaxis(found.mechanism, 2, 0)
    corners = [list(body.corner) for body in model.structure.bodies]  # type: ignore[union-attr]
    density = (found.member_tension / found.member_length)[:9].max()
    stiffness = np.zeros((4, 4))

    def energy(weights: np.ndarray) -> float:
        """Return the energy of bodies that turn about their centres of corners and move with these."""
        velocity, placed = np.tensordot(weights, motion, 1), start.copy()
        for nodes in corners:
            position = found.node_position[nodes]
            arm, rate = position - position.mean(axis=0), velocity[nodes] - velocity[nodes].mean(axis=0)
            matrix = sum(np.dot(a, a) * np.eye(3) - np.outer(a, a) for a in arm)
            spin = np.linalg.solve(matrix, sum(np.cross(a, v) for a, v in zip(arm, rate, strict=True)))
            angle = float(np.linalg.norm(spin))
            cross = np.cross(np.eye(3), spin / (angle or 1.0))
            turn = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
            rows = position.mean(axis=0) + velocity[nodes].mean(axis=0) + arm @ turn.T
            for node, row in zip(nodes, rows, strict=True):
                at = np.flatnonzero(model.manifest.coordinate_place[:, 0] == node)
                placed[at] = row
        return float(model.compute("potential_energy", coordinate=placed))

    step, middle = 1e-4, energy(np.zeros(4))
    unit = step * np.eye(4)
    for i in range(4):
        for j in range(4):
            plus, minus = energy(unit[i] + unit[j]), energy(-unit[i] - unit[j])
            cross, back = energy(unit[i] - unit[j]), energy(unit[j] - unit[i])
            stiffness[i, j] = (plus + minus - cross - back) / (4 * step**2)
    assert middle > 0.0
    np.testing.assert_allclose(np.linalg.eigvalsh(stiffness) / density, found.stability.eigenvalue, rtol=1e-4)


def test_modes_are_those_of_the_linear_model(
    floating: tuple[CompiledModel, np.ndarray], found: Analysis
) -> None:
    model, start = floating
    assert found.modes is not None
    assert (found.modes.n_total, found.modes.n_rigid) == (12, 6)
    frequency = np.sort(linearize(model, coordinate=start).natural_frequency)
    np.testing.assert_allclose(found.modes.frequency, frequency[-12:], rtol=1e-9)
