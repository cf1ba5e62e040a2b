"""Cables through rings: one tension in all strands, and derivatives that agree with those of the energy."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium, simulate
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import read_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError, StructureError, TensegrityError
from tensegrity_codegen.tables.request import ModelRequest

ROPE = {"kind": "cable", "nodes": ["a", "ring", "b"], "axial_stiffness": 1000.0, "rest_length": 2.2}


def hang_ring(force: tuple[float, float] = (0.0, -50.0), **rope: Any) -> dict[str, Any]:
    """Return a scene in the plane: a rope from (0, 0) to (2, 0) through a ring that carries a load."""
    return {
        "name": "hung",
        "axes": "xz",
        "nodes": {
            "a": {"position": [0, 0], "anchored": True},
            "b": {"position": [2, 0], "anchored": True},
            "ring": {"position": [1.1, -0.5], "mass": 1.0},
        },
        "members": {"rope": ROPE | rope},
        "loads": [{"node": "ring", "force": list(force)}],
        "inputs": [{"name": "winch", "kind": "rest_length", "members": ["rope"]}],
    }


# Three cables over seven strands, two of them twice through one node, two of them damped.
NET = {
    "name": "threaded",
    "gravity": [0, 0, -9.81],
    "nodes": {
        "a": {"position": [0, 0, 0], "anchored": True},
        "b": {"position": [2, 0, 0], "anchored": True},
        "c": {"position": [1, 2, 0], "anchored": "xz", "mass": 0.5},
        "r": {"position": [1.1, 0.4, -0.7], "mass": 1.0},
        "s": {"position": [0.3, 1.4, -0.9], "mass": 2.0},
        "t": {"position": [0.6, 0.7, -1.9], "mass": 0.7},
    },
    "members": {
        "rope": {"kind": "cable", "nodes": ["a", "r", "s", "b"], "axial_stiffness": 1000.0,
                 "prestress": 30.0, "damping": 3.0},
        "loop": {"kind": "cable", "nodes": ["r", "t", "s", "r"], "spring_constant": 800.0, "prestress": 10.0},
        "back": {"kind": "cable", "nodes": ["c", "s", "t", "s"], "spring_constant": 500.0, "prestress": 5.0,
                 "switch_elongation": 0.001, "stiffness_ratio": 0.5, "damping": 2.0},
        "bar": {"kind": "bar", "nodes": ["r", "t"], "axial_stiffness": 1e4, "damping": 1.0},
        "up": {"kind": "cable", "nodes": ["c", "s"], "spring_constant": 100.0, "prestress": 1.0},
    },
    "inputs": [{"name": "winch", "kind": "rest_length", "members": ["rope", "up"]}],
}  # fmt: skip
RIGID = NET | {
    "name": "threaded_rod",
    "members": NET["members"] | {"bar": {"kind": "bar", "nodes": ["r", "t"]}},  # type: ignore[dict-item]
}


def make_structure(document: dict[str, Any]) -> Structure:
    """Return the structure of a scene document."""
    return assemble(read_scene(document))[0]


@pytest.mark.parametrize(
    ("force", "place", "tension"),
    [
        ((0.0, -50.0), (1.0, -0.57787422087632), 49.966003051912),
        ((20.0, -50.0), (1.72374315297, -0.441656484379), None),
    ],
)
def test_ring_hangs_where_its_two_strands_pull_alike(
    force: tuple[float, float], place: tuple[float, float], tension: float | None
) -> None:
    """The tension is the same on both sides, so that without a sideways load both slope alike."""
    found = find_equilibrium(compile_scene(hang_ring(force), for_="equilibrium"), tolerance=1e-13)
    assert found.status == "converged"
    np.testing.assert_allclose(found.node_position[2, [0, 2]], place, rtol=3e-12)
    if tension is not None:
        np.testing.assert_allclose(found.member_tension, [tension], rtol=1e-13)
    np.testing.assert_allclose(
        found.member_length, np.linalg.norm(found.node_position[:2] - found.node_position[2], axis=1).sum()
    )


@pytest.mark.parametrize("document", [NET, RIGID], ids=["node_position", "rigid_bar"])
def test_all_derivatives_are_those_of_energy_and_acceleration(document: dict[str, Any]) -> None:
    """Residual, stiffness and Jacobians, assembled strand by strand, against CasADi's derivatives."""
    formulation = "rigid_bar" if document is RIGID else "node_position"
    model = build_model(make_structure(document), ModelRequest((), formulation=formulation))
    of = model.expression
    q, v, u = (model.arguments[name].symbol for name in ("coordinate", "velocity", "input"))
    energy, tension, derivative = of("potential_energy"), of("member_tension"), of("state_derivative")
    pairs = {
        "node_residual": -ca.gradient(energy, q),
        "tangent_stiffness": ca.hessian(energy, q)[0],
        "equilibrium_matrix": ca.jacobian(of("member_length"), q).T,
        "input_jacobian": ca.jacobian(derivative, u),
        "state_jacobian": ca.jacobian(derivative, ca.vertcat(q, v)),
    }
    if formulation == "node_position":
        force = ca.mtimes(of("mass_matrix"), of("acceleration"))
        pairs |= {"damping_matrix": -ca.jacobian(force, v), "tension_jacobian": ca.jacobian(tension, q)}
        stiffness = of("material_stiffness") + of("geometric_stiffness")
        check_equal(model, stiffness, of("tangent_stiffness"))
    for name, expected in pairs.items():
        check_equal(model, of(name), expected)


