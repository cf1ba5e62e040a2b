"""Scenes as environments: what gymnasium asks for, motions, seeds, files, copies that fail, and bad input."""

import sys
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import (
    Description,
    Observed,
    Policy,
    Profile,
    build_controller,
    compile_scene,
    environment,
    simulate,
)
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    MissingExtraError,
    NonFiniteError,
    SceneError,
    TensegrityError,
    UnknownNameError,
)
from tests.codegen.quickly import without_optimisation
from tests.learning.scenes import CORD, PRISM

gymnasium: Any = pytest.importorskip("gymnasium", reason="needs the package gymnasium, the extra `learn`")
RANDOM = [
    "classes.cord.spring_constant=uniform(70,90)",
    "actuators.winch.delay=uniform(0,0.03)",
    "sensors[0].noise=uniform(0,1e-3)",
]
STEPS = 12


def run(env: Any, count: int = STEPS, seed: int = 0) -> list[Any]:
    """Return observations, rewards and ends of steps with random actions, the same for each copy alone."""
    rng, results = np.random.default_rng(seed), []
    for _ in range(count):
        action = rng.uniform(-1, 1, (20, len(env.description.action)))[: env.num_envs]
        results += env.step(action)[:4]
    return results


def are_equal(first: list[Any], second: list[Any], rows: Any = slice(None)) -> bool:
    return all(np.array_equal(a[rows], b[rows]) for a, b in zip(first, second, strict=True))


@pytest.mark.filterwarnings("ignore:.*infinity")
@pytest.mark.parametrize(("scene", "options"), [(CORD, {"randomise": RANDOM}), (PRISM, {"seconds": 0.1})])
def test_gymnasium_finds_no_fault_in_a_single_environment(scene: Any, options: Any) -> None:
    from gymnasium.utils.env_checker import check_env

    env = environment(scene, **options)
    check_env(env, skip_render_check=True)
    assert env.reset(seed=3)[0] in env.observation_space


@pytest.mark.filterwarnings("ignore:.*infinity")
def test_wrappers_of_gymnasium_take_vector_environments() -> None:
    env = environment(CORD, 3, seconds=0.1)
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(
        gymnasium.wrappers.vector.NormalizeObservation(env)
    )
    wrapped.reset(seed=1)
    lengths = []
    for _ in range(13):
        observation, *_, info = wrapped.step(wrapped.action_space.sample())
        assert observation.shape == wrapped.observation_space.shape
        lengths += info["episode"]["l"][info["_episode"]].tolist() if "episode" in info else []
    assert lengths == [5] * 6
    assert env.observation_space.shape == (3, 5)
    assert env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.NEXT_STEP


def test_steps_are_the_motion_that_simulate_finds() -> None:
    env = environment(CORD, 2, act={"winch": (-0.1, 0.2), "push": (-2, 2)}, stepper={"rtol": 1e-9})
    assert env.description.observation[-1] == Observed("command", "mixed", 2)
    env.reset(seed=1)
    actions = np.random.default_rng(2).uniform(-1, 1, (10, 2, 2))
    commands = []
    for action in actions:
        env.step(action)
        commands.append(env.actions.command[1].copy())
    # The same commands as a profile with steps: the winch arrives 13 ms late, the push at once.
    table = np.array(commands)
    times = sorted({*(0.02 * k for k in range(11)), *(0.02 * k + 0.013 for k in range(10))})
    rows: dict[str, list[float]] = {"winch": [], "push": []}
    marks = []
    for begin, end in pairwise(times):
        middle = (begin + end) / 2
        arrived = int(np.floor((middle - 0.013) / 0.02))
        values = {"winch": table[arrived, 0] if arrived >= 0 else 0.0, "push": table[int(middle / 0.02), 1]}
        marks += [begin + 1e-9 * (begin > 0), end]
        for name in rows:
            rows[name] += [values[name]] * 2
    model = compile_scene(CORD, for_="simulate", method="rk853")
    start = env.starts.coordinate[0]
    profile = Profile(np.array(marks), {name: np.array(row) for name, row in rows.items()})
    motion = simulate(model, 0.2, coordinate=start, schedule=profile, method="rk853", rtol=1e-10)
    np.testing.assert_allclose(env.stepper.coordinate[1], motion.coordinate[-1], atol=2e-8)
    assert np.abs(motion.coordinate[-1] - start).max() > 0.01


