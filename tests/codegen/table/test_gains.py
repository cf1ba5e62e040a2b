"""Inputs with gains, temperature above all, in every emitter and formulation.

The fixed bar: rest length rho (1 + alpha dT), so that t = -EA alpha dT / (1 + alpha dT).
"""

from typing import Any

import numpy as np
import pytest

import tensegrity_codegen as tc
from tensegrity_codegen.control.embedded.parts import _check_gains
from tensegrity_codegen.export.export_mjcf import build_mjcf
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError

ALPHA, EA = 1.2e-5, 2e5
QUANTITIES = ["member_tension", "acceleration", "input_jacobian"]

SCENE: dict[str, Any] = {
    "name": "warm",
    "gravity": [0, 0, -9.81],
    "classes": {
        "rod": {"kind": "bar", "axial_stiffness": EA, "thermal_expansion": ALPHA},
        "rope": {"kind": "cable", "spring_constant": 500.0, "thermal_expansion": 2e-4, "damping": 2.0},
    },
    "nodes": {
        "a": {"position": [0, 0, 0], "anchored": True},
        "b": {"position": [2, 0, 0], "anchored": True},
        "c": {"position": [1, 0.5, -0.5], "mass": 2.0, "velocity": [0.1, 0.2, 0.3]},
        "d": {"position": [1, -1, -1], "mass": 1.0},
    },
    "members": {
        "held": {"class": "rod", "nodes": ["a", "b"], "rest_length": 2.0},
        "ac": {"class": "rod", "nodes": ["a", "c"], "strain": 1e-4},
        "bc": {"class": "rope", "nodes": ["b", "c"], "prestress": 30.0},
        "cd": {"class": "rope", "nodes": ["c", "d"], "prestress": 10.0},
        "bd": {"class": "rope", "nodes": ["b", "d"], "prestress": 10.0},
    },
    "inputs": [
        {"kind": "temperature", "name": "sun", "members": ["rod", "bc", "cd"]},
        {"kind": "rest_length", "name": "winch", "members": ["bc", "bd"], "gain": [0.25, 0.5]},
        {"kind": "force", "name": "push", "nodes": ["c"], "direction": [0, 0, 1]},
    ],
}
U = np.array([50.0, 0.02, 3.0])


def vary(**model: Any) -> dict[str, Any]:
    """Return the scene with these keys of its section `model`."""
    return {**SCENE, "model": {"quantities": QUANTITIES, **model}}


def heat(scene: dict[str, Any]) -> tc.Structure:
    """Return the structure with the rest lengths that the inputs U make."""
    structure, _ = tc.load_scene(scene)
    assert isinstance(structure, tc.Structure)
    rest = structure.rest_length.copy()
    rest[[0, 1]] *= 1 + ALPHA * U[0]
    rest[[2, 3]] *= 1 + 2e-4 * U[0]
    rest[[2, 4]] += np.array([0.25, 0.5]) * U[1]
    return structure.with_changes(rest_length=rest)


