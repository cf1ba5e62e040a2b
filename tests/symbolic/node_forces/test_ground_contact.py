"""Forces of the ground, against the same equations in plain NumPy.

N = k d^p max(0, 1 + a d') (Hunt and Crossley 1975); T = kt s + ct v, F = T min(1, mu N / |T|),
s' = (F - kt s) / ct.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tests.ground_cases import make_block, make_prism
from tests.models import load, simulator

Array = NDArray[np.float64]
QUANTITIES = (
    "contact_force",
    "penetration",
    "contact_margin",
    "stick_margin",
    "internal_rate",
    "energy_rate",
)


def build(**ground: Any) -> tuple[Structure, CompiledModel]:
    structure = make_block([0.0, 0.0, 0.0], **ground)
    return structure, simulator(structure, more=QUANTITIES)


def find_forces(structure: Structure, place: Array, velocity: Array, bristle: Array) -> dict[str, Array]:
    ground = structure.ground
    assert ground is not None
    n, basis = ground.normal, ground.tangents(structure.axes)
    depth, rate = ground.offset + ground.radius[0] - n @ place, -n @ velocity
    elastic = ground.stiffness * depth**ground.exponent if depth > 0 else 0.0
    normal = elastic * max(0.0, 1.0 + ground.dissipation * rate)
    slip = basis @ (velocity - ground.velocity)
    trial = ground.stick_stiffness * bristle + ground.stick_damping * slip
    size, limit = np.linalg.norm(trial), ground.friction * normal
    friction = trial if size <= limit else trial * (limit / size)
    pull = ground.stick_stiffness * bristle
    bristle_rate = (friction - pull) / ground.stick_damping
    stored = ground.stick_stiffness * bristle @ bristle_rate
    return {
        "contact_force": (normal * n - friction @ basis)[None],
        "penetration": np.array([depth]),
        "stick_margin": np.array([(limit - size) / ground.stick_stiffness if normal > 0 else -1.0]),
        "internal_rate": bristle_rate,
        "energy_rate": (elastic - normal) * rate + stored - friction @ (basis @ velocity),
        "friction": friction,
    }


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_static_forces_are_the_gradient_of_the_energy(exponent: float) -> None:
    """f = -dU/dq with s that follows the node, K = d2U/dq2 with constant s."""
    structure = make_block([0.0, 0.0, 0.0], exponent=exponent)
    model = load(structure, "potential_energy", "node_residual", "tangent_stiffness")
    start, bristle, step = np.array([0.1, 0.2, -1e-4]), np.array([3e-5, -2e-5]), 1e-8

    def compute(name: str, moved: Array, held: bool = False) -> Any:
        s = bristle if held else bristle + moved[:2]
        return model.compute(name, coordinate=start + moved, internal=s)

    force, unit = compute("node_residual", np.zeros(3)), step * np.eye(3)
    slope = [(compute("potential_energy", d) - compute("potential_energy", -d)) / (2 * step) for d in unit]
    np.testing.assert_allclose(force, -np.array(slope), rtol=1e-5, atol=1e-5)
    assert force[:2] == pytest.approx(-1e5 * bristle, rel=1e-12)
    turn = [
        (compute("node_residual", d, True) - compute("node_residual", -d, True)) / (2 * step) for d in unit
    ]
    stiffness = compute("tangent_stiffness", np.zeros(3)).toarray()
    np.testing.assert_allclose(stiffness, -np.array(turn), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_forces_are_those_of_the_equations(exponent: float) -> None:
    rng = np.random.default_rng(4)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    belt = np.cross(normal, rng.normal(size=3))
    structure, model = build(
        normal=normal, offset=0.3, radius=np.array([0.02]), velocity=belt, exponent=exponent
    )
    kinds = set()
    for _ in range(300):
        place = normal * (0.32 + rng.normal() * 1e-3) + np.cross(normal, rng.normal(size=3))
        velocity = belt + rng.normal(size=3) * 10.0 ** rng.uniform(-4, 1)
        bristle = rng.normal(size=2) * 10.0 ** rng.uniform(-6, -3)
        expected = find_forces(structure, place, velocity, bristle)
        state = {"coordinate": place, "velocity": velocity, "internal": bristle}
        for name in ("contact_force", "penetration", "stick_margin", "internal_rate"):
            np.testing.assert_allclose(
                model.compute(name, **state), expected[name], rtol=1e-9, atol=1e-9, err_msg=name
            )
        power = float(model.compute("energy_rate", **state))
        scale = np.abs(expected["contact_force"]).max() * np.abs(velocity).max() + 1e-9
        assert power == pytest.approx(float(expected["energy_rate"]), abs=1e-9 * scale + 1e-7)
        margin = float(model.compute("contact_margin", **state)[0])
        is_pressed = bool(np.any(expected["contact_force"]))
        assert (margin > 0) == is_pressed
        kinds.add((is_pressed, bool(expected["stick_margin"][0] > 0)))
    assert kinds == {(False, False), (True, False), (True, True)}


def find_rates(structure: Structure, state: Array) -> Array:
    """Return (q', q'', z') of one node of 1 kg; states may be complex, for derivatives."""
    ground = structure.ground
    assert ground is not None
    place, velocity, bristle = state[:3], state[3:6], state[6:]
    n, basis = ground.normal, ground.tangents(structure.axes)
    depth, rate = ground.offset + ground.radius[0] - n @ place, -n @ velocity
    factor = 1.0 + ground.dissipation * rate
    pressed = depth.real > 0 and factor.real > 0
    normal = ground.stiffness * depth**ground.exponent * factor if pressed else 0.0
    trial = ground.stick_stiffness * bristle + ground.stick_damping * (basis @ (velocity - ground.velocity))
    size, limit = np.sqrt(trial @ trial), ground.friction * normal
    friction = trial if size.real <= np.real(limit) else trial * (limit / size)
    force = normal * n - friction @ basis + structure.gravity
    return np.concatenate(
        [velocity, force, (friction - ground.stick_stiffness * bristle) / ground.stick_damping]
    )


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_the_state_jacobian_is_the_derivative_in_every_branch(exponent: float) -> None:
    """By complex steps (Squire, Trapp 1998): open, sticking and slipping contacts."""
    rng = np.random.default_rng(6)
    normal = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
    structure = make_block([0.0, 0.0, 0.0], normal=normal, exponent=exponent)
    model = simulator(structure, more=("state_jacobian", "stick_margin"))
    kinds = set()
    for _ in range(200):
        state = np.concatenate(
            [
                normal * rng.normal() * 1e-3,
                rng.normal(size=3) * 10.0 ** rng.uniform(-4, 0),
                rng.normal(size=2) * 10.0 ** rng.uniform(-6, -3),
            ]
        )
        steps = state[None] + 1e-30j * np.eye(8)
        expected = np.array([find_rates(structure, step).imag / 1e-30 for step in steps]).T
        at = {"coordinate": state[:3], "velocity": state[3:6], "internal": state[6:]}
        found = model.compute("state_jacobian", **at).toarray()
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())
        margin = float(model.compute("stick_margin", **at)[0])
        kinds.add("open" if margin == -1 else "stick" if margin > 0 else "slip")
    assert kinds == {"open", "stick", "slip"}


@pytest.mark.parametrize("formulation", ["node_position", "rigid_bar"])
def test_the_state_jacobian_of_a_prism_is_the_derivative_of_its_rates(formulation: str) -> None:
    """By central differences over 1e-7 m, m/s."""
    rng, prism = np.random.default_rng(7), make_prism()
    prism = prism.with_changes(node_position=prism.node_position - [0.0, 0.0, 0.502])
    if formulation == "node_position":
        prism = prism.with_changes(spring_constant=np.where(prism.is_rigid, 2e4, prism.spring_constant))
    model = simulator(prism, more=("state_jacobian", "state_derivative"), formulation=formulation)
    names, sizes = ("coordinate", "velocity", "internal"), (18, 18, 12)

    def split(state: Array) -> dict[str, Array]:
        return dict(zip(names, np.split(state, np.cumsum(sizes)[:-1]), strict=True))

    state = np.concatenate([model.nominal("coordinate"), rng.normal(size=18), 1e-4 * rng.normal(size=12)])
    found = model.compute("state_jacobian", **split(state)).toarray()
    rates = [
        np.asarray(model.compute("state_derivative", **split(state + sign * 1e-7 * direction)))
        for direction in np.eye(len(state))
        for sign in (1, -1)
    ]
    expected = (np.array(rates[::2]) - np.array(rates[1::2])).T / 2e-7
    assert found.shape == (48, 48)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("static_friction", [None, 0.7])
def test_an_open_foot_at_rest_is_not_taken_to_stick(static_friction: float | None) -> None:
    """T = N = 0: the force stays zero under every small change, and the bristle has s' = -(kt / ct) s."""
    prism = make_prism(static_friction=static_friction)
    prism = prism.with_changes(node_position=prism.node_position - [0.0, 0.0, 0.502])
    more, events = (
        ("state_jacobian", "state_derivative"),
        None if static_friction is None else ("ground", "stick"),
    )
    model = simulator(prism, "rodas", more=more, formulation="rigid_bar", events=events)
    internal = np.zeros(len(prism.internal_name))
    internal[12:] = 1.0  # with a static friction: all slip
    jacobian = model.compute("state_jacobian", internal=internal).toarray()
    ends = np.split(jacobian[36:48], 6)
    assert prism.ground is not None
    rate = prism.ground.stick_stiffness / prism.ground.stick_damping
    for foot, rows in enumerate(ends):  # the last three are in the air
        expected = np.zeros_like(rows)
        if foot >= 3:
            expected[:, 36 + 2 * foot : 38 + 2 * foot] = -rate * np.eye(2)
            np.testing.assert_allclose(rows, expected, rtol=1e-14)
            np.testing.assert_array_equal(jacobian[18:36, 36 + 2 * foot : 38 + 2 * foot], 0.0)
        else:
            np.testing.assert_allclose(rows[:, 18 + 3 * foot : 20 + 3 * foot], np.eye(2), rtol=1e-14)


