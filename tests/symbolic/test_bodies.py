"""The formulation `bodies` against mechanics written down a second time, another way."""

import copy
import dataclasses
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, BodyEvaluator, assemble_document, random_state
from tests.runtime.build import bar, make_structure, spring
from tests.symbolic.test_node_position import Evaluator

SYSTEM, _ = assemble_document(EVERYTHING)
EVALUATE = BodyEvaluator(SYSTEM)


def slope(quantity: str, argument: str, state: dict[str, np.ndarray], step: float = 1e-6) -> np.ndarray:
    """Return the derivative of a quantity by central differences, one column an entry of the argument."""
    columns = []
    for k in range(state[argument].size):
        moved = [dict(state), dict(state)]
        for sign, item in zip((1, -1), moved, strict=True):
            item[argument] = state[argument].copy()
            item[argument][k] += sign * step
        high, low = (EVALUATE(quantity, **item) for item in moved)
        columns.append((high - low).ravel() / (2 * step))
    return np.array(columns).T


def test_coordinates_are_named_after_body_and_angle() -> None:
    assert SYSTEM.coordinate_name[:4] == (
        "leg_declination", "leg_azimuth", "mast_elevation", "mast_azimuth",
    )  # fmt: skip
    assert SYSTEM.coordinate_name[-6:] == tuple(
        f"plate_{label}" for label in ("psi", "phi", "theta", "x", "y", "z")
    )
    assert EVALUATE.model.frame.coordinate_node_axis == ()


@pytest.mark.parametrize("seed", range(3))
def test_the_equations_of_motion_are_those_of_the_papers_equation_10(seed: int) -> None:
    # SCS (10): M q'' + c + A T + C q' + H F = 0; weight, fixed loads and the damping of t1, t3 stand apart.
    state = random_state(SYSTEM, seed)
    mass, v = EVALUATE("mass_matrix", **state), state["velocity"]
    rest = {**state, "velocity": 0 * v}
    friction = EVALUATE("coordinate_force", **state) - EVALUATE("damping_matrix", **state) @ v
    residual = mass @ EVALUATE("acceleration", **state) + EVALUATE("coriolis_force", **state) - friction
    assert np.abs(residual).max() < 1e-10
    by_load = EVALUATE("coordinate_force", **rest) - EVALUATE(
        "coordinate_force", **{**rest, "input": 0 * state["input"]}
    )
    forces = np.where([item.kind == "rest_length" for item in SYSTEM.inputs], 0.0, state["input"])
    only_forces = {**rest, "input": forces}
    by_force = EVALUATE("coordinate_force", **only_forces) - EVALUATE(
        "coordinate_force", **{**rest, "input": 0 * forces}
    )
    np.testing.assert_allclose(-EVALUATE("load_matrix", **state) @ forces, by_force, atol=1e-11)
    assert np.abs(by_load - by_force).max() > 1e-3  # the winch acts through the tendons instead


@pytest.mark.parametrize("seed", range(3))
def test_mass_matrix_and_kinetic_energy_follow_from_the_speeds_of_all_points(seed: int) -> None:
    """T = m |v_c|^2 / 2 + J |u'|^2 / 2 of each bar: the turning of a bar is (v_B - v_A) / l."""
    state = random_state(SYSTEM, seed)
    speed = EVALUATE("node_velocity", **state)
    total = 0.0
    for body in SYSTEM.bodies:
        if not hasattr(body, "length"):
            continue
        a, b = (speed[SYSTEM.find_node(f"{body.name}_{end}")] for end in "AB")
        turning = (b - a) / body.length
        total += body.mass * ((a + b) / 2) @ ((a + b) / 2) / 2 + body.inertia * turning @ turning / 2
    start = SYSTEM.coordinate_name.index("plate_psi")
    psi, phi, theta = state["coordinate"][start : start + 3]
    rates = state["velocity"][start : start + 3]
    to_body = rotation(psi, phi, theta).T
    axes = [np.array([0, 0, 1.0]), np.array([np.cos(psi), np.sin(psi), 0]), rotation(psi, phi, theta)[:, 1]]
    w = to_body @ sum(rate * axis for rate, axis in zip(rates, axes, strict=True))
    plate = next(body for body in SYSTEM.bodies if body.name == "plate")
    centre = speed[SYSTEM.find_node("plate_centre")]
    total += plate.mass * centre @ centre / 2 + w @ np.array(plate.inertia) @ w / 2
    v = state["velocity"]
    assert EVALUATE("kinetic_energy", **state)[0] == pytest.approx(total, rel=1e-13)
    assert v @ EVALUATE("mass_matrix", **state) @ v / 2 == pytest.approx(total, rel=1e-13)


