"""Stated errors of motions with contacts or plastic flow are above the true ones."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.accuracy.scales import set_atol_by_motion, tolerance_of_options
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.ground_cases import GRAVITY, make_block, make_ground, make_icosahedron, make_prism, make_rod
from tests.models import simulator
from tests.runtime.integrate.test_ground import rotate
from tests.scene.samples import build

Array = NDArray[np.float64]
EXACT = Stepping(atol=1e-14, control="steps")


def draw(rng: np.random.Generator) -> tuple[Structure, float]:
    """Return a structure that falls onto a ground, and how long [s]."""
    stiffness, count = 10.0 ** rng.uniform(3.3, 5.5), int(rng.choice([1, 2, 6, 12]))
    values = {
        "stiffness": stiffness,
        "stick_stiffness": stiffness * 10.0 ** rng.uniform(-0.5, 0.5),
        "friction": float(rng.choice([0.0, rng.uniform(0.05, 1.0)])),
        "dissipation": rng.uniform(0.0, 0.8),
        "stick_damping": 2.0 * np.sqrt(0.1 * stiffness),
    }
    turn = rotate(tuple(rng.uniform(-3.0, 3.0, 3)))
    if count == 1:
        return make_block([0.0, 0.0, rng.uniform(0.0, 0.5)], **values), rng.uniform(0.3, 1.5)
    if count == 6:
        return make_prism(turn, **values), rng.uniform(0.4, 0.8)
    if count == 2:
        ground = make_ground(2, radius=np.full(2, 0.02), **values)
        return make_rod().with_changes(ground=ground), rng.uniform(0.3, 0.8)
    ball = make_icosahedron()
    place = ball.node_position @ turn.T
    place = place - [0.0, 0.0, place[:, 2].min() - rng.uniform(0.01, 0.4)]
    velocity = np.tile(rng.normal(size=3) * [1.0, 1.0, 0.3], (12, 1))
    changes = {"node_position": place, "node_velocity": velocity, "ground": make_ground(12, **values)}
    return ball.with_changes(**changes), rng.uniform(0.2, 0.6)


def measure(model: CompiledModel, motion: Trajectory, exact: Trajectory, method: str, rtol: float) -> float:
    """Return the true error over the tolerance."""
    start = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    options = set_atol_by_motion(Motion(model, start, exact.time), Stepping().with_method(method, rtol))
    tolerance = tolerance_of_options(model.manifest, options)
    found, wanted = (np.hstack([item.coordinate, item.velocity]) for item in (motion, exact))
    return float((tolerance.lengths(found - wanted) / tolerance.allowed(found)).max())


@pytest.mark.parametrize(("seed", "draws"), [(0, 3), *thorough(*((seed, 5) for seed in (*range(12), 112)))])
def test_stated_errors_are_above_the_true_ones(seed: int, draws: int) -> None:
    rng, held = np.random.default_rng(seed), 0
    for _ in range(draws):
        structure, t_end = draw(rng)
        formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
        model = simulator(structure, "rk54", "rk853", formulation=formulation)
        times = np.linspace(0.0, t_end, 9)
        exact = simulate(model, t_end, samples=times, method="rk853", rtol=1e-12, stepping=EXACT)
        for method in ("rk54", "rk853"):
            rtol = 10.0 ** rng.uniform(-8.0, -3.0)
            motion = simulate(model, t_end, samples=times, method=method, rtol=rtol)
            if motion.status == "ok":
                true = measure(model, motion, exact, method, rtol)
                assert motion.error_estimate is not None
                assert 1.0 >= motion.error_estimate > true
                held += 1
    assert held >= 2 * draws - 2


@pytest.mark.parametrize("falls", [40, *thorough(200)])
def test_rigid_bars_that_rounding_moves_at_an_impact_hold_up_no_event(falls: int) -> None:
    """Cables go slack right after the impact, where at this tolerance bars' lengths are off by 1e-7."""
    rng, ball = np.random.default_rng(2), make_icosahedron()
    ground = make_ground(12, friction=0.0, stiffness=2.2e4, dissipation=0.3)
    model = simulator(ball.with_changes(ground=ground), "rk853", formulation="rigid_bar")
    stepping = Stepping(atol=1e-5, control="steps")
    for _ in range(falls):
        place = ball.node_position @ rotate(tuple(rng.uniform(-3.0, 3.0, 3))).T
        place = place - [0.0, 0.0, place[:, 2].min() - 0.3]
        options = {"samples": [0.0, 0.32], "method": "rk853", "rtol": 1e-3, "stepping": stepping}
        motion = simulate(model, 0.32, coordinate=place.ravel(), **options)
        assert motion.status == "ok"


