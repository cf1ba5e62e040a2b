"""Equilibria of cables with friction at rings: the capstan, equations written anew, what fails."""

from math import exp, pi
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

from tensegrity_codegen import compile_scene, find_equilibrium, linearize, simulate
from tensegrity_codegen.pipeline.settle import find_settled
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError
from tests.cases import thorough
from tests.models import load, simulator

STIFFNESS, REST = 1000.0, 2.2
CABLE = {"kind": "cable", "axial_stiffness": STIFFNESS, "damping": 1.0}


def ring_scene(friction: float, side: float = 20.0, **keys: Any) -> dict[str, Any]:
    """A ring on a cable between two anchors 2 m apart, pulled down by 50 N and aside."""
    nodes = {
        "a": {"position": [0.0, 0.0], "anchored": True},
        "b": {"position": [2.0, 0.0], "anchored": True},
        "ring": {"position": [1.0, -0.4583], "mass": 1.0},
    }
    cable = {**CABLE, "nodes": ["a", "ring", "b"], "rest_length": REST, "friction": friction}
    loads = [{"node": "ring", "force": [side, -50.0]}]
    return {"name": "tilted", "axes": "xz", "nodes": nodes, "members": {"c": cable}, "loads": loads, **keys}


def build(document: dict[str, Any]) -> Structure:
    return assemble(parse_scene(document, "scene"), "scene")[0]


def solve_anew(friction: float) -> Any:
    """Return x, z of the ring and what slipped, from balance and capstan; material goes towards a."""
    ends = np.array([[0.0, 0.0], [2.0, 0.0]])

    def pull(values: Any) -> Any:
        x, z, slid = values
        spans = ends - [x, z]
        length = np.linalg.norm(spans, axis=1)
        rest = REST / 2 + np.array([-slid, slid])
        tension = STIFFNESS * (length / rest - 1)
        units = spans / length[:, None]
        turn = pi - np.arccos(units[0] @ units[1])
        force = tension @ units + [20.0, -50.0]
        return [*force, tension[0] - exp(friction * turn) * tension[1]]

    return fsolve(pull, [1.6, -0.5, -0.3], xtol=1e-13)


def test_without_friction_the_ring_hangs_where_one_tension_puts_it() -> None:
    found = find_equilibrium(compile_scene(ring_scene(1e-12), for_="equilibrium"))
    assert found.node_position[2] == pytest.approx([1.72374315297, 0.0, -0.441656484379], abs=2e-10)
    assert found.member_tension[0] == pytest.approx(found.member_tension[1], rel=1e-9)


@pytest.mark.parametrize("friction", [0.02, 0.05, 0.3])
def test_the_ring_slips_to_the_limit_of_the_capstan(friction: float) -> None:
    found = find_equilibrium(compile_scene(ring_scene(friction), for_="equilibrium"))
    x, z, slid = solve_anew(friction)
    assert found.node_position[2, [0, 2]] == pytest.approx([x, z], abs=1e-9)
    assert found.slid == {"c_1": pytest.approx(slid, abs=1e-9)}
    assert found.as_evidence()["slid"] == found.slid
    vectors = found.node_position[[0, 2]] - found.node_position[[2, 1]]
    units = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    turn = np.arccos(units[0] @ units[1])
    assert found.member_tension[0] / found.member_tension[1] == pytest.approx(exp(friction * turn), rel=1e-9)
    assert found.member_tension.sum() > 0


def test_with_much_friction_strands_are_plain_cables() -> None:
    """Those of two cables between which nothing slips."""
    structure = build(ring_scene(1.0))
    stuck = find_equilibrium(compile_scene(ring_scene(1.0), for_="equilibrium"))
    plain = structure.with_changes(sliding=())
    alone = find_equilibrium(load(plain, *EQUILIBRIUM_QUANTITIES))
    assert stuck.slid == {"c_1": 0.0}
    assert stuck.node_position == pytest.approx(alone.node_position, abs=1e-12)
    assert stuck.member_tension == pytest.approx(alone.member_tension, rel=1e-12)


