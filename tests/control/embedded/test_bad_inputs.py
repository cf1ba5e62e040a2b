"""Steps with inputs that cannot be used: a status, and a command within rate and range."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.control.embedded.build_controller import ControllerBundle
from tensegrity_codegen.control.embedded.loaded import LoadedController
from tensegrity_codegen.control.feedback.design.gains import Estimator
from tensegrity_codegen.runtime.records.timed_motion import Motion

Array = NDArray[np.float64]
SAMPLE, RATE = 0.005, 0.1


@pytest.fixture
def controller(bundle: ControllerBundle) -> LoadedController:
    found = bundle.load()
    assert found.init() == "ok"
    return found


@pytest.fixture(scope="module")
def measured(motion: Motion, estimator: Estimator) -> Callable[[int], Array]:
    """Measurements of a sample, on the motion."""

    def find(k: int) -> Array:
        point = motion.at(k * SAMPLE)
        at = {"coordinate": point.coordinate, "velocity": point.velocity, "input": point.input}
        return np.array(estimator.sensing.measure(at))

    return find


def go(controller: LoadedController, measured: Callable[[int], Array], first: int, count: int) -> Array:
    for k in range(first, first + count):
        status, rest = controller.step(k * SAMPLE, measured(k))
        assert status == "ok"
    return rest


def spoil(values: Array, place: int, value: float) -> Array:
    found = values.copy()
    found[place] = value
    return found


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.nan, "non_finite_input"),
        (np.inf, "non_finite_input"),
        (0.0, "invalid_length"),
        (-0.3, "invalid_length"),
    ],
)
def test_measurements_of_no_use_keep_the_command(
    controller: LoadedController, measured: Callable[[int], Array], value: float, expected: str
) -> None:
    """The estimate goes on without them, and the next good ones are used again."""
    before = go(controller, measured, 0, 40)
    sums = controller.read("deviation")[12:]
    for k in range(40, 45):
        status, rest = controller.step(k * SAMPLE, spoil(measured(k), k - 40, value))
        assert status == expected
        np.testing.assert_array_equal(rest, before)
    np.testing.assert_array_equal(controller.read("deviation")[12:], sums)
    status, rest = controller.step(45 * SAMPLE, measured(45))
    assert status in ("ok", "rate_limited")
    assert (np.abs(rest - before) <= RATE * SAMPLE * (1 + 1e-12)).all()


def test_measurements_of_no_use_at_the_first_step(
    controller: LoadedController, measured: Callable[[int], Array], motion: Motion
) -> None:
    status, rest = controller.step(0.0, spoil(measured(0), 2, np.nan))
    assert status == "non_finite_input"
    assert rest == pytest.approx(motion.rest_length[0], rel=1e-12)


@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_times_that_are_no_numbers_change_nothing(
    controller: LoadedController, measured: Callable[[int], Array], time: float
) -> None:
    before = go(controller, measured, 0, 10)
    estimate = controller.read("estimate")
    status, rest = controller.step(time, measured(10))
    assert status == "non_finite_input"
    np.testing.assert_array_equal(rest, before)
    np.testing.assert_array_equal(controller.read("estimate"), estimate)
    assert controller.step(10 * SAMPLE, spoil(measured(10), 0, np.nan))[0] == "non_finite_input"
    assert (controller.read("estimate") != estimate).any()
    go(controller, measured, 11, 10)


@pytest.mark.parametrize("back", [0, 1, 9])
def test_repeated_and_backward_times_change_nothing(
    bundle: ControllerBundle, controller: LoadedController, measured: Callable[[int], Array], back: int
) -> None:
    before = go(controller, measured, 0, 10)
    status, rest = controller.step((9 - back) * SAMPLE, measured(9))
    assert status == "repeated_time"
    np.testing.assert_array_equal(rest, before)
    other = bundle.load()
    other.init()
    go(other, measured, 0, 10)
    np.testing.assert_array_equal(go(controller, measured, 10, 5), go(other, measured, 10, 5))


@pytest.mark.parametrize("from_state", [False, True])
def test_one_time_far_ahead_does_not_stop_the_controller(
    controller: LoadedController, measured: Callable[[int], Array], motion: Motion, from_state: bool
) -> None:
    """The third time that is refused, with times that rise, is taken for the clock."""

    def step(k: int, time: float) -> tuple[str, Array]:
        if not from_state:
            return controller.step(time, measured(k))
        point = motion.at(k * SAMPLE)
        return controller.step_state(time, np.concatenate([point.coordinate, point.velocity]))

    before = go(controller, measured, 0, 10)
    times = [1e6, *(k * SAMPLE for k in range(11, 60))]
    found = [step(10 + k, time) for k, time in enumerate(times)]
    assert [status for status, _ in found[:4]] == ["late", "repeated_time", "repeated_time", "late"]
    for _, rest in found[:4]:
        np.testing.assert_array_equal(rest, before)
    assert {status for status, _ in found[4:]} <= {"ok", "rate_limited"}
    assert [status for status, _ in found[40:]] == ["ok"] * 10
    change = np.diff([rest for _, rest in found], axis=0)
    assert (np.abs(change) <= RATE * SAMPLE * (1 + 1e-12)).all()
    assert controller.step(59 * SAMPLE, measured(59))[0] == "repeated_time"


def test_times_that_do_not_rise_never_set_the_clock(
    controller: LoadedController, measured: Callable[[int], Array]
) -> None:
    before = go(controller, measured, 0, 40)
    for k in [*[39] * 10, *range(38, 20, -1), *[20, 30, 25] * 5, 31]:
        status, rest = controller.step(k * SAMPLE, measured(k))
        assert status == "repeated_time"
        np.testing.assert_array_equal(rest, before)
    assert controller.step(32 * SAMPLE, spoil(measured(32), 0, np.nan))[0] == "late"
    assert controller.step(33 * SAMPLE, measured(33))[0] in ("ok", "rate_limited")


def test_a_late_step_keeps_the_command_and_the_next_one_goes_on(
    controller: LoadedController, measured: Callable[[int], Array]
) -> None:
    before = go(controller, measured, 0, 10)
    status, rest = controller.step(12 * SAMPLE, measured(12))
    assert status == "late"
    np.testing.assert_array_equal(rest, before)
    status, rest = controller.step(13 * SAMPLE, measured(13))
    assert status in ("ok", "rate_limited")
    assert (np.abs(rest - before) <= RATE * SAMPLE * (1 + 1e-12)).all()


def test_a_step_one_sample_late_is_not_refused(
    controller: LoadedController, measured: Callable[[int], Array]
) -> None:
    before = go(controller, measured, 0, 10)
    status, rest = controller.step(11 * SAMPLE, measured(11))
    assert status in ("ok", "rate_limited")
    assert (np.abs(rest - before) <= RATE * SAMPLE * (1 + 1e-12)).all()


def test_an_early_step_moves_by_the_rate_for_its_time_only(
    controller: LoadedController, measured: Callable[[int], Array]
) -> None:
    before = go(controller, measured, 0, 10)
    far = measured(10) + 0.003
    status, rest = controller.step(9.1 * SAMPLE, far)
    assert status == "rate_limited"
    assert (np.abs(rest - before) <= 0.1 * RATE * SAMPLE * (1 + 1e-9)).all()


def test_an_estimate_that_is_lost_starts_again_from_the_motion(
    controller: LoadedController, measured: Callable[[int], Array], motion: Motion
) -> None:
    """From a state with velocities that no prediction survives."""
    go(controller, measured, 0, 10)
    _, before = controller.step_state(10 * SAMPLE, np.full(12, 1e300))
    status, rest = controller.step(11 * SAMPLE, measured(11))
    assert status == "estimate_lost"
    np.testing.assert_array_equal(rest, before)
    assert controller.read("estimate")[:6] == pytest.approx(motion.at(11 * SAMPLE).coordinate, rel=1e-12)
    assert controller.step(12 * SAMPLE, measured(12))[0] in ("ok", "rate_limited")


@pytest.mark.parametrize("off", [1e300, 0.03])
def test_outliers_are_predicted_and_leave_the_estimate(
    bundle: ControllerBundle, measured: Callable[[int], Array], estimator: Estimator, off: float
) -> None:
    """A length that cannot be, or is 30 mm off, three times in a row; then the loop goes on."""
    one, other = bundle.load(), bundle.load()
    for controller in (one, other):
        controller.init()
        before = go(controller, measured, 0, 30)
    for k in range(30, 33):
        status, rest = one.step(k * SAMPLE, spoil(measured(k), 4, measured(k)[4] + off))
        assert status == "outlier"
        np.testing.assert_array_equal(rest, before)
        assert other.step(k * SAMPLE, measured(k))[0] == "ok"
        apart = np.abs(one.read("estimate")[:6] - other.read("estimate")[:6]).max()
        assert apart < 1e-3  # [rad]; the measurements alone would move it by far more
    assert one.step(33 * SAMPLE, measured(33))[0] in ("ok", "rate_limited")
    assert np.linalg.norm(estimator.at(0.15)[:6, 4]) * 0.03 > 2e-3


def test_what_stays_far_from_its_prediction_is_accepted_in_the_end(
    controller: LoadedController, measured: Callable[[int], Array], estimator: Estimator
) -> None:
    """A structure that stands elsewhere is no outlier for good; each one doubles what is accepted."""
    go(controller, measured, 0, 30)
    size = 30.0 * float(estimator.innovation[0, 4])
    words = [
        controller.step(k * SAMPLE, spoil(measured(k), 4, measured(k)[4] + size))[0] for k in range(30, 34)
    ]
    assert words[:3] == ["outlier"] * 3
    assert words[3] in ("ok", "rate_limited")


def test_memory_without_init_and_null_pointers(bundle: ControllerBundle, motion: Motion) -> None:
    controller = bundle.load()
    status, rest = controller.step(0.0, np.ones(9))
    assert status == "not_initialised"
    assert rest == pytest.approx(motion.rest_length[0], rel=1e-12)
    controller.init()
    status, rest = controller.step(0.0, None)
    assert status == "null_pointer"
    assert rest == pytest.approx(motion.rest_length[0], rel=1e-12)
    status, rest = controller.step_state(0.0, None)
    assert status == "null_pointer"


def test_a_start_that_is_no_number_is_the_start_of_the_motion(
    bundle: ControllerBundle, motion: Motion
) -> None:
    controller = bundle.load()
    assert controller.init(np.full(6, np.nan)) == "non_finite_input"
    assert controller.read("estimate")[:6] == pytest.approx(motion.coordinate[0], rel=1e-14)
    assert controller.init(motion.coordinate[0] + 0.01) == "ok"
    assert controller.read("estimate")[:6] == pytest.approx(motion.coordinate[0] + 0.01, rel=1e-14)


def test_steps_without_times_are_those_at_multiples_of_the_sample(
    bundle: ControllerBundle, controller: LoadedController, measured: Callable[[int], Array]
) -> None:
    rest = go(controller, measured, 0, 30)
    other = bundle.load()
    other.init()
    for k in range(30):
        status, last = other.next(measured(k))
        assert status == "ok"
    assert last == pytest.approx(rest, rel=1e-12)


def test_the_state_replaces_the_estimate(
    controller: LoadedController, measured: Callable[[int], Array], motion: Motion
) -> None:
    go(controller, measured, 0, 10)
    point = motion.at(10 * SAMPLE)
    state = np.concatenate([point.coordinate, point.velocity])
    assert controller.step_state(10 * SAMPLE, state)[0] == "ok"
    np.testing.assert_array_equal(controller.read("estimate")[:12], state)
    assert controller.step_state(11 * SAMPLE, spoil(state, 3, np.nan))[0] == "non_finite_input"
    assert controller.step(12 * SAMPLE, measured(12))[0] in ("ok", "rate_limited")


def test_a_fuzz_of_inputs_never_leaves_rate_and_range(
    bundle: ControllerBundle, measured: Callable[[int], Array], motion: Motion
) -> None:
    rng, controller = np.random.default_rng(5), bundle.load()
    controller.init()
    choices = np.array([0.0, -1.0, np.nan, np.inf, 1e308, -1e308, 1e-308, 0.3])
    time, rest, seen = 0.0, motion.rest_length[0], set()
    for k in range(3000):
        time += SAMPLE * rng.choice([1.0, 1.0, 1.0, 0.3, 2.0, 3.0, -5.0, 0.0])
        values = measured(k % 300) + 0.01 * rng.normal(size=9)
        if rng.random() < 0.3:
            values[rng.integers(9)] = rng.choice(choices)
        status, now = controller.step(time if rng.random() < 0.95 else np.nan, values)
        assert (now >= 0.1 - 1e-12).all()
        assert (now <= 0.5 + 1e-12).all()
        assert (np.abs(now - rest) <= RATE * SAMPLE * (1 + 1e-9)).all()
        rest, _ = now, seen.add(status)
    words = {"late", "repeated_time", "non_finite_input", "invalid_length", "outlier"}
    assert {"ok", "rate_limited", *words} <= seen