def test_rewards_are_progress_and_work_of_the_motion() -> None:
    """Of a weight that is lifted slowly the work is its weight times the way, and what the cord stores."""
    scene = {**CORD, "actuators": [{**CORD["actuators"][0], "range": [0.8, 1.2]}]}
    env = environment(
        scene,
        1,
        reward=lambda step: step.progress([0, 0, 1]),
        act={"winch": (-0.2, 0.2)},
        sample=0.002,
        seconds=60.0,
    )
    taken = environment(
        scene, 1, reward=lambda step: -step.effort(), act={"winch": (-0.2, 0.2)}, sample=0.002, seconds=60.0
    )
    total = np.zeros(2)
    for place, instance in enumerate((env, taken)):
        instance.reset(seed=1)
        for k in range(2000):
            total[place] += instance.step([[-min(k / 1500, 0.5)]])[1][0]
    height = env.stepper.coordinate[0, 2] - env.starts.coordinate[0, 2]
    assert total[0] == pytest.approx(height, rel=1e-9)
    assert height == pytest.approx(0.1, rel=0.02)
    assert total[1] == pytest.approx(-0.1 * 0.5 * 9.81, rel=0.02)


def test_the_same_seed_gives_the_same_bits_for_any_number_of_copies_and_threads() -> None:
    results = []
    for n, threads in ((4, 1), (4, 2), (2, 1)):
        env = environment(CORD, n, randomise=RANDOM, seconds=0.1, stepper={"threads": threads})
        results.append([env.reset(seed=5)[0], *run(env)])
    assert are_equal(results[0], results[1])
    assert are_equal(results[0], results[2], slice(2))
    env.reset(seed=6)
    assert not are_equal(run(env), results[2][1:])
    first, second = (environment(CORD, 2, randomise=RANDOM) for _ in range(2))
    assert not np.array_equal(first.reset()[0], second.reset()[0])


@pytest.mark.parametrize("n", [None, 3])
def test_a_saved_environment_goes_on_bit_by_bit(n: int | None, tmp_path: Path) -> None:
    def make() -> Any:
        return environment(CORD, n, randomise=RANDOM, seconds=0.1)

    env = make()
    copies = env if n else env.copies
    env.reset(seed=1)
    run(copies, 3)
    env.save(tmp_path / "env.npz")
    count = STEPS if n else 2  # a single one waits for its reset
    expected = run(copies, count, seed=1)
    other = make()
    other.load(tmp_path / "env.npz")
    assert are_equal(expected, run(other if n else other.copies, count, seed=1))
    with pytest.raises(TensegrityError, match="not of this environment"):
        environment(CORD, 2, randomise=RANDOM).load(tmp_path / "env.npz")
    with pytest.raises(TensegrityError, match="not of this environment"):
        environment(CORD, n).load(tmp_path / "env.npz")


def test_drawn_numbers_change_at_each_reset_of_their_copy_alone() -> None:
    texts = [*RANDOM, "actuators.winch.rate=uniform(0.1,0.2)"]
    env = environment(CORD, 3, randomise=texts, autoreset="disabled")
    env.reset(seed=1)
    before = env.stepper.arguments["spring_constant"].copy(), env.actions.delay.copy(), env.noise.copy()
    env.reset(options={"reset_mask": np.array([False, True, False])})
    after = env.stepper.arguments["spring_constant"], env.actions.delay, env.noise
    for first, second in zip(before, after, strict=True):
        assert (first != second).any(axis=1).tolist()[::2] == [False, False]
    assert before[0][1] != after[0][1]
    env.step(np.ones((3, 1)))  # as far as the rate allows
    np.testing.assert_allclose(env.actions.command, 0.02 * env.actions.rate, rtol=1e-12)
    assert ((env.actions.rate > 0.1) & (env.actions.rate < 0.2)).all()


