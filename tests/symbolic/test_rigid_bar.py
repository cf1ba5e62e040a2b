"""The formulation with rigid bars: constraint equations, projections, and what is refused (S&K 2; MODEL)."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.rigid_bar_check import find_redundant
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws
from tests.comparison import dense, largest_terms, run_in_casadi
from tests.random_structures import structures
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure

FEW = draws(10)
Array = NDArray[np.float64]


class Evaluated:
    """Quantities of a structure with rigid bars at its own state, by CasADi's virtual machine."""

    def __init__(self, structure: Structure, **options: str) -> None:
        self.structure = structure
        self.model = build_model(structure, ModelRequest((), formulation="rigid_bar", options=options))
        self.arguments = {name: item.nominal for name, item in self.model.arguments.items()}
        self.arguments["input"] = np.zeros(len(structure.inputs))

    def __call__(self, quantity: str, **changes: Array) -> Array:
        (function,) = prune(self.model, (quantity,))
        arguments = {**self.arguments, **changes}
        return dense(run_in_casadi(function, {name: arguments[name] for name in function.arguments}))


def make_rigid(structure: Structure, seed: int) -> Structure:
    """Return the structure with some members turned into rigid bars that do not repeat each other."""
    rng = np.random.default_rng(seed)
    chosen = np.flatnonzero(rng.random(structure.n_members) < 0.5)
    driven = {t for item in structure.inputs if item.kind == "rest_length" for t in item.targets}
    chosen = np.array([e for e in chosen if e not in driven], dtype=np.int64)
    chosen = np.setdiff1d(chosen, find_redundant(structure, chosen)) if chosen.size else chosen
    assume(chosen.size > 0)
    rigid = np.isin(np.arange(structure.n_members), chosen)
    return structure.with_changes(
        is_bar=structure.is_bar | rigid,
        tension_only=structure.tension_only & ~rigid,
        spring_constant=np.where(rigid, 0.0, structure.spring_constant),
        axial_stiffness=np.where(rigid, 0.0, structure.axial_stiffness),
        damping=np.where(rigid, 0.0, structure.damping),
        rest_length=np.where(rigid, structure.member_length(), structure.rest_length),
        node_mass=np.where(structure.node_mass > 0, structure.node_mass, 0.5),
    )


def reference_of(structure: Structure) -> ReferenceModel:
    """Return the reference of the structure without the forces of its rigid bars."""
    faint = np.where(structure.is_rigid, 1e-200, structure.spring_constant)
    return ReferenceModel(structure.with_changes(spring_constant=faint), {})


def solve_saddle(structure: Structure) -> tuple[Array, Array, Array]:
    """Return accelerations, multipliers and J of [H J^T; J 0] [a; lambda] = [f; -|d'|^2], by NumPy."""
    reference = reference_of(structure)
    places = structure.coordinate_node_axis
    arguments = {"coordinate": structure.node_position[places[:, 0], places[:, 1]]}
    arguments["velocity"] = structure.node_velocity[places[:, 0], places[:, 1]]
    mass = dense(reference.compute("mass_matrix"))
    free = reference.compute("acceleration", **arguments, input=np.zeros(len(structure.inputs)))
    bars = np.flatnonzero(structure.is_rigid)
    jacobian = np.zeros((len(bars), len(places)))
    speed = np.zeros(len(bars))
    for row, (i, j) in enumerate(structure.connectivity[bars]):
        d = structure.node_position[i] - structure.node_position[j]
        rate = (structure.node_velocity[i] - structure.node_velocity[j])[list(structure.axes)]
        speed[row] = rate @ rate
        for column, (node, axis) in enumerate(places):
            jacobian[row, column] = d[axis] * (float(node == i) - float(node == j))
    zero = np.zeros((len(bars), len(bars)))
    matrix = np.block([[mass, jacobian.T], [jacobian, zero]])
    solution = np.linalg.solve(matrix, np.concatenate([mass @ np.ravel(free), -speed]))
    return solution[: len(places)], solution[len(places) :], jacobian