@pytest.mark.parametrize(("weight", "slips"), [(169.0, False), (169.1, True), (300.0, True)])
def test_a_drum_holds_what_the_capstan_says(weight: float, slips: bool) -> None:
    """10 N behind 1.5 turns at 0.3 hold up to 169.020241717 N; beyond, the far strand is pulled through."""
    nodes = {
        "a": {"position": [-1.0, 0.0], "anchored": True},
        "drum": {"position": [0.0, 0.0], "anchored": True},
        "weight": {"position": [0.0, -1.0], "mass": 1.0, "anchored": "x"},
    }
    cable = {**CABLE, "axial_stiffness": 1e7, "nodes": ["a", "drum", "weight"], "prestress": 10.0}
    scene = {
        "name": "drum", "axes": "xz", "nodes": nodes,
        "members": {"rope": {**cable, "friction": 0.3, "wrap_deg": 540.0}},
        "loads": [{"node": "weight", "force": [0.0, -weight]}],
    }  # fmt: skip
    found = find_equilibrium(compile_scene(scene, for_="equilibrium"))
    assert found.member_tension[1] == pytest.approx(weight, rel=1e-9)
    assert (found.slid["rope_1"] != 0.0) == slips
    assert found.member_tension[0] == pytest.approx(weight / 16.9020241717 if slips else 10.0, rel=1e-8)


def chain(n: int, friction: Any) -> dict[str, Any]:
    """A cable through n rings that hang on elastic cables, and are loaded."""
    rng = np.random.default_rng(n)
    path = ["a", *(f"r{k}" for k in range(n)), "z"]
    nodes: dict[str, Any] = {"a": {"position": [0, 0, 0], "anchored": True}}
    members: dict[str, Any] = {}
    for k, name in enumerate(path[1:]):
        at = (k + 1) / (n + 1)
        nodes[name] = {"position": [at, 0.05 * (-1) ** k, -0.1 * k], "mass": 0.5}
        nodes[f"h{k}"] = {"position": [at, 0.3 * (-1) ** k, 1.0], "anchored": True}
        members[f"s{k}"] = {**CABLE, "nodes": [f"h{k}", name], "prestress": 5.0}
    members["c"] = {**CABLE, "nodes": path, "prestress": 5.0, "friction": friction}
    loads = [{"node": name, "force": rng.normal(0.0, 1.5, 3).tolist()} for name in path[1:]]
    return {"name": "chain", "gravity": [0, 0, -9.81], "nodes": nodes, "members": members, "loads": loads}


@pytest.mark.parametrize(
    ("n", "friction"), [(2, 0.02), (3, [0.02, 0.4, 0.05]), *thorough((5, 0.05), (5, 0.3))]
)
def test_several_rings_slip_as_far_as_they_have_to(n: int, friction: Any) -> None:
    model = compile_scene(chain(n, friction), for_="equilibrium")
    found = find_equilibrium(model)
    assert found.status == "converged"
    excess = model.compute("ring_excess", coordinate=found.coordinate, **found.internal_argument)
    behind, before = np.reshape(excess, (-1, 2)).T
    limit, slid = 1e-9 * found.largest_force, np.array(list(found.slid.values()))
    assert max(behind.max(), before.max()) < limit
    assert np.abs(behind[slid > 0]).max(initial=0.0) < limit
    assert np.abs(before[slid < 0]).max(initial=0.0) < limit
    assert slid.any()


def test_a_structure_stays_at_rest_where_friction_holds_it() -> None:
    structure = build(chain(2, 0.1))
    found = find_equilibrium(compile_scene(chain(2, 0.1), for_="equilibrium"))
    motion = simulate(
        simulator(structure, "radau"), 0.5, coordinate=found.coordinate, samples=3, method="radau",
        rtol=1e-9, arguments=found.internal_argument,
    )  # fmt: skip
    assert motion.coordinate[-1] == pytest.approx(found.coordinate, abs=1e-8)


def test_rigid_bars_and_stiff_ones_agree() -> None:
    """A boom on a pin, held by a cable that runs over its tip."""

    def boom(**bar: Any) -> dict[str, Any]:
        nodes = {
            "foot": {"position": [0, 0], "anchored": True},
            "tip": {"position": [1.0, 1.0], "mass": 2.0},
            "mast": {"position": [-0.5, 1.5], "anchored": True},
            "deck": {"position": [1.6, 0.0], "anchored": True},
        }
        members = {
            "boom": {"kind": "bar", "nodes": ["foot", "tip"], "rest_length": 2**0.5, **bar},
            "line": {**CABLE, "nodes": ["mast", "tip", "deck"], "prestress": 100.0, "friction": 0.1},
        }
        return {"name": "boom", "axes": "xz", "gravity": [0, -9.81], "nodes": nodes, "members": members}

    rigid, stiff = (
        find_equilibrium(compile_scene(boom(**bar), for_="equilibrium"))
        for bar in ({}, {"axial_stiffness": 1e10})
    )
    assert rigid.slid["line_1"] != 0.0
    assert rigid.slid == {"line_1": pytest.approx(stiff.slid["line_1"], rel=1e-6)}
    assert rigid.node_position == pytest.approx(stiff.node_position, abs=1e-7)


