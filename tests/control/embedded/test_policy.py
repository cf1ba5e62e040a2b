"""Policies in C: the commands of NumPy under rates, ranges and delays; bad observations; refusals."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle, build_controller
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorLimits
from tensegrity_codegen.control.feedback.policy import Acted, Description, Observed, Policy, read_policy
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.cases import thorough
from tests.codegen.build_c import has_sanitizers, run
from tests.codegen.compilers import require_compiler
from tests.codegen.quickly import SANITIZE, without_optimisation
from tests.control.embedded.test_in_programs import PROMOTION, compile_all, list_c

SAMPLE = 0.02
# Two actuators in another order than that of the scene; the input zero is not in the range of the second.
ACTIONS = (
    Acted("m_vertical2", 0.005, 0.02, rate=0.1, delay=0.03),
    Acted("m_top1", 0.02, 0.01, rate=0.05),
    Acted("m_opposite3", -0.01, 0.03, rate=0.08, delay=0.05),
)
SEEN = (Observed("length of top1", "m"), Observed("command", "m", 3), Observed("bar1.axis", "1", 3))
DESCRIPTION = Description("pinned_prism", SAMPLE, SEEN, ACTIONS)


def draw_policy(hidden: tuple[int, ...] = (9, 5), **changes: Any) -> Policy:
    """Return a network with random numbers that moves its actuators up to all limits."""
    random, sizes = np.random.default_rng(7), (7, *hidden, 3)
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    return Policy(
        weights=tuple(random.normal(size=pair) for pair in pairs),
        biases=tuple(0.3 * random.normal(size=pair[0]) for pair in pairs),
        mean=np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        scale=np.array([0.1, 0.2, 0.2, 0.2, 1.0, 0.5, 0.5]),  # rounding decays from command to command
        clip=2.5,
        description=DESCRIPTION,
        **changes,
    )


def follow(policy: Policy, observations: NDArray[np.float64]) -> tuple[list[str], NDArray[np.float64]]:
    """Return statuses and commands by the policy in NumPy and the cuts to rates and ranges."""
    centre, half, rate = np.array([(a.centre, a.half_range, a.rate) for a in ACTIONS]).T
    command = np.where(np.abs(centre) <= half, 0.0, centre)
    statuses, commands = [], []
    for row in observations:
        status = "non_finite_input"
        if np.isfinite(row).all():
            wanted = centre + half * policy(np.insert(row, [1] * 3, command))
            least, most = command - rate * SAMPLE, command + rate * SAMPLE
            command = np.clip(np.clip(wanted, least, most), centre - half, centre + half)
            status = "ok" if np.abs(command - wanted).max() <= 1e-12 else "rate_limited"
        statuses.append(status)
        commands.append(command)
    return statuses, np.array(commands)


def build(model: CompiledModel, policy: Policy, out: Path, **code: Any) -> ControllerBundle:
    """Build a controller quickly."""
    with without_optimisation():
        return build_controller(model, policy=policy, out=out, code=ControllerCode(**code))


@pytest.fixture(scope="module")
def bundle(model: CompiledModel, tmp_path_factory: pytest.TempPathFactory) -> ControllerBundle:
    """A controller with hidden layers of tanh, of which programs are made."""
    return build(model, draw_policy(), tmp_path_factory.mktemp("policy") / "ctl")


def draw_observations(count: int) -> NDArray[np.float64]:
    """Return observations without commands, slow and fast ones, some far out, some not finite."""
    random = np.random.default_rng(3)
    slow = np.array([0.3, 0.0, 0.0, 1.0]) + np.cumsum(random.normal(0.0, 0.05, size=(count, 4)), axis=0)
    rows = np.where(np.arange(count)[:, None] % 200 < 150, slow, random.normal(size=(count, 4)))
    rows[::37] *= 1e250
    rows[11::53, 2] = np.nan
    rows[17::91, 0] = -np.inf
    return rows


@pytest.mark.parametrize(
    ("hidden", "changes"),
    [
        ((9, 5), {}),
        ((12,), {"activation": "relu", "output": "tanh"}),
        *thorough(((3, 8), {"activation": "elu"})),
        *thorough(((), {"output": "tanh"})),
    ],
)
def test_commands_are_those_of_numpy(
    model: CompiledModel, tmp_path: Path, hidden: tuple[int, ...], changes: dict[str, Any]
) -> None:
    """To 1e-12 over 3,000 steps, in range and within rate, with inputs that arrive after their delays."""
    policy, rows = draw_policy(hidden, **changes), draw_observations(3000)
    controller = build(model, policy, tmp_path / "ctl").load()
    statuses, expected = follow(policy, rows)
    assert controller.init() == "ok"
    found, lengths, arrived = [], [], []
    for k, row in enumerate(rows):
        status, length = controller.step(k * SAMPLE, row) if k % 2 else controller.next(row)
        found.append((status, controller.read("command")))
        lengths.append(length)
        arrived.append(controller.read("input"))
    np.testing.assert_allclose([command for _, command in found], expected, rtol=0, atol=1e-12)
    assert [status for status, _ in found] == statuses
    assert {"ok", "rate_limited", "non_finite_input"} == set(statuses)
    structure = model.structure
    assert structure is not None
    rest = structure.rest_length[
        [model.manifest.member_name.index(name[2:]) for name in ("m_vertical2", "m_top1", "m_opposite3")]
    ]
    np.testing.assert_allclose(lengths, rest + expected, rtol=0, atol=1e-12)
    # Delays of 1.5, 0 and 2.5 samples: at the start of a sample what was sent 2, 0 and 3 samples before.
    places = [model.manifest.input_name.index(acted.name) for acted in ACTIONS]
    late = np.array(arrived)[:, places]
    for u, back in enumerate((2, 0, 3)):
        np.testing.assert_allclose(late[back:, u], expected[: len(rows) - back, u], rtol=0, atol=1e-12)


@pytest.mark.parametrize("hidden", [(), (12, 7)])
def test_actions_without_tanh_have_the_bits_of_numpy(
    model: CompiledModel, tmp_path: Path, hidden: tuple[int, ...]
) -> None:
    policy = draw_policy(hidden, activation="relu", output="linear")
    controller = build(model, policy, tmp_path / "ctl").load()
    controller.init()
    for row in draw_observations(200):
        if np.isfinite(row).all():
            seen = np.insert(row, [1] * 3, controller.read("command"))
            controller.next(row)
            assert np.array_equal(controller.read("action"), policy(seen))
            assert np.array_equal(policy(np.array([0 * seen, seen]))[1], policy(seen))


def test_single_precision_follows_double(model: CompiledModel, tmp_path: Path) -> None:
    """To 1e-6 m, without a number in double precision; the sources give no warning."""
    policy, rows = draw_policy(activation="elu"), draw_observations(300)
    single = build(model, policy, tmp_path / "ctl", precision="single", name="small")
    compile_all(single, require_compiler("gcc").command, "-std=c99", "-O1", PROMOTION, "-Wunused")
    assert "double" not in (single.folder / "small_control.c").read_text(encoding="utf-8")
    controller = single.load()
    controller.init()
    rows[np.abs(rows) > 1e30] = 50.0
    _, expected = follow(policy, rows)
    found = []
    for row in rows:
        controller.next(row)
        found.append(controller.read("command"))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_what_a_policy_does_not_need_is_left_out(bundle: ControllerBundle) -> None:
    """No motion, gains, estimator or model; nothing static is written and nothing allocated."""
    assert not any("model" in name for name in bundle.files)
    source = "".join((bundle.folder / f"pinned_prism_control.{end}").read_text("utf-8") for end in "ch")
    for word in (
        "MOTION",
        "GAIN",
        "estimate[",
        "deviation[",
        "step_state",
        "malloc",
        "N_COORDINATES",
        "DURATION",
    ):
        assert word not in source
    compile_all(bundle, require_compiler("gcc").command, "-std=c99", "-O1", "-Wunused")
    if (nm := shutil.which("nm")) is None:
        pytest.skip("nm is not installed: binutils has it")
    lines = run([nm, "pinned_prism_control.c.o"], bundle.folder).stdout.splitlines()
    kinds = {line.split()[-2]: line.split()[-1] for line in lines}
    assert set(kinds) <= {"T", "t", "r", "R", "U"}
    assert {line.split()[-1] for line in lines if " U " in line} <= {
        "memset",
        "memcpy",
        "tanh",
        "_GLOBAL_OFFSET_TABLE_",
    }


def test_the_manifest_and_the_readme_say_what_is_observed(bundle: ControllerBundle) -> None:
    """Sizes, names and activation; names in C too."""
    data = json.loads((bundle.folder / "manifest.json").read_text(encoding="utf-8"))
    assert data["policy"]["sizes"] == [7, 9, 5, 3]
    assert data["policy"]["activation"] == "tanh"
    assert Description.from_json(json.dumps(data["policy"]["description"])) == DESCRIPTION
    names = ["length of top1 in m", "bar1.axis[0] in 1", "bar1.axis[1] in 1", "bar1.axis[2] in 1"]
    assert data["sensors"] == names
    assert data["actuators"] == ["m_vertical2", "m_top1", "m_opposite3"]
    assert data["sizes"]["N_SENSORS"] == 4
    readme = (bundle.folder / "README.md").read_text(encoding="utf-8")
    assert "Order of the observation: length of top1 in m, bar1.axis[0] in 1," in readme
    assert "- nodes: base_b1, base_b2, base_b3, bar1_A, " in readme
    assert "\n- members: bottom1, " in readme
    assert "- bodies" not in readme
    assert "pinned_prism_control_init(&c);" in readme
    assert bundle.load().description.policy == data["policy"]


def test_the_example_runs(bundle: ControllerBundle, tmp_path: Path) -> None:
    """Ten steps at the mean of what is observed."""
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    folder = Path(shutil.copytree(bundle.folder, tmp_path / "copy"))
    run(["make", "CC=" + " ".join(require_compiler("gcc").command)], folder)
    said = run([str(folder / "example")], folder).stdout.split()
    policy = draw_policy()
    mean = np.array([policy.mean[[0, 4, 5, 6]]] * 10)
    _, expected = follow(policy, mean)
    rest = bundle.load()
    rest.init()
    for row in mean:
        _, length = rest.next(row)
    assert said.count("m_opposite3") == 10
    assert float(said[-2]) == pytest.approx(length[2], abs=1e-6)
    np.testing.assert_allclose(rest.read("command"), expected[-1], rtol=0, atol=1e-12)


# Memory of any content, NULL, numbers that are not finite or huge, times that go back.
TROUBLES = r"""
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "pinned_prism_control.h"

