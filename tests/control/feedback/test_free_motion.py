"""Free structures: without outer forces their motions have no momentum, and turn as their shapes require."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.equilibrium_path import EquilibriumPath
from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tests.control.feedback.structures import build_prism, compile_motion, plan_prism
from tests.control.planning.structures import actuate
from tests.runtime.build import bar, cable, make_structure


def follow(model: Any, motion: Motion) -> float:
    """Return the largest difference of coordinates between the simulation and the motion."""
    run = simulate(
        model,
        motion.duration,
        schedule=motion.profile(),
        coordinate=motion.coordinate[0],
        samples=len(motion.time),
    )
    assert run.status == "ok", run.message
    return float(np.abs(run.coordinate - motion.coordinate).max())


@pytest.mark.thorough
def test_a_free_prism_of_unequal_masses_turns_as_it_must() -> None:
    prism = build_prism(rigid=True)
    structure = prism.with_changes(
        member_mass=np.where(prism.is_bar, 0.3, 0.0), node_mass=np.array([0.05, 0.1, 0.02, 0.03, 0.04, 0.2])
    )
    model, found = compile_motion(structure, "rigid_bar"), plan_prism(structure, "rigid_bar")
    motion = time_motion(model, found, 1.4, samples=101)
    assert motion.warnings == ()
    assert follow(model, motion) < 1e-9
    np.testing.assert_allclose(motion.coordinate[0], found.coordinate[0], atol=1e-12)
    assert np.abs(motion.coordinate[-1] - found.coordinate[-1]).max() > 1e-4  # turned as a whole
    np.testing.assert_allclose(_distances(motion.coordinate[-1]), _distances(found.coordinate[-1]), atol=1e-9)


def test_a_free_structure_that_goes_back_ends_where_it_began() -> None:
    structure = build_prism()
    model, found = compile_motion(structure), plan_prism(structure)
    motion = time_motion(model, found, 2.8, samples=201, there_and_back=True)
    np.testing.assert_allclose(motion.coordinate[-1], found.coordinate[0], atol=1e-11)
    assert np.abs(motion.coordinate[100] - motion.coordinate[0]).max() > 1e-3
    assert follow(model, motion) < 1e-5


def _distances(coordinate: np.ndarray) -> np.ndarray:
    place = coordinate.reshape(6, 3)
    return np.linalg.norm(place[:, None] - place, axis=2)


def build_kite() -> Structure:
    """Return a free square of four damped cables with two crossing bars, in the plane."""
    members = [cable(k, (k + 1) % 4, 0.9, 500.0, damping=5.0) for k in range(4)]
    members += [bar(0, 2, 1.45, 1e5, damping=50.0), bar(1, 3, 1.45, 1e5, damping=50.0)]
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    kite = make_structure(corner, members, axes="xy", mass=np.array([0.1, 0.2, 0.3, 0.5]))
    return actuate(kite, rate=0.1)


@pytest.mark.thorough
def test_a_free_kite_in_the_plane() -> None:
    structure = build_kite()
    model = compile_motion(structure)
    path = EquilibriumPath([[0.0] * 4, [-0.05, 0.02, -0.03, 0.04]])
    motion = time_motion(model, path, 1.0)
    assert motion.warnings == ()
    mass = np.repeat(structure.node_mass, 2)
    momentum = (motion.velocity * mass).reshape(-1, 4, 2).sum(axis=1)
    assert np.abs(momentum).max() < 1e-9
    assert follow(model, motion) < 1e-5