def test_linear_models_are_those_of_strands_that_stick() -> None:
    scene = ring_scene(0.05)
    found = find_equilibrium(compile_scene(scene, for_="equilibrium"))
    model = compile_scene(scene, for_="linearize")
    linear = linearize(model, equilibrium=found)
    settled, again = find_settled(*assemble(parse_scene(scene, "scene"), "scene"))
    assert again.slid == pytest.approx(found.slid)
    assert isinstance(settled, Structure)
    plain = settled.with_changes(sliding=(), damping=settled.damping)
    own = linearize(load(plain, "state_derivative", "state_jacobian"))
    assert linear.natural_frequency == pytest.approx(own.natural_frequency, rel=1e-8)
    assert linear.state_name == own.state_name


def test_a_ring_that_friction_cannot_hold_is_said_to_slip_on() -> None:
    """Straight on nothing is held: the ring is pulled along the cable to its end."""
    scene = ring_scene(0.3)
    scene["axes"] = "x"
    scene["nodes"] = {
        name: {**node, "position": [node["position"][0]]} for name, node in scene["nodes"].items()
    }
    scene["members"]["c"] |= {"rest_length": 1.9}
    scene["loads"] = [{"node": "ring", "force": [5.0]}]
    with pytest.raises(ConvergenceError, match="slips through rings") as raised:
        find_equilibrium(compile_scene(scene, for_="equilibrium"))
    assert raised.value.evidence["status"] == "stalled"
    # What is stated of the failure belongs together: forces balance for the slip that is stated
    model = compile_scene(scene, for_="equilibrium")
    found = find_equilibrium(model, raise_on_failure=False)
    residual = model.compute("node_residual", coordinate=found.coordinate, **found.internal_argument)
    assert np.abs(residual).max() < 1e-9 * found.largest_force


def test_the_ground_and_load_paths_are_refused() -> None:
    scene = ring_scene(0.1)
    with pytest.raises(FormulationError, match=r"friction at rings is not supported here: .*load_path"):
        compile_scene(scene, for_="load_path")
    ground = {"normal": [0, 1], "stiffness": 1e4}
    nodes = {**scene["nodes"], "b": {"position": [2.0, 0.0], "anchored": True}}
    with pytest.raises(FormulationError, match="friction at rings"):
        find_equilibrium(compile_scene({**scene, "nodes": nodes, "ground": ground}, for_="equilibrium"))


def test_a_failed_search_states_no_tensions_that_do_not_balance() -> None:
    # A mast in two stays and a ring on a rope that would slip until the mast has fallen over.
    held = {"a": [0, 0, 0], "b": [0.5, 0.4, 0.6], "e1": [-1, 0.5, 0], "e2": [-1, -0.5, 0], "e3": [1, 0, 0]}
    stay = {"kind": "cable", "spring_constant": 2000.0, "prestress": 10.0}
    rope = {"kind": "cable", "nodes": ["d", "r", "b"], "axial_stiffness": 1000.0, "damping": 5.0}
    document: dict[str, Any] = {
        "name": "ringed",
        "gravity": [0, 0, -9.81],
        "nodes": {
            **{name: {"position": place, "anchored": True} for name, place in held.items()},
            "d": {"position": [0, 0, 1.2], "mass": 0.5},
            "r": {"position": [0.3, 0, 0.5], "mass": 0.3},
        },
        "members": {
            "mast": {"kind": "bar", "nodes": ["a", "d"], "spring_constant": 1e5, "mass": 0.2},
            **{f"g{k}": {**stay, "nodes": ["r" if k == 3 else "d", f"e{k}"]} for k in (1, 2, 3)},
            "rope": {**rope, "friction": [0.2], "rest_length": 1.0},
        },
    }
    found = find_equilibrium(compile_scene(document, for_="equilibrium"), raise_on_failure=False)
    assert (found.status, found.iterations < 1000) == ("stalled", True)
    tension = dict(zip(found.member_name, found.member_tension, strict=True))
    assert [name for name, value in tension.items() if np.isnan(value)] == ["rope_1", "rope_2"]
    # The spans at rest with what has slipped, their tensions by their law: these balance, and are not held.
    place = dict(zip(found.node_name, found.node_position, strict=True))
    spans = [place[end] - place["r"] for end in ("d", "b", "e3")]
    first, second = np.linalg.norm([0.3, 0, -0.7]), np.linalg.norm([0.2, 0.4, 0.1])
    rest = np.array([first, second]) / (first + second) + np.array([-1, 1]) * found.slid["rope_1"]
    length = np.array([np.linalg.norm(span) for span in spans])
    pull = [*1000.0 * (length[:2] / rest - 1), tension["g3"]]
    force = sum(t * span / size for t, span, size in zip(pull, spans, length, strict=True))
    assert force == pytest.approx([0, 0, 0.3 * 9.81], abs=1e-9)
