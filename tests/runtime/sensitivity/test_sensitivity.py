"""Sensitivities of equilibria: Taylor remainders, closed forms, gauges, accuracy, and what is refused."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.sensitivity import static_system
from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity, equilibrium_sensitivity
from tensegrity_codegen.runtime.statics.equilibrium import build_problem, find_equilibrium
from tensegrity_codegen.runtime.statics.on_ground import continue_on_ground
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    NonFiniteError,
    SingularStiffnessError,
    UnknownNameError,
)
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import assemble_document
from tests.cases import thorough
from tests.ground_cases import make_prism
from tests.models import load
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.sensitivity.taylor import check_slopes, find_remainders

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"
DOWN = (0.0, 0.0, -9.81)


@cache
def example(name: str) -> Structure:
    structure, _ = load_scene(EXAMPLES / f"{name}.toml")
    assert isinstance(structure, Structure)
    return structure


def with_stiffness(subject: Any, law: str) -> Any:
    """Return the structure with the same stiffness at its rest lengths by spring constants or by EA."""
    mu = subject.spring_constant + subject.axial_stiffness / subject.rest_length
    if law == "spring_constant":
        return subject.with_changes(spring_constant=mu, axial_stiffness=0 * mu)
    return subject.with_changes(spring_constant=0 * mu, axial_stiffness=mu * subject.rest_length)


def set_free(structure: Structure) -> Structure:
    return structure.with_changes(
        node_anchored=np.zeros_like(structure.node_anchored),
        gravity=np.zeros(3),
        node_load=0 * structure.node_load,
    )


def set_held(structure: Structure) -> Structure:
    """Return the structure with the three lowest nodes anchored."""
    lowest = np.argsort(structure.node_position[:, 2], kind="stable")[:3]
    held = np.zeros_like(structure.node_anchored)
    held[lowest] = True
    return structure.with_changes(node_anchored=held)


HOLDS = {"free": set_free, "held": set_held, "example": lambda structure: structure}


def solve(structure: Structure, **options: Any) -> tuple[Any, Sensitivity]:
    model = ReferenceModel(structure)
    start = find_equilibrium(model, tolerance=1e-13, raise_on_failure=False)
    assert start.is_found
    return start, equilibrium_sensitivity(model, start, **options)


def draw(subject: Any, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, subject.n_members) * subject.rest_length


# --- remainders of second order ----------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["axial_stiffness", *thorough("spring_constant")])
@pytest.mark.parametrize("hold", ["free", *thorough(*(hold for hold in HOLDS if hold != "free"))])
@pytest.mark.parametrize("name", ["prism", *thorough("icosahedron", "tower")])
def test_remainders_are_of_second_order(name: str, hold: str, law: str) -> None:
    structure = with_stiffness(HOLDS[hold](example(name)), law)
    start, found = solve(structure)
    assert len(found.gauge) == {"free": 6, "held": 0}.get(hold, len(found.gauge))
    model = ReferenceModel(structure)
    for seed in range(2):
        check_slopes(*find_remainders(model, start, found, structure.rest_length, draw(structure, seed)))


def compile_statics(subject: Any, **options: Any) -> Any:
    parameters = {"rest_length": tuple(range(subject.n_members))}
    request = ModelRequest((), parameters=parameters, **options)
    return build_library(subject, find_needs("sensitivity", subject, request).besides(request)).load()


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "hold"), [("tower", "example"), *thorough(("icosahedron", "free"))])
def test_so_they_are_of_compiled_models(name: str, hold: str) -> None:
    structure = HOLDS[hold](example(name))
    model = compile_statics(structure)
    start = find_equilibrium(model, tolerance=1e-13, raise_on_failure=False)
    found = equilibrium_sensitivity(model, start)
    check_slopes(*find_remainders(model, start, found, structure.rest_length, draw(structure, 3)))


@pytest.mark.thorough
@pytest.mark.parametrize("is_loaded", [True, *thorough(False)])
def test_rigid_bars_and_the_lengths_that_they_keep(is_loaded: bool) -> None:
    """Columns of rigid bars are derivatives by their lengths, rows their tensions; the bars are exact."""
    structure = example("icosahedron")
    is_bar, length = structure.is_bar, structure.member_length()
    structure = structure.with_changes(
        spring_constant=np.where(is_bar, 0.0, structure.spring_constant),
        rest_length=np.where(is_bar, length, structure.rest_length),
        node_load=structure.node_load if is_loaded else 0 * structure.node_load,
    )
    model = compile_statics(structure, formulation="rigid_bar")
    start = find_equilibrium(model, tolerance=1e-12)
    found = equilibrium_sensitivity(model, start)
    assert len(found.gauge) == (4 if is_loaded else 6)
    check_slopes(*find_remainders(model, start, found, structure.rest_length, draw(structure, 0)))
    assert found.smallest_eigenvalue == pytest.approx(start.smallest_eigenvalue, rel=1e-9)


def test_rigid_bars_are_the_limit_of_stiff_ones() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"}, gravity=DOWN, bar_stiffness=1e9)
    is_bar = structure.is_bar
    rigid = structure.with_changes(spring_constant=np.where(is_bar, 0.0, structure.spring_constant))
    _, stiff = solve(structure)
    model = compile_statics(rigid, formulation="rigid_bar")
    found = equilibrium_sensitivity(model, find_equilibrium(model, tolerance=1e-12))
    for one, other in ((found.coordinate, stiff.coordinate), (found.tension, stiff.tension)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5 * np.abs(other).max())


def test_rigid_bars_alone() -> None:
    """A triangle in its plane: each angle follows from the lengths."""
    place = [[0, 0, 0], [1, 0, 0], [0.3, 0.8, 0]]
    length = np.linalg.norm(np.diff([*place, place[0]], axis=0), axis=1)
    members = [bar(k, (k + 1) % 3, float(length[k]), 0.0) for k in range(3)]
    structure = make_structure(place, members, axes="xy")
    request = ModelRequest((), formulation="rigid_bar")
    model = build_library(structure, find_needs("sensitivity", structure, request).besides(request)).load()
    found = equilibrium_sensitivity(model)
    assert found.gauge == ("slide along x", "slide along y", "turn about z")
    check_gauge(structure.node_position, found.node)
    ends = structure.connectivity
    along = (structure.node_position[ends[:, 0]] - structure.node_position[ends[:, 1]]) / length[:, None]
    stretched = np.einsum("eak,ea->ek", found.node[ends[:, 0]] - found.node[ends[:, 1]], along)
    np.testing.assert_allclose(stretched, np.eye(3), atol=1e-12)
    assert np.abs(found.tension).max() < 1e-12


def check_bodies(system: BodySystem) -> tuple[Any, Sensitivity]:
    model = compile_statics(system, formulation="bodies")
    start = find_equilibrium(model, tolerance=1e-13, raise_on_failure=False)
    assert start.is_found, start.message
    found = equilibrium_sensitivity(model, start)
    check_slopes(*find_remainders(model, start, found, system.rest_length, draw(system, 1)))
    return start, found


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["axial_stiffness", *thorough("spring_constant")])
def test_the_tower_of_bodies(law: str) -> None:
    system, _ = load_scene(EXAMPLES / "svd_tower.toml")
    _, found = check_bodies(with_stiffness(system, law))
    assert found.gauge == ()
    assert found.node.shape == (system.n_nodes, 3, system.n_members)


@pytest.mark.thorough
@pytest.mark.parametrize("law", ["spring_constant", "axial_stiffness"])
def test_the_tower_of_bodies_on_a_free_base(law: str) -> None:
    document = tomllib.loads((EXAMPLES / "svd_tower.toml").read_text(encoding="utf-8"))
    del document["loads"]
    free = {"kind": "rigid", "mass": 1, "inertia": [0.05, 0.05, 0.1], "centre": [0, 0, 0]}
    document["bodies"]["base"] |= free
    system, _ = assemble_document(document)
    start, found = check_bodies(with_stiffness(system, law))
    assert len(found.gauge) == 6
    check_gauge(start.node_position, found.node)


def check_gauge(position: np.ndarray, node: np.ndarray) -> None:
    """Check that nodes neither move nor turn on the whole, in any column."""
    local = position - position.mean(axis=0)
    scale = len(position) * np.abs(node).max()
    assert np.abs(node.sum(axis=0)).max() < 1e-10 * scale
    assert np.abs(np.cross(local[:, :, None], node, axis=1).sum(axis=0)).max() < 1e-10 * scale


# --- closed forms, gauge, slack cables -----------------------------------------------------------------


@pytest.mark.parametrize("law", ["spring_constant", "axial_stiffness"])
def test_two_springs_in_a_row_in_closed_form(law: str) -> None:
    """t = (2 - rho_1 - rho_2) / (1/k_1 + 1/k_2), by rest lengths, and the node in between."""
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [cable(0, 1, 0.7, 30.0), spring(1, 2, 0.8, 70.0)],
        anchored={0: "xyz", 1: "yz", 2: "xyz"}, axes="x", mass=0.0,
    )  # fmt: skip
    start, found = solve(with_stiffness(structure, law))
    k, rest, length = structure.spring_constant, structure.rest_length, start.member_length
    # Each by EA: dt/drho = -EA l / rho^2 = -k l / rho at constant length.
    slope = k if law == "spring_constant" else k * length / rest
    expected = np.array([[slope[0], -slope[1]]]) / k.sum()
    np.testing.assert_allclose(found.coordinate, expected, rtol=1e-12)
    tension = -slope * np.array([k[1], k[0]]) / k.sum()
    np.testing.assert_allclose(found.tension, [tension, tension], rtol=1e-12)
    assert found.gauge == ()
    assert found.smallest_eigenvalue == pytest.approx(k.sum())


def test_a_free_structure_neither_slides_nor_turns() -> None:
    start, found = solve(prism())
    assert found.gauge == (*(f"slide along {a}" for a in "xyz"), *(f"turn about {a}" for a in "xyz"))
    check_gauge(start.node_position, found.node)
    np.testing.assert_allclose(found.gauge_motion.T @ found.gauge_motion, np.eye(6), atol=1e-12)


def test_a_structure_on_a_table_slides_and_turns_there() -> None:
    structure = prism(anchored={0: "z", 1: "z", 2: "z"}, gravity=DOWN)
    start, found = solve(structure)
    assert found.gauge == ("slide along x", "slide along y", "turn about z")
    assert not found.node[:3, 2].any()
    assert np.abs(found.node[:, :2].sum(axis=0)).max() < 1e-12
    model = ReferenceModel(structure)
    small = 0.2 * draw(structure, 2)  # soft under its weight: 8e-3 of the rest lengths is far
    check_slopes(*find_remainders(model, start, found, structure.rest_length, small))


def test_slack_cables_are_named_and_have_no_effect() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"}, gravity=DOWN)
    members = [0, 4]  # ends of a cable that hangs between a bottom and a top node
    slack = structure.with_changes(
        member_name=(*structure.member_name, "loose"),
        member_class=(*structure.member_class, "c"),
        connectivity=np.vstack([structure.connectivity, members]),
        is_bar=np.append(structure.is_bar, False),
        tension_only=np.append(structure.tension_only, True),
        rest_length=np.append(structure.rest_length, 5.0),
        spring_constant=np.append(structure.spring_constant, 100.0),
        axial_stiffness=np.append(structure.axial_stiffness, 0.0),
        damping=np.append(structure.damping, 0.0),
        member_mass=np.append(structure.member_mass, 0.0),
        radius=np.append(structure.radius, 0.0),
    )
    _, plain = solve(structure)
    _, found = solve(slack)
    assert found.slack == ("loose",)
    assert not found.coordinate[:, -1].any()
    assert not found.tension[:, -1].any()
    assert not found.tension[-1].any()
    np.testing.assert_allclose(found.coordinate[:, :-1], plain.coordinate, rtol=0, atol=1e-10)


def test_cables_at_their_rest_lengths_are_named() -> None:
    """An unloaded node between two springs, with a cable of exactly its length beside them."""
    members = [spring(0, 1, 1.0), spring(1, 2, 1.0), cable(0, 1, 1.0), cable(0, 1, 1.5), cable(0, 1, 0.9)]
    ends = {0: "xyz", 1: "yz", 2: "xyz"}
    place = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    found = refused(make_structure(place, members[:4], anchored=ends, axes="x"))
    assert (found.slack, found.one_sided) == (("e2", "e3"), ("e2",))
    _, found = solve(make_structure(place, members[3:] + members[:2], anchored=ends, axes="x"))
    assert (found.slack, found.one_sided) == (("e0",), ())


def test_planar_structures_have_one_turn() -> None:
    """A crossed square of bars and cables in the plane x, z."""
    corner = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    members = [cable(k, (k + 1) % 4, 0.9) for k in range(4)]
    members += [bar(k, k + 2, 2**0.5, 1e4) for k in range(2)]
    start, found = solve(make_structure(corner, members, axes="xz"))
    assert found.gauge == ("slide along x", "slide along z", "turn about y")
    structure = make_structure(corner, members, axes="xz")
    model = ReferenceModel(structure)
    check_slopes(*find_remainders(model, start, found, structure.rest_length, draw(structure, 5)))


def test_no_mass_is_needed_and_other_names_and_orders_change_nothing() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"}, mass=0.0)
    _, found = solve(structure)
    order = np.random.default_rng(0).permutation(structure.n_members)
    mixed = structure.with_changes(
        member_name=tuple(f"other{k}" for k in range(structure.n_members)),
        **{
            name: getattr(structure, name)[order]
            for name in (
                *("connectivity", "is_bar", "tension_only", "rest_length", "spring_constant"),
                *("axial_stiffness", "damping", "member_mass", "radius"),
            )
        },
    )
    _, other = solve(mixed)
    np.testing.assert_allclose(other.coordinate, found.coordinate[:, order], rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.tension, found.tension[np.ix_(order, order)], rtol=0, atol=1e-6)


def test_columns_are_members_or_actuators() -> None:
    structure = prism()
    _, whole = solve(structure)
    _, two = solve(structure, columns=["e5", "e2"])
    np.testing.assert_allclose(two.coordinate, whole.coordinate[:, [5, 2]], atol=1e-11)
    assert two.column_name == ("e5", "e2")
    _, winch = solve(structure, columns={"winch": ["e1", "e2"], "motor": "e3"})
    expected = np.column_stack([whole.tension[:, 1] + whole.tension[:, 2], whole.tension[:, 3]])
    np.testing.assert_allclose(winch.tension, expected, atol=1e-8)
    assert winch.column_name == ("winch", "motor")
    inputs = (
        ActuatedInput("winch", "rest_length", (1, 2)),
        ActuatedInput("push", "force", (0,), (1.0, 0.0, 0.0)),
    )
    _, driven = solve(structure.with_changes(inputs=inputs), columns=["winch", "e3"])
    np.testing.assert_allclose(driven.tension, expected, atol=1e-8)
    with pytest.raises(UnknownNameError):
        solve(structure.with_changes(inputs=inputs), columns=["push"])


def test_ranks_name_the_members_that_move_a_node_or_change_a_tension_most() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"})
    _, found = solve(structure)
    ranked = found.rank_for_node("n3", "z", most=3)
    row = found.node[3, 2]
    assert [name for name, _ in ranked] == [f"e{k}" for k in np.argsort(-np.abs(row), kind="stable")[:3]]
    assert [value for _, value in ranked] == sorted(row, key=abs)[:-4:-1]
    (first, value), *_ = found.rank_for_tension("e2", most=1)
    assert value == found.tension[2, int(first[1:])]
    with pytest.raises(UnknownNameError):
        found.rank_for_node("n9")
    with pytest.raises(UnknownNameError):
        found.rank_for_node("n3", "w")
    with pytest.raises(UnknownNameError):
        found.rank_for_tension("n3")
    with pytest.raises(InvalidValueError):
        found.rank_for_node("n3", most=0)


# --- accuracy ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("stiffness", "allowed"), [(1e8, 1e-6), *thorough((1e4, 1e-10), (1e6, 1e-8))])
def test_far_from_the_origin_a_few_digits_are_lost(stiffness: float, allowed: float) -> None:
    """1,000 m away positions have 1e-13 m of rounding, which bars 1e6 times stiffer than cables amplify."""
    near = prism(bar_stiffness=stiffness)
    far = near.with_changes(node_position=near.node_position + np.array([1000.0, -700.0, 400.0]))
    results = []
    for structure in (near, far):
        model = ReferenceModel(structure)
        start = find_equilibrium(model, raise_on_failure=False)  # stops at its rounding where that is larger
        results.append((start, equilibrium_sensitivity(model, start)))
    (at, found), (moved_at, moved) = results
    turn, _ = Rotation.align_vectors(
        *(s.node_position - s.node_position.mean(axis=0) for s in (at, moved_at))
    )
    node = np.einsum("ij,njk->nik", turn.as_matrix(), moved.node)
    for one, other in ((node, found.node), (moved.tension, found.tension)):
        assert np.abs(one - other).max() < allowed * np.abs(other).max()
    assert len(moved.gauge) == 6
    assert moved.smallest_eigenvalue == pytest.approx(found.smallest_eigenvalue, rel=allowed)


def test_casadi_differentiates_the_implicit_function_to_the_same_numbers() -> None:
    """An exact certificate: CasADi's own derivative of its root finder."""
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"}, gravity=DOWN)
    model = build_model(structure, ModelRequest((), {"rest_length": tuple(range(structure.n_members))}))
    q, rho = (model.arguments[name].symbol for name in ("coordinate", "rest_length"))
    balance = {"x": q, "p": rho, "g": model.expression("node_residual")}
    find_root = ca.rootfinder("find_root", "newton", balance, {"abstol": 1e-12})
    start, found = solve(structure)
    length = ca.MX.sym("length", structure.n_members)
    root = find_root(ca.DM(start.coordinate), length)
    tension = ca.Function("tension", [q, rho], [model.expression("member_tension")])(root, length)
    derivative = ca.Function(
        "derivative", [length], [ca.jacobian(root, length), ca.jacobian(tension, length)]
    )
    by_place, by_tension = (np.array(ca.densify(item)) for item in derivative(structure.rest_length))
    np.testing.assert_allclose(found.coordinate, by_place, rtol=0, atol=1e-11 * np.abs(by_place).max())
    np.testing.assert_allclose(found.tension, by_tension, rtol=0, atol=1e-11 * np.abs(by_tension).max())


