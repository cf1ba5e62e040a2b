"""Loops over members in generated C: the bits and statuses of CasADi's virtual machine, and their text."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.codegen.print.instructions import read_instructions
from tensegrity_codegen.codegen.print.member_loops import MIN_MEMBERS, find_member_loops
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import draws, thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters, offered
from tests.codegen.test_generated_c import arguments_near, assert_same_bits, raw_call
from tests.comparison import dense, run_in_casadi
from tests.random_structures import make_structure, structures
from tests.runtime.build import bar, cable, prism
from tests.runtime.build import make_structure as node_structure

WISHES = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")
QUANTITIES = ("elastic_energy", "member_tension", "node_force", "tangent_stiffness", "acceleration")


def in_space(seed: int, n_nodes: int = 9) -> Structure:
    return make_structure(np.random.default_rng(seed), n_nodes, (0, 1, 2), dict.fromkeys(WISHES, True))


def build(structure: Structure, request: ModelRequest, **how: str) -> CompiledModel:
    return build_library(structure, request, **how).load()


def text_of(structure: Structure, request: ModelRequest) -> str:
    source = emit(structure, request)
    return source.files[f"{source.manifest.name}.c"]


@pytest.mark.thorough
@given(structures(most_nodes=9), st.booleans(), st.integers(0, 2**32 - 1))
@draws(20)
def test_random_structures_equal_the_virtual_machine(
    structure: Structure, changeable: bool, seed: int
) -> None:
    assert_equals_virtual_machine(structure, changeable, seed, {})


@pytest.mark.parametrize("seed", [3, *thorough(4, 5, 6)])
@pytest.mark.parametrize("changeable", [False, *thorough(True)])
def test_all_quantities_of_a_structure_equal_the_virtual_machine(seed: int, changeable: bool) -> None:
    assert_equals_virtual_machine(in_space(seed), changeable, seed, {})


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("family", EACH_FAMILY)
@pytest.mark.parametrize("flags", ["reference", "native"])
def test_every_compiler_and_both_flag_sets_give_the_same_bits(family: str, flags: str) -> None:
    require_compiler(family)
    assert_equals_virtual_machine(in_space(1), False, 1, {"compiler": family, "flags": flags})


def assert_equals_virtual_machine(
    structure: Structure, changeable: bool, seed: int, how: dict[str, str]
) -> None:
    parameters = all_parameters(structure) if changeable else {}
    functions = offered(structure, ModelRequest((), parameters=parameters))
    model = build(structure, ModelRequest(tuple(functions), parameters=parameters), **how)
    arguments = arguments_near(model, seed)
    for name, function in functions.items():
        assert_same_bits(model.compute(name, **arguments), run_in_casadi(function, arguments), name)


def test_a_number_that_is_not_finite_has_the_status_of_the_code_without_loops() -> None:
    """Three members are below the size of a loop: the same structure with them alone tells the statuses."""
    place = np.random.default_rng(2).normal(size=(5, 3))
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 0), (0, 2)]
    structure = node_structure(place, [cable(i, j, 0.5) for i, j in pairs])
    model = build(structure, ModelRequest(("node_force", "tangent_stiffness")))
    assert "for (int e = 0; e < WHOLE_ROWS(6); ++e)" in text_of(structure, ModelRequest(("node_force",)))
    for spec in model.manifest.functions:
        for entry in range(15):
            for value, expected in ((np.nan, "non_finite_input"), (-np.inf, "non_finite_input")):
                coordinate = model.nominal("coordinate")
                coordinate.flat[entry] = value
                status, result = raw_call(model, spec.quantity, coordinate=coordinate)
                assert status == expected
                assert np.isnan(result).all()
            coordinate.flat[entry] = 1e308
            assert raw_call(model, spec.quantity, coordinate=coordinate)[0] == "non_finite_result"


@pytest.mark.parametrize("precision", ["double", *thorough("single")])
@pytest.mark.parametrize("emitter", ["unrolled", "table"])
def test_a_slack_cable_between_coincident_nodes_does_not_pull(emitter: str, precision: str) -> None:
    place = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    members = [cable(1, 2, 0.5, damping=2.0), cable(0, 1, 0.9, damping=2.0), bar(2, 3, 1.5, mu=100.0)]
    structure = node_structure(place, members)
    request = ModelRequest(("node_force", "state_jacobian"), emitter=emitter, precision=precision)
    model = build(structure, request)
    push = 100.0 * (1.5 - np.sqrt(2.0)) / np.sqrt(2.0)
    force = [[10.0, 0, 0], [-10.0, 0, 0], [push, -push, 0], [-push, push, 0]]
    pulls = model.compute("node_force")
    np.testing.assert_allclose(pulls.reshape(4, 3), force, atol=1e-4 if precision == "single" else 1e-13)
    assert np.isfinite(dense(model.compute("state_jacobian", velocity=list(range(12))))).all()
    coordinate = np.array(place, dtype=model.dtype)
    coordinate[2] = coordinate[3]
    with pytest.raises(NonFiniteError, match="the result is not finite"):  # of the bar
        model.compute("node_force", coordinate=coordinate.ravel())


def test_bars_and_cables_share_a_loop_and_bars_push() -> None:
    """Prism: three bars (spring constant 100 times the cables') and nine cables; bars have no limit."""
    structure = prism(150.0)
    text = text_of(structure, ModelRequest(("acceleration",)))
    assert text.count("for (int e = 0; e < WHOLE_ROWS(12); ++e)") == 1
    limits = text[text.index("double limit[16]") :].partition(";")[0]
    assert limits.count("-INFINITY") == structure.is_bar.sum() == 3
    short = structure.with_changes(rest_length=1.2 * structure.rest_length)  # all members want to be longer
    tension = build(short, ModelRequest(("member_tension",))).compute("member_tension")
    length, mu = structure.member_length(), structure.mu
    expected = np.where(structure.is_bar, mu * (length - 1.2 * structure.rest_length), 0.0)
    np.testing.assert_allclose(tension, expected, rtol=1e-12)
    assert (tension[structure.is_bar] < 0).all()


def test_a_slack_net_pulls_with_exact_zeros() -> None:
    place = np.random.default_rng(8).normal(size=(5, 3))
    structure = node_structure(place, [cable(k, (k + 1) % 5, 100.0) for k in range(5)])
    model = build(structure, ModelRequest(("node_force",)))
    np.testing.assert_array_equal(dense(model.compute("node_force")), 0.0)


@pytest.mark.parametrize("count", [MIN_MEMBERS - 1, MIN_MEMBERS])
def test_few_members_are_written_one_by_one(count: int) -> None:
    place = np.random.default_rng(1).normal(size=(count + 1, 3))
    structure = node_structure(place, [cable(0, k + 1, 0.5) for k in range(count)])
    assert ("member_row" in text_of(structure, ModelRequest(("node_force",)))) == (count == MIN_MEMBERS)


def test_anchored_members_have_the_loop_of_the_others() -> None:
    """A cable to an anchor has a number for a coordinate: still every cable stands in one loop."""
    place = np.random.default_rng(3).normal(size=(6, 3))
    members = [cable(i, j, 0.5) for i, j in ((0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (0, 3))]
    free = node_structure(place, members)
    held = free.with_changes(node_anchored=np.arange(6)[:, None] < np.array([2, 2, 1]))
    for quantity in QUANTITIES:
        text = text_of(held, ModelRequest((quantity,)))
        assert text.count("for (int e = 0; e < WHOLE_ROWS(7); ++e)") == 1, quantity
    model, without = build(held, ModelRequest(QUANTITIES)), build(free, ModelRequest(QUANTITIES))
    np.testing.assert_array_equal(model.compute("member_tension"), without.compute("member_tension"))
    assert model.compute("elastic_energy") == without.compute("elastic_energy")


def test_every_operation_of_a_member_is_in_one_loop() -> None:
    """The twelve lengths of a prism are twelve square roots, each in the loop once."""
    structure = prism(150.0)
    (function,) = prune(build_model(structure, ModelRequest(("node_force",))), ("node_force",))
    instructions = read_instructions(function.function)
    readers: list[list[int]] = [[] for _ in instructions]
    for k, instruction in enumerate(instructions):
        for operand in instruction.operands:
            readers[operand].append(k)
    loops = find_member_loops(instructions, readers)
    roots = [root for loop in loops for root in loop.members]
    assert len(roots) == len(set(roots)) == structure.n_members
    steps = [k for loop in loops for step in loop.steps for k in step if k is not None]
    assert len(steps) == len(set(steps))


def test_the_name_of_the_former_emitter_is_that_of_this_code() -> None:
    request = ModelRequest(("node_force",), emitter="lanes")
    assert request == replace(request, emitter="unrolled")
    assert emit(prism(150.0), request).manifest.emitter == "unrolled"


LAW_VALUES = {
    "plastic": {"yield_elongation": 0.02, "hardening": 0.1, "isotropic": 0.3},
    "bilinear": {"switch_elongation": 0.03, "stiffness_ratio": 0.2},
    "viscous": {"relaxation_time": 0.1, "relaxed_fraction": 0.4},
}


@pytest.mark.parametrize("seed", [3, *thorough(0, 1, 2, 4, 5)])
def test_members_of_different_laws_equal_the_virtual_machine(seed: int) -> None:
    """Bars and cables that yield, switch, relax or do none of it have conditions of several kinds."""
    random = np.random.default_rng(seed)
    structure = in_space(seed, 8)
    law = random.integers(0, 4, structure.n_members)
    own = {
        name: np.where(law == number, value * random.uniform(0.5, 1.5, structure.n_members), 0.0)
        for number, values in enumerate(LAW_VALUES.values())
        for name, value in values.items()
    }
    mixed = structure.with_changes(law_parameter=own)
    functions = offered(mixed, ModelRequest(()))
    model = build(mixed, ModelRequest(tuple(functions)))
    for k in range(3):
        arguments = arguments_near(model, 10 * seed + k)
        for name, function in functions.items():
            assert_same_bits(model.compute(name, **arguments), run_in_casadi(function, arguments), name)


@pytest.mark.parametrize("name", ["row", "a" * 41])
def test_names_of_single_members_are_not_those_of_arrays(name: str) -> None:
    """Three bars stand by themselves beside loops; values of one without a short name have its number."""
    place = np.random.default_rng(5).normal(size=(9, 3))
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7), (7, 8), (8, 0)]
    members = [cable(i, j, 0.5) for i, j in pairs]
    structure = node_structure(place, members)
    parameters = {"rest_length": (2, 3, 4)}  # other operations than those of numbers: fewer than a loop has
    request = ModelRequest(("node_force", "tangent_stiffness"), parameters=parameters)
    names = [*structure.member_name]
    names[2] = name
    renamed = structure.with_changes(member_name=tuple(names))
    model, plain = build(renamed, request), build(structure, request)
    for quantity in request.quantities:
        np.testing.assert_array_equal(dense(model.compute(quantity)), dense(plain.compute(quantity)))