int main(void)
{
  static const double bad[6] = {0.0 / 1.0, 1e308, -1e308, NAN, INFINITY, -INFINITY};
  pinned_prism_control c;
  double seen[4] = {0.3, 0.0, 0.0, 1.0}, rest[3];
  int k, u, wrong = 0, status;
  memset(&c, 0xa5, sizeof c);
  wrong += pinned_prism_control_step(&c, 0.0, seen, rest) != PINNED_PRISM_CONTROL_NOT_INITIALISED;
  wrong += pinned_prism_control_init(NULL) != PINNED_PRISM_CONTROL_NULL_POINTER;
  wrong += pinned_prism_control_init(&c) != PINNED_PRISM_CONTROL_OK;
  wrong += pinned_prism_control_step(&c, 0.0, NULL, rest) != PINNED_PRISM_CONTROL_NULL_POINTER;
  wrong += pinned_prism_control_step(&c, 0.0, seen, NULL) != PINNED_PRISM_CONTROL_NULL_POINTER;
  for (k = 0; k < 600; ++k) {
    double before[3];
    memcpy(before, c.command, sizeof before);
    seen[k % 4] = bad[k % 6];
    status = pinned_prism_control_step(&c, k % 50 == 49 ? NAN : k * 0.02, seen, rest);
    for (u = 0; u < 3; ++u) {
      wrong += !(fabs(c.command[u] - before[u]) <= 0.1 * 0.02 * (1.0 + 1e-9)) || !isfinite(rest[u]);
    }
    wrong += (k % 6 >= 3) && status != PINNED_PRISM_CONTROL_NON_FINITE_INPUT;
    seen[k % 4] = 0.5;
  }
  wrong += pinned_prism_control_step(&c, 0.0, seen, rest) != PINNED_PRISM_CONTROL_REPEATED_TIME;
  wrong += strcmp(pinned_prism_control_sensor_name(3), "bar1.axis[2] in 1") != 0;
  printf("wrong %d\n", wrong);
  return 0;
}
"""


def test_bad_observations_never_leave_the_limits(bundle: ControllerBundle, tmp_path: Path) -> None:
    """Under the sanitizers of gcc, where these are installed."""
    gcc = require_compiler("gcc")
    (tmp_path / "main.c").write_text(TROUBLES, encoding="utf-8")
    options = SANITIZE if has_sanitizers(gcc, tmp_path) else ("-O1",)
    sources = [str(bundle.folder / name) for name in list_c(bundle)]
    run(
        [*gcc.command, "-std=c99", *options, f"-I{bundle.folder}", "main.c", *sources, "-o", "main", "-lm"],
        tmp_path,
    )
    assert run([str(tmp_path / "main")], tmp_path).stdout == "wrong 0\n"


@pytest.mark.parametrize(
    "motor", ['inputs]]\nkind = "rest_length"', "actuators]]\nrate = 0.1\ntime_constant = 0.05"]
)
def test_a_policy_of_a_file_moves_inputs_of_a_scene_file(motor: str, tmp_path: Path) -> None:
    """Inputs and motors that lag have no limits of commands but those of the policy; names are safe in C."""
    scene, stored = tmp_path / "mass.toml", tmp_path / "policy.npz"
    scene.write_text(
        'name = "mass"\naxes = "z"\n[nodes]\ntop = { position = [0, 0, 0], anchored = true }\n'
        "load = { position = [0, 0, -1], mass = 1.0 }\n[members]\n"
        'cord = { nodes = ["top", "load"], class = "cable" }\n'
        '[classes.cable]\nkind = "cable"\nspring_constant = 100.0\nrest_length = 0.9\n'
        f'[[{motor}\nname = "motor"\nmembers = ["cord"]\n',
        encoding="utf-8",
    )
    description = Description(
        "mass", 0.1, (Observed('max("load.z") ??/ */', "m"),), (Acted("motor", 0.0, 0.2),)
    )
    Policy(
        weights=(np.array([[2.0]]),), biases=(np.array([0.1]),), mean=np.array([-1.0]), scale=np.ones(1),
        description=description,
    ).write(stored)  # fmt: skip
    with without_optimisation():
        controller = build_controller(scene, policy=read_policy(stored), out=tmp_path / "ctl").load()
    controller.init()
    assert controller.description.sensors == ("max(_load.z_) __/ */ in m",)
    status, length = controller.step(0.0, [-0.9])  # 0.9 + 0.2 (2 * 0.1 + 0.1)
    assert status == "ok"
    np.testing.assert_allclose(length, [0.96], rtol=0, atol=1e-15)
    with pytest.raises(InvalidValueError, match="shape"):
        controller.init([0.0])
    with pytest.raises(InvalidValueError, match="shape"):
        controller.step(0.1, [0.0, 0.0])


SCENE = """
name = "mass"
axes = "z"
nodes = { top = { position = [0, 0, 0], anchored = true }, load = { position = [0, 0, -1], mass = 1.0 } }
members = { cord = { nodes = ["top", "load"], class = "cable" } }
classes = { cable = { kind = "cable", spring_constant = 100.0, rest_length = 0.9 } }
inputs = [{ kind = "force", name = "push", nodes = ["load"], direction = [0, 0, 1] }]
actuators = [{ name = "motor", members = ["cord"] }]
"""


def build_on_mass(folder: Path, weight: float, name: str) -> ControllerBundle:
    """Build the controller of a network with a single weight, which moves that input."""
    (folder / "mass.toml").write_text(SCENE, encoding="utf-8")
    policy = Policy(
        weights=(np.array([[weight]]),), biases=(np.zeros(1),), mean=np.zeros(1), scale=np.ones(1),
        description=Description("mass", 0.1, (Observed("x"),), (Acted(name, 0.0, 0.2),)),
    )  # fmt: skip
    with without_optimisation():
        return build_controller(folder / "mass.toml", policy=policy, out=folder / "ctl")


def test_a_controller_that_is_built_again_runs_the_new_code(tmp_path: Path) -> None:
    """While the old one of that folder is alive and goes on."""
    controllers = []
    for weight in (0.1, 0.9):
        controllers.append(build_on_mass(tmp_path, weight, "motor").load())
        controllers[-1].init()
    for controller, weight in zip(controllers, (0.1, 0.9), strict=True):
        controller.next([0.5])
        assert controller.read("action").tolist() == [0.5 * weight]


def test_a_policy_that_pushes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="moves rest lengths alone") as refused:
        build_on_mass(tmp_path, 0.1, "push")
    assert "push" in str(refused.value.given)


def change_action(**changes: Any) -> Policy:
    """Return a policy with another first action."""
    actions = (replace(ACTIONS[0], **changes), *ACTIONS[1:])
    return replace(draw_policy(), description=replace(DESCRIPTION, action=actions))


@pytest.mark.parametrize(
    ("policy", "error", "says"),
    [
        (lambda: change_action(name="m_vertica2"), UnknownNameError, "did you mean 'm_vertical2'"),
        (lambda: change_action(half_range=0.5), InvalidValueError, "0.1 to 0.5 m, 0.1 m/s"),
        (lambda: change_action(rate=0.2), InvalidValueError, "0.2 m/s"),
        (lambda: change_action(rate=np.inf), InvalidValueError, "inf m/s"),
        (lambda: "policy.npz", InvalidValueError, "as of read_policy"),
    ],
)
def test_policies_of_other_scenes_are_refused(
    model: CompiledModel, tmp_path: Path, policy: Callable[[], Any], error: type[Exception], says: str
) -> None:
    """Actuators that do not exist, or that can do less."""
    with pytest.raises(error) as refused:
        build_controller(model, policy=policy(), out=tmp_path / "ctl")
    assert says in str(refused.value)
    assert not (tmp_path / "ctl").exists()


def test_other_parts_beside_a_policy_are_refused(
    model: CompiledModel, motion: Motion, gains: Gains, tmp_path: Path
) -> None:
    """Each by its name; so is a controller of nothing."""
    parts: dict[str, Any] = {
        "motion": motion, "gains": gains, "sample": 0.02, "limits": ActuatorLimits(rate=0.1), "arguments": {},
    }  # fmt: skip
    for name, part in parts.items():
        with pytest.raises(InvalidValueError, match="no place beside a policy") as refused:
            build_controller(model, policy=draw_policy(), out=tmp_path / "ctl", **{name: part})
        assert refused.value.where == name
    with pytest.raises(InvalidValueError, match="not a motion"):
        build_controller(model, out=tmp_path / "ctl")