@pytest.mark.parametrize("emitter", ["unrolled", "table"])
@pytest.mark.parametrize("heavy", [False, True], ids=["nodes", "bars"])
def test_tensions_accelerations_and_jacobian_in_every_emitter(emitter: str, heavy: bool) -> None:
    scene = vary(emitter=emitter)
    if heavy:  # the mass matrix couples nodes
        scene["classes"] = {**SCENE["classes"], "rod": {**SCENE["classes"]["rod"], "mass": 0.3}}
    model = tc.compile_scene(scene)
    tension = model.compute("member_tension", input=U)
    assert tension[0] == pytest.approx(-119.92804317, abs=1e-8)
    warm = tc.build_library(heat(scene), tc.load_scene(scene)[1]).load()
    np.testing.assert_allclose(tension, warm.compute("member_tension", input=U * [0, 0, 1]), rtol=1e-12)
    given = model.compute("input_jacobian", input=U).toarray()
    for k, step in enumerate([1e-3, 1e-7, 1e-3]):
        ends = [
            model.compute("acceleration", input=U + sign * step * np.eye(3)[k]).ravel() for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(slope).max() > 0
        np.testing.assert_allclose(given[6:, k], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def test_node_distances_have_the_same_jacobian() -> None:
    near = tc.compile_scene(vary(formulation="node_distance"))
    given = near.compute("input_jacobian", input=U).toarray()
    n = given.shape[0] // 2
    for k, step in enumerate([1e-3, 1e-7]):
        ends = [
            near.compute("acceleration", input=U + sign * step * np.eye(3)[k]).ravel() for sign in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(given[n:, k], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def write_out(structure: tc.Structure, scene: dict[str, Any]) -> dict[str, Any]:
    """Return the scene with the rest lengths of a structure, and without inputs."""
    rest = dict(zip(structure.member_name, structure.rest_length.tolist(), strict=True))
    members = {
        name: {"class": value["class"], "nodes": value["nodes"], "rest_length": rest[name]}
        for name, value in scene["members"].items()
    }
    return {**scene, "members": members, "inputs": [], "model": {"emitter": "table"}}


@pytest.mark.parametrize("method", ["rk853", "radau"])
def test_motions_are_those_of_the_heated_structure(method: str) -> None:
    scene = vary(emitter="table")
    arguments = {"sun": U[0], "winch": U[1]}
    ends = [
        tc.simulate(tc.compile_scene(one, for_="simulate", method=method), 0.3, **how).coordinate[-1]
        for one, how in (
            (scene, {"method": method, "rtol": 1e-10, "arguments": arguments}),
            (write_out(heat(scene), scene), {"method": method, "rtol": 1e-10}),
        )
    ]
    cold = tc.simulate(tc.compile_scene(scene, for_="simulate", method=method), 0.3, method=method)
    assert np.abs(ends[0] - cold.coordinate[-1]).max() > 1e-3
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


def test_equilibria_and_their_derivatives() -> None:
    model = tc.compile_scene(vary(), for_=("equilibrium", "sensitivity"))
    arguments = {"sun": 20.0, "winch": 0.01}
    found = tc.find_equilibrium(model, arguments=arguments)
    rates = tc.equilibrium_sensitivity(model, found, columns=["sun", "winch"], arguments=arguments)
    for k, (name, step) in enumerate((("sun", 1e-2), ("winch", 1e-5))):
        ends = [
            tc.find_equilibrium(model, arguments={**arguments, name: arguments[name] + sign * step})
            for sign in (1, -1)
        ]
        slope = (ends[0].member_tension - ends[1].member_tension) / (2 * step)
        np.testing.assert_allclose(rates.tension[:, k], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


def test_single_precision_and_batches() -> None:
    model = tc.compile_scene(vary(emitter="table", precision="single"))
    assert model.compute("member_tension", input=U.astype(np.float32))[0] == pytest.approx(-119.928, rel=1e-3)
    batch = tc.compile_scene(vary(batch_width=8, integrators=["rk853"]), for_="simulate_batch")
    found = tc.simulate_batch(batch, 0.2, arguments={"sun": np.array([0.0, U[0]]), "winch": U[1]})
    alone = tc.simulate(
        tc.compile_scene(vary(), for_="simulate"), 0.2, arguments={"sun": U[0], "winch": U[1]}
    )
    np.testing.assert_allclose(found.coordinate[1, -1], alone.coordinate[-1], atol=1e-5)


def test_tendons_of_bodies() -> None:
    scene = {
        "name": "held",
        "classes": {"cord": {"kind": "cable", "axial_stiffness": EA, "thermal_expansion": ALPHA}},
        "bodies": {
            "base": {"kind": "fixed", "points": {"p": [0, 0, 0]}},
            "top": {"kind": "rigid", "mass": 1.0, "inertia": [1, 1, 1], "points": {"q": [0, 0, 0]},
                    "centre": [0, 0, 1]},
        },
        "tendons": {"s": {"class": "cord", "points": ["base.p", "top.q"], "rest_length": 0.999}},
        "inputs": [{"kind": "temperature", "name": "sun", "members": ["s"]}],
        "model": {"quantities": ["member_tension"]},
    }  # fmt: skip
    rest = 0.999 * (1 + ALPHA * 50.0)
    tension = tc.compile_scene(scene).compute("member_tension", input=np.array([50.0]))
    assert tension[0] == pytest.approx(EA * (1 - rest) / rest, rel=1e-12)


def test_a_bar_that_is_kept_rigid_is_not_heated() -> None:
    scene = vary(formulation="rigid_bar", options={"bars": "all"}, quantities=["acceleration"])
    scene["members"] = {name: value for name, value in SCENE["members"].items() if name != "held"}
    with pytest.raises(FormulationError, match="keeps its length at every temperature") as caught:
        tc.compile_scene(scene)
    assert caught.value.given == "ac"
    scene["inputs"] = [{"kind": "temperature", "name": "sun", "members": ["rope"]}]
    tension = tc.compile_scene(scene).compute("acceleration", input=np.array([5.0]))
    assert np.isfinite(tension).all()


def test_a_motor_does_not_move_a_bar_that_keeps_the_length_of_the_scene() -> None:
    inputs = [{"kind": "rest_length", "name": "push", "members": ["ac"]}]
    members = {name: value for name, value in SCENE["members"].items() if name != "held"}
    scene = vary(formulation="rigid_bar", options={"bars": "all"}, quantities=["constraint_residual"])
    scene |= {"members": members, "inputs": inputs}
    with pytest.raises(FormulationError, match="keeps rigid have no rest length to change") as caught:
        tc.compile_scene(scene)
    assert (caught.value.given, caught.value.where.split(": ")[1]) == ("ac", "inputs.push")
    scene["model"]["options"]["correction"] = "first_order"  # its length then follows from its rest length
    model = tc.compile_scene(scene)
    moved = [model.compute("constraint_residual", input=np.array([u]))[0] for u in (0.0, 0.01)]
    assert moved[1] - moved[0] == pytest.approx(-0.01)


def test_mujoco_has_the_forces_of_gains() -> None:
    structure, _ = tc.load_scene(SCENE)
    assert isinstance(structure, tc.Structure)
    root, _ = build_mjcf(structure)
    gains = {item.get("name"): float(item.get("gainprm", "")) for item in root.iter("general")}
    bc = structure.member_name.index("bc")
    assert gains["winch.bc"] == pytest.approx(0.25 * 500.0)
    assert gains["winch.bd"] == pytest.approx(0.5 * 500.0)
    assert gains["sun.bc"] == pytest.approx(2e-4 * structure.rest_length[bc] * 500.0)
    assert gains["sun.held"] == pytest.approx(ALPHA * EA)


def test_controllers_in_c_refuse_gains() -> None:
    structure, _ = tc.load_scene(SCENE)
    with pytest.raises(InvalidValueError, match="does not know inputs of temperature") as caught:
        _check_gains(structure)
    assert caught.value.given == "sun"
    _check_gains(structure.with_changes(inputs=structure.inputs[2:]))
