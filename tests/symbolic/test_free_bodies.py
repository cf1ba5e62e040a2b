"""Rigid bodies beside nodes and members: rates and Jacobians against bodies with quaternions in NumPy."""

from typing import Any

import numpy as np
import pytest

from tests.cases import thorough
from tests.free_body_cases import MappedScene, make_random
from tests.symbolic.test_rigid_bar import Evaluated

SEEDS = [*range(3), *thorough(*range(3, 60))]
TINY = 1e-30  # imaginary step
Array = Any  # NumPy arrays, real or complex


class Case:
    """A random scene at a random state, in both models."""

    def __init__(self, seed: int, scene: dict[str, Any] | None = None) -> None:
        self.mapped = MappedScene(scene or make_random(seed))
        self.found = Evaluated(self.mapped.structure)
        reference, rng = self.mapped.reference, np.random.default_rng(seed + 1000)
        parts = reference.split(reference.start.copy())
        for part, size in zip(parts, (0.02, 0.1, 0.02, 1.0, 4.0, 1.0, 0.002), strict=True):
            part += size * rng.normal(size=part.shape)
        parts[-1][:] -= np.outer(parts[-1] @ reference.normal, reference.normal)
        self.y = np.concatenate([part.ravel() for part in parts])

    @property
    def arguments(self) -> dict[str, Array]:
        """The state as arguments of the model."""
        state, n = self.mapped.state(self.y), self.mapped.structure.n_coordinates
        state = {"coordinate": state[:n], "velocity": state[n : 2 * n], "internal": state[2 * n :]}
        return {name: value for name, value in state.items() if value.size}

    def rates(self, y: Array, wind: Array = 0.0, push: Array = 0.0) -> Array:
        """Return the rates of the model's state by the reference, at these inputs."""
        reference = self.mapped.reference
        rest_length, load = reference.rest_length + 0 * wind, reference.load + 0 * push
        rest_length[[0, 2]] += wind
        load[reference.index["b0.p1"]] += push * np.array([0.0, 0.6, 0.8])
        return self.mapped.rates(y, reference.rates(y, rest_length, load))

    def steps(self) -> Array:
        """Return one imaginary step along each coordinate of the reference; deflections stay in the plane."""
        normal, along = self.mapped.reference.normal, np.eye(len(self.y))
        first = len(self.y) - 3 * len(self.mapped.reference.contacts)
        plane = np.eye(3) - np.outer(normal, normal)
        along[first:, first:] = np.kron(np.eye(len(self.mapped.reference.contacts)), plane)
        return self.y + 1j * TINY * along