def test_friction_never_exceeds_its_limit_and_never_adds_energy() -> None:
    rng = np.random.default_rng(5)
    structure, model = build()
    assert structure.ground is not None
    for _ in range(500):
        state = {
            "coordinate": np.array([0.0, 0.0, -(10.0 ** rng.uniform(-9, -2))]),
            "velocity": rng.normal(size=3) * 10.0 ** rng.uniform(-9, 1),
            "internal": rng.normal(size=2) * 10.0 ** rng.uniform(-12, -3),
        }
        x, y, z = model.compute("contact_force", **state)[0]
        assert np.hypot(x, y) <= 0.5 * z * (1 + 1e-12)
        assert float(model.compute("energy_rate", **state)) <= 0.0


@pytest.mark.parametrize("depth", [-0.1, 0.0, 1e-3])
def test_a_vertical_touch_without_friction_divides_by_nothing(depth: float) -> None:
    """|T| = 0, N = 0 or not: the stick branch comes first."""
    _, model = build()
    state = {"coordinate": [0.0, 0.0, -depth], "velocity": [0.0, 0.0, -1.0], "internal": [0.0, 0.0]}
    found = {name: model.compute(name, **state) for name in QUANTITIES}
    assert all(np.isfinite(value).all() for value in found.values())
    np.testing.assert_array_equal(found["contact_force"][0, :2], [0.0, 0.0])
    np.testing.assert_array_equal(found["internal_rate"], [0.0, 0.0])
    assert (found["stick_margin"][0] > 0) == (depth > 0)


def test_the_ground_does_not_pull_a_node_that_leaves_fast() -> None:
    _, model = build(dissipation=0.5)
    state = {"coordinate": [0.0, 0.0, -1e-3], "velocity": [0.3, 0.0, 2.5], "internal": [0.0, 0.0]}
    np.testing.assert_array_equal(model.compute("contact_force", **state), np.zeros((1, 3)))
    assert model.compute("contact_margin", **state)[0] < 0


def test_not_a_number_is_a_named_error() -> None:
    from tensegrity_codegen.system.errors import NonFiniteError

    _, model = build()
    with pytest.raises(NonFiniteError, match="internal"):
        model.compute("contact_force", coordinate=np.zeros(3), velocity=np.zeros(3), internal=[np.nan, 0.0])
