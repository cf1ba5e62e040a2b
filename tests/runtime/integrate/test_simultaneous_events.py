"""Derivatives of motions in which cables are pulled taut at one instant, as in mirror-symmetric structures.

Each cable has a time of its own, which the numbers of the structure move: S+ = S- + sum over the cables of
[f]_i dg_i / g_i'. What a motion does differs to second order with the order of the events, so that central
differences have an error of first order in their step, which is extrapolated to zero.
"""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.adjoint import TapedRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import motion_gradient
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tests.cases import thorough
from tests.models import simulator, start_of
from tests.runtime.integrate.test_columns import fall

STEPS = Stepping(control="steps")
CABLE: dict[str, Any] = {"kind": "cable", "spring_constant": 1000.0, "rest_length": 1.2, "damping": 3.0}


def swing(**more: Any) -> dict[str, Any]:
    """1 kg that falls onto two damped cables, both pulled taut as it has fallen 0.46 m."""
    return {
        "name": "swing",
        "axes": "xz",
        "gravity": [0, -9.81],
        "nodes": {
            "l": {"position": [-1, 0], "anchored": True},
            "r": {"position": [1, 0], "anchored": True},
            "m": {"position": [0, -0.2], "mass": 1.0},
        },
        "members": {"s": {**CABLE, "nodes": ["l", "m"]}, "t": {**CABLE, "nodes": ["r", "m"]}},
        **more,
    }


def find_slopes(model: CompiledModel, name: str, way: Any, t_end: float, **given: Any) -> Any:
    """Return the derivative of the state at the end along a change of an argument, by six motions."""
    nominal = model.nominal(name)

    def end(change: float) -> Any:
        arguments = {name: nominal + change * way}
        motion = simulate(model, t_end, samples=[0.0, t_end], rtol=3e-13, arguments=arguments, **given)
        return np.concatenate([motion.coordinate[-1], motion.velocity[-1]])

    step = 5e-7 if name == "rest_length" else 1e-5  # changes of lengths move events most
    near, middle, far = ((end(k * step) - end(-k * step)) / (2 * k * step) for k in (1, 2, 4))
    return (8.0 * near - 6.0 * middle + far) / 3.0


def check_both_ways(model: CompiledModel, t_end: float, names: Any, ways: Any, method: str = "rk853") -> int:
    """Compare columns and the gradient backwards with differences; returns how many events coincide."""
    run = TapedRun(Motion(model, start_of(model), np.array([0.0, t_end])), RunOptions(method, 1e-11, 1e-13))
    raw = run.finish()
    weight = np.random.default_rng(0).normal(size=raw.columns.shape[:2])
    weight[0], weight[:, len(start_of(model)) :] = 0.0, 0.0
    back = run.go_back(weight).number
    given: dict[str, Any] = {"method": method, "stepping": STEPS}
    motion = simulate(model, t_end, samples=[0.0, t_end], rtol=1e-11, **given)
    assert motion.columns is not None
    for name, way in zip(names, ways, strict=True):
        expected = find_slopes(model, name, way, t_end, **given)
        own = [k for k, column in enumerate(motion.column_name) if column.split(".")[0] == name]
        found = motion.columns[-1, : len(expected)][:, own] @ way
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
        along = weight[1, : len(expected)] @ expected
        assert back[name].ravel() @ way == pytest.approx(along, abs=1e-6 * np.abs(expected).max())
    return int((np.diff(np.sort(motion.log.time)) < 1e-9).sum())


@pytest.mark.parametrize("method", ["rk853", "rk54"])
def test_each_of_two_cables_has_its_own_jump(method: str) -> None:
    columns = ("rest_length", "damping")
    model = simulator(
        load_scene(swing())[0],
        *("rk853", "rk54"),
        more=("adjoint_rate",),
        parameters={"rest_length": (0, 1), "damping": (0, 1)},
        columns=columns,
    )
    motion = simulate(model, 0.5, samples=[0.0, 0.5], method=method, rtol=1e-10)
    assert motion.columns is not None
    expected = [[-0.55124, 0.55124], [-1.11426, -1.11426]]
    np.testing.assert_allclose(motion.columns[-1, :2, :2], expected, atol=1e-5)
    ways = np.random.default_rng(1).normal(size=(2, 2))
    assert check_both_ways(model, 0.5, columns, ways, method) == 2