def rotation(psi: float, phi: float, theta: float) -> np.ndarray:
    """R3(psi) R1(phi) R2(theta), as a product of matrices."""
    c, s = np.cos, np.sin
    r3 = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    r1 = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    r2 = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    return r3 @ r1 @ r2


def test_coriolis_force_is_that_of_christoffel_symbols_of_the_mass_matrix() -> None:
    # SCS (9), with the slopes of M by central differences.
    state = random_state(SYSTEM, 5)
    v, n = state["velocity"], SYSTEM.n_coordinates
    slopes = slope("mass_matrix", "coordinate", state).reshape(n, n, n)  # M_ij by q_n
    wanted = np.einsum("ijn,j,n->i", slopes, v, v) - np.einsum("jni,j,n->i", slopes, v, v) / 2
    np.testing.assert_allclose(EVALUATE("coriolis_force", **state), wanted, atol=1e-8)


def test_forces_at_rest_are_the_slope_of_the_energy_and_of_what_has_no_potential() -> None:
    state = random_state(SYSTEM, 7)
    gradient = slope("potential_energy", "coordinate", state).ravel()
    free = EVALUATE("coordinate_force", **state) - EVALUATE("unpotential_force", **state)
    np.testing.assert_allclose(free, -gradient, atol=2e-7)
    stiffness = -slope("coordinate_force", "coordinate", state)
    np.testing.assert_allclose(EVALUATE("tangent_stiffness", **state), stiffness, atol=1e-6)
    lengths = slope("member_length", "coordinate", state)
    np.testing.assert_allclose(EVALUATE("equilibrium_matrix", **state), lengths.T, atol=1e-8)


@pytest.mark.parametrize(
    ("jacobian", "arguments"),
    [("state_jacobian", ("coordinate", "velocity")), ("input_jacobian", ("input",))],
)
def test_jacobians_are_the_slopes_of_the_state_derivative(jacobian: str, arguments: tuple[str, ...]) -> None:
    state = random_state(SYSTEM, 11)
    wanted = np.hstack([slope("state_derivative", argument, state) for argument in arguments])
    found = EVALUATE(jacobian, **state)
    np.testing.assert_allclose(found, wanted, atol=3e-7 * np.abs(wanted).max())


def test_rest_length_and_parameter_jacobians_are_slopes_too() -> None:
    everything = tuple(range(SYSTEM.n_members))
    evaluate = BodyEvaluator(SYSTEM, {"rest_length": everything, "gravity": ()})
    state = random_state(SYSTEM, 13)
    found = evaluate("parameter_jacobian", **state)
    np.testing.assert_allclose(
        found[:, : len(everything)], evaluate("rest_length_jacobian", **state), atol=1e-9
    )
    step = 1e-6 * np.eye(3)
    for axis in range(3):
        high, low = (
            evaluate("state_derivative", **state, gravity=SYSTEM.gravity + sign * step[axis])
            for sign in (1, -1)
        )
        np.testing.assert_allclose(found[:, len(everything) + axis], (high - low) / 2e-6, atol=1e-6)
    changed = SYSTEM.rest_length.copy()
    changed[1] += 1e-6
    high = evaluate("state_derivative", **state, rest_length=changed)
    low = evaluate("state_derivative", **state, rest_length=2 * SYSTEM.rest_length - changed)
    np.testing.assert_allclose(found[:, 1], (high - low) / 2e-6, atol=1e-4)


