"""The discretisation error of chains against the catenary (Irvine): order 2, and extrapolation."""

from typing import Any

import numpy as np
import pytest

import tensegrity_codegen as tc
from tensegrity_codegen.pipeline.segment_error import _halve
from tensegrity_codegen.structure.pieces import find_chains, measure_chain

G = 9.81


def span(n: int, **values: Any) -> dict[str, Any]:
    """Return a span of 10 m, of 1 N/m and EA 1000 N, in n segments."""
    line = {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 1000.0, "rest_length": 10.5}
    return {
        "name": "span", "axes": "xz", "gravity": [0, -G],
        "nodes": {"a": {"position": [0, 0], "anchored": True}, "b": {"position": [10, 0], "anchored": True}},
        "members": {"line": line | {"mass_per_length": 1 / G, "segments": n} | values},
        "inputs": [{"kind": "rest_length", "name": "winch", "members": ["line"]}],
    }  # fmt: skip


ALONE = {
    "members": {"line": {"kind": "cable", "nodes": ["a", "c"], "axial_stiffness": 1e3}},
    "nodes": {"a": {"position": [0, 0], "anchored": True}, "c": {"position": [0, -1], "mass": 1.0}},
    "inputs": [],
}
EXACT = tc.find_catenary(10.0, 0.0, 10.5, 1.0, 1000.0)


def horizontal(n: int) -> float:
    model = tc.compile_scene(span(n), for_="equilibrium")
    found = tc.find_equilibrium(model)
    assert isinstance(model.structure, tc.Structure)
    rows = find_chains(model.structure)["line"]
    tension, _ = measure_chain(model.structure, rows, found.node_position, found.member_tension)
    return float(np.sqrt(tension**2 - (10.5 / 2) ** 2))


def test_chains_err_by_the_square_of_their_segments() -> None:
    values = np.array([horizontal(n) for n in (4, 8, 16, 32, 64)])
    error = 1 - values / 8.38006825738
    assert error == pytest.approx([2.4e-2, 5.9e-3, 1.5e-3, 3.7e-4, 9.3e-5], rel=0.02)
    assert abs((4 * values[4] - values[3]) / 3 / 8.38006825738 - 1) < 1e-6


def test_the_error_is_stated() -> None:
    found = tc.find_equilibrium(tc.compile_scene(span(16), for_="equilibrium"))
    assert found.segments == ()
    assert "segments" not in found.as_evidence()
    (item,) = tc.add_segment_error(found).segments
    assert (item.cable, item.n_segments) == ("line", 16)
    assert item.sag - EXACT.sag == pytest.approx(2.74e-3, rel=1e-2)
    assert item.extrapolated_sag == pytest.approx(EXACT.sag, rel=2e-6)
    assert item.extrapolated_end_tension == pytest.approx(EXACT.end_tension[0], rel=2e-6)
    assert item.relative == pytest.approx(item.sag / EXACT.sag - 1, rel=1e-2)
    with_error = tc.add_segment_error(found)
    assert with_error.as_evidence()["segments"][0]["cable"] == "line"
    assert "16 segments of cable line err by 0.18 %" in repr(with_error)
    assert not any("err by" in text for text in with_error.warnings)
    coarse = tc.add_segment_error(tc.find_equilibrium(tc.compile_scene(span(4), for_="equilibrium")))
    assert any("4 segments of cable line err by 3 %" in text for text in coarse.warnings)


def test_inputs_and_loads_are_those_of_the_equilibrium() -> None:
    model = tc.compile_scene(span(16) | {"parameters": {"node_load": ["line_node_8"]}}, for_="equilibrium")
    arguments = {"winch": 0.3, "node_load": np.zeros((1, 2))}
    (item,) = tc.add_segment_error(tc.find_equilibrium(model, arguments=arguments)).segments
    # The mass stays: 10.5 N on 10.8 m, whose EA is that of the material.
    exact = tc.find_catenary(10.0, 0.0, 10.8, 10.5 / 10.8, 1000.0)
    assert item.extrapolated_sag == pytest.approx(exact.sag, rel=2e-6)
    loaded = tc.find_equilibrium(model, arguments={"node_load": np.array([[0.0, -5.0]])})
    (heavy,) = tc.add_segment_error(loaded).segments
    assert heavy.extrapolated_sag == pytest.approx(heavy.sag, rel=3e-3)
    assert heavy.end_tension > item.end_tension + 2