@pytest.mark.parametrize("share", [1.0, 1.1])
def test_a_gradient_tells_how_far_differences_are_from_it(share: float) -> None:
    """Also where what it is computed from is wrong: here the derivatives that the loss states."""
    model = simulator(
        load_scene(swing())[0],
        "rk853",
        more=("adjoint_rate",),
        parameters={"rest_length": (0, 1), "damping": (0, 1)},
    )

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        weight = np.zeros_like(motion.node_position)
        weight[-1, 2] = [1.0, 0.0, -0.7]
        return float((motion.node_position * weight).sum()), {"node_position": share * weight}

    found = motion_gradient(model, loss, 0.8, samples=3)
    assert found.error is not None
    assert found.error == pytest.approx(1.0 - 1.0 / share, abs=1e-5)
    assert motion_gradient(model, loss, 0.8, samples=3, check=False).error is None


def test_a_cable_is_pulled_taut_as_its_node_touches_the_ground() -> None:
    """At one instant a force jumps, and at another event it does not."""
    ground = {"stiffness": 3000.0, "dissipation": 0.3, "friction": 0.3, "offset": -np.sqrt(1.2**2 - 1.0)}
    model = simulator(
        load_scene(swing(ground=ground))[0],
        "rk853",
        more=("adjoint_rate",),
        parameters={"rest_length": (0, 1), "ground": (0,)},
        columns=("rest_length", "ground"),
    )
    ways = np.array([20.0, -6.0]), np.array([1000.0])
    motion = simulate(model, 0.32, method="rk853", rtol=1e-11, stepping=STEPS)
    assert set(motion.log.kind) == {"cable", "ground", "stick"}
    assert np.ptp(motion.log.time) < 1e-12
    check_both_ways(model, 0.6, ("rest_length", "ground"), ways)


def test_an_input_jumps_as_cables_are_pulled_taut() -> None:
    fallen = float(np.sqrt(2.0 * (np.sqrt(1.2**2 - 1.0) - 0.2) / 9.81))
    push = {"name": "push", "kind": "force", "nodes": ["m"], "direction": [1.0, 0.3]}
    model = simulator(
        load_scene(swing(inputs=[push]))[0],
        "rk853",
        parameters={"rest_length": (0, 1)},
        columns=("rest_length",),
    )
    jump = Profile([0.0, fallen, fallen, 1.0], {"push": [0.0, 0.0, 5.0, 5.0]})
    given: dict[str, Any] = {"method": "rk853", "stepping": STEPS, "schedule": jump}
    motion = simulate(model, 0.5, samples=[0.0, 0.5], rtol=1e-11, **given)
    assert motion.columns is not None
    way = np.array([1.0, -0.3])
    expected = find_slopes(model, "rest_length", way, 0.5, **given)
    assert np.abs(motion.columns[-1] @ way - expected).max() < 1e-6 * np.abs(expected).max()


def test_a_cable_that_is_paid_out_goes_slack_with_a_jump() -> None:
    """It still becomes longer as it goes slack: its damping pulls up to there."""
    from tensegrity_codegen.structure.structure import ActuatedInput

    driven = fall(2.0).with_changes(inputs=(ActuatedInput("winch", "rest_length", (0,)),))
    model = simulator(
        driven, "rk853", more=("adjoint_rate",), parameters={"rest_length": (0,)}, columns=("rest_length",)
    )
    schedule = Profile([0.0, 0.36, 0.41, 1.0], {"winch": [0.0, 0.0, 0.5, 0.5]})
    given: dict[str, Any] = {"method": "rk853", "stepping": STEPS, "schedule": schedule}
    motion = simulate(model, 0.45, samples=[0.0, 0.45], rtol=1e-11, **given)
    assert motion.columns is not None
    assert [int(way) for way in motion.log.direction] == [1, -1]
    expected = find_slopes(model, "rest_length", np.ones(1), 0.45, **given)
    np.testing.assert_allclose(motion.columns[-1, :, 0], expected, rtol=1e-6)