def test_power_lost_is_that_of_friction_and_damping() -> None:
    state = random_state(SYSTEM, 17)
    q, v = state["coordinate"], state["velocity"]
    a = EVALUATE("acceleration", **state)
    step = 1e-6
    moved = [{"coordinate": q + h * v + h * h * a / 2, "velocity": v + h * a} for h in (step, -step)]
    ahead, behind = (EVALUATE("total_energy", **{**state, **item})[0] for item in moved)
    power = v @ (EVALUATE("unpotential_force", **state) - EVALUATE("damping_matrix", **state) @ v)
    assert (ahead - behind) / (2 * step) == pytest.approx(power, rel=1e-6)
    assert EVALUATE("energy_rate", **state)[0] == pytest.approx(power, rel=1e-12)
    assert np.linalg.eigvalsh(EVALUATE("damping_matrix", **state))[0] > -1e-12


# --- charts ----------------------------------------------------------------------------------------


def two_bars(**stick: Any) -> dict[str, Any]:
    """Two free bars that three tendons hold together; `stick` says how the second one is described."""
    wires = [("post.B", "stick.A"), ("post.A", "stick.B"), ("post.B", "stick.B")]
    return {
        "name": "pair",
        "gravity": [0, 0.5, -1],
        "bodies": {
            "post": {
                "kind": "bar", "length": 1.0, "mass": 0.6, "inertia": 0.15, "centre": [0, 0, 0],
                "direction": [0.3, 0.2, 1.0],
            },
            "stick": {
                "kind": "bar", "length": 0.8, "mass": 0.4, "inertia": 0.064, "centre": [0.5, 0.1, 0.2],
                "direction": [0.6, 0.5, -0.4], **stick,
            },
        },
        "tendons": {
            f"w{k}": {"points": list(e), "spring_constant": 20.0, "rest_length": 0.3, "tension_only": False}
            for k, e in enumerate(wires)
        },
    }  # fmt: skip


def test_the_motion_does_not_depend_on_the_chart() -> None:
    results = []
    for axis in "xyz":
        system, _ = assemble_document(two_bars(polar_axis=axis, azimuth_offset_deg=20))
        evaluate = BodyEvaluator(system)
        # The same velocities of the points, whatever the angles are.
        wanted = np.random.default_rng(3).uniform(-1, 1, 5)
        start = system.coordinate_name.index("stick_x")
        jacobian = evaluate("node_jacobian")[:, start : start + 5]
        spin = np.cross(
            [0.4, -0.3, 0.7], evaluate("node_position")[2:] - system.coordinate[start : start + 3]
        )
        motion = np.zeros_like(evaluate("node_position"))
        motion[2:] = spin + wanted[:3]
        velocity = np.zeros(system.n_coordinates)
        velocity[start : start + 5] = np.linalg.lstsq(jacobian, motion.ravel(), rcond=None)[0]
        np.testing.assert_allclose(evaluate("node_velocity", velocity=velocity), motion, atol=1e-12)
        results.append(
            (evaluate.node_acceleration(velocity=velocity), evaluate("kinetic_energy", velocity=velocity))
        )
    for acceleration, energy in results[1:]:
        np.testing.assert_allclose(acceleration, results[0][0], atol=1e-11)
        assert energy[0] == pytest.approx(results[0][1][0], rel=1e-13)


def test_chart_margin_is_the_sine_of_the_angle_to_the_pole() -> None:
    margin = dict(zip(("leg", "mast", "boom", "stick", "plate"), EVALUATE("chart_margin"), strict=True))
    assert margin["leg"] == pytest.approx(np.sin(np.radians(130)))
    assert margin["mast"] == pytest.approx(np.cos(np.radians(50)))
    assert margin["stick"] == pytest.approx(np.sin(np.radians(70)))
    assert margin["plate"] == pytest.approx(np.cos(np.radians(20)))
    boom = np.array([0.2, 0.8, 0.5]) / np.linalg.norm([0.2, 0.8, 0.5])
    assert margin["boom"] == pytest.approx(np.sqrt(1 - boom[0] ** 2))  # "auto" took the farthest axis, x