@pytest.mark.thorough
@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@FEW
def test_accelerations_and_tensions_solve_the_saddle_system(structure: Structure, seed: int) -> None:
    rigid = make_rigid(structure, seed)
    acceleration, multiplier, jacobian = solve_saddle(rigid)
    found = Evaluated(rigid)
    assume(np.linalg.cond(jacobian @ jacobian.T) < 1e6)
    scale = np.abs(acceleration).max() + 1.0
    assert np.abs(found("acceleration").ravel() - acceleration).max() < 1e-9 * scale
    bars = np.flatnonzero(rigid.is_rigid)
    tension = found("member_tension").ravel()[bars]
    expected = multiplier * rigid.member_length()[bars]
    assert np.abs(tension - expected).max() < 1e-9 * (np.abs(expected).max() + 1.0)
    force = found("node_force").reshape(rigid.n_nodes, len(rigid.axes))
    places = rigid.coordinate_node_axis
    columns = [rigid.axes.index(int(axis)) for axis in places[:, 1]]
    moved = dense(reference_of(rigid).compute("mass_matrix")) @ acceleration
    assert np.abs(force[places[:, 0], columns] - moved).max() < 1e-8 * (np.abs(force).max() + 1.0)


@pytest.mark.thorough
@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@FEW
def test_projections_restore_lengths_and_rates_and_leave_what_keeps_them(
    structure: Structure, seed: int
) -> None:
    rigid = make_rigid(structure, seed)
    _, _, jacobian = solve_saddle(rigid)
    assume(np.linalg.cond(jacobian @ jacobian.T) < 1e4)
    found = Evaluated(rigid)
    q = found.arguments["coordinate"]
    assert np.abs(found("consistent_coordinate").ravel() - q).max() < 1e-14 * (1 + np.abs(q).max())
    noise = 1e-4 * np.random.default_rng(seed).normal(size=q.shape)
    projected = found("consistent_coordinate", coordinate=q + noise).ravel()
    assert np.abs(found("constraint_residual", coordinate=projected)).max() < 1e-14 * (1 + np.abs(q).max())
    v = found("consistent_velocity").ravel()
    assert np.abs(jacobian @ v).max() < 1e-12 * (1 + np.abs(v).max()) * np.abs(jacobian).max()
    again = found("consistent_velocity", velocity=v).ravel()
    assert np.abs(again - v).max() < 1e-12 * (1 + np.abs(v).max())


@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@FEW
def test_statics_are_those_of_the_springs(structure: Structure, seed: int) -> None:
    rigid = make_rigid(structure, seed)
    found, reference = Evaluated(rigid), reference_of(rigid)
    pairs = [(name, name) for name in ("node_residual", "tangent_stiffness")]
    for name, expected in (*pairs, ("spring_tension", "member_tension")):
        value = dense(reference.compute(expected, velocity=np.zeros(rigid.n_coordinates)))
        off = np.abs(found(name).reshape(value.shape) - value)
        assert off.max(initial=0.0) < 1e-9 * (np.abs(value).max(initial=0.0) + 1.0)


def rod(**more: Any) -> Structure:
    """Two masses on a rigid bar, one cable to an anchor."""
    members = [bar(0, 1, 1.0, 0.0), cable(1, 2, 0.5)]
    return make_structure([[0, 0, 0], [1, 0, 0], [1, 1, 0]], members, anchored={2: "xyz"}, **more)


def test_a_lone_bar_turns_about_its_centre_of_mass() -> None:
    members = [bar(0, 1, 2.0, 0.0)]
    structure = make_structure([[-1, 0, 0], [1, 0, 0]], members, mass=3.0)
    spinning = structure.with_changes(node_velocity=np.array([[0, -4.0, 0], [0, 4.0, 0]]))
    found = Evaluated(spinning)
    assert found("acceleration").ravel() == pytest.approx([16.0, 0, 0, -16.0, 0, 0])  # v^2 / r inwards
    assert found("member_tension").ravel() == pytest.approx([48.0])  # m v^2 / r


