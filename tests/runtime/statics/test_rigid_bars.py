"""Directions, forces and corrections of rigid bars, in dense and in sparse algebra."""

import numpy as np
import pytest
import scipy

from tensegrity_codegen.runtime.model import rigid_bars
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.model.rigid_bars import RigidBars
from tests.runtime.build import bar, make_structure
from tests.runtime.rigid_reference import RigidReference


def fan() -> tuple[RigidReference, RigidBars]:
    """Bars that meet, one that stands alone, one with an anchored end, a node without bars."""
    place = np.random.default_rng(5).normal(size=(8, 3))
    ends = [(0, 1), (1, 2), (2, 0), (3, 4), (5, 6)]
    members = [bar(i, j, float(np.linalg.norm(place[i] - place[j])), 0.0) for i, j in ends]
    members.append(bar(6, 7, 1.0, 10.0))
    model = RigidReference(make_structure(place, members, anchored={5: "xyz"}))
    return model, RigidBars(model.manifest, model.structure.rest_length[:5])


def test_directions_are_an_orthonormal_basis_of_what_keeps_the_lengths() -> None:
    model, bars = fan()
    jacobian = bars.jacobian(model.structure.node_position)
    basis = bars.find_directions(jacobian).toarray()
    assert basis.shape == (21, 21 - 5)
    np.testing.assert_allclose(basis.T @ basis, np.eye(16), atol=1e-14)
    assert np.abs(jacobian @ basis).max() < 1e-14
    assert len(bars.components) == 3


def test_the_jacobian_is_the_derivative_of_the_gaps_and_the_stiffness_that_of_the_forces() -> None:
    model, bars = fan()
    q = model.nominal("coordinate").ravel()
    step = np.random.default_rng(6).normal(size=q.shape)
    density = np.arange(1.0, 6.0)

    def at(s: float) -> tuple[np.ndarray, np.ndarray]:
        position = place_nodes(model, q + s * step)
        length = np.linalg.norm(bars.vectors(position), axis=1)
        return bars.gap(position), bars.jacobian(position).T @ (density * length)

    (gap_1, force_1), (gap_0, force_0) = at(1e-6), at(-1e-6)
    jacobian = bars.jacobian(model.structure.node_position)
    np.testing.assert_allclose((gap_1 - gap_0) / 2e-6, jacobian @ step, atol=1e-8)
    np.testing.assert_allclose((force_1 - force_0) / 2e-6, bars.stiffness(density) @ step, atol=1e-7)


@pytest.mark.parametrize("dense", [0, 200])
def test_forces_are_balanced_and_gaps_closed(dense: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rigid_bars, "DENSE_BARS", dense)
    model, bars = fan()
    position = model.structure.node_position
    jacobian = bars.jacobian(position)
    tension = np.array([1.0, -2.0, 3.0, -4.0, 5.0])
    np.testing.assert_allclose(bars.find_tension(jacobian, jacobian.T @ tension), tension, rtol=1e-12)
    gap = np.array([1e-3, 0, -2e-3, 0, 1e-3])
    np.testing.assert_allclose(jacobian @ bars.find_correction(position, gap), -gap, atol=1e-16)


def test_dense_sums_over_pairs_of_entries_are_those_of_sparse_products_bit_by_bit() -> None:
    model, bars = fan()
    rng = np.random.default_rng(7)
    jacobian = bars.jacobian(model.structure.node_position + rng.normal(size=(8, 3)))
    stiffness, density = rng.normal(size=(21, 21)), rng.normal(size=5)
    turning = bars.stiffness(density).toarray()
    along = (jacobian.T @ scipy.sparse.diags_array(density) @ jacobian).toarray()
    np.testing.assert_array_equal(bars.bend(stiffness, density, jacobian), stiffness + turning - along)
    np.testing.assert_array_equal(bars.pull(jacobian, density), jacobian.T @ density)
    assert jacobian.has_canonical_format
    assert jacobian.shape == (5, 21)
