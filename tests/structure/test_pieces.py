"""Connected pieces of graphs are those of SciPy, in the order of their first nodes."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import tensegrity_codegen as tc
from tensegrity_codegen.export.export_mjcf import build_mjcf
from tensegrity_codegen.structure.pieces import find_chains, find_pieces, measure_chain
from tests.reference import ReferenceModel


@pytest.mark.parametrize(
    ("count", "edges"), [(0, 0), (1, 0), (5, 0), (40, 12), (300, 150), (300, 290), (2000, 2500)]
)
def test_random_graphs_have_the_pieces_of_scipy(count: int, edges: int) -> None:
    random = np.random.default_rng(count + edges)
    first, second = random.integers(0, max(count, 1), (2, edges))
    graph = coo_array((np.ones(edges), (first, second)), shape=(max(count, 1), max(count, 1)))
    expected, label = connected_components(graph, directed=False)
    found, piece = find_pieces(count, first, second)
    assert found == (expected if count else 0)
    assert piece.tolist() == label[:count].tolist()


def test_a_long_chain_in_any_order_is_one_piece() -> None:
    order = np.random.default_rng(3).permutation(10_000)
    found, piece = find_pieces(10_000, order[:-1], order[1:])
    assert found == 1
    assert not piece.any()


def string(n: int, **more: Any) -> dict[str, Any]:
    """Return a string of 2 m and 0.05 kg/m under 200 N, without gravity."""
    line = {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 1e4, "prestress": 200.0}
    return {
        "name": "wire",
        "nodes": {"a": {"position": [0, 0, 0], "anchored": True},
                  "b": {"position": [2, 0, 0], "anchored": True}},
        "members": {"line": line | {"mass_per_length": 0.05, "segments": n}},
    } | more  # fmt: skip


def test_frequencies_are_those_of_a_string() -> None:
    """f_k = k/(2 l) sqrt(T / m'), with the mass of the rest length on the present length; order 2."""
    mass = 0.05 / (1 + 200.0 / 1e4)
    exact = np.sqrt(200.0 / mass) / 4.0
    error = []
    for n in (8, 16):
        found = tc.analyse(tc.compile_scene(string(n), for_="analyse"))
        assert found.modes is not None
        lowest = np.sort(found.modes.frequency)[:2]  # both directions across
        assert lowest[0] == pytest.approx(lowest[1], rel=1e-9)
        error.append(1 - lowest[0] / exact)
        # Lumped masses: f = (2 n / pi) sin(pi / (2 n)) of the exact one.
        assert lowest[0] / exact == pytest.approx(2 * n / np.pi * np.sin(np.pi / (2 * n)), rel=1e-9)
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize(
    "model",
    [{"emitter": "unrolled"}, {"emitter": "table"}, {"formulation": "node_distance"}],
    ids=str,
)
def test_half_of_the_mass_of_a_cable_is_at_each_end(model: dict[str, str]) -> None:
    scene = {
        "name": "hung", "gravity": [0, 0, -10],
        "nodes": {"a": {"position": [0, 0, 0], "anchored": True}, "b": {"position": [1, 0, -1]},
                  "c": {"position": [0, 1, -2], "mass": 0.5}},
        "classes": {"rope": {"kind": "cable", "spring_constant": 50.0, "strain": 0.1},
                    "rod": {"kind": "bar", "spring_constant": 90.0, "strain": 0.1}},
        "members": {"ab": {"class": "rope", "nodes": ["a", "b"], "mass": 0.4},
                    "bc": {"class": "rod", "nodes": ["b", "c"], "mass": 0.6},
                    "ac": {"class": "rope", "nodes": ["a", "c"], "mass": 0.2}},
        "model": {"quantities": ["acceleration", "potential_energy", "mass_matrix"], **model},
    }  # fmt: skip
    if "formulation" in model:
        scene["model"]["quantities"] = ["acceleration", "kinetic_energy"]
    compiled = tc.compile_scene(scene)
    structure = compiled.structure
    assert isinstance(structure, tc.Structure)
    reference = ReferenceModel(structure)
    if "formulation" not in model:
        expected = reference.compute("mass_matrix")
        given = compiled.compute("mass_matrix").toarray()
        assert given == pytest.approx(
            np.asarray(expected.toarray() if hasattr(expected, "toarray") else expected)
        )
        assert given[0, 0] == pytest.approx(0.2 + 0.2)  # half of the cable, a third of the bar
        assert given[0, 3] == pytest.approx(0.1)
        assert compiled.compute("acceleration").ravel() == pytest.approx(
            np.asarray(reference.compute("acceleration")).ravel(), rel=1e-10
        )
    else:
        near = tc.compile_scene({**scene, "model": {"quantities": ["acceleration"]}})
        moved = near.compute("acceleration").reshape(2, 3)
        assert compiled.compute("acceleration").reshape(-1, 3)[0] == pytest.approx(-moved[0], rel=1e-9)


def test_motions_keep_their_energy() -> None:
    scene = string(6, gravity=[0, 0, -10])
    scene["members"]["line"] |= {"rest_length": 2.1}
    del scene["members"]["line"]["prestress"]
    scene["nodes"]["b"]["anchored"] = "yz"
    scene["nodes"]["b"]["mass"] = 0.2
    scene["model"] = {"quantities": ["total_energy"]}
    model = tc.compile_scene(scene, for_="simulate", method="rk853")
    motion = tc.simulate(model, 0.5, method="rk853", rtol=1e-9)
    energy = [
        float(np.ravel(model.compute("total_energy", coordinate=q, velocity=v))[0])
        for q, v in zip(motion.coordinate[::20], motion.velocity[::20], strict=True)
    ]
    assert np.ptp(energy) < 1e-6
    assert np.abs(motion.coordinate[-1] - motion.coordinate[0]).max() > 0.1


def test_chains_are_groups_of_cables_with_mass_in_a_row() -> None:
    structure, _ = tc.load_scene(string(4, groups={"pair": ["line"]}))
    assert isinstance(structure, tc.Structure)
    assert find_chains(structure) == {"line": [0, 1, 2, 3]}  # and not "pair", which is the same
    bare = structure.with_changes(member_mass=np.zeros(4))
    assert find_chains(bare) == {}
    turned = structure.with_changes(groups={"line": (1, 0, 2, 3)})
    assert find_chains(turned) == {}


def test_a_straight_chain_has_no_sag() -> None:
    structure, _ = tc.load_scene(string(4))
    assert isinstance(structure, tc.Structure)
    rows = find_chains(structure)["line"]
    tension, sag = measure_chain(structure, rows, structure.node_position, structure.static_tension())
    assert (tension, sag) == (pytest.approx(200.0), 0.0)


def test_mujoco_has_half_of_a_cable_at_each_end() -> None:
    structure, _ = tc.load_scene(string(4))
    assert isinstance(structure, tc.Structure)
    root, notes = build_mjcf(structure)
    mass = [float(item.get("mass", "")) for item in root.iter("inertial")]
    assert mass == pytest.approx([float(structure.member_mass[0])] * 3)
    assert not any("own mass" in text for text in notes)