def test_halves_have_the_same_inputs_and_groups() -> None:
    structure, _ = tc.load_scene(span(3))
    assert isinstance(structure, tc.Structure)
    fine, _ = _halve(structure)
    assert fine.member_name[:2] == ("line_1_1", "line_1_2")
    assert fine.groups["line"] == tuple(range(6))
    assert fine.inputs[0].rest_length_gain == pytest.approx(dict.fromkeys(range(6), 1 / 6))
    assert fine.connectivity[:, 1].tolist()[:-1] == fine.connectivity[:, 0].tolist()[1:]
    assert fine.rest_length.sum() == pytest.approx(10.5)
    assert fine.member_mass.sum() == pytest.approx(10.5 / G)


def test_a_mast_with_a_free_top() -> None:
    """A cable over two spans that both pull a free mass: positions of its ends change with the segments."""
    scene = span(8)
    scene["nodes"]["c"] = {"position": [5, -3], "mass": 0.4}
    half = {"kind": "cable", "axial_stiffness": 1000.0, "mass_per_length": 1 / G, "segments": 8}
    scene["members"] = {
        "west": half | {"nodes": ["a", "c"], "rest_length": 6.2},
        "east": half | {"nodes": ["b", "c"], "rest_length": 6.2},
    }
    scene["inputs"] = []
    found = tc.add_segment_error(tc.find_equilibrium(tc.compile_scene(scene, for_="equilibrium")))
    assert [item.cable for item in found.segments] == ["west", "east"]
    # The exact height of the mass, by bisection of its balance with two catenaries.
    low, high = -6.0, -3.0
    for _ in range(60):
        middle = (low + high) / 2
        pull = tc.find_catenary(5.0, middle, 6.2, 1.0, 1000.0)
        upwards = 2 * (pull.vertical_force - 6.2) - 0.4 * G
        low, high = (middle, high) if upwards > 0 else (low, middle)
    exact = tc.find_catenary(5.0, low, 6.2, 1.0, 1000.0)
    for item in found.segments:
        assert item.extrapolated_end_tension == pytest.approx(exact.end_tension[0], rel=2e-5)
        assert item.extrapolated_sag == pytest.approx(exact.sag, rel=1e-3)


def test_nothing_is_added_without_cables_in_segments() -> None:
    found = tc.find_equilibrium(tc.compile_scene(span(1) | ALONE, for_="equilibrium"))
    assert tc.add_segment_error(found) is found


def test_a_vertical_cable_has_no_sag_to_err_in() -> None:
    scene = span(6)
    scene["nodes"]["b"] = {"position": [0, -10], "mass": 1.0}
    found = tc.add_segment_error(tc.find_equilibrium(tc.compile_scene(scene, for_="equilibrium")))
    (item,) = found.segments
    assert (item.sag, item.extrapolated_sag) == (0.0, 0.0)
    assert item.end_tension == pytest.approx(10.5 + G, rel=1e-9)  # its weight and the mass, exactly
    assert item.relative < 1e-9


def test_rigid_bars_and_cables_in_segments() -> None:
    """A mast on a ball joint, held by two sagging stays: its length stays in the finer search."""
    stay = {"kind": "cable", "axial_stiffness": 2000.0, "mass_per_length": 1 / G, "segments": 6}
    scene = span(6)
    scene["nodes"] = {
        "a": {"position": [-5, 0], "anchored": True}, "b": {"position": [6, 0], "anchored": True},
        "foot": {"position": [0, 0], "anchored": True}, "top": {"position": [0.1, 5], "mass": 0.1},
    }  # fmt: skip
    scene["members"] = {
        "mast": {"kind": "bar", "nodes": ["foot", "top"]},
        "west": stay | {"nodes": ["a", "top"], "rest_length": 7.1},
        "east": stay | {"nodes": ["b", "top"], "rest_length": 7.8},
    }
    scene["inputs"] = []
    found = tc.add_segment_error(tc.find_equilibrium(tc.compile_scene(scene, for_="equilibrium")))
    assert [item.cable for item in found.segments] == ["west", "east"]
    assert all(1e-4 < item.relative < 0.05 for item in found.segments)