def test_members_that_share_a_length_have_a_tension_each_in_a_loop() -> None:
    places = [[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0], [0, -0.1, 0]]
    points = {f"p{k}": place for k, place in enumerate(places)}
    body = {"kind": "rigid", "mass": 1.0, "inertia": [0.01, 0.02, 0.03], "points": points}
    cable = {"kind": "cable", "spring_constant": 100.0, "rest_length": 0.9}
    ends = [{"nodes": [f"a.p{k}", f"b.p{k}"]} for k in range(4)]
    spring = {"spring_constant": 70.0, "rest_length": 0.5}
    members = {f"m{k}": cable | ends[k] for k in range(4)} | {
        f"n{k}": cable | ends[k] | spring for k in range(4)
    }
    scene = {
        "name": "pairs",
        "bodies": {"a": body | {"position": [0.0, 0.0, 0.0]}, "b": body | {"position": [0.0, 0.0, 1.0]}},
        "members": members,
    }
    structure, _ = assemble(parse_scene(scene))
    request = ModelRequest(("member_tension", "acceleration"), formulation="rigid_bar", emitter="unrolled")
    source = emit(structure, request)
    assert "tension_e_2" in source.files["pairs.c"]
    tension = build(structure, request).compute("member_tension")
    of = dict(zip(structure.member_name, tension, strict=True))
    assert [of[f"m{k}"] for k in range(4)] == pytest.approx([10.0] * 4)
    assert [of[f"n{k}"] for k in range(4)] == pytest.approx([35.0] * 4)
