"""Every peer computes the same as the package: on the prism, the free icosahedron and a small tower."""

import sys
from dataclasses import replace
from types import ModuleType

import casadi as ca
import numpy as np
import pytest
from harness.ensemble import list_ensemble_ways
from harness.ours import Build, Ours, list_emitters
from harness.problem import LEVELS, Problem, make_problem, make_tower
from harness.session import Session, relative_error
from harness.tools import Tools, Unavailable, find_tools
from peers import casadi_c, casadi_vm, jax_arrays, mujoco_tendons, numba_loops, numpy_arrays
from peers.casadi_expressions import own_expression, unrolled

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.symbolic.build import build_model

NAMES = ("prism", "icosahedron", "tower2")
QUANTITIES = ("node_force", "elastic_energy", "tangent_stiffness", "state_jacobian", "acceleration")
PEERS = (casadi_c, casadi_vm, numpy_arrays, numba_loops, jax_arrays, mujoco_tendons)
NEEDS = {numba_loops: "numba", jax_arrays: "jax", mujoco_tendons: "mujoco"}


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Tools:
    found = find_tools(tmp_path_factory.mktemp("libraries"), 120.0)
    return replace(found, compilers=found.compilers[:1])


def package_value(problem: Problem, quantity: str) -> np.ndarray:
    """Return what the package's expression gives in CasADi's virtual machine."""
    function = prune(build_model(problem.structure, problem.request(quantity)), (quantity,))[0].function
    given = {"coordinate": problem.coordinate, "velocity": np.zeros(len(problem.free))}
    result = function(*[given[name] for name in function.name_in()])
    return np.array(
        ca.DM(result).nonzeros() if quantity.endswith(("stiffness", "jacobian")) else ca.vec(result)
    )


def check(problem: Problem, quantity: str, peer: ModuleType, tools: Tools) -> int:
    """Compare every candidate of the peer with the package; return how many there were."""
    expected, found = package_value(problem, quantity).reshape(-1), 0
    for title, make in peer.ways(problem, quantity, tools):
        try:
            candidate = make()
        except Unavailable:
            continue
        assert candidate.run(2) > 0.0
        assert relative_error(candidate.value(), expected) < 1e-12, title
        found += 1
    return found


@pytest.mark.peers
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.__name__)
def test_a_peer_computes_what_the_package_computes(name: str, peer: ModuleType, tools: Tools) -> None:
    if peer in NEEDS:
        pytest.importorskip(NEEDS[peer], reason=f"{NEEDS[peer]} is not installed (extra `bench`)")
    problem = make_problem(name)
    asked = QUANTITIES if name == "prism" else tuple(q for q in QUANTITIES if q != "state_jacobian")
    found = {quantity: check(problem, quantity, peer, tools) for quantity in asked}
    expected = {"node_force", "acceleration"} if peer is mujoco_tendons else set(QUANTITIES[:3])
    assert expected <= {quantity for quantity, count in found.items() if count}


def test_a_state_of_the_problems_has_slack_cables() -> None:
    problem = make_problem("prism")
    fixed = problem.fixed_position.copy()
    fixed[problem.free] = problem.coordinate
    ends = fixed.reshape(-1, 3)[problem.structure.connectivity]
    slack = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) < problem.rest_length
    assert np.any(slack & problem.tension_only)


def test_a_missing_package_is_told(monkeypatch: pytest.MonkeyPatch, tools: Tools) -> None:
    for module in NEEDS.values():
        monkeypatch.setitem(sys.modules, module, None)
    problem = make_problem("prism")
    for peer in NEEDS:
        _, make = peer.ways(problem, "node_force", tools)[0]
        with pytest.raises(Unavailable, match="not installed"):
            make()


