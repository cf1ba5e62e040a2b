"""Actions become inputs by ranges, rates and delays; observations are what the scene measures."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import Acted, load_scene
from tensegrity_codegen.learning.channels import PARTS, Actions, Observations, choose_actions
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownNameError
from tests.learning.scenes import CORD

SAMPLE = 0.01


def list_inputs(actions: Actions, count: int, seed: int = 1) -> tuple[np.ndarray, list[list[Any]]]:
    """Return random actions (count, n, n_actions), and the parts of each sample that they become."""
    rows = np.random.default_rng(seed).uniform(-1.5, 1.5, (count, *actions.command.shape))
    parts = []
    for row in rows:
        actions.push(row)
        parts.append(list(actions.list_parts()))
    return rows, parts


def test_a_command_keeps_to_range_and_rate_from_the_last_one_on() -> None:
    acted = (Acted("slow", 0.5, 0.2, rate=3.0), Acted("free", 0.0, 1.0), Acted("away", -3.0, 1.0))
    actions = Actions(acted, SAMPLE, 2, False)
    assert actions.first.tolist() == [0.5, 0.0, -3.0]  # the scene's input is 0, where the range has it
    rows, parts = list_inputs(actions, 50)
    last = np.tile([0.5, 0.0, -3.0], (2, 1))
    for row, ((length, command),) in zip(rows, parts, strict=True):
        wanted = [0.5, 0.0, -3.0] + np.clip(row, -1, 1) * [0.2, 1.0, 1.0]
        reach = np.array([0.03, np.inf, np.inf])
        last = np.clip(np.clip(wanted, last - reach, last + reach), [0.3, -1, -4], [0.7, 1, -2])
        np.testing.assert_array_equal(command, last)
        assert length == SAMPLE


def test_commands_arrive_after_delays_that_are_no_multiple_of_the_sample() -> None:
    acted = (Acted("a", 0.0, 1.0, delay=0.013), Acted("b", 0.0, 1.0, delay=0.02), Acted("c", 0.0, 1.0))
    actions = Actions(acted, SAMPLE, 1, False)
    rows, parts = list_inputs(actions, 12)
    sent = np.clip(rows[:, 0], -1, 1)
    for k, sample in enumerate(parts):
        lengths, commands = zip(*sample, strict=True)
        np.testing.assert_allclose(lengths, [0.003, 0.007], rtol=1e-12)
        for start, command in zip((0.0, 0.003), commands, strict=True):
            now = k * SAMPLE + start + 1e-9
            arrived = [int(np.floor((now - part.delay) / SAMPLE)) for part in acted]
            expected = [sent[j, u] if j >= 0 else 0.0 for u, j in enumerate(arrived)]
            np.testing.assert_array_equal(command[0], expected)


def test_drawn_delays_are_rounded_to_parts_of_the_sample_and_differ_between_copies() -> None:
    actions = Actions((Acted("a", 0.0, 1.0),), SAMPLE, 3, True)
    actions.set_delays(np.array([1, 2]), np.array([[0.0038], [0.031]]))
    np.testing.assert_allclose(actions.delay[:, 0], [0.0, 0.005, 0.03], rtol=1e-12)
    rows, parts = list_inputs(actions, 6)
    sent = np.clip(rows[..., 0], -1, 1)
    assert [len(sample) for sample in parts] == [PARTS] * 6
    halves = [
        [sample[0][1][:, 0], sample[2][1][:, 0]] for sample in parts
    ]  # from 0 and from half a sample on
    assert halves[4][0].tolist() == [sent[4, 0], sent[3, 1], sent[1, 2]]
    assert halves[4][1].tolist() == [sent[4, 0], sent[4, 1], sent[1, 2]]


def test_a_nan_sends_the_last_command_again() -> None:
    actions = Actions((Acted("a", 0.0, 1.0),), SAMPLE, 2, False)
    actions.push(np.array([[0.5], [0.25]]))
    actions.push(np.array([[np.nan], [np.inf]]))
    assert actions.command.tolist() == [[0.5], [1.0]]


def test_actions_are_the_actuators_or_inputs_with_ranges() -> None:
    structure, _ = load_scene(CORD)
    (winch,) = choose_actions(structure, None)
    assert (winch.name, winch.rate, winch.delay) == ("winch", 0.5, 0.013)
    np.testing.assert_allclose([winch.centre, winch.half_range], [0.05, 0.15], rtol=1e-12)
    push, winch = choose_actions(structure, {"push": (-4.0, 2.0), "winch": (0.0, 0.1)})
    assert (push.centre, push.half_range, push.rate, winch.half_range) == (-1.0, 3.0, np.inf, 0.05)
    lagging = {**CORD, "actuators": [{**CORD["actuators"][0], "time_constant": 0.1}]}
    assert choose_actions(load_scene(lagging)[0], None)[0].rate == np.inf


@pytest.mark.parametrize(
    ("changes", "act", "error", "words"),
    [
        ({"actuators": []}, None, StructureError, ("cord: actuators", "0 actuators|no actuators, 1 inputs")),
        ({}, "winsh", UnknownNameError, ("act", "did you mean 'winch'")),
        ({}, ["push"], InvalidValueError, ("push", "range = ")),
        ({}, {"winch": (0.1, 0.1)}, InvalidValueError, ("winch", "0.1 to 0.1")),
        ({}, {"winch": (-5, 5)}, InvalidValueError, ("cord: winch", "-5 to 5 of", "-0.1 to 0.2")),
        ({}, {"winch": (0, 0.21)}, InvalidValueError, ("cord: winch", "0 to 0.21 of", "-0.1 to 0.2")),
        (
            {"actuators": [{"name": "winch", "members": "c"}]},
            {"winch": (-1.5, 0)},
            InvalidValueError,
            ("cord: winch", "-1 to inf"),
        ),
        (
            {"actuators": [{"name": "winch", "members": "c"}]},
            None,
            InvalidValueError,
            ("winch", "act={'winch'"),
        ),
    ],
)
def test_what_cannot_act_is_named(
    changes: Any, act: Any, error: type[Exception], words: tuple[str, ...]
) -> None:
    with pytest.raises(error) as caught:
        choose_actions(load_scene({**CORD, **changes})[0], act)
    for word in words:
        assert any(part in str(caught.value) for part in word.split("|"))


def test_the_usual_observation_is_all_sensors_or_the_state() -> None:
    structure, _ = load_scene(CORD)
    assert [text.expression for text in Observations(structure, ()).texts] == [
        "length",
        "sensors[1]",
        "command",
    ]
    plain, _ = load_scene({key: value for key, value in CORD.items() if key != "sensors"})
    names = [text.expression for text in Observations(plain, ()).texts]
    assert names == ["node_position", "node_velocity", "command"]


@pytest.mark.parametrize(
    ("observe", "hint"),
    [("member_lenght", "'member_length'"), ("lengt", "'length'"), ("comand", "'command'")],
)
def test_an_unknown_observation_has_a_suggestion(observe: str, hint: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        Observations(load_scene(CORD)[0], observe)
    assert hint in caught.value.hint
    assert "observe" in caught.value.where