def check_equal(model: Any, found: ca.SX, expected: ca.SX) -> None:
    """Compare two expressions at places at random where all cables pull."""
    arguments = [model.arguments[name] for name in ("coordinate", "velocity", "input")]
    function = ca.Function("f", [a.symbol for a in arguments], [ca.densify(found), ca.densify(expected)])
    rng = np.random.default_rng(0)
    for _ in range(3):
        place = arguments[0].nominal + 0.02 * rng.standard_normal(len(arguments[0].nominal))
        values = function(place, 0.1 * rng.standard_normal(len(place)), -0.2)
        one, other = (np.array(value) for value in values)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


def test_c_computes_what_the_expressions_say() -> None:
    quantities = ("member_tension", "acceleration", "state_jacobian", "tangent_stiffness", "total_energy")
    document = NET | {"model": {"quantities": list(quantities)}}
    compiled = compile_scene(document)
    model = build_model(make_structure(document), ModelRequest(quantities))
    names = ("coordinate", "velocity", "input")
    rng = np.random.default_rng(1)
    place = model.arguments["coordinate"].nominal + 0.05 * rng.standard_normal(10)
    state = (place, rng.standard_normal(10), np.array([-0.1]))
    for quantity in quantities:
        function = ca.Function("f", [model.arguments[n].symbol for n in names], [model.expression(quantity)])
        expected = np.array(ca.densify(function(*state)))
        found = compiled.compute(quantity, coordinate=place, velocity=state[1], input=state[2])
        found = found.toarray() if hasattr(found, "toarray") else np.asarray(found)
        np.testing.assert_allclose(found.ravel(), expected.reshape(found.shape or (1,)).ravel(), rtol=1e-11)


def test_ring_without_damping_keeps_its_energy() -> None:
    """A heavy ring slides and swings on a rope that goes slack and taut again."""
    document = hang_ring((20.0, -50.0))
    motion = simulate(compile_scene(document, for_="simulate"), t_end=3.0, rtol=1e-9)
    assert motion.status == "ok"
    scale = float(motion.kinetic_energy.max())
    assert np.ptp(motion.total_energy) < 1e-7 * scale
    assert float(motion.member_tension.min()) == 0.0 < float(motion.member_tension.max())


def test_winch_at_one_end_moves_the_ring_by_half_of_what_it_takes_in() -> None:
    """With vertical strands half of a length that disappears shows at the ring."""
    document = hang_ring()
    document["nodes"]["b"]["position"] = [1e-3, 0]
    document["nodes"]["ring"]["position"] = [0, -1.1]
    model = compile_scene(document, for_="equilibrium")
    start, ahead = (find_equilibrium(model, arguments={"input": [u]}) for u in (0.0, -0.2))
    np.testing.assert_allclose(ahead.node_position[2, 2] - start.node_position[2, 2], 0.1025, rtol=1e-5)


@pytest.mark.parametrize(
    ("nodes", "more", "words"),
    [
        (["a", "ring", "ring", "b"], {}, "passes a node twice in a row"),
        (["a", "ring", "b"], {"tension_only": False}, "only a cable that cannot push passes rings"),
        (["a", "ring", "b"], {"kind": "bar"}, "only a cable that cannot push passes rings"),
        (["a", "ring", "b"], {"mass": 1.0}, "no mass of its own"),
        (["a", "rng", "b"], {}, "a node that is not defined"),
        (["a"], {}, "2"),
    ],
)
def test_rings_that_make_no_sense_are_named(nodes: list[str], more: dict[str, Any], words: str) -> None:
    with pytest.raises(TensegrityError, match=words) as caught:
        make_structure(hang_ring(nodes=nodes, **more))
    assert "members.rope" in str(caught.value)


def test_ring_on_the_end_of_its_cable_is_refused_unless_it_is_slack() -> None:
    document = hang_ring()
    document["nodes"]["ring"]["position"] = [0, 0]
    document["members"]["rope"]["rest_length"] = 2.5
    model = compile_scene(document, for_="equilibrium")
    assert model.compute("node_residual").tolist() == [0.0, -50.0]
    assert not model.compute("tangent_stiffness").toarray().any()
    document["members"]["rope"]["rest_length"] = 1.9
    with pytest.raises(StructureError, match="joins two nodes at one place"):
        make_structure(document)


@pytest.mark.parametrize("model", [{"formulation": "node_distance"}, {"emitter": "table"}])
def test_what_does_not_know_rings_says_so(model: dict[str, Any]) -> None:
    with pytest.raises(FormulationError, match="cables through rings are not supported here"):
        compile_scene(hang_ring() | {"model": model})
