"""Linear models: known frequencies, damping ratios, first-order exactness."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, NonFiniteError
from tests.cases import draws
from tests.ground_cases import GRAVITY, make_prism, make_slope
from tests.models import simulator
from tests.random_structures import structures
from tests.reference import ReferenceModel
from tests.runtime.build import bar, make_structure, prism, spring


def oscillator(damping: float):
    """2 kg on 200 N/m along z."""
    return make_structure(
        [[0, 0, 0], [0, 0, -1]], [spring(0, 1, 1.0, 200.0, damping=damping)],
        anchored={0: "z"}, axes="z", mass=2.0,
    )  # fmt: skip


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.9])
def test_damped_oscillator(ratio: float) -> None:
    """f = sqrt(k/m) / 2 pi = 10 / 2 pi Hz and zeta = c / 2 sqrt(k m)."""
    found = linearize(ReferenceModel(oscillator(ratio * 2 * 20)))
    assert found.natural_frequency == pytest.approx([10 / (2 * np.pi)])
    assert found.damping_ratio == pytest.approx([ratio], abs=1e-12)
    assert not np.signbit(found.damping_ratio).any()
    assert found.state_name == ("n1.z", "n1.z'")
    assert found.spectrum.growing == 0


def test_a_sticking_contact_is_a_spring_and_a_damper() -> None:
    """f = sqrt(k / m) / 2 pi with zeta = ct / 2 sqrt(kt m) along the slope; two states do nothing.

    A node may be anywhere along the plane, with its bristle bent accordingly.
    """
    angle = np.radians(20.0)
    slope, downhill = make_slope(angle)
    offset = GRAVITY * np.sin(angle) / 1e5
    names = linearize_quantities("node_position", with_inputs=False)
    model = simulator(slope, "rodas", more=names)
    at = model.nominal("coordinate") + offset * downhill
    found = linearize(model, coordinate=at, arguments={"internal": [offset, 0.0]})
    assert np.abs(found.residual_rate).max() < 1e-12
    assert found.state_name[-2:] == ("n0_stick1", "n0_stick2")
    assert found.natural_frequency == pytest.approx(np.full(3, np.sqrt(1e5) / (2 * np.pi)), rel=1e-9)
    normal = 0.5 * GRAVITY * np.cos(angle) / (2 * np.sqrt(1e5))  # a N / 2 sqrt(k m)
    assert sorted(found.damping_ratio) == pytest.approx([normal, 0.5, 0.5], rel=1e-9)
    assert (found.spectrum.zero_eigenvalues, found.spectrum.growing) == (2, 0)


def test_energies_of_a_balance_are_no_states_of_a_linear_model() -> None:
    slope, _ = make_slope(0.3)
    assert slope.ground is not None
    names = linearize_quantities("node_position", with_inputs=False)
    models = [
        simulator(item, "rodas", more=names)
        for item in (slope, slope.with_changes(ground=replace(slope.ground, balances_energy=True)))
    ]
    plain, balanced = (linearize(model) for model in models)
    assert len(models[1].manifest.internal_name) == len(models[0].manifest.internal_name) + 4
    assert balanced.state_name == plain.state_name
    assert balanced.spectrum.zero_eigenvalues == plain.spectrum.zero_eigenvalues
    assert abs(balanced.A - plain.A).max() == 0.0


def test_a_standing_prism_of_rigid_bars_has_a_linear_model() -> None:
    prism = make_prism()
    prism = prism.with_changes(node_position=prism.node_position - [0.0, 0.0, 0.5001])
    names = linearize_quantities("rigid_bar", with_inputs=False)
    model = simulator(prism, "rodas", more=names, formulation="rigid_bar")
    found = linearize(model)
    assert found.A.shape == (48, 48)
    assert found.variation.shape == (48, 42)  # three bars keep their lengths
    assert found.spectrum.is_complete


def test_overdamped_oscillator_does_not_oscillate() -> None:
    found = linearize(ReferenceModel(oscillator(2 * 2 * 20)))
    assert found.natural_frequency.size == 0
    np.testing.assert_allclose(found.spectrum.eigenvalue, 10 * (-2 + np.array([1, -1]) * 3**0.5))


def test_pendulum_frequencies() -> None:
    """Swings at sqrt(g/l), twice, and stretches at sqrt(k/m)."""
    structure = make_structure(
        [[0, 0, 0], [0, 0, -1]], [bar(0, 1, 1.0, 1e4)], anchored={0: "xyz"}, gravity=(0, 0, -9.81)
    )
    model = ReferenceModel(structure)
    rest = find_equilibrium(model)
    found = linearize(model, coordinate=rest.coordinate)
    swing = np.sqrt(9.81 / rest.member_length[0])
    assert 2 * np.pi * found.natural_frequency == pytest.approx([swing, swing, 100.0], rel=1e-6)
    up = linearize(model, coordinate=[0, 0, 1 - 9.81e-4])
    assert up.spectrum.growing == 2


@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_free_prism_has_twelve_zero_eigenvalues(damping: float) -> None:
    structure = prism(150.0)
    structure = structure.with_changes(damping=np.full(structure.n_members, damping))
    model = ReferenceModel(structure)
    found = linearize(model, coordinate=find_equilibrium(model).coordinate)
    assert found.spectrum.zero_eigenvalues == 12
    assert found.spectrum.growing == 0
    assert found.spectrum.is_complete


@draws(8)
@given(structures(most_nodes=10))
def test_linear_model_is_exact_to_first_order(structure: Structure) -> None:
    model = ReferenceModel(structure)
    found = linearize(model)
    rng = np.random.default_rng(0)
    n, errors = len(found.state) // 2, []
    way, turn = rng.normal(size=2 * n), rng.normal(size=len(found.input))
    exact = model.compute("state_derivative")
    np.testing.assert_allclose(found.A @ found.state + found.B @ found.input + found.c, exact, atol=1e-6)
    for size in (1e-4, 1e-5):
        x, u = found.state + size * way, found.input + size * turn
        true = model.compute("state_derivative", coordinate=x[:n], velocity=x[n:], input=u)
        errors.append(np.linalg.norm(found.A @ x + found.B @ u + found.c - true))
    assert errors[1] <= errors[0] / 50 + 1e-8 * (1 + np.abs(exact).max())


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_large_chain_finds_the_smallest_frequencies(damping: float) -> None:
    """Chain of 801 equal masses and springs: omega_k = 2 sqrt(k/m) sin(k pi / 2 (n + 1))."""
    n = 800
    place = np.zeros((n + 2, 3))
    place[:, 0] = np.arange(n + 2)
    members = [spring(k, k + 1, 1.0, 100.0, damping=damping) for k in range(n + 1)]
    model = ReferenceModel(make_structure(place, members, axes="x", anchored={0: "x", n + 1: "x"}))
    found = linearize(model, frequency_count=5)
    expected = 20 * np.sin(np.arange(1, 6) * np.pi / (2 * (n + 1)))
    assert not found.spectrum.is_complete
    np.testing.assert_allclose(2 * np.pi * found.natural_frequency[:5], expected, rtol=1e-6)
    np.testing.assert_allclose(found.damping_ratio[:5], damping / 200 * expected, rtol=1e-5, atol=1e-12)


def test_bad_requests_are_refused() -> None:
    model = ReferenceModel(oscillator(0.0))
    with pytest.raises(InvalidValueError):
        linearize(model, coordinate=[0.0, 1.0])
    with pytest.raises(NonFiniteError):
        linearize(model, velocity=[float("inf")])

    class Poor(ReferenceModel):
        def has(self, quantity):
            return quantity != "state_jacobian"

    with pytest.raises(FormulationError, match="state_jacobian"):
        linearize(Poor(oscillator(0.0)))
