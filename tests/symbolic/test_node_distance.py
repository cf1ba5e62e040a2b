"""Node distances against node positions and against the saddle system (S&K 3 to 7, MODEL 2 and 3)."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.inertia import Inertia
from tensegrity_codegen.symbolic.pair_coordinates import PairCoordinates
from tensegrity_codegen.system.errors import FormulationError, UnknownKeyError, UnknownNameError
from tensegrity_codegen.tables.request import ModelRequest, complete_options
from tests.cases import draws, thorough
from tests.comparison import dense, largest_terms, run_in_casadi
from tests.random_structures import structures
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring

Array = NDArray[np.float64]
FEW = draws(5)
CHOICES = st.fixed_dictionaries(
    {
        "pairs": st.sampled_from(["connected", "full"]),
        "order": st.sampled_from(["uvec321", "uvec123"]),
        "basis": st.sampled_from(["cycles", "orthonormal"]),
    }
)


class Evaluated:
    """A model in node distances, evaluated by CasADi at node positions and velocities (n_nodes, 3)."""

    def __init__(self, structure: Structure, options: dict[str, str], parameters: Any = None) -> None:
        request = ModelRequest((), parameters or {}, formulation="node_distance", options=options)
        self.structure = structure
        self.model = build_model(structure, request)
        self.arguments = {name: item.nominal for name, item in self.model.arguments.items()}
        mass = Inertia(structure, [float(m) for m in structure.node_mass]).weight_mass()
        self.weight = np.array([float(m) for m in mass])
        self.layout = PairCoordinates(
            structure, options.get("pairs", "connected"), options.get("order", "uvec321"), list(self.weight)
        )

    def at(self, position: Array, velocity: Array) -> "Evaluated":
        self.arguments["coordinate"] = self.layout.compute(position, self.weight)
        self.arguments["velocity"] = self.layout.compute(velocity, self.weight)
        return self

    def __call__(self, quantity: str) -> Array:
        (function,) = prune(self.model, (quantity,))
        return dense(run_in_casadi(function, {name: self.arguments[name] for name in function.arguments}))

    def map(self) -> Array:
        """The matrix from free node coordinates to coordinates: D, and J_c below it."""
        columns = []
        for node, axis in self.structure.coordinate_node_axis:
            unit = np.zeros((self.structure.n_nodes, 3))
            unit[node, axis] = 1.0
            columns.append(self.layout.compute(unit, self.weight))
        return np.array(columns).T


def moved(structure: Structure, seed: int) -> tuple[Array, Array, dict[str, Array]]:
    """Random positions and velocities near the stated ones, and the same as node coordinates."""
    rng, places = np.random.default_rng(seed), structure.coordinate_node_axis
    position, velocity = structure.node_position.copy(), structure.node_velocity.copy()
    position[places[:, 0], places[:, 1]] += 1e-3 * rng.normal(size=len(places))
    arguments = {
        "coordinate": position[places[:, 0], places[:, 1]],
        "velocity": velocity[places[:, 0], places[:, 1]],
    }
    return position, velocity, arguments


def close(found: Array, expected: Array, relative: float = 1e-12, scale: float = 0.0) -> None:
    np.testing.assert_allclose(
        np.reshape(found, expected.shape),
        expected,
        rtol=0,
        atol=relative * max(np.abs(expected).max(initial=0.0), scale, 1e-300),
    )


def with_masses(structure: Structure) -> Structure:
    return structure.with_changes(node_mass=np.where(structure.node_mass > 0, structure.node_mass, 0.5))


def force_to_acceleration(structure: Structure) -> float:
    masses = np.concatenate([structure.node_mass, structure.member_mass / 6])
    return largest_terms(structure) / float(masses[masses > 0].min())


# --- the same mechanics as in node positions ---------------------------------------------------------


@given(structures(most_nodes=12), CHOICES, st.integers(0, 2**32 - 1))
@FEW
def test_results_are_those_of_node_positions(
    structure: Structure, options: dict[str, str], seed: int
) -> None:
    structure = with_masses(structure)
    position, velocity, arguments = moved(structure, seed)
    reference = ReferenceModel(structure, {})
    found = Evaluated(structure, options).at(position, velocity)
    axes = list(structure.axes)
    close(found("node_position"), position[:, axes])
    close(found("node_velocity"), velocity[:, axes], scale=1e-3)
    energy = np.abs(largest_terms(structure)) * np.abs(position).max() * structure.n_nodes
    for name, scale in (
        ("member_vector", 0.0),
        ("member_length", 0.0),
        ("member_tension", largest_terms(structure)),
        ("node_force", largest_terms(structure)),
        ("potential_energy", energy),
        ("total_energy", energy),
    ):
        close(found(name), dense(reference.compute(name, **arguments)), scale=scale)
    expected = found.map() @ reference.compute("acceleration", **arguments)
    close(found("acceleration"), expected, scale=force_to_acceleration(structure))


@pytest.mark.thorough
@given(structures(most_nodes=10), CHOICES, st.integers(0, 2**32 - 1))
@FEW
def test_jacobians_are_those_of_node_positions_mapped(
    structure: Structure, options: dict[str, str], seed: int
) -> None:
    structure = with_masses(structure)
    position, velocity, arguments = moved(structure, seed)
    parameters = {"rest_length": tuple(range(structure.n_members)), "gravity": ()}
    reference = ReferenceModel(structure, parameters)
    found = Evaluated(structure, options, parameters).at(position, velocity)
    both = np.kron(np.eye(2), found.map())
    to_state = dense(reference.compute("state_jacobian", **arguments))
    scale = np.abs(to_state).max() * 10
    close(found("state_jacobian") @ both, both @ to_state, 1e-11, scale)
    for name in ("rest_length_jacobian", "parameter_jacobian", *["input_jacobian"] * bool(structure.inputs)):
        expected = both @ dense(reference.compute(name, **arguments))
        if np.any(expected):
            close(found(name), expected, 1e-11)


@pytest.mark.thorough
@given(structures(most_nodes=10), st.integers(0, 2**32 - 1))
@FEW
def test_masses_and_stiffnesses_may_change_at_run_time(structure: Structure, seed: int) -> None:
    structure = with_masses(structure)
    chosen = tuple(range(structure.n_nodes))
    rng = np.random.default_rng(seed)
    heavier = structure.with_changes(node_mass=structure.node_mass * rng.uniform(1, 2, structure.n_nodes))
    found = Evaluated(structure, {"pairs": "full"}, {"node_mass": chosen, "gravity": ()})
    found.arguments["node_mass"] = heavier.node_mass
    there = Evaluated(heavier, {"pairs": "full"})
    found.weight = there.weight
    found.at(structure.node_position, structure.node_velocity)
    scale = force_to_acceleration(structure)
    close(found("acceleration"), there("acceleration"), scale=scale)
    close(found("distance_inertia"), there("distance_inertia"))
    close(found("node_position"), there("node_position"))


# --- S&K 4: inertia, Theorem 3, saddle system --------------------------------------------------------


@given(structures(most_nodes=12), CHOICES)
@FEW
def test_diagonal_inertia_carries_the_mass_matrix(structure: Structure, options: dict[str, str]) -> None:
    structure = with_masses(structure)
    found = Evaluated(structure, {**options, "pairs": "full"})
    inertia, d = found("distance_inertia"), found.map()
    assert np.count_nonzero(inertia - np.diag(np.diag(inertia))) == 0
    expected = dense(ReferenceModel(structure, {}).compute("mass_matrix"))
    close(d.T @ inertia @ d, expected, 4e-16 * structure.n_nodes)


@given(structures(most_nodes=12), CHOICES, st.integers(0, 2**32 - 1))
@FEW
def test_maps_from_nodes_are_those_of_the_paper(
    structure: Structure, options: dict[str, str], seed: int
) -> None:
    """delta = D r, r_c = J_c r, and of free structures H = D^T H_delta D + J_c^T M J_c."""
    structure = with_masses(structure)
    position, velocity, _ = moved(structure, seed)
    found = Evaluated(structure, {**options, "pairs": "full"}).at(position, velocity)
    axes = list(structure.axes)
    names = ["difference_map", *(["centre_map"] if found.layout.centres else [])]  # anchors hold them all
    whole = np.vstack([found(name) for name in names])
    close(whole @ position[:, axes].ravel(), found.arguments["coordinate"])
    np.testing.assert_allclose(whole[found.layout.n_differences :].sum(axis=1), 1.0)
    free = ~structure.node_anchored[:, axes].ravel()
    close(whole[:, free], found.map())
    inertia, expected = found("distance_inertia"), ReferenceModel(structure, {}).compute("mass_matrix")
    close((whole.T @ inertia @ whole)[np.ix_(free, free)], dense(expected), 4e-16 * structure.n_nodes)


@given(structures(most_nodes=12), CHOICES)
@FEW
def test_factored_form_is_the_formed_inverse_times_the_forces(
    structure: Structure, options: dict[str, str]
) -> None:
    structure = with_masses(structure)
    found = Evaluated(structure, options)
    scale = force_to_acceleration(structure)
    close(found("distance_inertia_inverse") @ found("distance_force"), found("acceleration"), scale=scale)


def random_masses(n: int, kind: str, seed: int) -> Structure:
    """Free structures with all pairs as members, or with three members a node."""
    rng = np.random.default_rng(seed)
    everything = [(i, j) for i in range(n) for j in range(i + 1, n)]
    tree = [(int(rng.integers(k)), k) for k in range(1, n)]
    rest = [pair for pair in everything if pair not in tree]
    more = rest if kind == "complete" else [rest[k] for k in rng.permutation(len(rest))[: 2 * n]]
    position = rng.uniform(-1, 1, (n, 3))
    members = []
    for i, j in tree + more:
        rest_length = np.linalg.norm(position[i] - position[j]) * rng.uniform(0.9, 1.05)
        make = (cable, spring, bar)[int(rng.integers(3))]
        members.append(make(i, j, rest_length, mu=rng.uniform(50, 500)))
    return make_structure(position, members, mass=rng.uniform(0.2, 2, n), gravity=(0, 0, -9.81))


@pytest.mark.parametrize("kind", ["complete", "sparse"])
@pytest.mark.parametrize("n", [6, 9, *thorough(12, 18, 24, 30)])
def test_full_connected_and_saddle_accelerations_agree(n: int, kind: str) -> None:
    structure = random_masses(n, kind, seed=n)
    full, connected = Evaluated(structure, {"pairs": "full"}), Evaluated(structure, {"pairs": "connected"})
    acceleration = full("acceleration").ravel()
    names = {name: k for k, name in enumerate(full.model.frame.coordinate_name)}
    rows = [names[name] for name in connected.model.frame.coordinate_name]
    close(connected("acceleration").ravel(), acceleration[rows])
    force = full("distance_force").ravel()
    matrix = full("saddle_matrix")
    solution = splu(csc_array(matrix)).solve(np.concatenate([force, np.zeros(len(matrix) - len(force))]))
    close(solution[: len(force)], acceleration)
    inverse = full("distance_inertia_inverse")
    close(inverse @ force, acceleration)


@given(structures(most_nodes=9), CHOICES)
@FEW
def test_multipliers_close_the_balance_of_the_pairs(structure: Structure, options: dict[str, str]) -> None:
    structure = with_masses(structure)
    found = Evaluated(structure, {**options, "pairs": "full"})
    basis = found.model.expression("constraint_basis")
    if basis.nnz() == 0:
        return
    balance = found("distance_inertia") @ found("acceleration").ravel()
    balance = balance + found("constraint_basis") @ found("multiplier").ravel()
    close(balance, found("distance_force").ravel(), scale=largest_terms(structure))


# --- constraints ------------------------------------------------------------------------------------


@given(structures(most_nodes=12), CHOICES, st.integers(0, 2**32 - 1))
@FEW
def test_constraints_hold_wherever_the_nodes_are(
    structure: Structure, options: dict[str, str], seed: int
) -> None:
    position, velocity, _ = moved(structure, seed)
    structure = with_masses(structure)
    found = Evaluated(structure, options).at(position, velocity)
    if found.model.expression("constraint_basis").nnz() == 0:
        return
    basis, d = found("constraint_basis"), found.map()
    n = found.layout.n_differences
    assert np.abs(basis.T[:, :n] @ d[:n]).max() < 1e-14
    assert basis.shape[1] == n - np.linalg.matrix_rank(d[:n])
    assert np.abs(found("constraint_residual")).max() < 1e-13 * max(1.0, np.abs(position).max())
    if options["basis"] == "cycles":
        assert set(np.unique(basis)) <= {-1.0, 0.0, 1.0}
    else:
        close(basis.T @ basis, np.eye(basis.shape[1]))


def test_cycles_of_a_star_have_three_entries_each() -> None:
    """MODEL 2: for n = 6 30 cycles, 90 numbers; an orthonormal basis needs several times that."""
    structure = prism().with_changes(node_anchored=np.zeros((6, 3), dtype=bool))
    cycles = Evaluated(structure, {"pairs": "full", "basis": "cycles"})("constraint_basis")
    assert cycles.shape == (48, 30)
    assert set(np.count_nonzero(cycles, axis=0)) == {3}
    orthonormal = Evaluated(structure, {"pairs": "full", "basis": "orthonormal"})("constraint_basis")
    assert np.count_nonzero(np.abs(orthonormal) > 1e-12) > 3 * 90


def test_a_violated_constraint_shows_in_the_residual() -> None:
    found = Evaluated(prism(), {"pairs": "connected"})
    found.arguments["coordinate"] = found.arguments["coordinate"] + 1e-3 * np.arange(
        found.layout.n_coordinates
    )
    assert np.abs(found("constraint_residual")).max() > 1e-4


@given(structures(most_nodes=12), CHOICES, st.integers(0, 2**32 - 1))
@FEW
def test_closing_the_cycles_keeps_what_is_consistent_and_mends_the_rest(
    structure: Structure, options: dict[str, str], seed: int
) -> None:
    position, velocity, _ = moved(structure, seed)
    found = Evaluated(with_masses(structure), options).at(position, velocity)
    if found.model.expression("constraint_basis").nnz() == 0:
        with pytest.raises(FormulationError, match="no cycle"):
            found("consistent_coordinate")
        return
    for name in ("coordinate", "velocity"):
        good = found.arguments[name]
        close(found(f"consistent_{name}"), good, 1e-14, np.abs(position).max())
    noise = 1e-3 * np.random.default_rng(seed).normal(size=found.layout.n_coordinates)
    found.arguments["coordinate"] = found.arguments["coordinate"] + noise
    positions = found("node_position")
    found.arguments["coordinate"] = found("consistent_coordinate").ravel()
    assert np.abs(found("constraint_residual")).max() < 1e-13
    close(found("node_position"), positions)


# --- coordinates ------------------------------------------------------------------------------------


def triangle(**more: Any) -> Structure:
    members = [spring(0, 1, 0.9), spring(0, 2, 0.8), cable(1, 2, 1.2)]
    return make_structure([[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0.1]], members, **more)


def test_orders_of_components_are_those_of_the_paper() -> None:
    """S&K 3, for n = 3: uvec123 = (121, 131, 231, 122, ...), uvec321 = (121, 122, 123, 131, ...)."""
    pairs = ["n0_n1", "n0_n2", "n1_n2"]
    centre = ("centre_x", "centre_y", "centre_z")
    names = Evaluated(triangle(), {"order": "uvec123"}).model.frame.coordinate_name
    assert names == (*(f"{pair}_{axis}" for axis in "xyz" for pair in pairs), *centre)
    names = Evaluated(triangle(), {"order": "uvec321"}).model.frame.coordinate_name
    assert names == (*(f"{pair}_{axis}" for pair in pairs for axis in "xyz"), *centre)


def test_actuated_members_come_first_and_have_one_block_each() -> None:
    """S&K 6: control-sorted coordinates; G is block diagonal with a 3 x 1 block for each input."""
    inputs = (ActuatedInput("u", "rest_length", (2,)), ActuatedInput("w", "rest_length", (0,)))
    structure = triangle(inputs=inputs)
    structure = structure.with_changes(rest_length=np.array([0.9, 0.8, 1.0]))
    found = Evaluated(structure, {})
    assert found.model.frame.coordinate_name[:7:3] == ("n1_n2_x", "n0_n1_x", "n0_n2_x")
    block = found("control_jacobian")
    direction = [structure.node_position[i] - structure.node_position[j] for i, j in ((1, 2), (0, 1))]
    expected = np.zeros((12, 2))
    for k, (vector, mu) in enumerate(zip(direction, (100.0, 100.0), strict=True)):
        expected[3 * k : 3 * k + 3, k] = mu * vector / np.linalg.norm(vector)
    close(block, expected)


def test_force_jacobian_is_that_of_the_paper() -> None:
    """MODEL 3: df/dd = -mu [(1 - rho/l) I + (rho/l^3) d d^T]; a slack cable has a zero block."""
    structure = triangle()
    found = Evaluated(structure, {})
    expected = np.zeros((12, 12))
    for e, (i, j) in enumerate(structure.connectivity):
        d = structure.node_position[i] - structure.node_position[j]
        length, rho = np.linalg.norm(d), structure.rest_length[e]
        if length > rho or not structure.tension_only[e]:
            block = -100 * ((1 - rho / length) * np.eye(3) + rho / length**3 * np.outer(d, d))
            expected[3 * e : 3 * e + 3, 3 * e : 3 * e + 3] = block
    assert not expected[6:9, 6:9].any()
    close(found("force_jacobian"), expected)


def test_anchored_differences_are_no_coordinates() -> None:
    structure = triangle(anchored={0: "xyz", 1: "yz"})
    names = Evaluated(structure, {}).model.frame.coordinate_name
    assert names == ("n0_n1_x", "n0_n2_x", "n0_n2_y", "n0_n2_z", "n1_n2_x", "n1_n2_y", "n1_n2_z")


def test_parts_that_nothing_joins_have_centres_of_their_own() -> None:
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [5, 0, 0], [5, 2, 0]],
        [spring(0, 1, 0.9), spring(2, 3, 1.5)],
        mass=[1, 1, 1, 3],
    )
    found = Evaluated(structure, {})
    assert found.layout.n_coordinates == 6 + 6
    close(found("node_position"), structure.node_position)
    centres = dict(zip(found.model.frame.coordinate_name, found.arguments["coordinate"], strict=True))
    assert sorted(value for name, value in centres.items() if name.endswith("_y") and "centre" in name) == [
        0,
        1.5,
    ]


def test_names_of_coordinates_stay_apart() -> None:
    structure = replace(triangle(), node_name=("a", "b_c", "a_b"), member_name=("e0", "e1", "e2"))
    names = Evaluated(replace(structure, connectivity=np.array([[0, 1], [2, 1], [2, 0]])), {}).model.frame
    assert len(set(names.coordinate_name)) == 12


# --- what is refused --------------------------------------------------------------------------------


def request(**options: str) -> ModelRequest:
    return ModelRequest((), formulation="node_distance", options=options)


def test_unknown_options_are_refused() -> None:
    with pytest.raises(UnknownKeyError, match="no such option") as key:
        build_model(triangle(), request(pair="full"))
    assert "pairs, order, basis" in str(key.value)
    with pytest.raises(UnknownNameError, match="not one of the words") as word:
        build_model(triangle(), request(order="uvec132"))
    assert "uvec321" in str(word.value)
    with pytest.raises(UnknownKeyError, match="no options"):
        complete_options("node_position", {"pairs": "full"})


def test_what_needs_all_pairs_says_so() -> None:
    model = build_model(triangle(), request(pairs="connected"))
    for name in ("distance_inertia", "multiplier", "saddle_matrix"):
        with pytest.raises(FormulationError, match="needs the pairs of all nodes"):
            model.expression(name)


def test_anchors_that_move_and_rigid_bars_are_refused() -> None:
    structure = triangle(anchored={0: "xyz"})
    moving = ModelRequest((), {"anchor_position": (0,)}, formulation="node_distance")
    with pytest.raises(FormulationError, match="no anchor positions at run time"):
        build_model(structure, moving)
    rigid = structure.with_changes(spring_constant=np.array([0.0, 100, 100]))
    with pytest.raises(FormulationError, match="'node_distance' has no rigid bars"):
        build_model(rigid, request())


def test_a_free_node_without_mass_is_refused_where_it_matters() -> None:
    model = build_model(triangle(mass=[1.0, 0.0, 1.0]), request())
    assert model.expression("member_tension").numel() == 3
    with pytest.raises(FormulationError, match="without mass"):
        model.expression("acceleration")