def test_stiffness_of_all_bars_is_replaced_and_their_scene_length_kept() -> None:
    members = [bar(0, 1, 1.01, 1e4), cable(1, 2, 0.5)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [1, 1, 0]], members, anchored={2: "xyz"})
    assert Evaluated(structure, bars="all")("constraint_residual") == pytest.approx(0.0)
    corrected = Evaluated(structure, bars="all", correction="first_order")
    # The cable pulls across the bar, which carries almost nothing: it is kept at its rest length.
    assert corrected("constraint_residual").ravel() == pytest.approx([-0.01], abs=1e-4)


def test_a_corrected_bar_in_steady_rotation_is_as_long_as_its_tension_makes_it() -> None:
    """The tension m v^2 / r does not change, so that nothing is neglected; without correction t / mu is."""
    members = [bar(0, 1, 2.0 - 48.0 / 1e4, 1e4)]
    structure = make_structure([[-1, 0, 0], [1, 0, 0]], members, mass=3.0)
    spinning = structure.with_changes(node_velocity=np.array([[0, -4.0, 0], [0, 4.0, 0]]))
    corrected = Evaluated(spinning, bars="all", correction="first_order")
    assert corrected("constraint_residual").ravel() == pytest.approx([0.0], abs=1e-12)
    assert corrected("member_tension").ravel() == pytest.approx([48.0])
    assert corrected("rigidity_error").ravel() == pytest.approx([0.0], abs=1e-12)
    assert Evaluated(spinning, bars="all")("rigidity_error").ravel() == pytest.approx([48.0 / 1e4], rel=1e-2)


def test_damping_of_a_cable_is_all_that_takes_energy() -> None:
    structure = rod()
    assert Evaluated(structure)("energy_rate").ravel() == pytest.approx([0.0])
    damped = structure.with_changes(
        damping=np.array([0.0, 2.0]), node_velocity=np.array([[0, -3.0, 0], [0, -3.0, 0], [0, 0, 0]])
    )
    assert Evaluated(damped)("energy_rate").ravel() == pytest.approx([-2.0 * 3.0**2])


def test_what_has_no_determined_bar_forces_is_refused() -> None:
    with pytest.raises(FormulationError, match="needs a rigid bar"):
        build_model(make_structure([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.0)]), request_of())
    triangle = [bar(0, 1, 1.0, 0.0), bar(1, 2, np.sqrt(2), 0.0), bar(0, 2, 1.0, 0.0)]
    held = make_structure([[0, 0, 0], [1, 0, 0], [0, 1, 0]], triangle, anchored={0: "xyz", 1: "xyz"})
    with pytest.raises(FormulationError, match="not determined") as caught:
        build_model(held, request_of())
    assert "e0" in str(caught.value)
    twice = [bar(0, 1, 1.0, 0.0), bar(0, 1, 1.0, 0.0)]
    with pytest.raises(FormulationError, match="not determined"):
        build_model(make_structure([[0, 0, 0], [1, 0, 0]], twice), request_of())


def test_a_rigid_bar_has_no_stiffness_at_run_time() -> None:
    for name in ("spring_constant", "axial_stiffness", "damping"):
        with pytest.raises(FormulationError, match="can change at run time"):
            build_model(rod(), request_of({name: (0,)}))
    build_model(rod(), request_of({"damping": (1,), "rest_length": (0, 1), "node_mass": (0,)}))


def request_of(parameters: dict[str, tuple[int, ...]] | None = None) -> ModelRequest:
    return ModelRequest((), parameters=parameters or {}, formulation="rigid_bar")


def test_repeated_bars_are_found_in_every_set_that_free_nodes_join() -> None:
    place = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 5, 0], [1, 5, 0], [0, 6, 0], [9, 9, 9], [9, 9, 8]]
    ends = [(0, 1), (1, 2), (3, 4), (4, 5), (5, 3), (6, 7)]
    members = [bar(i, j, float(np.linalg.norm(np.subtract(place[i], place[j]))), 0.0) for i, j in ends]
    held = {0: "xyz", 2: "xyz", 3: "xyz", 5: "xyz", 6: "xyz"}
    structure = make_structure(place, members, anchored=held)
    redundant = find_redundant(structure, np.arange(6))
    # One of the two collinear bars between anchors, and the bar between two anchors.
    assert len(redundant) == 2
    assert redundant[0] in (0, 1)
    assert redundant[1] == 4