def test_large_structures_take_the_same_numbers_by_lanczos(monkeypatch: pytest.MonkeyPatch) -> None:
    start, found = solve(example("tower"))
    monkeypatch.setattr(static_system, "DENSE_LIMIT", 10)
    again = equilibrium_sensitivity(ReferenceModel(example("tower")), start)
    assert again.smallest_eigenvalue == pytest.approx(found.smallest_eigenvalue, rel=1e-9)
    assert found.smallest_eigenvalue == pytest.approx(start.smallest_eigenvalue, rel=1e-9)


def test_unstable_equilibria_have_a_sensitivity_too() -> None:
    """An upright pendulum on a spring: its height follows the rest length, its eigenvalue is negative."""
    structure = make_structure([[0, 0, 0], [0, 0, 1]], [spring(0, 1, 1.1, 98.1)], anchored={0: "xyz"},
                               gravity=DOWN)  # fmt: skip
    found = equilibrium_sensitivity(ReferenceModel(structure))
    np.testing.assert_allclose(found.node[1, :, 0], [0, 0, 1], atol=1e-12)
    assert found.smallest_eigenvalue == pytest.approx(-9.81)


# --- what is refused -----------------------------------------------------------------------------------


def refused(structure: Structure, **options: Any) -> Any:
    return equilibrium_sensitivity(ReferenceModel(structure), **options)


