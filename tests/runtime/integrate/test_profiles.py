"""Inputs that follow a profile in C: orders, kinks and jumps, slack cables, every method, refusals."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tensegrity_codegen import CompiledModel, Profile, simulate
from tensegrity_codegen.runtime.integrate import c_run
from tensegrity_codegen.runtime.integrate.integration import BoundIntegrator
from tensegrity_codegen.runtime.integrate.methods import METHODS, find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.integrate.scipy_methods import build_derivative
from tensegrity_codegen.runtime.profiles.driven import bind_profile
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import STATUS
from tests.cases import thorough
from tests.models import simulator, start_of
from tests.runtime.integrate import nets

INPUTS = (
    ActuatedInput("winch", "rest_length", (0, 2)),
    ActuatedInput("push", "force", (5,), (1.0, 0.0, 0.0)),
)
FloatArray = NDArray[np.float64]

IN_C = ("rk4", "rk54", "rk853", "tsit5", "radau", "rodas")
END = 3.0
# Knots that no equal steps meet, with a jump at 1.31 s.
KNOTS = [0.0, 0.7321, 1.31, 1.31, 1.9173, 2.6457, END]
LINES = Profile(
    KNOTS, {"winch": [0.0, 0.4, -0.2, 0.1, 0.5, 0.5, 0.0], "push": [0.0, 0.0, 2.0, -1.0, 1.0, 0.0, 3.0]}
)
WAVES = Profile(
    np.linspace(0.0, END, 13),
    {"winch": 0.3 * np.sin(np.linspace(0.0, 9.0, 13)), "push": np.cos(np.linspace(0.0, 7.0, 13))},
    "cubic",
)


@pytest.fixture(scope="module")
def net() -> CompiledModel:
    """A soft bar in a plane, one end between four cables that go slack; two of them have a winch."""
    return simulator(nets.net(rod=80.0, inputs=INPUTS), *IN_C)


def follow_by_scipy(model: CompiledModel, profile: Profile, times: FloatArray) -> FloatArray:
    """Return the states at `times` by DOP853 at its least tolerance.

    It begins anew at every knot, before which the profile has the values that hold there, and near the times
    at which cables go slack or taut: any such times would do, they only spare it steps across kinks.
    """
    near = simulate(
        model, END, method="rk853", rtol=1e-9, stepping=Stepping(atol=1e-10), schedule=profile
    ).log.time
    bound = bind_profile(model, profile, {}, END)
    derivative, found = build_derivative(model, {}, bound), [start_of(model)]
    state = found[0]
    for start, end in pairwise(np.unique(np.concatenate([profile.time, times, near])).tolist()):

        def before(t: float, x: FloatArray, last: float = float(np.nextafter(end, 0.0))) -> FloatArray:
            return derivative(min(t, last), x)

        run = solve_ivp(before, (start, end), state, "DOP853", rtol=3e-14, atol=1e-14, max_step=5e-3)
        state = run.y[:, -1]
        if end in times:
            found.append(state)
    return np.array(found)


def take_equal_steps(
    model: CompiledModel, method: str, profile: Profile, count: int
) -> tuple[FloatArray, int]:
    """Return state and number of events after equal steps, each cut at its events and kinks."""
    drive = bind_profile(model, profile, {}, END)
    motion = Motion(model, start_of(model), np.array([0.0, END]), schedule=drive)
    bound = BoundIntegrator(method, motion)
    assert bound.knots is not None
    null, now, counts = bound.ffi.NULL, bound.ffi.new("double *"), bound.ffi.new("integrator_run *")
    counts.watch, counts.profile = 1, bound.knots.struct
    for end in np.linspace(0.0, END, count + 1)[1:].tolist():
        step = bound.ffi.new("double *", END / count)
        given = (end, 1e9, 1e9, 1000, now, step, bound.pointer(bound.state), *bound.arguments(), 0)
        status = bound.call(*given, null, null, bound.n_sampled, counts, bound.pointer(bound.work))
        assert (status, now[0]) == (0, end)
    return bound.state, int(counts.n_events)


FIVE = (800, 1200, 2000)


@pytest.mark.parametrize(
    ("profile", "method", "order", "counts"),
    [
        (LINES, "rk853", 8, (120, 160, 240)),
        *thorough(
            *((profile, method, 5, FIVE) for profile in (LINES, WAVES) for method in ("rk54", "tsit5")),
            (WAVES, "rk853", 8, (200, 280, 400)),
        ),
    ],
)
def test_the_order_is_that_without_a_profile(
    net: CompiledModel, profile: Profile, method: str, order: int, counts: tuple[int, ...]
) -> None:
    """Through 18 events of cables, the knots and a jump; steps meet none of them by themselves."""
    best, n_events = take_equal_steps(net, "rk853", profile, 1000)
    found = [take_equal_steps(net, method, profile, count) for count in counts]
    errors = [np.abs(state - best).max() for state, _ in found]
    assert [events for _, events in found] == [n_events] * len(counts)
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.6)


@pytest.mark.thorough
@pytest.mark.parametrize("profile", [LINES, WAVES], ids=["linear", "cubic"])
def test_the_order_of_the_fixed_step_is_four(net: CompiledModel, profile: Profile) -> None:
    best, _ = take_equal_steps(net, "rk853", profile, 1000)
    counts = (600, 1200, 2400)
    runs = [
        simulate(
            net,
            END,
            samples=2,
            method="rk4",
            stepping=Stepping(step=END / n, control="steps"),
            schedule=profile,
        )
        for n in counts
    ]
    errors = [np.abs(np.hstack([run.coordinate, run.velocity])[-1] - best).max() for run in runs]
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(4, abs=0.4)


@pytest.mark.thorough
@pytest.mark.parametrize("profile", [LINES, WAVES], ids=["linear", "cubic"])
def test_the_order_of_radau_over_tolerances_is_five(net: CompiledModel, profile: Profile) -> None:
    best, _ = take_equal_steps(net, "rk853", profile, 1000)
    steps, errors = [], []
    for tolerance in (1e-6, 1e-7, 1e-8, 1e-9):
        run = simulate(
            net,
            END,
            samples=2,
            method="radau",
            rtol=tolerance,
            stepping=Stepping(atol=tolerance, control="steps"),
            schedule=profile,
        )
        assert run.status == "ok"
        extra = 1.5 * run.log.count + len(profile.time)  # glides, and halves of steps that were cut
        steps.append(run.n_steps - extra)
        errors.append(np.abs(np.hstack([run.coordinate, run.velocity])[-1] - best).max())
    assert -np.polyfit(np.log(steps), np.log(errors), 1)[0] > 4.3


class Made(dict[str, FloatArray]):
    """What is made when it is wanted."""

    def __init__(self, make: Callable[[str], FloatArray]) -> None:
        super().__init__()
        self.make = make

    def __missing__(self, kind: str) -> FloatArray:
        self[kind] = self.make(kind)
        return self[kind]


@pytest.fixture(scope="module")
def by_scipy(net: CompiledModel) -> dict[str, FloatArray]:
    times = np.linspace(0.0, END, 16)
    return Made(lambda kind: follow_by_scipy(net, LINES if kind == LINES.kind else WAVES, times))


@pytest.mark.parametrize("profile", [LINES, *thorough(WAVES)], ids=["linear", "cubic"])
@pytest.mark.parametrize("method", [name for name in METHODS if not find_method(name).scipy])
def test_every_method_in_c_follows_a_profile_as_scipy_does(
    net: CompiledModel, by_scipy: dict[str, FloatArray], method: str, profile: Profile
) -> None:
    given = (
        {"stepping": Stepping(step=5e-4)}
        if method == "rk4"
        else {"rtol": 1e-11, "stepping": Stepping(atol=1e-12)}
    )
    run = simulate(net, END, samples=16, method=method, schedule=profile, **given)
    apart = np.abs(np.hstack([run.coordinate, run.velocity]) - by_scipy[profile.kind]).max()
    assert run.status == "ok"
    assert apart < (1e-6 if method == "rk4" else 1e-10)
    assert "scipy" not in run.method
    assert run.log.count == 18
    assert run.energy_drift is None
    np.testing.assert_allclose(run.input[:, 0], [profile(t)["winch"] for t in run.time], atol=1e-14)


SCIPY = [name for name in METHODS if find_method(name).scipy]
OTHERS = [name for name in SCIPY if name != "scipy_dop853"]


@pytest.mark.parametrize("method", ["scipy_dop853", *thorough(*OTHERS)])
def test_methods_of_scipy_begin_anew_at_kinks(net: CompiledModel, method: str) -> None:
    """A force that jumps, and its slope, on a net whose cables stay taut or slack for so long."""
    push = Profile([0.0, 0.011, 0.011, 0.023, 0.05], {"push": [0.0, 1.0, -20.0, -20.0, 30.0]})
    best = simulate(
        net,
        0.03,
        samples=5,
        method="rk853",
        rtol=1e-13,
        stepping=Stepping(atol=1e-14, control="steps"),
        schedule=push,
    )
    run = simulate(
        net, 0.03, samples=5, method=method, rtol=1e-11, stepping=Stepping(atol=1e-13), schedule=push
    )
    assert (run.status, len(run.time)) == ("ok", 5)
    assert best.log.count == 0
    np.testing.assert_allclose(run.velocity, best.velocity, rtol=0.0, atol=3e-10)


def test_a_jump_that_slackens_a_cable_is_an_event_at_its_time(net: CompiledModel) -> None:
    run = simulate(net, END, method="rk853", rtol=1e-9, stepping=Stepping(atol=1e-10), schedule=LINES)
    at_jump = run.log.time == 1.31
    assert [run.log.name[k] for k in np.flatnonzero(at_jump)] == [net.manifest.member_name[0]]
    assert run.log.direction[at_jump].tolist() == [-1]


@pytest.mark.parametrize("method", ["rk54", "radau"])
def test_many_calls_give_the_bits_of_one(
    net: CompiledModel, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, Any] = {"method": method, "rtol": 1e-7, "stepping": Stepping(atol=1e-8, control="steps")}
    whole = simulate(net, END, schedule=LINES, **given)
    monkeypatch.setattr(c_run, "FIRST_CHUNK", 1)
    monkeypatch.setattr(c_run, "CHUNK_SECONDS", -1.0)
    parts = simulate(net, END, schedule=LINES, **given)
    np.testing.assert_array_equal(parts.coordinate, whole.coordinate)
    np.testing.assert_array_equal(parts.velocity, whole.velocity)
    assert (parts.n_steps, parts.log.count) == (whole.n_steps, whole.log.count)


@pytest.mark.parametrize("method", ["rk54", "rk853", "tsit5", "rk4", "radau"])
def test_a_constant_profile_is_the_constant_input(net: CompiledModel, method: str) -> None:
    is_fixed = method == "rk4"
    stepping = Stepping(1e-3 if is_fixed else None, None if is_fixed else 1e-9, control="steps")
    given: dict[str, Any] = {"rtol": 1e-6 if is_fixed else 1e-8, "stepping": stepping}
    constant = Profile([0.0, END], {"winch": [0.2, 0.2], "push": [1.0, 1.0]})
    inputs = {"winch": 0.2, "push": 1.0}
    driven = simulate(net, END, method=method, schedule=constant, **given)
    plain = simulate(net, END, method=method, arguments=inputs, **given)
    np.testing.assert_array_equal(driven.coordinate, plain.coordinate)
    np.testing.assert_array_equal(driven.member_tension, plain.member_tension)
    assert (driven.n_steps, driven.log.count) == (plain.n_steps, plain.log.count)


def test_a_condition_is_watched_with_the_inputs_at_its_time(net: CompiledModel) -> None:
    ramp = Profile([0.0, 1.0, END], {"push": [0.0, 0.0, 4.0]})
    run = simulate(net, END, schedule=ramp, until="n5.x > 1.9")
    assert run.events[0].kind == "condition"
    assert run.node_position[-1, 5, 0] == pytest.approx(1.9, abs=1e-9)


@pytest.mark.parametrize("values", [{"rod": [0, 0.1, 0.1, 0, 0, 0, 0]}, {"spring_constant": np.ones((7, 5))}])
def test_radau_refuses_members_whose_law_changes(values: Any) -> None:
    inputs = (*INPUTS, ActuatedInput("rod", "rest_length", (4,)))
    held = {"spring_constant": tuple(range(5))}
    model = simulator(nets.net(rod=80.0, inputs=inputs), "rk853", "radau", parameters=held)
    if "spring_constant" in values:
        base = np.tile(model.nominal("spring_constant"), (7, 1))
        base[3, 4] *= 1.01
        values = {"spring_constant": base}
    profile = Profile(KNOTS, values)
    with pytest.raises(InvalidValueError, match="radau holds masses") as caught:
        simulate(model, 1.0, method="radau", schedule=profile)
    assert "e4" in str(caught.value)
    drive = bind_profile(model, profile, {}, END)
    bound = BoundIntegrator("radau", Motion(model, start_of(model), np.array([0.0, END]), schedule=drive))
    assert bound.knots is not None
    run = simulate(model, 1.0, schedule=profile)
    assert run.status == "ok"
    assert "rk853" in run.method
    assert "which radau holds" in run.why_method


def call_c(model: CompiledModel, **changes: Any) -> str:
    """Return the status word of rk853 with a profile of which some fields are changed."""
    drive = bind_profile(model, LINES, {}, END)
    bound = BoundIntegrator("rk853", Motion(model, start_of(model), np.array([0.0, END]), schedule=drive))
    assert bound.knots is not None
    null, run = bound.ffi.NULL, bound.ffi.new("integrator_run *")
    run.profile = bound.knots.struct
    kept = []
    for name, value in changes.items():
        if isinstance(value, np.ndarray):
            value = bound.ffi.from_buffer("double[]", value)
            kept.append(value)
        setattr(bound.knots.struct, name, null if value is None else value)
    given = (END, 1e-6, 1e-6, 10, bound.ffi.new("double *"), bound.ffi.new("double *"))
    tail = (bound.pointer(bound.state), *bound.arguments(), 0, null, null, bound.n_sampled, run)
    return STATUS[bound.call(*given, *tail, bound.pointer(bound.work))]


def test_c_refuses_what_it_cannot_follow(net: CompiledModel) -> None:
    pieces = LINES.pieces
    back, gap = pieces.time.copy(), pieces.coefficient.copy()
    back[2], gap[3, 0, 0] = back[1], np.nan
    assert call_c(net) == "ok"
    assert call_c(net, n_pieces=4) == "invalid_argument"  # ends early
    assert call_c(net, n_pieces=0) == call_c(net, degree=-1) == call_c(net, n_values=-1) == "invalid_argument"
    assert call_c(net, time=pieces.time + 0.1) == call_c(net, time=back) == "invalid_argument"
    assert call_c(net, coefficient=gap) == "non_finite_input"
    assert (
        call_c(net, time=None) == call_c(net, place=None) == call_c(net, coefficient=None) == "null_pointer"
    )