def test_a_copy_with_a_nan_fails_alone() -> None:
    env, other = (environment(CORD, 3, reward=lambda step: step.progress([0, 0, 1])) for _ in range(2))
    for instance in (env, other):
        instance.reset(seed=1)
    action = np.full((3, 1), 0.5)
    bad = action.copy()
    bad[1], bad[2] = np.nan, 1e300  # a huge one asks for the end of the range
    good = other.step(np.array([[0.5], [0.5], [1.0]]))
    observation, reward, terminated, truncated, info = env.step(bad)
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert info["status"].tolist() == [None, "non_finite_input", None]
    assert np.isfinite(observation).all()
    assert reward[1] == 0.0
    assert are_equal(list(good[:2]), [observation, reward], [0, 2])
    _, reward, terminated, _, info = env.step(action)
    assert not terminated.any()
    assert info == {}
    assert reward[1] == 0.0
    assert env.elapsed.tolist() == [2, 0, 2]


def test_a_motion_that_fails_ends_an_episode_with_its_status() -> None:
    env = environment(CORD, 2)
    env.reset(seed=1)
    before = env.observation.copy()
    env.stepper.velocity[0] = 1e200
    observation, reward, terminated, _, info = env.step(np.zeros((2, 1)))
    assert terminated.tolist() == [True, False]
    assert info["status"][0] == env.stepper.status_text(0) != "ok"
    np.testing.assert_array_equal(observation[0], before[0])
    assert np.isfinite(reward).all()


def test_an_observation_that_is_not_finite_ends_an_episode() -> None:
    env = environment(CORD, 2, observe=["sqrt(node_velocity[load, z])", "command"], start="scene")
    env.reset(seed=1)
    env.stepper.velocity[:, 2] = [1.0, -1.0]
    observation, _, terminated, _, info = env.step(np.zeros((2, 1)))
    assert terminated.tolist() == [False, True]
    assert info["status"].tolist() == [None, "non_finite_result"]
    assert np.isfinite(observation).all()


def test_episodes_begin_in_the_next_step_or_in_the_same_one() -> None:
    later, same, disabled = (
        environment(CORD, 2, seconds=0.04, observe=("member_length", "command"), autoreset=mode)
        for mode in ("next_step", "same_step", "disabled")
    )
    action, ends = np.ones((2, 1)), []
    for env in (later, same, disabled):
        start, _ = env.reset(seed=1)
        env.step(action)
        ends.append(env.step(action))
        assert ends[-1][3].tolist() == [True, True]
    np.testing.assert_array_equal(np.stack([*ends[1][4]["final_obs"]]), ends[0][0])
    begun = later.step(action)
    assert begun[1].tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(begun[0], ends[1][0])
    assert begun[0][0, -1] == start[0, -1] == 0.0  # the command
    with pytest.raises(TensegrityError, match="reset_mask"):
        disabled.step(action)
    disabled.reset(options={"reset_mask": np.array([True, True])})
    disabled.step(action)


def test_inputs_that_do_not_act_push_as_they_are_drawn() -> None:
    env = environment(CORD, 50, randomise="input.push=uniform(1,3)", sample=0.001)
    env.reset(seed=1)
    push = env.inputs[:, 0].copy()
    assert push.min() > 1.0
    assert np.ptp(push) > 1.0
    for _ in range(10):
        env.step(np.full((50, 1), -1 / 3))
    np.testing.assert_allclose(env.stepper.velocity[:, 0], push / 0.5 * 0.01, rtol=1e-3)


def test_sensors_have_their_noise_and_quantities_have_none() -> None:
    observe = ["length", "member_length", "sensors[1]", "node_position[load]", "top = node_velocity[load, z]"]
    env = environment(CORD, 4000, observe=observe, sample=0.002)
    observation, _ = env.reset(seed=1)
    noisy, exact = observation[:, 0], observation[:, 1]
    np.testing.assert_allclose(exact, 1.0 + 0.5 * 9.81 / 80.0, rtol=1e-9)
    assert (noisy - exact).std() == pytest.approx(1e-3, rel=0.05)
    np.testing.assert_array_equal(observation[:, 2:5], observation[:, 5:8])
    for _ in range(3):
        observation, *_ = env.step(np.ones((4000, 1)))
    np.testing.assert_allclose(observation[:, 8], env.stepper.velocity[:, 2], rtol=1e-12)
    names = [(part.name, part.size, part.unit, part.noise) for part in env.description.observation]
    assert names[0] == ("length", 1, "m", 1e-3)
    assert names[4] == ("top", 1, "m/s", 0.0)