def test_a_state_that_is_no_equilibrium_is_refused_with_its_residual() -> None:
    with pytest.raises(InvalidValueError, match=r"no equilibrium") as caught:
        refused(prism(140.0))
    assert "32.3766 N" in caught.value.given
    start, _ = solve(prism())
    with pytest.raises(InvalidValueError, match="no equilibrium"):
        refused(prism(), equilibrium=start, arguments={"rest_length": 1.01 * prism().rest_length})


@pytest.mark.parametrize(
    ("position", "members", "anchored", "axes", "motion"),
    [
        # A node that hangs on a slack cable; two unstressed springs in a row; a square of bars.
        ([[0, 0, 0], [1, 0, 0]], [cable(0, 1, 1.5)], {0: "xyz"}, "xyz", {"n1"}),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [spring(0, 1, 1.0), spring(1, 2, 1.0)], {0: "xyz", 2: "xyz"},
         "xyz", {"n1"}),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [bar(k, (k + 1) % 4, 1.0) for k in range(4)], {},
         "xy", {"n0", "n1", "n2"}),
    ],
)  # fmt: skip
def test_mechanisms_are_refused_by_their_nodes(
    position: Any, members: Any, anchored: Any, axes: str, motion: set[str]
) -> None:
    with pytest.raises(SingularStiffnessError, match="nothing resists") as caught:
        refused(make_structure(position, members, anchored=anchored, axes=axes))
    evidence = caught.value.evidence
    assert set(evidence["motion"]) == motion
    assert abs(evidence["smallest_eigenvalue"]) <= evidence["rounding"]
    assert caught.value.exit_code == 3