# --- bars as constraints, and as stiff springs -----------------------------------------------------


def as_structure(stiffness: float) -> Structure:
    """The two bars as four nodes with half a mass each, their bars as springs."""
    system, _ = assemble_document(two_bars())
    position = BodyEvaluator(system)("node_position")
    members = [bar(0, 1, 1.0, stiffness), bar(2, 3, 0.8, stiffness)]
    members += [spring(i, j, 0.3, 20.0) for i, j in ((1, 2), (0, 3), (1, 3))]
    return make_structure(position, members, gravity=(0, 0.5, -1), mass=[0.3, 0.3, 0.2, 0.2])


def test_accelerations_are_those_of_nodes_with_bars_as_constraints() -> None:
    """Half a bar's mass at each end is J = m l^2 / 4; multipliers keep the lengths in node coordinates."""
    system, _ = assemble_document(two_bars())
    evaluate = BodyEvaluator(system)
    velocity = np.random.default_rng(1).uniform(-1, 1, system.n_coordinates)
    r, w = evaluate("node_position"), evaluate("node_velocity", velocity=velocity)
    mass = np.repeat([0.3, 0.3, 0.2, 0.2], 3)
    force = np.repeat([0.3, 0.3, 0.2, 0.2], 3).reshape(-1, 3) * np.array([0, 0.5, -1.0])
    for i, j in ((1, 2), (0, 3), (1, 3)):
        d = r[i] - r[j]
        pull = 20.0 * (1 - 0.3 / np.linalg.norm(d)) * d
        force[i] -= pull
        force[j] += pull
    rows, drift = np.zeros((2, 12)), np.zeros(2)
    for k, (i, j) in enumerate(((0, 1), (2, 3))):
        d, dv = r[i] - r[j], w[i] - w[j]
        rows[k, 3 * i : 3 * i + 3], rows[k, 3 * j : 3 * j + 3] = d, -d
        drift[k] = dv @ dv
    free = force.ravel() / mass
    multiplier = np.linalg.solve(rows / mass @ rows.T, rows @ free + drift)
    wanted = free - rows.T @ multiplier / mass
    np.testing.assert_allclose(evaluate.node_acceleration(velocity=velocity).ravel(), wanted, atol=1e-11)


def test_forces_on_stiff_springs_become_those_of_rigid_bars() -> None:
    # The generalised force of the bodies is J^T times the forces on the nodes, whatever holds the bars.
    system, _ = assemble_document(two_bars())
    evaluate = BodyEvaluator(system)
    structure = as_structure(1e6)
    model = build_model(structure, ModelRequest(()))
    force = Evaluator(structure)("node_residual").ravel()
    assert model.formulation == "node_position"
    np.testing.assert_allclose(evaluate("coordinate_force"), evaluate("node_jacobian").T @ force, atol=1e-8)


# --- what it refuses -------------------------------------------------------------------------------


def test_a_body_without_inertia_is_refused() -> None:
    system, _ = assemble_document(two_bars())
    light = dataclasses.replace(system.bodies[0], inertia=0.0)
    with pytest.raises(FormulationError, match="without any kinetic energy") as caught:
        build_model(
            system.with_changes(bodies=(light, system.bodies[1])), ModelRequest((), formulation="bodies")
        )
    assert "bodies.post" in caught.value.where


def test_a_parameter_that_bodies_lack_is_refused() -> None:
    with pytest.raises(FormulationError, match="no such run-time parameter"):
        build_model(SYSTEM, ModelRequest((), parameters={"node_mass": (0,)}, formulation="bodies"))


def test_what_is_absent_leaves_no_trace() -> None:
    document = copy.deepcopy(two_bars())
    del document["gravity"]
    evaluate = BodyEvaluator(assemble_document(document)[0])
    evaluate("acceleration")
    assert evaluate.functions["acceleration"].arguments == ("coordinate", "velocity")
    with pytest.raises(FormulationError, match="would be empty"):
        evaluate("damping_matrix")