def differ(found: Array, expected: Array) -> float:
    """Return the largest difference over the largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_rates_are_those_of_the_equations_with_quaternions(seed: int) -> None:
    """Bodies by parts or by mass and inertia, in contact or not, members, loads, damping and spin."""
    case = Case(seed)
    expected, n = case.rates(case.y), case.mapped.structure.n_coordinates
    assert differ(case.found("acceleration", **case.arguments), expected[n : 2 * n]) < 1e-10
    assert differ(case.found("state_derivative", **case.arguments), expected) < 1e-10
    inputs = {"input": np.array([0.03, -2.0])}
    pushed = case.rates(case.y, 0.03, -2.0)
    assert differ(case.found("state_derivative", **case.arguments, **inputs), pushed) < 1e-10


@pytest.mark.parametrize("seed", SEEDS)
def test_jacobians_along_motions_that_keep_bodies_rigid_are_those_of_imaginary_steps(seed: int) -> None:
    case = Case(seed)
    along = np.array([case.mapped.state(y).imag for y in case.steps()]).T / TINY
    expected = np.array([case.rates(y).imag for y in case.steps()]).T / TINY
    jacobian = case.found("state_jacobian", **case.arguments)
    terms = np.abs(jacobian) @ np.abs(along)
    assert (np.abs(jacobian @ along - expected) / terms.max()).max() < 1e-12
    inputs = [case.rates(case.y, wind=1j * TINY).imag, case.rates(case.y, push=1j * TINY).imag]
    assert differ(case.found("input_jacobian", **case.arguments), np.array(inputs).T / TINY) < 1e-12


@pytest.mark.parametrize("seed", SEEDS)
def test_masses_and_inertias_of_parts_and_where_bodies_are(seed: int) -> None:
    case = Case(seed)
    reference, bodies = case.mapped.reference, case.mapped.structure.bodies
    for b, body in enumerate(bodies):
        assert body.mass == pytest.approx(reference.mass[b], rel=1e-14)
        np.testing.assert_allclose(body.centre, reference.centre[b], rtol=0, atol=1e-15)
        assert differ(body.inertia, reference.inertia[b]) < 1e-14
    position, velocity = case.mapped.move_nodes(reference.start)
    np.testing.assert_allclose(case.mapped.structure.node_position, position, rtol=0, atol=2e-15)
    np.testing.assert_allclose(case.mapped.structure.node_velocity, velocity, rtol=0, atol=2e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_position_axes_angular_velocity_and_energy_of_bodies(seed: int) -> None:
    case = Case(seed)
    reference = case.mapped.reference
    r, _, x, v, omega, xdot, _ = reference.split(case.y)
    _, axes, _, _ = case.mapped.find_bodies(*case.mapped.move_nodes(case.y))
    count = len(r)
    assert differ(case.found("body_position", **case.arguments).reshape(count, 3), r) < 1e-14
    assert differ(case.found("body_velocity", **case.arguments).reshape(count, 3), v) < 1e-13
    assert differ(case.found("body_axes", **case.arguments).reshape(count, 3, 3), axes) < 1e-12
    assert differ(case.found("body_angular_velocity", **case.arguments).reshape(count, 3), omega) < 1e-12
    spin = np.einsum("bi,bij,bj->", omega, reference.inertia, omega)
    energy = spin + reference.mass @ (v**2).sum(1) + reference.node_mass @ (xdot**2).sum(1)
    assert case.found("kinetic_energy", **case.arguments) == pytest.approx(energy / 2, rel=1e-13)
    assert len(x) == 1


def make_case(inertia: tuple[float, ...]) -> Case:
    """Return the first random scene with bodies of 0.5 kg of these principal inertias [kg m2]."""
    scene = make_random(0)
    for body in scene["bodies"].values():
        for key in ("parts", "centre_of_mass"):
            body.pop(key, None)
        body |= {"mass": 0.5, "inertia": list(inertia)}
    return Case(0, scene)


@pytest.mark.parametrize("inertia", [(1e-3, 1.5e-3, 2.5e-3), (1e-3, 1e-3, 1e-8), (1e-3, 1e-3, 1e-3)])
def test_flat_thin_and_round_bodies_move_as_others(inertia: tuple[float, ...]) -> None:
    """The corners of a flat body lie in a plane but one without mass, those of a thin one near a line."""
    case = make_case(inertia)
    found = case.found("state_derivative", **case.arguments)
    assert differ(found, case.rates(case.y)) < 1e-10


@pytest.mark.parametrize("inertia", [(1e-3, 1.5e-3, 2.5e-3), (1e-3, 1e-3, 1e-6)])
def test_the_consistent_place_of_a_body_is_the_nearest_by_masses(inertia: tuple[float, ...]) -> None:
    """What is corrected has no momentum, (x - P x)^T H r = 0 for each rigid motion r, but for its squares."""
    case = make_case(inertia)
    structure, arguments = case.mapped.structure, case.arguments
    rows = np.array([node for node, _ in structure.coordinate_node_axis])
    on_body = np.isin(rows, structure.bodies[0].corner)
    error = np.where(on_body, 1e-7 * np.random.default_rng(4).normal(size=len(rows)), 0.0)
    bent = arguments | {"coordinate": arguments["coordinate"] + error}
    straight = case.found("consistent_coordinate", **bent).ravel()
    place = straight[on_body].reshape(4, 3)
    motions = [np.tile(axis, (4, 1)) for axis in np.eye(3)] + [np.cross(axis, place) for axis in np.eye(3)]
    momentum = (case.found("mass_matrix", **arguments) @ (bent["coordinate"] - straight))[on_body]
    size = np.abs(momentum).sum()
    assert size > 0
    for motion in motions:
        assert abs(momentum @ motion.ravel()) < 1e-4 * size
    again = case.found("consistent_coordinate", **arguments | {"coordinate": straight}).ravel()
    np.testing.assert_allclose(again, straight, atol=1e-13)
