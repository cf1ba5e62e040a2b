"""Gradients of motions of rigid bodies on the ground, against differences of motions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import Stepping, build_library, motion_gradient, simulate
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tests.free_body_cases import make_roller

T_END = 0.3
STEP = 1e-5


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    """A rod with balls at its ends that hops on a slope and rolls, held by a damped cable."""
    document: dict[str, Any] = make_roller(
        10.0, 0.4, (0.15, -0.15), mass=0.4, inertia=[2e-3, 1.5e-4, 2.1e-3], radius=0.03,
        angular_velocity=[2.0, 5.0, -1.0],
    )  # fmt: skip
    document["bodies"]["b"]["position"][2] += 0.02
    document["ground"] |= {"stiffness": 5e3, "stick_stiffness": 5e3, "stick_damping": 20.0}
    document["nodes"] = {"post": {"position": [-0.1, 0.1, 0.3], "anchored": True}}
    cable = {"kind": "cable", "nodes": ["post", "b.end0"], "spring_constant": 20.0, "damping": 0.1}
    document["members"] = {"c": cable | {"rest_length": 0.2}}
    document["parameters"] = {"spring_constant": "all", "body_mass": "all", "body_inertia": ["b"]}
    document["parameters"] |= {"ground": ["friction"]}
    structure, request = assemble_scene(parse_scene(document))
    quantities = ("member_tension", "acceleration", "kinetic_energy", "total_energy", "adjoint_rate")
    wanted = replace(request, quantities=quantities, integrators=("rk853",))
    return build_library(structure, wanted).load()


def find_loss(motion: Trajectory) -> tuple[float, dict[str, np.ndarray]]:
    """Return a combination of the places of an end at the end and of the other one on the way."""
    weight = np.zeros_like(motion.node_position)
    names = list(motion.node_name)
    weight[-1, names.index("b_end0")] = [1.0, 2.0, 3.0]
    weight[50, names.index("b_end1")] = [0.5, -1.0, 0.0]
    return float((weight * motion.node_position).sum()), {"node_position": weight}


def compute_difference(model: CompiledModel, name: str, place: tuple[int, ...]) -> float:
    """Return the derivative of the loss to a number, over its size, by differences of tight motions."""
    nominal = np.array(model.nominal(name), dtype=float)

    def move(part: float) -> float:
        values = nominal.copy()
        values[place] *= 1.0 + part
        stepping = Stepping(control="steps", atol=1e-14)
        options: dict[str, Any] = {"method": "rk853", "rtol": 1e-12, "stepping": stepping}
        return find_loss(simulate(model, T_END, arguments={name: values}, **options))[0]

    return (8 * (move(STEP) - move(-STEP)) - move(2 * STEP) + move(-2 * STEP)) / (12 * STEP)


def test_gradients_through_contacts_are_those_of_differences(model: CompiledModel) -> None:
    found = motion_gradient(model, find_loss, T_END, rtol=1e-11, check=False)
    for name in ("spring_constant", "body_mass", "body_inertia", "ground"):
        nominal = np.array(model.nominal(name), dtype=float)
        slopes = np.reshape(found.by[name], nominal.shape) * nominal
        for place in np.ndindex(nominal.shape):
            difference = compute_difference(model, name, place)
            assert slopes[place] == pytest.approx(difference, rel=1e-6, abs=1e-8), (name, place)


def test_another_mass_and_inertia_are_those_of_another_scene(model: CompiledModel) -> None:
    """A body whose mass and inertias are all twice as large moves as one that is stated so."""
    twice = {name: 2.0 * np.array(model.nominal(name)) for name in ("body_mass", "body_inertia")}
    found = simulate(model, T_END, rtol=1e-9, method="rk853", arguments=twice)
    document = model.structure
    assert document is not None
    body = document.bodies[0]
    heavy = replace(body, mass=2.0 * body.mass, inertia=2.0 * body.inertia)
    mass = np.where(document.node_mass > 0, 2.0 * document.node_mass, 0.0)
    other = document.with_changes(bodies=(heavy,), node_mass=mass)
    quantities = ("member_tension", "acceleration", "kinetic_energy", "total_energy")
    request = replace(assemble_request(), quantities=quantities, integrators=("rk853",))
    right = simulate(build_library(other, request).load(), T_END, rtol=1e-9, method="rk853")
    assert found.node_position == pytest.approx(right.node_position, abs=1e-9)
    assert found.total_energy == pytest.approx(right.total_energy, rel=1e-9)


def assemble_request() -> Any:
    """Return the request of a scene of bodies."""
    return assemble_scene(parse_scene(make_roller(0.0, 0.0)))[1]
