"""Delays in samples, and linear models in which commands arrive late, beside small steps of the model."""

import numpy as np
from scipy.linalg import expm

from tensegrity_codegen.control.feedback.design.linear_samples import (
    compute_delayed_hold,
    shift_commands,
    split_delays,
)

SAMPLE = 0.1
DELAY = np.array([0.0, 0.03, 0.1, 0.23, 0.03, 0.3 - 1e-12])


def test_delays_are_whole_samples_and_a_rest() -> None:
    back, rest, count = split_delays(DELAY, SAMPLE)
    assert back.tolist() == [0, 0, 1, 2, 0, 3]
    np.testing.assert_allclose(rest, [0, 0.03, 0, 0.03, 0.03, 0], atol=1e-12)
    assert count.tolist() == [0, 1, 1, 3, 1, 3]


def test_late_commands_move_the_model_as_small_steps_do() -> None:
    rng = np.random.default_rng(0)
    rate, gain = rng.normal(size=(4, 4)), rng.normal(size=(4, 6))
    a, b, past_gain = compute_delayed_hold(rate, gain, SAMPLE, DELAY)
    shift, enter = shift_commands(DELAY, SAMPLE)
    commands = rng.normal(size=(12, 6))
    x, past = rng.normal(size=4), np.zeros(len(shift))
    exact, fine = x.copy(), 100
    block = np.zeros((10, 10))
    block[:4, :4], block[:4, 4:] = rate, gain
    move = expm(SAMPLE / fine * block)[:4]
    for k, command in enumerate(commands):
        x = a @ x + b @ command + past_gain @ past
        past = shift @ past + enter @ command
        for j in range(fine):
            sent = np.floor(k + (j + 0.5) / fine - DELAY / SAMPLE).astype(int)
            arrived = np.where(sent >= 0, commands[sent, np.arange(6)], 0.0)
            exact = move @ np.concatenate([exact, arrived])
        np.testing.assert_allclose(x, exact, rtol=1e-9, atol=1e-9)


def test_without_delays_nothing_is_on_its_way() -> None:
    a, b, past = compute_delayed_hold(np.array([[-1.0]]), np.array([[2.0]]), SAMPLE, np.zeros(1))
    np.testing.assert_allclose([a[0, 0], b[0, 0]], [np.exp(-0.1), 2 * (1 - np.exp(-0.1))], rtol=1e-14)
    assert past.shape == (1, 0)
    assert [item.shape for item in shift_commands(np.zeros(1), SAMPLE)] == [(0, 0), (0, 1)]
