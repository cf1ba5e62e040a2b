"""Motors with a time constant and a largest rate: closed form, events, plastic members, statics, bad input.

Step 0.02 m, tau 0.1 s, rate 0.05 m/s: u = 0.05 t until t = 0.3, then u = 0.02 - 0.005 exp(-(t - 0.3) / tau).
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.linear.linearize import linearize
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError, SceneError
from tests.models import load, simulator
from tests.plastic_cases import with_plastic
from tests.runtime.build import bar, cable, make_structure, spring

METHODS = ("rk54", "rk853", "rodas", "radau")
LATE = 0.0193233235838  # u(0.5) [m]


def make_winch(rate: float = 0.05, tau: float = 0.1, **member: Any) -> Structure:
    """Return 1 kg on a damped spring along x, whose rest length a motor changes."""
    structure = make_structure(
        [[0, 0, 0], [1.0, 0, 0]],
        [spring(0, 1, 1.0, 1e4, **{"damping": 50.0, **member})],
        anchored={0: "xyz", 1: "yz"},
        inputs=(ActuatedInput("winch", "rest_length", (0,)),),
    )
    return structure.with_changes(actuators=(Actuator("winch", (0,), rate, time_constant=tau),))


def move(model: Any, times: Any, method: str, **more: Any) -> Any:
    samples = np.array(times, dtype=float)
    stepping = Stepping(atol=1e-14, control="steps")
    return simulate(model, samples[-1], samples=samples, method=method, rtol=1e-12, stepping=stepping, **more)


@pytest.mark.parametrize("method", METHODS)
def test_a_motor_follows_its_command_with_lag_and_rate(method: str) -> None:
    model = simulator(make_winch(), *METHODS)
    motion = move(model, [0.0, 0.1, 0.3, 0.5], method, arguments={"winch": 0.02})
    assert motion.internal_name == ("winch_motor",)
    assert motion.internal[:, 0] == pytest.approx([0.0, 0.005, 0.015, LATE], abs=1e-13)
    assert (motion.log.kind, motion.log.name) == (("motor",), ("winch",))
    assert motion.log.time[0] == pytest.approx(0.3, abs=1e-12)
    assert motion.log.direction[0] == 1


def test_a_motor_without_a_rate_lags_alone() -> None:
    model = simulator(make_winch(rate=np.inf), "rk853")
    motion = move(model, [0.0, 0.1, 0.2], "rk853", arguments={"winch": 0.02})
    assert motion.internal[:, 0] == pytest.approx(0.02 * (1 - np.exp([-0.0, -1.0, -2.0])), abs=1e-12)
    assert motion.log.count == 0


def test_commands_may_follow_a_profile_with_a_step() -> None:
    """The command steps from 0 to 0.02 at 0.1 s: the same motion, a tenth of a second later."""
    model = simulator(make_winch(), *METHODS)
    profile = Profile(np.array([0.0, 0.1, 0.1 + 1e-9, 0.6]), {"winch": np.array([0.0, 0.0, 0.02, 0.02])})
    motion = move(model, [0.0, 0.4, 0.6], "rk853", schedule=profile)
    assert motion.internal[:, 0] == pytest.approx([0.0, 0.015, LATE], abs=1e-9)
    assert motion.log.time[-1] == pytest.approx(0.4, abs=1e-8)


def test_fixed_steps_are_of_order_four_through_the_event() -> None:
    model = simulator(make_winch(), "rk4", "rk853")
    exact = move(model, [0.0, 0.5], "rk853", arguments={"winch": 0.02}).coordinate[-1, 0]
    errors = []
    for step in (7e-3, 3.5e-3):
        motion = simulate(
            model,
            0.5,
            samples=[0.0, 0.5],
            method="rk4",
            stepping=Stepping(step=step, control="steps"),
            arguments={"winch": 0.02},
        )
        errors.append(abs(motion.coordinate[-1, 0] - exact))
    assert errors[0] / errors[1] > 10.0


def test_a_plastic_cable_yields_as_a_motor_shortens_it() -> None:
    """Both ends held: x = -u. k 1e4, Fy 50, h 0.1: x = 0.02 - 0.005 e^-2 at 0.5 s; yield at u = -0.005."""
    held = make_structure(
        [[0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]],
        [cable(0, 1, 1.0, 1e4), cable(1, 2, 1.0, 1e7, damping=100.0)],
        anchored={0: "xyz", 1: "yz", 2: "xyz"},
        inputs=(ActuatedInput("winch", "rest_length", (0,)),),
    )
    structure = with_plastic(held, [50.0, 0.0]).with_changes(
        actuators=(Actuator("winch", (0,), 0.05, time_constant=0.1),)
    )
    model = simulator(structure, "rk853")
    profile = Profile(np.array([0.0, 0.5, 0.5 + 1e-9, 1.0]), {"winch": np.array([-0.02, -0.02, 0.0, 0.0])})
    motion = move(model, [0.0, 0.5, 1.0], "rk853", schedule=profile)
    yields = [t for t, kind in zip(motion.log.time, motion.log.kind, strict=True) if kind == "yield"]
    assert yields[0] == pytest.approx(0.1, abs=1e-3)
    x = LATE - (motion.coordinate[1, 0] - 1.0) * -1.0
    q = dict(zip(motion.internal_name, motion.internal[1], strict=True))["e0_plastic"]
    assert q == pytest.approx(0.9 * (x - 0.005), abs=1e-9)
    assert motion.member_tension[1, 0] == pytest.approx(1e4 * (x - q), abs=1e-5)


def test_at_rest_motors_are_at_their_commands() -> None:
    structure = make_winch()
    model = load(structure, *EQUILIBRIUM_QUANTITIES)
    found = find_equilibrium(model, arguments={"winch": 0.02})
    assert found.coordinate == pytest.approx([1.02], abs=1e-12)
    assert found.internal_argument["internal"] == pytest.approx([0.02])
    moving = simulator(structure, *METHODS)
    rest = simulate(
        moving,
        0.1,
        method="rk853",
        samples=3,
        coordinate=found.coordinate,
        arguments={"winch": 0.02, **found.internal_argument},
    )
    assert np.abs(rest.coordinate - 1.02).max() < 1e-12


@pytest.mark.parametrize("formulation", ["node_position", "rigid_bar"])
def test_linear_models_have_the_motor_as_a_state(formulation: str) -> None:
    """Eigenvalue -1/tau, and B = 1/tau in the row of the motor alone."""
    extra = [bar(1, 2, 1.0, 0.0, mass=0.1)] if formulation == "rigid_bar" else []
    structure = make_structure(
        [[0, 0, 0], [1.0, 0, 0], [1.0, 1.0, 0]][: 2 + len(extra)],
        [spring(0, 1, 1.0, 1e4, damping=50.0), *extra],
        anchored={0: "xyz", 1: "yz", 2: "xz"} if extra else {0: "xyz", 1: "yz"},
        inputs=(ActuatedInput("winch", "rest_length", (0,)),),
    ).with_changes(actuators=(Actuator("winch", (0,), 0.05, time_constant=0.1),))
    wanted = ("state_jacobian", "state_derivative", "input_jacobian", "constraint_residual")
    model = load(structure, *wanted[: 3 + len(extra)], formulation=formulation)
    a = model.compute("state_jacobian").toarray()
    b = model.compute("input_jacobian").toarray().ravel()
    assert b[-1] == pytest.approx(10.0)
    assert np.abs(b[:-1]).max() == 0.0
    assert a[-1, -1] == pytest.approx(-10.0)
    assert np.min(np.abs(np.linalg.eigvals(a) + 10.0)) < 1e-6
    if not extra:
        linear = linearize(model)
        assert linear.state_name[-1] == "winch_motor"


def test_batches_of_motions_know_motors() -> None:
    model = simulator(make_winch(), "rk853", batch_width=4, emitter="unrolled")
    commands = np.array([[0.02], [0.01]])
    batch = simulate_batch(model, 0.5, samples=2, method="rk853", arguments={"input": commands}, rtol=1e-9)
    assert batch.internal is not None
    assert batch.internal[0, -1, 0] == pytest.approx(LATE, abs=1e-7)


SCENE = """
name = "lift"
[nodes]
top = {{ position = [0, 0, 1], anchored = true }}
mass = {{ position = [0, 0, 0], mass = 1, anchored = "xy" }}
[members]
rope = {{ kind = "cable", nodes = ["top", "mass"], spring_constant = 1e3 }}
[[actuators]]
name = "winch"
members = "rope"
{values}
[model]
quantities = ["member_tension"]
"""


def read(folder: Path, values: str) -> Structure:
    path = folder / "lift.toml"
    path.write_text(SCENE.format(values=values), encoding="utf-8")
    structure, _ = load_scene(path)
    assert isinstance(structure, Structure)
    return structure


def test_a_time_constant_survives_a_scene_file(tmp_path: Path) -> None:
    structure = read(tmp_path, "time_constant = 0.1\nrate = 0.05")
    assert structure.internal_name == ("winch_motor",)
    write_scene(describe_structure(structure), tmp_path / "again.toml")
    again, _ = load_scene(tmp_path / "again.toml")
    assert again.actuators == structure.actuators


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_a_time_constant_that_cannot_be_is_refused(tmp_path: Path, value: str) -> None:
    with pytest.raises(SceneError, match="time_constant"):
        read(tmp_path, f"time_constant = {value}")


@pytest.mark.parametrize(
    ("request_of", "word"),
    [
        ({"emitter": "table"}, "emitter 'table'"),
        ({"formulation": "node_distance"}, "formulation"),
        ({"solvers": ("equilibrium",)}, "solvers"),
        ({"columns": ("velocity",)}, "derivatives of motions"),
    ],
)
def test_what_does_not_know_lagging_motors_is_refused(request_of: dict[str, Any], word: str) -> None:
    with pytest.raises(FormulationError, match=word):
        simulator(make_winch(), "rk54", **request_of)
    with pytest.raises(FormulationError, match="motors with a time constant"):
        simulate(simulator(make_winch(), *METHODS), 0.01, method="scipy_dop853")
