"""Gradients of motions of rigid bodies, backwards over the steps, through contacts that roll."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.simulate.gradient import motion_gradient
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.sweeps.fitting.identify import identify
from tests.codegen.quickly import without_optimisation
from tests.standing_robot import describe_robot

NODE = "rod0_hi"


def test_gradients_reach_points_of_bodies_through_contacts() -> None:
    """Against differences of motions: a robot that is dropped higher than in its scene, and bounces."""
    scene = describe_robot()
    names = {"rest_length": ["b0"], "spring_constant": ["v1"], "damping": ["b0"]}
    scene["parameters"] = {**names, "node_load": ["rod1.hi"], "ground": "all"}
    quantities = ["member_tension", "acceleration", "kinetic_energy", "total_energy", "adjoint_rate"]
    scene["model"] = {"quantities": quantities, "integrators": ["rk853"]}
    with without_optimisation():
        model = compile_scene(scene)
    node = model.manifest.node_name.index(NODE)

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        place, rate = np.zeros_like(motion.node_position), np.zeros_like(motion.node_velocity)
        place[-1, node], rate[-1, node] = [1.0, 0.5, 0.3], [0.02, 0.0, 0.03]
        value = (place * motion.node_position).sum() + (rate * motion.node_velocity).sum()
        return float(value), {"node_position": place, "node_velocity": rate}

    start = {"coordinate": model.nominal("coordinate") + np.tile([0.0, 0.0, 0.02], 12)}
    found = motion_gradient(model, loss, 0.25, samples=3, rtol=1e-11, **start)
    assert found.error is not None
    assert found.error < 1e-5
    ways = np.random.default_rng(0).normal(size=3)
    for name in ("rest_length", "spring_constant", "damping", "ground", "node_load"):
        stated = np.asarray(model.nominal(name), dtype=float)
        way = ways if name == "node_load" else np.abs(stated.ravel())
        ends = []
        for sign in (1.0, -1.0):
            arguments = {name: stated + sign * 1e-6 * way.reshape(stated.shape)}
            run = simulate(model, 0.25, samples=3, method="rk853", rtol=1e-12, arguments=arguments, **start)
            ends.append(loss(run)[0])
        slope = float((found.by[name].ravel() * way).sum())
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-9), name


def test_points_of_bodies_are_measured() -> None:
    """The stiffness of a cable from the motion of a point of a body, and a rest length."""
    scene = describe_robot(on_ground=False)
    with without_optimisation():
        true = compile_scene(scene, for_="simulate")
        run = simulate(true, 0.2, samples=21, rtol=1e-10)
        node = true.manifest.node_name.index(NODE)
        table = {
            "time": run.time,
            **{f"{NODE}.{a}": run.node_position[:, node, k] for k, a in enumerate("xyz")},
        }
        scene["members"]["b0"]["spring_constant"] = 420.0
        scene["members"]["t1"]["rest_length"] = 0.153
        keys = ("members.b0.spring_constant", "members.t1.rest_length")
        found = identify(scene, table, keys)
    np.testing.assert_allclose(list(found.value), [400.0, 0.15], rtol=1e-6)
