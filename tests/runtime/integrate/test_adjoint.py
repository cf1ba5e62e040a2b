"""Gradients of motions backwards over their steps, against the columns that are integrated beside them.

Both are exact derivatives of the same steps, one the transpose of the other (Hairer, Norsett, Wanner 1993,
II.15), so that they agree to rounding through contacts, slip and cables pulled taut.
"""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.adjoint import TapedRun
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import motion_gradient
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.plain_c.alone import compile_alone, options_for
from tests.ground_cases import make_prism
from tests.models import simulator, start_of
from tests.runtime.build import make_structure, spring
from tests.runtime.integrate.test_columns import fall
from tests.runtime.integrate.test_ground import rotate

METHODS = ("rk54", "tsit5", "rk853")
OF_CABLE = ("rest_length", "spring_constant", "damping")


def tilted_prism() -> tuple[Structure, dict[str, Any]]:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    cables = tuple(np.flatnonzero(prism.tension_only).tolist())
    return prism, {"formulation": "rigid_bar", "parameters": {"rest_length": cables, "ground": (0, 2)}}


def both_ways(model: CompiledModel, method: str, t_end: float, rtol: float, memory: int = 2**26) -> Any:
    """Return the gradient of a random sum of states at 12 samples by columns and backwards, and the run."""
    motion = Motion(model, start_of(model), np.linspace(0.0, t_end, 12))
    run = TapedRun(motion, RunOptions(method, rtol, rtol / 100), memory)
    raw = run.finish()
    assert raw.status == "ok"
    weight = np.random.default_rng(3).normal(size=raw.columns.shape[:2])
    found = run.go_back(weight)
    return np.einsum("ti,tip->p", weight, raw.columns), found, run


@pytest.mark.parametrize("method", METHODS)
def test_both_ways_agree_where_damped_cables_are_pulled_taut(method: str) -> None:
    wanted = (*OF_CABLE, "coordinate", "velocity")
    model = simulator(
        fall(), method, more=("adjoint_rate",), parameters=dict.fromkeys(OF_CABLE, (0,)), columns=wanted
    )
    columns, found, _ = both_ways(model, method, 3.0, 1e-9)
    backwards = dict(zip(("coordinate", "velocity"), found.state, strict=True))
    backwards |= {name: found.number[name][0] for name in OF_CABLE}
    names = [name.split(".")[0] for name in model.manifest.column_name]
    np.testing.assert_allclose([backwards[name] for name in names], columns, rtol=1e-11)


@pytest.mark.parametrize(("method", "rtol"), [("rk853", 1e-8), *thorough(("rk54", 1e-6), ("tsit5", 1e-6))])
def test_both_ways_agree_through_contacts_and_slip(method: str, rtol: float) -> None:
    prism, request = tilted_prism()
    model = simulator(prism, method, more=("adjoint_rate",), columns=("rest_length", "ground"), **request)
    columns, found, run = both_ways(model, method, 0.6, rtol)
    assert run.result().log.count >= 30
    backwards = np.concatenate([found.number["rest_length"], found.number["ground"]])
    assert np.abs(backwards - columns).max() < 1e-10 * np.abs(columns).max()