def test_motors_with_a_lag_follow_in_the_equations() -> None:
    scene = {**CORD, "actuators": [{**CORD["actuators"][0], "time_constant": 0.1, "delay": 0.0}]}
    env = environment(scene, 1, sample=0.05)
    env.reset(seed=1)
    for k in range(1, 4):
        env.step([[1.0]])
        # It winds at its rate until (0.2 - u) / 0.1 s is less.
        assert env.stepper.internal[0, 0] == pytest.approx(0.5 * 0.05 * k, rel=1e-9)
    assert env.description.action[0].rate == np.inf


def test_a_recorded_episode_is_a_motion_with_its_inputs(tmp_path: Path) -> None:
    env = environment(PRISM, 2, seconds=0.1, terminate=lambda step: step.is_outside(height=-1.0))
    before, _ = env.reset(seed=1)
    motion = env.record(lambda observation: np.full((2, 3), 0.2), copy=1, seed=3)
    np.testing.assert_array_equal(env.observation, before)  # it stays as it was
    assert motion.status == "ok"
    np.testing.assert_allclose(motion.time, 0.02 * np.arange(6), rtol=1e-12)
    assert motion.contacts is not None
    motion.write(tmp_path / "episode.npz")
    read = read_trajectory(tmp_path / "episode.npz", env.draws.structure)
    np.testing.assert_array_equal(read.node_position, motion.node_position)
    env.reset(seed=3)
    for k in range(5):
        np.testing.assert_array_equal(motion.coordinate[k], env.stepper.coordinate[1])
        np.testing.assert_array_equal(motion.input[k], env.inputs[1])  # type: ignore[index]
        env.step(np.full((2, 3), 0.2))


def test_pictures_show_the_copies_as_they_are() -> None:
    pytest.importorskip("matplotlib")
    env = environment(CORD)
    env.reset(seed=1)
    first = env.render()
    for _ in range(10):
        env.step([1.0])
    second = env.render()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert first.shape != second.shape or (first != second).any()


def test_the_description_says_what_is_seen_moved_and_drawn(tmp_path: Path) -> None:
    env = environment(CORD, 2, randomise=RANDOM, sample=0.01)
    env.description.write(tmp_path / "env.json")
    read = Description.read(tmp_path / "env.json")
    assert read == env.description
    assert (read.scene, read.sample, read.n_observation) == ("cord", 0.01, 5)
    assert read.randomised[0] == "classes.cord.spring_constant=uniform(70.0,90.0)"


def test_a_policy_in_c_sends_the_commands_of_the_environment(tmp_path: Path) -> None:
    env = environment(CORD, 1, sample=0.01, seconds=9.0)
    random, size = np.random.default_rng(4), env.description.n_observation
    policy = Policy(
        weights=(random.normal(size=(7, size)), random.normal(size=(1, 7))),
        biases=(random.normal(size=7), random.normal(size=1)),
        mean=np.array([1.06, 0.0, 0.0, -1.06, 0.0]),
        scale=np.array([0.01, 0.1, 1.0, 0.05, 0.1]),
        description=env.description,
    )
    with without_optimisation():
        controller = build_controller(env.model, policy=policy, out=tmp_path / "ctl").load()
    controller.init()
    observation, _ = env.reset(seed=1)
    commands = []
    for k in range(300):
        controller.step(0.01 * k, observation[0, :-1])
        observation, *_ = env.step(policy(observation))
        commands.append(env.actions.command[0])
        np.testing.assert_allclose(controller.read("command"), commands[-1], rtol=0, atol=1e-12)
    assert np.ptp(commands, axis=0).min() > 0.05


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"n": 0}, "n: out of range"),
        ({"n": 2.5}, "n: out of range"),
        ({"sample": 0.0}, "sample"),
        ({"seconds": np.inf}, "seconds"),
        ({"autoreset": "never"}, "next_step"),
        ({"observe": "node_positon"}, "did you mean"),
        ({"randomise": "input.winch=uniform(0,1)"}, "an action decides"),
        ({"observe": "member_length.max"}, "observe"),
        ({"reward": 3}, "reward: not a function"),
        ({"terminate": [1]}, "terminate: not a function"),
        ({"stepper": {"method": "rk99"}}, "rk99"),
    ],
)
def test_bad_input_is_named(options: dict[str, Any], word: str) -> None:
    with pytest.raises(TensegrityError) as caught:
        environment(CORD, **options)
    assert word in str(caught.value)


