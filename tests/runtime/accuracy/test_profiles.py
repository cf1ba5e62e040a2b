"""`auto` with profiles: a motor ramp on a prism whose cables go slack, with soft and with stiff bars."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import CompiledModel, Profile, Trajectory, simulate, simulate_batch
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import bar, cable, make_structure, prism

END = 2.0
RAMP = Profile([0.0, 0.2, 0.9, 1.2, END], {"motor": [0.0, 0.0, 0.3, 0.3, 0.0]})


def build_prism(bar_stiffness: float) -> CompiledModel:
    """A prism that stands on three nodes, a motor on two of its side cables; cables of 100 N/m."""
    structure = prism(bar_stiffness=bar_stiffness, strain=0.05, anchored=dict.fromkeys(range(3), "xyz"))
    motor = ActuatedInput("motor", "rest_length", (3, 7))
    return simulator(structure.with_changes(inputs=(motor,)), "rk853", "radau")


def apart(run: Trajectory, other: Trajectory) -> tuple[float, float]:
    """Return the largest differences of positions [m] and velocities [m/s]."""
    position = float(np.abs(run.coordinate - other.coordinate).max())
    return position, float(np.abs(run.velocity - other.velocity).max())


@pytest.mark.parametrize("tolerance", [1e-6, *thorough(1e-4, 1e-8)])
def test_a_ramp_with_slack_cables_meets_the_tolerance(tolerance: float) -> None:
    model = build_prism(1e3)
    run = simulate(
        model, END, samples=21, rtol=tolerance, stepping=Stepping(atol=0.1 * tolerance), schedule=RAMP
    )
    best = simulate(
        model,
        END,
        samples=21,
        method="rk853",
        rtol=1e-12,
        stepping=Stepping(atol=1e-13, control="steps"),
        schedule=RAMP,
    )
    position, velocity = apart(run, best)
    assert run.status == "ok"
    assert run.method.startswith("auto (rk853")
    assert run.log.count == best.log.count > 10
    assert max(position, velocity) < tolerance


@pytest.mark.thorough
def test_radau_takes_stiff_bars_and_bounds_what_kinks_excite() -> None:
    """Bars 10^6 times as stiff as cables: kinks of the ramp make them vibrate, which radau leaves out."""
    model = build_prism(1e8)
    run = simulate(model, END, samples=21, rtol=1e-6, stepping=Stepping(atol=1e-7), schedule=RAMP)
    best = simulate(
        model,
        END,
        samples=21,
        method="rk853",
        rtol=1e-9,
        stepping=Stepping(atol=1e-11, control="steps"),
        schedule=RAMP,
    )
    position, velocity = apart(run, best)
    assert run.status == best.status == "ok"
    assert run.method.startswith("auto (radau")
    assert run.evidence["vibration_speed_error"] > 0.0
    assert position < 1e-6
    assert velocity < 2e-6 + run.evidence["vibration_speed_error"]


def test_the_rates_are_those_of_the_whole_profile() -> None:
    """A profile that makes a cable 40 times as stiff later on."""
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0]], [cable(0, 1, 0.9, mu=0.0, axial=100.0)], anchored={0: "xyz"},
        inputs=(ActuatedInput("motor", "rest_length", (0,)),),
    )  # fmt: skip
    model = simulator(structure, "rk853")
    shrink = Profile([0.0, 0.5, 1.0], {"motor": [0.0, 0.0, -0.88]})
    run = simulate(model, 1.0, samples=11, rtol=1e-8, stepping=Stepping(atol=1e-9), schedule=shrink)
    best = simulate(
        model,
        1.0,
        samples=11,
        method="rk853",
        rtol=1e-12,
        stepping=Stepping(atol=1e-13, control="steps"),
        schedule=shrink,
    )
    assert run.status == "ok"
    assert max(apart(run, best)) < 1e-7 * np.abs(best.velocity).max()


def test_a_batch_runs_its_motions_in_c_one_after_the_other() -> None:
    model = build_prism(1e3)
    start = model.nominal("coordinate") + np.linspace(0.0, 0.01, 3)[:, None]
    options: dict[str, Any] = {"samples": 5, "rtol": 1e-8, "schedule": RAMP}
    batch = simulate_batch(model, END, coordinate=start, threads=2, stepping=Stepping(atol=1e-9), **options)
    assert batch.status == ("ok",) * 3
    assert batch.method == "rk853"
    for k in range(3):
        alone = simulate(
            model,
            END,
            method="rk853",
            coordinate=start[k],
            stepping=Stepping(atol=1e-9),
            **options,
        )
        np.testing.assert_array_equal(batch.coordinate[k], alone.coordinate)


def test_rigid_bars_do_not_grow() -> None:
    position = [[0, 0, 0], [1, 0, 0.1], [0.4, 0.3, 1.1]]
    members = [cable(0, 1, 0.9), cable(1, 2, 1.0), bar(0, 2, 1.2083045973594573, 0.0)]
    inputs = (ActuatedInput("motor", "rest_length", (0,)), ActuatedInput("jack", "rest_length", (2,)))
    structure = make_structure(position, members, anchored={0: "xyz"}, inputs=inputs)
    model = simulator(structure, "rk853", formulation="rigid_bar")
    assert simulate(model, 0.5, schedule=Profile([0.0, 1.0], {"motor": [0.0, 0.1]})).status == "ok"
    for method in ("auto", "rk853", "scipy_dop853"):
        with pytest.raises(InvalidValueError, match="rigid bars keep their lengths"):
            simulate(model, 0.5, method=method, schedule=Profile([0.0, 0.2, 1.0], {"jack": [0.0, 0.0, 0.1]}))