def test_a_prism_without_prestress_is_a_mechanism() -> None:
    with pytest.raises(SingularStiffnessError):
        refused(prism(strain=0.0))


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"columns": ["e1", "e1"]}, DuplicateNameError),
        ({"columns": {"winch": ["e1", "e1"]}}, DuplicateNameError),
        ({"columns": ["nothing"]}, UnknownNameError),
        ({"columns": {"winch": ["nothing"]}}, UnknownNameError),
        ({"columns": []}, InvalidValueError),
        ({"columns": {"winch": []}}, InvalidValueError),
        ({"tolerance": 0.0}, InvalidValueError),
        ({"tolerance": float("nan")}, InvalidValueError),
        ({"equilibrium": np.zeros(4)}, InvalidValueError),
        ({"equilibrium": np.full(18, np.nan)}, NonFiniteError),
        ({"arguments": {"coordinate": np.zeros(18)}}, InvalidValueError),
    ],
)
def test_wrong_arguments_are_refused_by_name(options: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error):
        refused(prism(), **options)


def test_a_model_without_the_quantities_is_refused() -> None:
    structure = prism()
    model = load(structure, "member_length")
    with pytest.raises(FormulationError, match="lacks functions"):
        equilibrium_sensitivity(model)


def test_nodes_in_one_place_have_no_sensitivity() -> None:
    with pytest.raises(NonFiniteError, match="not finite"):
        equilibrium_sensitivity(compile_statics(prism()), np.zeros(18))


