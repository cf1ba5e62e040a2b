"""Model-predictive control after trouble: solved again at once, and ends where the regulator ends."""

from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.embedded.build_controller import build_controller
from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
from tensegrity_codegen.control.embedded.parts import ControllerCode
from tensegrity_codegen.control.feedback.design.linear_samples import build_rest
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.control.feedback.mpc import design_mpc
from tensegrity_codegen.control.feedback.study.tuning import choose_weights
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tests.body_scenes import assemble_document
from tests.cases import thorough
from tests.control.embedded.troubles import TROUBLES, list_readings
from tests.control.feedback.pinned_prism import Array

SAMPLE = 0.005  # [s]
SOON = 3  # samples, after which each program is solved
QUICK = ("huge", "turns", "jumps of 10 deg", "noise of 5 deg and 100 rad/s", "mirrored", "driven away")


def build_four_bars() -> CompiledModel:
    """Return a prism of four bars on a fixed base, with a motor in each of its twelve cables."""
    turn = [np.pi / 2 * k for k in range(4)]
    foot = {f"b{k + 1}": [0.2 * float(np.cos(a)), 0.2 * float(np.sin(a)), 0.0] for k, a in enumerate(turn)}
    body: dict[str, Any] = {"base": {"kind": "fixed", "points": foot}}
    tendons, kinds = {}, {"top": 12.841020626369412, "vertical": 25.0, "opposite": 8.183171441390478}
    for k in range(1, 5):
        body[f"bar{k}"] = {
            "kind": "bar", "length": 0.5213271835448015, "mass": 0.06, "inertia": 0.023101472745734184,
            "anchor": f"base.b{k}", "azimuth_deg": 75.0 + 90.0 * k, "declination_deg": 47.827618512974254,
        }  # fmt: skip
        after, before = k % 4 + 1, (k + 2) % 4 + 1
        ends = {"top": (f"bar{k}.B", after), "vertical": (f"base.b{k}", before)}
        ends["opposite"] = (f"base.b{k}", after)
        for kind, (first, second) in ends.items():
            tendons[f"{kind}{k}"] = {"class": kind, "points": [first, f"bar{second}.B"]}
    motors = [{"name": f"m_{e}", "members": [e], "rate": 0.15, "range": [0.05, 0.6]} for e in tendons]
    classes = {e: {"kind": "cable", "axial_stiffness": 600.0, "prestress": f} for e, f in kinds.items()}
    friction = [{"bodies": [f"bar{k}", "base"], "coefficient": -0.003} for k in range(1, 5)]
    document = {
        "name": "four_bars", "classes": classes, "bodies": body, "tendons": tendons,
        "joint_friction": friction, "actuators": motors, "limits": {"least_tension": 2.0},
    }  # fmt: skip
    system, request = assemble_document(document)
    return build_library(system, want_analyses(system, request, ("equilibrium", "control"))).load()


@pytest.fixture(scope="module")
def four_bars() -> tuple[CompiledModel, Motion]:
    model = build_four_bars()
    return model, build_rest(model, find_equilibrium(model), 1.0)


def find_state(motion: Motion, time: float) -> Array:
    point = motion.at(time)
    return np.concatenate([point.coordinate, point.velocity])


@pytest.mark.parametrize("precision", ["double", *thorough("single")])
@pytest.mark.parametrize(("count", "kinds"), [(80, QUICK), *thorough((300, tuple(TROUBLES)))])
def test_the_exact_state_is_solved_again_after_every_kind_of_trouble(
    model: CompiledModel, motion: Motion, count: int, kinds: tuple[str, ...], precision: str, tmp_path: Path
) -> None:
    weights = choose_weights(model, motion, sample=SAMPLE)
    mpc = design_mpc(
        model, motion, weights.Q, weights.R, sample=SAMPLE, integral_action=weights.integral_action
    )
    code = ControllerCode(precision=precision)
    controller = build_controller(model, motion, mpc, out=tmp_path / "ctl", code=code).load()
    for kind in kinds:
        controller.init()
        with np.errstate(over="ignore"):  # in single precision
            for time, state in islice(list_readings(kind, lambda t: find_state(motion, t), SAMPLE, 0), count):
                _, rest = controller.step_state(time, state)
                assert np.isfinite(rest).all()
        began = max(float(controller.read("time")), count * SAMPLE)
        began = began if began < 1e6 else count * SAMPLE
        after = [
            controller.step_state(t, find_state(motion, t))[0]
            for t in (began + SAMPLE * k for k in range(1, 61))
        ]
        assert "not_solved" not in after[SOON:], kind


