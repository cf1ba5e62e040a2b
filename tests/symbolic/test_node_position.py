"""The formulation in node positions against an independent NumPy model (S&K 2, 5)."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.quantities import PARAMETERS
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws
from tests.codegen.subjects import everything
from tests.comparison import dense, largest_terms, run_in_casadi
from tests.random_structures import structures
from tests.reference import ReferenceModel
from tests.runtime.build import cable, make_structure, spring
from tests.symbolic.taylor import check_second_order

SLOW = draws(6)


def offered(structure: Structure, request: ModelRequest) -> list[PrunedFunction]:
    """Return every quantity that has an entry in this structure, pruned."""
    model = build_model(structure, request)
    return offered_by(model, *model.quantities)


def offered_by(model: SymbolicModel, *quantities: str) -> list[PrunedFunction]:
    functions: list[PrunedFunction] = []
    for name in quantities:
        try:
            functions += prune(model, (name,))
        except FormulationError:
            continue
    return functions


def all_parameters(structure: Structure) -> dict[str, tuple[int, ...]]:
    everything = {
        "rest_length": range(structure.n_members),
        "spring_constant": np.flatnonzero(structure.spring_constant),
        "axial_stiffness": np.flatnonzero(structure.axial_stiffness),
        "damping": range(structure.n_members),
        "node_mass": np.flatnonzero(structure.node_mass),
        "node_load": range(structure.n_nodes),
        "gravity": (),
    }
    return {
        name: tuple(int(k) for k in items)
        for name, items in everything.items()
        if len(items) or name == "gravity"
    }


def check_against_reference(structure: Structure, request: ModelRequest, seed: int) -> None:
    reference = ReferenceModel(structure, request.parameters)
    inputs = np.random.default_rng(seed).uniform(-0.05, 0.05, len(structure.inputs))
    for function in offered(structure, request):
        arguments = {name: reference.nominal(name) for name in function.arguments if name != "input"}
        arguments |= {"input": inputs} if structure.inputs else {}
        expected = dense(reference.compute(function.quantity.name, **arguments))
        found = dense(run_in_casadi(function, arguments))
        scale = max(np.abs(expected).max(), 1e-300)
        error = np.abs(found.reshape(expected.shape) - expected).max() / scale
        assert error < 1e-12, (function.quantity.name, error)


@pytest.mark.thorough
@given(structures(), st.integers(0, 2**32 - 1))
@SLOW
def test_every_quantity_equals_the_numpy_model_with_constants_baked_in(
    structure: Structure, seed: int
) -> None:
    check_against_reference(structure, ModelRequest(()), seed)


@given(structures(most_nodes=15), st.integers(0, 2**32 - 1))
@draws(2)
def test_every_quantity_equals_the_numpy_model_with_all_parameters_at_run_time(
    structure: Structure, seed: int
) -> None:
    check_against_reference(structure, ModelRequest((), parameters=all_parameters(structure)), seed)


# --- derivatives by Taylor tests -------------------------------------------------------------------


class Evaluator:
    """Quantities of one structure in CasADi's virtual machine; arguments default to the structure's own."""

    def __init__(self, structure: Structure, parameters: dict[str, tuple[int, ...]] | None = None) -> None:
        request = ModelRequest((), parameters=parameters or {})
        self.model = build_model(structure, request)
        self.nominal = {name: item.nominal for name, item in self.model.arguments.items()}
        self.functions: dict[str, PrunedFunction] = {}

    def __call__(self, quantity: str, **changes: np.ndarray) -> np.ndarray:
        if quantity not in self.functions:
            (self.functions[quantity],) = prune(self.model, (quantity,))
        return dense(run_in_casadi(self.functions[quantity], {**self.nominal, **changes}))

    def along(self, quantity: str, direction: dict[str, np.ndarray]) -> Callable[[float], np.ndarray]:
        """Return the quantity as a function of the step along a direction in several arguments."""
        return lambda h: self(quantity, **{n: self.nominal[n] + h * d for n, d in direction.items()}).ravel()


def draw_direction(evaluator: Evaluator, names: Iterable[str], seed: int) -> dict[str, np.ndarray]:
    """Return a random direction; stiffness, damping and mass change in proportion to what they are."""
    rng = np.random.default_rng(seed)
    proportional = ("spring_constant", "axial_stiffness", "damping", "node_mass")
    direction = {}
    for name in names:
        nominal = evaluator.nominal[name]
        direction[name] = rng.uniform(-1, 1, nominal.shape) * (nominal if name in proportional else 1.0)
    return direction


def terms_of_acceleration(structure: Structure) -> float:
    masses = np.concatenate([structure.node_mass, structure.member_mass / 6])
    return largest_terms(structure) / float(masses[masses > 0].min())


JACOBIANS = {
    "state_jacobian": ("coordinate", "velocity"),
    "input_jacobian": ("input",),
    "rest_length_jacobian": ("rest_length",),
    "parameter_jacobian": PARAMETERS,
}


def check_jacobian(jacobian: str, structure: Structure, seed: int) -> bool:
    """Check a Jacobian if it has an entry (inputs may act on anchors alone); return whether it has."""
    parameters = all_parameters(structure) if jacobian not in ("state_jacobian", "input_jacobian") else {}
    evaluator = Evaluator(structure, parameters)
    if not offered_by(evaluator.model, jacobian):
        return False
    names = [name for name in JACOBIANS[jacobian] if name in evaluator.nominal]
    direction = draw_direction(evaluator, names, seed)
    stacked = np.concatenate([direction[name].ravel() for name in names])
    check_second_order(
        evaluator.along("state_derivative", direction),
        evaluator(jacobian) @ stacked,
        terms_of_acceleration(structure),
        jacobian,
    )
    return True


@pytest.mark.thorough
@pytest.mark.parametrize("jacobian", JACOBIANS)
@given(structure=structures(most_nodes=8), seed=st.integers(0, 2**32 - 1))
@draws(8)
def test_jacobians_leave_a_remainder_of_second_order(jacobian: str, structure: Structure, seed: int) -> None:
    assume(check_jacobian(jacobian, structure, seed))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("jacobian", JACOBIANS)
def test_so_they_do_where_everything_is_present(jacobian: str, seed: int) -> None:
    assert check_jacobian(jacobian, everything()[0], seed)


@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@draws(6)
def test_the_tangent_stiffness_is_the_slope_of_the_residual(structure: Structure, seed: int) -> None:
    evaluator = Evaluator(structure)
    direction = draw_direction(evaluator, ("coordinate",), seed)
    slope = -evaluator("tangent_stiffness") @ direction["coordinate"]
    along = evaluator.along("node_residual", direction)
    check_second_order(along, slope, largest_terms(structure), "tangent_stiffness")


@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@draws(6)
def test_the_residual_is_the_slope_of_the_energy(structure: Structure, seed: int) -> None:
    evaluator = Evaluator(structure)
    direction = draw_direction(evaluator, ("coordinate",), seed)
    slope = np.atleast_1d(-evaluator("node_residual") @ direction["coordinate"])
    extent = np.abs(structure.node_position).max() + 3.0
    terms = largest_terms(structure) * extent * structure.n_members
    check_second_order(evaluator.along("potential_energy", direction), slope, terms, "node_residual")


# --- identities ------------------------------------------------------------------------------------


@given(structures(most_nodes=12))
@draws(6)
def test_stiffness_is_material_plus_geometric_and_symmetric(structure: Structure) -> None:
    evaluator = Evaluator(structure)
    material, geometric, tangent = (
        evaluator(f"{name}_stiffness") for name in ("material", "geometric", "tangent")
    )
    np.testing.assert_allclose(material + geometric, tangent, rtol=0, atol=1e-13 * np.abs(material).max())
    for matrix in (material, geometric, tangent):
        np.testing.assert_array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(material).min() >= -1e-12 * np.abs(material).max()


@given(structures(most_nodes=12))
@draws(6)
def test_tensions_balance_what_acts_on_the_free_coordinates(structure: Structure) -> None:
    """A t = weight + loads - residual at rest, where weight and loads are the residual without members."""
    still = structure.with_changes(node_velocity=np.zeros_like(structure.node_velocity))
    evaluator = Evaluator(still, all_parameters(still))
    soft = {
        name: np.zeros_like(evaluator.nominal[name])
        for name in ("spring_constant", "axial_stiffness")
        if name in evaluator.nominal
    }
    applied = evaluator("node_residual", **soft)
    pulled = evaluator("equilibrium_matrix") @ evaluator("member_tension")
    residual = evaluator("node_residual")
    np.testing.assert_allclose(applied - pulled, residual, rtol=0, atol=1e-12 * largest_terms(structure))


@given(structures(most_nodes=12))
@draws(6)
def test_anchors_carry_weight_and_loads(structure: Structure) -> None:
    """Along an axis that is modelled, residuals minus reactions add up to weight and loads."""
    still = structure.with_changes(node_velocity=np.zeros_like(structure.node_velocity))
    evaluator = Evaluator(still)
    axes = list(still.axes)
    weight = (still.node_mass.sum() + still.member_mass.sum()) * still.gravity[axes]
    total = evaluator("node_force").sum(axis=0)
    atol = 1e-12 * largest_terms(structure) * structure.n_members
    np.testing.assert_allclose(total, weight + still.node_load[:, axes].sum(axis=0), rtol=0, atol=atol)
    if still.node_anchored[:, axes].any():
        anchored = still.node_anchored[:, axes]
        force = evaluator("node_force")
        np.testing.assert_allclose(force[anchored], -evaluator("support_reaction"), rtol=0, atol=atol)
        np.testing.assert_allclose(force[~anchored], evaluator("node_residual"), rtol=0, atol=atol)


# --- slack cables, coincident nodes ----------------------------------------------------------------


def two_members(rest: float) -> Structure:
    """A taut two-sided spring 0-1, and a cable 1-2 of length 1 that is slack from a rest length of 1 on."""
    members = [spring(0, 1, 0.9), cable(1, 2, rest, damping=2.0)]
    position = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    return make_structure(position, members).with_changes(node_velocity=np.arange(9.0).reshape(3, 3))


@pytest.mark.parametrize("rest", [1.0, 1.1])
def test_a_slack_cable_leaves_zero_blocks(rest: float) -> None:
    evaluator = Evaluator(two_members(rest))
    cable_end = slice(6, 9)
    for name in ("material_stiffness", "geometric_stiffness", "tangent_stiffness", "damping_matrix"):
        matrix = evaluator(name)
        assert not matrix[cable_end].any()
        assert not matrix[:, cable_end].any()
    assert not evaluator("state_jacobian")[9 + 6 :].any()
    assert not evaluator("rest_length_jacobian")[:, 1].any()
    assert evaluator("rest_length_jacobian")[:, 0].any()
    assert evaluator("member_tension").tolist() == [pytest.approx(10.0), 0.0]
    assert evaluator("force_density")[1] == 0.0


def test_a_taut_cable_fills_its_blocks() -> None:
    evaluator = Evaluator(two_members(0.9))
    for name in ("material_stiffness", "geometric_stiffness", "damping_matrix"):
        assert evaluator(name)[6:9].any()


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_a_slack_cable_between_coincident_nodes_does_not_pull(damping: float) -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 0.5, damping=damping)])
    evaluator = Evaluator(structure)
    together = np.zeros(6)
    assert evaluator("member_tension", coordinate=together) == [0.0]
    assert evaluator("elastic_energy", coordinate=together) == [0.0]
    assert evaluator("member_length", coordinate=together) == [0.0]
    at = {"coordinate": together, "velocity": np.arange(6.0)}
    for name in (
        "acceleration",
        "force_density",
        "tangent_stiffness",
        "equilibrium_matrix",
        "tension_jacobian",
    ):
        assert not evaluator(name, **at).any()
    jacobian = evaluator("state_jacobian", **at)
    assert jacobian.sum() == 6.0
    assert not jacobian[6:].any()
    assert not evaluator("rest_length_jacobian", **at).any()


def test_a_spring_between_coincident_nodes_has_no_direction() -> None:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 0.5)])
    evaluator = Evaluator(structure)
    assert evaluator("member_tension", coordinate=np.zeros(6)) == [-50.0]
    assert np.isnan(evaluator("acceleration", coordinate=np.zeros(6))).all()


def test_both_stiffness_laws_agree_where_they_must() -> None:
    """EA = k rho gives the same tension and stiffness, but another derivative to rest length (SCS)."""
    place = [[0, 0, 0], [1.2, 0, 0]]
    by_k = Evaluator(make_structure(place, [spring(0, 1, 0.8, mu=50.0)]))
    by_area = Evaluator(make_structure(place, [spring(0, 1, 0.8, mu=0.0, axial=40.0)]))
    for name in ("member_tension", "tangent_stiffness", "elastic_energy"):
        np.testing.assert_allclose(by_k(name), by_area(name), rtol=1e-15)
    slope_k, slope_area = (e("rest_length_jacobian")[9, 0] for e in (by_k, by_area))
    assert slope_k == pytest.approx(50.0)
    assert slope_area == pytest.approx(40.0 * 1.2 / 0.8**2)