def test_every_emitter_is_a_candidate(tools: Tools) -> None:
    problem, build = make_problem("prism"), Build(tools.compilers[0], "reference")
    ours = Ours(tools.compilation, tools.runner)
    assert "unrolled" in list_emitters()
    for emitter in list_emitters():
        candidate = ours.make(problem, "node_force", emitter, build)
        assert candidate.run(1) > 0.0
        assert np.array_equal(candidate.value(), package_value(problem, "node_force").reshape(-1))
        assert candidate.built is not None
        assert candidate.built.seconds > 0.0


def test_a_candidate_that_computes_something_else_is_not_timed(tools: Tools) -> None:
    right = numpy_arrays.ways(make_problem("prism"), "elastic_energy", tools)[0]
    wrong = numpy_arrays.ways(make_problem("icosahedron"), "elastic_energy", tools)[0]
    session = Session(rounds=1, target=1e-4)
    session.compare(
        "prism", 12, "elastic_energy", [("ours", right), ("peer", ("wrong", wrong[1]))], ("NumPy",)
    )
    good, bad = session.rows
    assert good.ns is not None
    assert bad.ns is None
    assert bad.note == "computes something else"


def test_no_function_of_casadi_is_called_in_its_c(tools: Tools) -> None:
    """gcc keeps calls of functions that another library may replace, unless the flags say that none does."""
    ways = dict(casadi_c.ways(make_problem("prism"), "elastic_energy", tools))
    built = ways[f"{casadi_c.UNROLLED} ({tools.compilers[0].name})"]().built
    assert built is not None
    assert (built.code_bytes or 0) > 0
    slow = replace(tools, compilation=replace(tools.compilation, folder=tools.compilation.folder / "slow"))
    with pytest.MonkeyPatch.context() as patch:
        flags = tuple(flag for flag in casadi_c.FLAGS if "interposition" not in flag)
        patch.setattr(casadi_c, "FLAGS", flags)
        make = dict(casadi_c.ways(make_problem("prism"), "elastic_energy", slow))
        other = make[f"{casadi_c.UNROLLED} ({tools.compilers[0].name})"]().built
    if tools.compilers[0].name == "gcc":
        assert other is not None
        assert other.code_bytes != built.code_bytes


@pytest.mark.peers
@pytest.mark.parametrize("quantity", QUANTITIES[:3])
def test_many_states_are_computed_alike(quantity: str, tools: Tools) -> None:
    pytest.importorskip("numba", reason="numba is not installed (extra `bench`)")
    pytest.importorskip("jax", reason="jax is not installed (extra `bench`)")
    problem, count, found = make_problem("prism"), 5, 0
    expected = package_value(problem, quantity).reshape(-1)
    for _, (title, make) in list_ensemble_ways(
        problem, quantity, tools, Ours(tools.compilation, tools.runner), count
    ):
        try:
            candidate = make()
        except Unavailable:
            continue
        candidate.run(1)
        assert relative_error(candidate.value(), expected) < 1e-12, title
        found += 1
    assert found >= 7


def test_the_towers_have_the_sizes_they_are_named_for() -> None:
    assert [9 * levels + 3 for levels in LEVELS] == [93, 903, 9003, 100_002]
    tower = make_tower(10)
    assert (tower.n_members, tower.n_nodes, tower.n_coordinates) == (93, 33, 90)
    assert len(set(tower.member_name)) == 93
    assert tower.is_bar.sum() == 30


def test_the_expressions_of_peer_and_package_have_the_same_non_zeros() -> None:
    problem = make_problem("tower2")
    for quantity in ("tangent_stiffness", "state_jacobian"):
        ours, theirs = own_expression(problem, quantity), unrolled(problem, quantity)
        assert ours.sparsity_out(0) == theirs.sparsity_out(0)


def test_libraries_are_compiled_once(tools: Tools) -> None:
    command = (*tools.compilers[0].command, "-shared", "-fPIC", "x.c")
    sources = {"x.c": "int x(void) { return 1; }\n"}
    first = tools.compilation.build(sources, command, version="1")
    assert tools.compilation.build(sources, command, version="1") == first
    assert tools.compilation.build(sources, command, version="2").path != first.path