def start_off(parts: tuple[CompiledModel, Motion], degrees: float, **options: Any) -> list[ControlRun]:
    """Return runs of the regulator and of model-predictive control from angles that are off."""
    model, held = parts
    weights = choose_weights(model, held, sample=SAMPLE)
    signs = np.random.default_rng(5).choice([-1.0, 1.0], len(model.nominal("coordinate")))
    away = Disturbance(coordinate_error=np.radians(degrees) * signs)
    return [
        simulate_control_batch(
            model, held,
            design(model, held, weights.Q, weights.R, sample=SAMPLE, integral_action=weights.integral_action),
            draws=[away], t_end=4.0, **options,
        )[0]
        for design in (design_lqr, design_mpc)
    ]  # fmt: skip


@pytest.mark.parametrize("degrees", [8.0, *thorough(2.0, 4.0, 6.0, 10.0)])
def test_a_start_far_off_ends_where_the_regulator_ends(
    four_bars: tuple[CompiledModel, Motion], degrees: float
) -> None:
    check_ends(four_bars, degrees)


@pytest.mark.thorough
@pytest.mark.parametrize("degrees", [2.0, 6.0, 10.0])
def test_a_moving_prism_that_starts_far_off_ends_where_the_regulator_ends(
    model: CompiledModel, motion: Motion, degrees: float
) -> None:
    check_ends((model, motion), degrees)


def check_ends(parts: tuple[CompiledModel, Motion], degrees: float) -> None:
    """Both end within a hundredth of a degree of the motion, and of each other."""
    ends = [run.worst_error(last=0.5) for run in start_off(parts, degrees)]
    assert np.degrees(ends[1]) == pytest.approx(np.degrees(ends[0]), abs=0.005)
    assert np.degrees(ends[1]) < 0.01


def test_sums_that_stand_still_at_least_tensions_are_warned_of(
    four_bars: tuple[CompiledModel, Motion],
) -> None:
    """Stiffnesses are 5 % off, and every cable is to keep its tension."""
    model, held = four_bars
    weights = choose_weights(model, held, sample=SAMPLE)
    mpc = design_mpc(
        model, held, weights.Q, weights.R, sample=SAMPLE, integral_action=weights.integral_action,
        least_tension=20.0,
    )  # fmt: skip
    draw = Disturbance(axial_stiffness=600.0 * np.where(np.arange(12) % 2, 1.05, 0.95))
    run = simulate_control_batch(model, held, mpc, draws=[draw], t_end=1.0, compare=False)[0]
    count = run.step_status.count("tension_limited") + run.step_status.count("least_tension")
    assert count > 100
    assert run.warnings == (
        f"{count / 2:.0f} % of the commands were held back by least tensions or ranges of coordinates, and "
        "integrals of errors stand still then: an error may stay, and smaller least tensions avoid that",
    )


def test_a_run_whose_programs_are_often_not_solved_says_so(four_bars: tuple[CompiledModel, Motion]) -> None:
    """One iteration is too few wherever a limit is active."""
    regulated, planned = start_off(four_bars, 8.0, code=ControllerCode(qp_iterations=1))
    count = planned.step_status.count("not_solved")
    assert regulated.status == "ok"
    assert count > 80
    assert planned.status == "not_solved"
    assert f"800 limited, {count} not solved: the last plan, or feedback, was cut instead" in planned.message