def test_bad_shapes_are_named() -> None:
    env = environment(CORD, 2, reward=lambda step: step.action)
    with pytest.raises(TensegrityError, match="has not begun"):
        env.step(np.zeros((2, 1)))
    env.reset(seed=1)
    for action in (np.zeros(2), np.zeros((3, 1)), "go"):
        with pytest.raises(TensegrityError, match="actions"):
            env.step(action)
    with pytest.raises(TensegrityError, match="reward"):
        env.step(np.zeros((2, 1)))
    with pytest.raises(TensegrityError, match="seed"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(TensegrityError, match="reset_mask"):
        env.reset(options={"reset_mask": np.ones(3, bool)})


def test_gymnasium_is_asked_for_when_an_environment_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(MissingExtraError, match="environments need the package 'gymnasium'") as caught:
        environment(CORD)
    assert "'.[learn]'" in caught.value.hint


def test_copies_make_no_warnings() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = environment(CORD, 2)
        env.reset()
        env.step(np.full((2, 1), np.nan))


def test_other_files_and_settings_are_refused_and_change_nothing(tmp_path: Path) -> None:
    env, other = (environment(CORD, 2, seconds=seconds) for seconds in (10.0, 5.0))
    env.reset(seed=1)
    env.save(tmp_path / "env.npz")
    with pytest.raises(InvalidValueError, match="another seconds"):
        other.load(tmp_path / "env.npz")
    good = dict(np.load(tmp_path / "env.npz"))
    before = env._list_held()
    for name, value in (
        ("actions.delay", np.full((2, 1), np.nan)),
        ("actions.sent", np.zeros((0, 2, 1))),
        ("stepper.status", np.array([99, 0], dtype=np.int32)),
        ("stepper.state", good["stepper.state"] + 1j),
        ("elapsed", np.array(["a", "b"])),
    ):
        np.savez(tmp_path / "bad.npz", **good | {name: value})
        with pytest.raises(InvalidValueError) as caught:
            env.load(tmp_path / "bad.npz")
        assert name.removeprefix("stepper.") in str(caught.value)
        assert all(
            np.array_equal(array, before[held], equal_nan=True) for held, array in env._list_held().items()
        )
    data = (tmp_path / "env.npz").read_bytes()
    for damaged in (data[:-40], b"no archive", b""):
        (tmp_path / "bad.npz").write_bytes(damaged)
        with pytest.raises(SceneError, match=r"bad\.npz"):
            env.load(tmp_path / "bad.npz")


def test_masks_seeds_and_rewards_of_another_kind_are_refused() -> None:
    env = environment(CORD, 3)
    observation, _ = env.reset(seed=1)
    again, _ = env.reset(options={"reset_mask": np.zeros(3, dtype=bool)})
    assert np.array_equal(again, observation)
    for mask in ([3, 3, 3], [np.nan] * 3, [True]):
        with pytest.raises(InvalidValueError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    for seed in ([-1, 2, 3], ["a", 1, 2], [1, 2]):
        with pytest.raises(InvalidValueError, match="seed"):
            env.reset(seed=seed)
    for given, error in (
        ("text", InvalidValueError),
        (np.zeros(2), InvalidValueError),
        (np.full(3, np.nan), NonFiniteError),
    ):
        bad = environment(CORD, 3, reward=lambda step, given=given: given)
        bad.reset(seed=1)
        with pytest.raises(error, match="reward"):
            bad.step(np.zeros((3, 1)))
    with pytest.raises(UnknownNameError, match="rtol"):
        environment(CORD, 3, stepper={"n": 3})
    with pytest.raises(InvalidValueError, match="start"):
        environment(CORD, 3, start=None)  # type: ignore[arg-type]