def make_mirrored(seed: int) -> tuple[dict[str, Any], str]:
    """Return a random scene with mirrored pairs of nodes, anchors, cables and bars, and its formulation."""
    draw = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(draw.uniform(low, high))

    width, height, middle = between(0.8, 1.2), between(0.0, 0.3), between(-0.4, -0.1)
    nodes: dict[str, Any] = {
        f"a{side}": {"position": [sign * width, height], "anchored": True}
        for side, sign in (("l", -1), ("r", 1))
    }
    nodes["m"] = {"position": [0.0, middle], "mass": between(0.5, 2.0)}
    members: dict[str, Any] = {}

    def add(name: str, ends: Any, kind: str, part: float) -> None:
        values = {"kind": kind, "spring_constant": between(200.0, 2000.0), "damping": between(1.0, 8.0)}
        for first, second in ends:
            away = np.subtract(nodes[first]["position"], nodes[second]["position"])
            length = round(part * float(np.hypot(*away)), 9)
            members[f"{name}_{first}_{second}"] = {**values, "nodes": [first, second], "rest_length": length}

    add("hang", [("al", "m"), ("ar", "m")], "cable", between(1.05, 1.3))
    last, formulation = "a", "rigid_bar" if seed % 3 == 0 else "node_position"
    for k in range(int(draw.integers(1, 3))):
        place, speed = (
            (between(0.3, 0.9), between(-1.2, -0.7) - 0.3 * k),
            (between(-0.5, 0.5), between(-0.5, 0.5)),
        )
        mass, name = between(0.3, 1.0), f"p{k}"
        for side, sign in (("l", -1), ("r", 1)):
            ends = {"position": [sign * place[0], place[1]], "velocity": [sign * speed[0], speed[1]]}
            if formulation == "rigid_bar" and k == 0:
                ends["velocity"][0] = 0.0
            nodes[name + side] = {**ends, "mass": mass}
        left, right = name + "l", name + "r"
        add("side", [(f"{last}l", left), (f"{last}r", right)], "cable", between(1.02, 1.2))
        kind = "bar" if formulation != "rigid_bar" and draw.random() < 0.5 else "cable"
        add("inside", [("m", left), ("m", right)], kind, between(0.98, 1.1))
        if formulation == "rigid_bar" and k == 0:
            members["beam"] = {"kind": "bar", "nodes": [left, right], "mass": 0.2}
        elif draw.random() < 0.5:
            add("across", [(left, right)], "cable", between(1.05, 1.2))
        last = name
    scene = {"name": "mirrored", "axes": "xz", "gravity": [0, -9.81], "nodes": nodes, "members": members}
    return scene, formulation


@pytest.mark.parametrize("seed", [1, *thorough(*(k for k in range(30) if k != 1))])
def test_random_mirror_symmetric_structures_have_the_derivatives_of_differences(seed: int) -> None:
    scene, formulation = make_mirrored(seed)
    structure, _ = load_scene(scene)
    springs = tuple(k for k, name in enumerate(structure.member_name) if name != "beam")
    columns = ("rest_length", "spring_constant", "damping")
    model = simulator(
        structure,
        "rk853",
        more=("adjoint_rate",),
        formulation=formulation,
        parameters=dict.fromkeys(columns, springs),
        columns=columns,
    )
    draw = np.random.default_rng(seed)
    ways = [draw.normal(size=len(springs)) * model.nominal(name) for name in columns]
    assert check_both_ways(model, 0.7, columns, ways) >= 2