@pytest.mark.thorough
@given(structures(most_nodes=12), st.integers(0, 2**32 - 1))
@FEW
def test_matrices_and_reactions_are_those_of_springs_and_tensions_of_bars(
    structure: Structure, seed: int
) -> None:
    """The reference adds up springs in NumPy; bars come in by the multipliers of the saddle system."""
    rigid = make_rigid(structure, seed)
    _, multiplier, jacobian = solve_saddle(rigid)
    assume(np.linalg.cond(jacobian @ jacobian.T) < 1e6)
    reference, found = reference_of(rigid), Evaluated(rigid)
    at = {name: found.arguments[name] for name in ("coordinate", "velocity")}
    at["input"] = np.zeros(len(rigid.inputs))
    for name in ("material_stiffness", "geometric_stiffness", "damping_matrix", "equilibrium_matrix"):
        expected = dense(reference.compute(name, **at))
        if np.any(expected) and (name != "damping_matrix" or np.any(rigid.damping)):
            atol = max(1e-12 * np.abs(expected).max(), 1e-150)  # products of smaller numbers underflow
            np.testing.assert_allclose(found(name), expected, rtol=0, atol=atol)
    parts = [found(name) for name in ("material_stiffness", "geometric_stiffness") if _has(found, name)]
    if parts:
        whole = found("tangent_stiffness")
        np.testing.assert_allclose(sum(parts), whole, rtol=0, atol=1e-12 * np.abs(whole).max())
    if not np.any(rigid.node_anchored[:, list(rigid.axes)]):
        return
    pull = np.zeros((rigid.n_nodes, 3))
    for e, value in zip(np.flatnonzero(rigid.is_rigid), multiplier, strict=True):
        i, j = rigid.connectivity[e]
        d = value * (rigid.node_position[i] - rigid.node_position[j])
        pull[i] -= d
        pull[j] += d
    held = rigid.node_anchored[:, list(rigid.axes)]
    expected = np.ravel(reference.compute("support_reaction", **at)) - pull[:, list(rigid.axes)][held]
    scale = np.abs(expected).max() + np.abs(pull).max() + largest_terms(rigid)
    np.testing.assert_allclose(found("support_reaction").ravel(), expected, rtol=0, atol=1e-9 * scale)


def _has(found: Evaluated, name: str) -> bool:
    return bool(found.model.expression(name).nnz())


def test_reactions_and_geometric_stiffness_are_the_limit_of_stiff_bars() -> None:
    """A mast on an anchor under a weight, held upright by stays: bars of 1e9 N/m carry what rigid ones do."""
    place = [[0, 0, 0], [0, 0, 2], [2, 0, 0], [-1, 2, 0], [-1, -2, 0]]
    stays = [cable(1, k, 2.5, 300.0, damping=0.4) for k in (2, 3, 4)]
    anchored = {0: "xyz", 2: "xyz", 3: "xyz", 4: "xyz"}

    def mast(stiffness: float, shorter: float) -> Structure:
        made = make_structure(
            place, [bar(0, 1, 2.0 + shorter, stiffness), *stays], anchored=anchored, gravity=(0, 0, -9.81)
        )
        return made.with_changes(name="mast")

    rigid = Evaluated(mast(0.0, 0.0))
    tension = float(rigid("member_tension").ravel()[0])
    stiff = ReferenceModel(mast(1e9, -tension / 1e9), {})
    found, expected = rigid("support_reaction").ravel(), np.ravel(stiff.compute("support_reaction"))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)

    # Stiffnesses are those without the bars, to which statics add (t / l) (I - u u^T) of each bar.
    bar_part = tension / 2.0 * np.diag([1.0, 1.0, 0.0])
    expected = dense(stiff.compute("geometric_stiffness"))
    assert tension < -100.0
    np.testing.assert_allclose(rigid("geometric_stiffness") + bar_part, expected, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(rigid("equilibrium_matrix"), dense(stiff.compute("equilibrium_matrix")))
    np.testing.assert_allclose(rigid("damping_matrix"), dense(stiff.compute("damping_matrix")), atol=1e-15)