def test_many_tapes_make_the_bits_of_one() -> None:
    """A motion that its tape does not hold is integrated again, piece by piece."""
    prism, request = tilted_prism()
    model = simulator(prism, "rk853", more=("adjoint_rate",), **request)
    motion = Motion(model, start_of(model), np.linspace(0.0, 0.6, 7))
    found = []
    for memory in (2**26, 40_000):
        run = TapedRun(motion, RunOptions("rk853", 1e-7, 1e-9), memory)
        raw = run.finish()
        back = run.go_back(np.ones((7, len(start_of(model)) + len(model.manifest.internal_name))))
        found.append((raw.n_steps, len(run.starts), raw.state, back.state, back.number["ground"]))
    (steps, one, state, start, number), (again, many, *others) = found
    assert (steps, one) == (again, 1)
    assert many > 20
    for mine, other in zip((state, start, number), others, strict=True):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_gradients_reach_inputs_over_time(kind: Any) -> None:
    """Against differences of motions; positions, lengths and tensions of all samples count."""
    swing = make_structure(
        [[0, 0, 0], [1.2, 0, 0]],
        [spring(0, 1, 1.0, 40.0)],
        anchored={0: "xyz", 1: "yz"},
        mass=1.0,
        inputs=(ActuatedInput("motor", "rest_length", (0,)),),
    )
    wanted = ("adjoint_rate", "adjoint_tension")
    parameters = {"rest_length": (0,), "anchor_position": (0,)}
    model = simulator(swing, "rk853", more=wanted, parameters=parameters)
    name = swing.inputs[0].name

    def loss(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        position, tension = motion.node_position, motion.member_tension
        length = np.linalg.norm(position[:, 1] - position[:, 0], axis=-1)[:, None]
        value = float((position**2).sum() + (length**3).sum() + 0.01 * (tension**2).sum())
        parts = {"node_position": 2.0 * position, "member_length": 3.0 * length**2}
        return value, {**parts, "member_tension": 0.02 * tension}

    time, knots = [0.0, 0.3, 0.5, 1.0], np.array([0.0, 0.1, -0.05, 0.02])

    def run(values: Any, **changed: Any) -> Any:
        profile = Profile(time, {name: values}, kind)
        return motion_gradient(model, loss, 1.0, samples=9, rtol=1e-11, schedule=profile, arguments=changed)

    found = run(knots)
    for k in range(4):
        step = 1e-5 * np.eye(4)[k]
        slope = (run(knots + step).loss - run(knots - step).loss) / 2e-5
        assert found.knots[name][k] == pytest.approx(slope, rel=1e-6)
    for argument in parameters:
        nominal = model.nominal(argument)
        step = np.zeros_like(nominal)
        step.reshape(-1)[0] = 1e-5
        ends = [run(knots, **{argument: nominal + sign * step}).loss for sign in (1.0, -1.0)]
        assert found.by[argument].reshape(-1)[0] == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6)


def test_a_structure_without_cables_or_parameters_has_gradients_to_its_start() -> None:
    """x = x0 cos(w t) + v0 / w sin(w t), w^2 = k / m."""
    swing = make_structure(
        [[0, 0, 0], [1.2, 0, 0]], [spring(0, 1, 1.0, 40.0)], anchored={0: "xyz", 1: "yz"}, mass=1.0
    )
    model = simulator(swing, "rk853", more=("adjoint_rate",))

    def end(motion: Trajectory) -> tuple[float, dict[str, Any]]:
        weight = np.zeros_like(motion.node_position)
        weight[-1, 1, 0] = 1.0
        return float(motion.node_position[-1, 1, 0]), {"node_position": weight}

    found = motion_gradient(model, end, 0.7, samples=3, rtol=1e-11)
    w = np.sqrt(40.0)
    assert found.by["coordinate"] == pytest.approx([np.cos(0.7 * w)], rel=1e-8)
    assert found.by["velocity"] == pytest.approx([np.sin(0.7 * w) / w], rel=1e-8)


def test_a_library_without_the_adjoint_says_how_to_build_one() -> None:
    model = simulator(fall(), "rk853")
    with pytest.raises(FormulationError, match="adjoint_rate"):
        motion_gradient(model, lambda motion: (0.0, {}), 0.1)
    with pytest.raises(FormulationError, match="not differentiated"):
        build_library(fall(), ModelRequest(("acceleration", "adjoint_rate"), integrators=("rodas",)))


def test_the_c_files_compile_alone_with_the_adjoint(tmp_path: Any) -> None:
    for more in ((), ("-DWITH_INTERNAL=1",), ("-DWITH_INTERNAL=1", "-DWITH_COLUMNS=1")):
        options = (*options_for(15, False), "-DWITH_ADJOINT=1", *more)
        compile_alone(["adjoint.h"], "gcc", "c", options, tmp_path)
        compile_alone(["adjoint.h"], "g++", "c++", options, tmp_path)