@pytest.mark.parametrize("frictionless", [False, True])
def test_feet_on_the_ground_stick_or_slide(frictionless: bool) -> None:
    """Differences of equilibria with feet that go on sticking where they do."""
    structure = make_prism()
    cables = tuple(np.flatnonzero(~structure.is_rigid).tolist())
    needed = find_needs("sensitivity", structure, ModelRequest((), formulation="rigid_bar"))
    model = load(structure, *needed.quantities, formulation="rigid_bar", parameters={"rest_length": cables})
    found = find_equilibrium(model, tolerance=1e-13, frictionless=frictionless)
    slopes = equilibrium_sensitivity(model, found)
    column, step = 2, 1e-6
    sides = []
    for sign in (1.0, -1.0):
        length = model.nominal("rest_length").ravel().copy()
        length[column] += sign * step
        problem = build_problem(model, {"rest_length": length})
        assert problem.contacts is not None
        assert found.feet is not None
        problem.contacts.friction = not frictionless
        problem.contacts.begin(found.node_position, found.feet.internal)
        outcome = continue_on_ground(
            problem, found.coordinate, lambda _: pytest.fail("searched"), tolerance=1e-13
        )
        sides.append(outcome.point)
    name = slopes.column_name.index(model.manifest.argument("rest_length").over[column])
    change = (sides[0].tension - sides[1].tension) / (2 * step)
    np.testing.assert_allclose(slopes.tension[:, name], change, atol=1e-6 * np.abs(change).max())


def test_feet_that_slip_have_no_sensitivity() -> None:
    structure = make_prism(friction=0.2)
    needed = find_needs("sensitivity", structure, ModelRequest((), formulation="rigid_bar"))
    model = load(structure, *needed.quantities, formulation="rigid_bar")
    with pytest.raises(FormulationError, match="feet that slip"):
        equilibrium_sensitivity(model, find_equilibrium(model))
