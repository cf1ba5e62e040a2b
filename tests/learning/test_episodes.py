"""Random numbers of copies, numbers of a scene that are drawn anew, states in which episodes begin."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tensegrity_codegen import Observed, environment
from tensegrity_codegen.learning.episodes import DrawnNumbers, Streams
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    SceneError,
    UnknownNameError,
)
from tests.learning.scenes import CORD, PRISM

BLOCK: dict[str, Any] = {
    "name": "block",
    "bodies": {
        "b": {
            "kind": "rigid",
            "position": [0, 0, 0],
            "mass": 1.0,
            "inertia": [1.0, 1.5, 2.0],
            "points": {"p": [0.0, 1.0, 0.0]},
        }
    },
    "inputs": [{"kind": "force", "name": "push", "nodes": ["b.p"], "direction": [1, 0, 0]}],
}
BALLS = [{"kind": "ball", "radius": 0.1, "position": [x, 0, 0], "mass": 1.0} for x in (-1.0, 1.0)]


def test_random_numbers_are_those_of_splitmix64() -> None:
    streams = Streams(2)
    words = np.array([0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F], dtype=np.uint64)  # seed 0
    expected = ((words >> np.uint64(11)) + 0.5) * 2.0**-53
    np.testing.assert_array_equal(streams.draw(2, np.array([1]))[0], expected[:2])
    np.testing.assert_array_equal(streams.draw(1, np.array([0, 1]))[:, 0], [expected[0], expected[2]])


def test_a_stream_does_not_depend_on_others_and_is_uniform() -> None:
    many, few, rows = Streams(50), Streams(3), np.arange(50)
    many.seed(7, rows)
    few.seed(7, rows[:3])
    numbers = many.draw(40, rows)
    np.testing.assert_array_equal(numbers[:3], few.draw(40, rows[:3]))
    assert len(np.unique(numbers)) == numbers.size
    assert stats.kstest(numbers.ravel(), "uniform").pvalue > 0.01
    assert stats.kstest(many.draw_normal(40, rows).ravel(), "norm").pvalue > 0.01
    few.seed([5, 7, None], rows[:3])
    other = Streams(1)
    other.seed([7], rows[:1])
    assert few.key[1] == other.key[0]


def test_numbers_are_drawn_for_each_copy_within_their_distributions() -> None:
    texts = [
        "classes.cord.spring_constant=uniform(70,90)",
        "nodes.load.mass=normal(0.5,0.05)",
        "actuators.winch.delay=uniform(0,0.02)",
        "sensors[0].noise=uniform(0,0.1)",
        "node_load.load[0]=uniform(-1,1)",
    ]
    drawn, streams, rows = DrawnNumbers(CORD, texts, moves_start=True), Streams(150), np.arange(150)
    streams.seed(1, rows)
    arguments = drawn.draw(streams, rows)
    mass = arguments["node_mass"][:, 0]
    assert stats.kstest(arguments["spring_constant"][:, 0], "uniform", (70, 20)).pvalue > 0.01
    assert stats.kstest(mass, "norm", (0.5, 0.05)).pvalue > 0.01
    assert stats.kstest(arguments["actuator_delay"][:, 0], "uniform", (0, 0.02)).pvalue > 0.01
    assert stats.kstest(arguments["sensor_noise"][:, 0], "uniform", (0, 0.1)).pvalue > 0.01
    assert arguments["sensor_noise"][:, 1].tolist() == [0.0] * 150
    assert stats.kstest(arguments["node_load"][:, 0, 0], "uniform", (-1, 2)).pvalue > 0.01
    assert {*drawn.request.parameters} == {"spring_constant", "node_mass", "node_load"}


def test_masses_and_inertias_of_rigid_bodies_are_drawn() -> None:
    texts = ["bodies.b.mass=uniform(0.5,2)", "bodies.b.inertia[2]=uniform(1.6,2.4)"]
    env = environment(
        BLOCK, 30, act={"push": (-1, 1)}, observe="body_velocity", randomise=texts, start="scene",
        sample=0.01, stepper={"quantities": "body_angular_velocity"},
    )  # fmt: skip
    env.reset(seed=1)
    observation, *_ = env.step(np.ones((30, 1)))
    mass, inertia = env.stepper.arguments["body_mass"][:, 0], env.stepper.arguments["body_inertia"][:, 0]
    assert stats.kstest(mass, "uniform", (0.5, 1.5)).pvalue > 0.01
    assert stats.kstest(inertia[:, 2], "uniform", (1.6, 0.8)).pvalue > 0.01
    np.testing.assert_allclose(inertia[:, :2], [[1.0, 1.5]] * 30, rtol=1e-12)
    np.testing.assert_allclose(observation[:, 0], 0.01 / mass, rtol=1e-4)
    spin = env.stepper.values["body_angular_velocity"][:, 0, 2]
    np.testing.assert_allclose(spin, -0.01 / inertia[:, 2], rtol=1e-4)
    both = environment(
        BLOCK, 2, act={"push": (-1, 1)}, randomise=[texts[0], "gravity[2]=uniform(-2,-1)"], start="scene"
    )
    both.reset(seed=1)
    assert both.description.observation[-1] == Observed("command", "N", 1)
    assert {"body_mass", "gravity"} <= {*both.stepper.arguments}


def test_draws_that_are_no_scene_are_drawn_again() -> None:
    drawn = DrawnNumbers(CORD, ["nodes.load.mass=normal(0.1,0.2)"], moves_start=True)
    streams, rows = Streams(200), np.arange(200)
    streams.seed(1, rows)
    mass = drawn.draw(streams, rows)["node_mass"][:, 0]
    assert mass.min() > 0.0
    assert stats.kstest(mass, stats.truncnorm(-0.5, np.inf, 0.1, 0.2).cdf).pvalue > 0.01


@pytest.mark.parametrize(
    ("changes", "text", "words"),
    [
        (
            {
                "bodies": {"b": {"kind": "rigid", "position": [0, 0, 1], "parts": BALLS}}
            },  # whose centre it moves
            "bodies.b.parts[0].mass=uniform(1,2)",
            ("bodies.b.parts[0].mass", "bodies cannot", "centre"),
        ),
        (BLOCK, "bodies.b.points.p[1]=uniform(0.9,1)", ("bodies.b.points.p[1]", "bodies cannot")),
        ({}, "ground.friction=uniform(0,1)", ("ground",)),
        ({}, "gust.load[0]=uniform(0,1)", ("gust.load[0]", "gust cannot")),
        ({}, "actuators.winch.range[0]=uniform(0.8,0.9)", ("actuators.winch.range[0]", "changes no motion")),
        ({}, "nodes.load.position[2]=uniform(-1.1,-1)", ("start='scene'",)),
        ({}, "nodes.top.position[2]=uniform(-0.1,0.1)", ("nodes.top.position[2]",)),
        ({}, "classes.cord.spring_constant", ("KEY=",)),
        ({}, "classes.cord.spring_constant=uniform(3)", ("uniform(3)",)),
        ({}, "classes.cord.sprin_constant=uniform(1,2)", ("spring_constant",)),
    ],
)
def test_a_key_that_cannot_be_drawn_is_named_with_the_reason(
    changes: Any, text: str, words: tuple[str, ...]
) -> None:
    with pytest.raises(SceneError) as caught:
        DrawnNumbers({**CORD, **changes}, [text], moves_start=True)
    for word in words:
        assert word in str(caught.value)


def test_positions_are_drawn_where_episodes_start_in_the_scene() -> None:
    text = "nodes.load.position[2]=uniform(-1.1,-1.05)"
    env = environment(CORD, 20, start="scene", randomise=text)
    env.reset(seed=1)
    height = env.stepper.coordinate[:, 2]
    assert height.min() > -1.1
    assert height.max() < -1.05
    assert len(np.unique(height)) == 20


def test_episodes_start_at_rest_under_the_first_commands() -> None:
    for least, act, length in ((1.1, None, 1.2), (0.9, {"winch": (-0.1, 0.1)}, 1.0)):
        scene = {**CORD, "actuators": [{**CORD["actuators"][0], "range": [least, 1.3]}]}
        env = environment(scene, 2, act=act)
        env.reset(seed=1)
        np.testing.assert_allclose(env.stepper.coordinate[:, 2], -length - 0.5 * 9.81 / 80.0, rtol=1e-9)


def test_structures_come_to_rest_on_the_ground_and_on_facets_at_random() -> None:
    env = environment(PRISM, 40, start="facet", stepper={"quantities": "contact_force"})
    observation, _ = env.reset(seed=2)
    height = env.stepper.coordinate.reshape(40, 6, 3)[:, :, 2]
    stands = height < 1e-3
    assert (stands.sum(axis=1) == 3).all()
    facets, counts = np.unique(stands, axis=0, return_counts=True)
    assert len(facets) == len(env.starts.coordinate) == 8
    assert counts.max() < 14
    weight = (3 * 0.1 + 6 * 0.05) * 9.81
    np.testing.assert_allclose(env.stepper.values["contact_force"][:, :, 2].sum(axis=1), weight, rtol=1e-3)
    still = [-part.centre / part.half_range for part in env.description.action]
    for _ in range(25):
        after, *_ = env.step(np.tile(still, (40, 1)))
    assert np.abs(after - observation)[:, :36].max() < 2e-4  # [m], [m/s]: it stays
    flat = environment(PRISM, 1)
    flat.reset(seed=1)
    assert flat.stepper.coordinate.reshape(6, 3)[3:, 2].min() > 0.14  # as it was dropped


def test_episodes_start_in_states_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "starts.npz"
    np.savez(
        path, coordinate=[[0.0, 0.0, -1.0], [0.1, 0.0, -1.0], [0.2, 0.0, -1.0]], velocity=[[0.0, 0.0, 1.0]]
    )
    env = environment(CORD, 30, start=path)
    env.reset(seed=1)
    assert set(env.stepper.coordinate[:, 0]) == {0.0, 0.1, 0.2}
    assert env.stepper.velocity.tolist() == [[0.0, 0.0, 1.0]] * 30


@pytest.mark.parametrize(
    ("arrays", "word"),
    [
        ({"coordinate": np.zeros((2, 4))}, "a row for each"),
        ({"push": np.zeros(2)}, "positions"),
        ({"x": [1]}, "x"),
    ],
)
def test_a_file_without_starts_is_refused(arrays: Any, word: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "starts.npz", **arrays)
    with pytest.raises(SceneError, match=word):
        environment(CORD, start=tmp_path / "starts.npz")


def test_starts_that_a_scene_does_not_have_are_refused() -> None:
    with pytest.raises(FormulationError, match="facets"):
        environment(CORD, start="facet")
    with pytest.raises(UnknownNameError, match="did you mean 'settled'"):
        environment(CORD, start="setled")
    undamped = {
        "name": "ball",
        "gravity": [0, 0, -9.81],
        "nodes": {"a": {"position": [0, 0, 1], "mass": 1.0}, "b": {"position": [0, 0, 1.2], "mass": 1.0}},
        "members": {"m": {"kind": "bar", "nodes": ["a", "b"], "spring_constant": 1e3}},
        "ground": {"stiffness": 1e3, "dissipation": 0.0, "friction": 0.0},
        "actuators": [{"name": "w", "members": "m", "range": [0.1, 0.3]}],
    }
    with pytest.raises(ConvergenceError, match="come to rest"):
        environment(undamped, stepper={"rtol": 1e-3})
    with pytest.raises(InvalidValueError, match="stepper"):
        environment(CORD, stepper=3)
