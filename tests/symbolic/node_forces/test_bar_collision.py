"""Forces between bars that touch: gradient of an energy, closed forms, motions.

Normal force: Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.collision import Collision
from tensegrity_codegen.structure.structure import Structure
from tests.models import simulator
from tests.runtime.build import bar, make_structure

Array = NDArray[np.float64]
RADIUS, STIFFNESS = 0.01, 2e4


def make_crossed(dissipation: float = 0.0, gap: float = 0.05, **more: Any) -> Structure:
    """Return two free rigid bars of 1 m and 0.4 kg, crossed at their middles, one above the other."""
    half = [0.5, 0.0, 0.0], [0.0, 0.5, 0.0]
    height = 2 * RADIUS + gap
    ends = [[-x for x in half[0]], half[0], [0.0, -0.5, height], [0.0, 0.5, height]]
    members = [bar(2 * k, 2 * k + 1, 1.0, 0.0, mass=0.4) for k in range(2)]
    crossed = make_structure(ends, members, mass=0.0, **more)
    return crossed.with_changes(radius=np.full(2, RADIUS), collision=Collision(STIFFNESS, 1.0, dissipation))


def move(
    structure: Structure, velocity: Array, times: Any, method: str = "rk853"
) -> tuple[CompiledModel, Trajectory]:
    """Return the library and the motion from rest but for these velocities of nodes (n_nodes, 3)."""
    model = simulator(structure, method, more=("collision_force",), formulation="rigid_bar")
    stepping = Stepping(atol=1e-14, control="steps")
    motion = simulate(
        model,
        float(times[-1]),
        samples=np.asarray(times),
        method=method,
        rtol=1e-12,
        stepping=stepping,
        velocity=velocity.ravel(),
    )
    return model, motion


def fall(speed: float) -> Array:
    """Return the velocities of four nodes of which the last two go down."""
    velocity = np.zeros((4, 3))
    velocity[2:, 2] = -speed
    return velocity


@pytest.mark.parametrize("method", ["rk54", "rk853", "radau"])
def test_equal_bars_exchange_their_speeds(method: str) -> None:
    """Without dissipation; the contact takes pi sqrt(m / 2 k) (two masses on a spring)."""
    _, motion = move(make_crossed(), fall(1.0), [0.0, 0.1], method)
    np.testing.assert_allclose(motion.node_velocity[-1][:, 2], [-1.0, -1.0, 0.0, 0.0], atol=1e-9)
    assert motion.log.kind == ("collision", "collision")
    assert motion.log.direction.tolist() == [1, -1]
    touch = np.pi * np.sqrt(0.2 / STIFFNESS)
    np.testing.assert_allclose(motion.log.time, [0.05, 0.05 + touch], rtol=1e-9)


def test_restitution_is_that_of_hunt_and_crossley() -> None:
    """w/a + ln(1 - a w)/a^2 = -(v/a - ln(1 + a v)/a^2) for the speeds v before and w after."""
    a, before = 0.3, 2.0
    _, motion = move(make_crossed(a), fall(before), [0.0, 0.1])
    after = float(motion.node_velocity[-1, 2, 2] - motion.node_velocity[-1, 0, 2])
    assert after / a + np.log(1 - a * after) / a**2 == pytest.approx(
        -(before / a - np.log(1 + a * before) / a**2), rel=1e-9
    )
    momentum = motion.node_velocity[-1].sum(axis=0)
    np.testing.assert_allclose(momentum, fall(before).sum(axis=0), atol=1e-10)


def test_forces_are_the_gradient_of_the_energy() -> None:
    rng = np.random.default_rng(4)
    structure = make_crossed(gap=-0.004)
    model = simulator(
        structure,
        "rk853",
        more=("collision_force", "bar_distance", "potential_energy"),
        formulation="rigid_bar",
    )
    for _ in range(20):
        q = structure.node_position.ravel() + 2e-3 * rng.standard_normal(12)
        change = rng.standard_normal(12)
        overlap = max(0.0, -float(model.compute("bar_distance", coordinate=q)[0]))
        force = model.compute("collision_force", coordinate=q, velocity=np.zeros(12))
        assert float(force[0]) == pytest.approx(STIFFNESS * overlap, rel=1e-12)
        step = 1e-6 * change
        ends = [model.compute("potential_energy", coordinate=q + s * step) for s in (1, -1)]
        slope = (float(ends[0]) - float(ends[1])) / 2
        distances = [model.compute("bar_distance", coordinate=q + s * step)[0] for s in (1, -1)]
        assert slope == pytest.approx(-float(force[0]) * float(distances[0] - distances[1]) / 2, abs=1e-9)


def test_energy_is_kept_through_an_oblique_collision() -> None:
    velocity = fall(1.5)
    velocity[3] += [0.3, 0.2, 0.4]
    velocity[3, 1] = velocity[2, 1]  # a rigid bar keeps its length
    _, motion = move(make_crossed(), velocity, np.linspace(0.0, 0.1, 21))
    assert motion.log.count >= 2
    np.testing.assert_allclose(motion.total_energy, motion.total_energy[0], rtol=1e-9)
    assert motion.status == "ok"