@pytest.fixture(scope="module")
def drop() -> CompiledModel:
    """Return a mass that falls from the rest length of a damped cable, which yields and goes slack."""
    cable = {
        "kind": "cable", "nodes": ["t", "w"], "spring_constant": 3000.0, "rest_length": 1.0,
        "yield_force": 40.0, "hardening": 0.05, "isotropic": 0.3, "damping": 0.5,
    }  # fmt: skip
    nodes = {
        "t": {"position": [0.0], "anchored": True},
        "w": {"position": [-1.0], "mass": 1.0, "velocity": [-3.0]},
    }
    scene = {"name": "drop", "axes": "z", "gravity": [-9.81], "nodes": nodes, "members": {"c": cable}}
    return simulator(build(scene)[0], "rk853")


@pytest.mark.parametrize(
    ("rtol", "samples"),
    [(10.0**-4.5, 17), (10.0**-4.5, 101), (3.2e-5, 17), *thorough((1e-5, 17), (3.2e-5, 101), (1e-7, 17))],
)
def test_stated_errors_hold_where_a_member_yields(drop: CompiledModel, rtol: float, samples: int) -> None:
    """Steps from the end of flow begin at rest, where the estimate of order 8 sees little."""
    times = np.linspace(0.0, 2.0, samples)
    exact = simulate(drop, 2.0, samples=times, method="rk853", rtol=1e-12, stepping=EXACT)
    motion = simulate(drop, 2.0, samples=times, method="rk853", rtol=rtol)
    assert motion.status == "ok"
    assert motion.error_estimate is not None
    assert 1.0 >= motion.error_estimate > measure(drop, motion, exact, "rk853", rtol)
    assert "rounding" not in motion.message
    assert motion.log.count == exact.log.count == 20


def test_a_rope_that_lies_on_the_floor_takes_no_steps_of_rounding() -> None:
    """Velocities are some 1e-13 m/s then, which rounding keeps from any tolerance far below that."""
    nodes = {f"n{k}": {"position": [0.05 * k - 0.2, 0.0, 0.03], "mass": 0.002} for k in range(9)}
    bars = {f"b{k}": {"mass": 0.004, "kind": "bar", "nodes": [f"n{k}", f"n{k + 1}"]} for k in range(8)}
    ground = {
        "radius": 0.005, "stiffness": 2000.0, "restitution": {"value": 0.5, "speed": 0.5}, "friction": 0.8,
    }  # fmt: skip
    scene = {
        "name": "rope",
        "gravity": [0.0, 0.0, -GRAVITY],
        "nodes": nodes,
        "members": bars,
        "ground": ground,
    }
    model = simulator(build(scene)[0], "rk853", formulation="rigid_bar")
    motion = simulate(model, 2.0, samples=21)
    assert motion.status == "ok"
    assert motion.error_estimate is not None
    assert 0.05 <= motion.error_estimate <= 1.0
    assert motion.n_steps < 10_000
    depth = (0.002 + 0.5 * 0.004) * GRAVITY / 2000.0
    assert motion.position("n0")[-1] == pytest.approx([-0.2, 0.0, 0.005 - depth], abs=1e-9)
    assert float(np.abs(motion.node_velocity[-1]).max()) < 1e-9
