"""Environments of gymnasium, which is imported with this module alone: many copies, and one of them."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.control.feedback.policy import MAX_DELAY, Description
from tensegrity_codegen.learning.channels import POSITION, VELOCITY, Actions, Observations
from tensegrity_codegen.learning.episodes import DrawnNumbers, Starts, Streams
from tensegrity_codegen.learning.step import EnvironmentStep
from tensegrity_codegen.live.draw import draw
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.arrays import (
    check_finite,
    check_saved,
    check_shape,
    fit_saved,
    read_saved,
    to_doubles,
    write_arrays,
)
from tensegrity_codegen.runtime.trajectory.evaluate import evaluate_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.contact_estimates import compute_body_mass
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import MOTOR_END

TENSION = "member_tension"
Function = Callable[[EnvironmentStep], ArrayLike]
MODES = {mode.name.lower(): mode for mode in gymnasium.vector.AutoresetMode}
# Arrays of an environment that an episode goes on from, besides those of its stepper.
SETTING = "settings."  # before the names of settings in a file
HELD = (
    *("noise", "base", "inputs", "elapsed", "done", "observation", "start", "streams.key", "streams.drawn"),
    *("actions.command", "actions.sent", "actions.delay", "actions.rate"),
)


class StructureVectorEnv(gymnasium.vector.VectorEnv):
    """Copies of a structure side by side, as `environment` makes them.

    description: what is observed, moved and randomised; stepper: states and run-time parameters of the
    copies.
    """

    def __init__(
        self,
        stepper: Any,
        description: Description,
        draws: DrawnNumbers,
        observations: Observations,
        starts: Starts,
        reward: Function,
        terminate: Function | None,
        seconds: float,
        autoreset: str,
    ) -> None:
        self.stepper, self.model, self.num_envs, n = stepper, stepper.model, stepper.n, stepper.n
        self.description, self.draws, self.observations = description, draws, observations
        self.starts, self.reward, self.terminate, self.seconds = starts, reward, terminate, seconds
        self.autoreset, self.sample = MODES[autoreset], description.sample
        self.render_mode, self.metadata = "rgb_array", {"render_modes": ["rgb_array"]}
        self.metadata |= {"render_fps": 1.0 / self.sample, "autoreset_mode": self.autoreset}
        size, acted = description.n_observation, description.action
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(acted),), np.float64)
        for name in ("observation_space", "action_space"):
            space = getattr(self, f"single_{name}")
            setattr(self, name, gymnasium.vector.utils.batch_space(space, n))
        # Arrays of the copies.
        manifest, structure = stepper.model.manifest, draws.structure
        names, internal = manifest.input_name, manifest.internal_name
        is_late = any(t.partition("=")[0].endswith(".delay") for t in draws.texts)
        self.actions, self.streams = Actions(acted, self.sample, n, is_late), Streams(n)
        for duration, _ in self.actions.list_parts():
            stepper.check_sample(duration)
        self.noise = np.array([[sensor.noise for sensor in structure.sensors]] * n)
        self.base, self.inputs = np.zeros((n, len(names))), np.zeros((n, len(names)))
        self.elapsed, self.done = np.zeros(n, np.int64), np.zeros(n, np.bool_)
        self.observation, self.start, self.is_seeded = np.zeros((n, size)), np.zeros((n, 3)), False
        # Actions and actuators of the same name, inputs of actions, parts of nodes in the centre of mass,
        # rest lengths by inputs.
        devices = [device.name for device in structure.actuators]
        pairs = [(k, devices.index(a.name)) for k, a in enumerate(acted) if a.name in devices]
        self.actuated = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        self.lags = np.array([device.time_constant > 0.0 for device in structure.actuators])
        self.place = np.array([names.index(action.name) for action in acted])
        self.share = find_mass_shares(structure)
        lengths = [add_inputs_to_rest_length(structure, {name: 1.0}) for name in names]
        self.gain = np.array(lengths) - structure.rest_length
        self.motor_input = [names.index(name) for name in manifest.motor_name]
        self.motor_state = [internal.index(f"{name}{MOTOR_END}") for name in manifest.motor_name]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin episodes of all copies, or of those of ``options["reset_mask"]``.

        Copy k draws the same numbers for a seed however many copies there are; of a list it has its own.
        """
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            allowed, given = f"{self.num_envs} truth values", f"{mask.dtype} {mask.shape}"
            raise InvalidValueError("no such copies", where="reset_mask", given=given, allowed=allowed)
        if isinstance(seed, Sequence):
            check_whole(len(seed), "seed: length", self.num_envs, self.num_envs)
            for k, one in enumerate(seed):
                check_whole(0 if one is None else one, f"seed[{k}]", 0)
        super().reset(seed=None if isinstance(seed, Sequence) else seed)
        if seed is not None or not self.is_seeded:
            self.streams.seed(seed, np.flatnonzero(mask | (not self.is_seeded)))
            self.is_seeded = True
        if mask.any():
            self._begin(np.flatnonzero(mask))
        return self.observation.copy(), {}

    def step(self, actions: ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Send commands, and advance all copies by one sample."""
        shape = (self.num_envs, len(self.description.action))
        action = to_doubles(actions, "actions", f"numbers {shape}")
        check_shape(action, shape, "actions")
        if not self.is_seeded or (self.autoreset is MODES["disabled"] and self.done.any()):
            allowed = "reset() first, or of those that have ended, options={'reset_mask': ended}"
            raise InvalidValueError("an episode has not begun", where="step", allowed=allowed)
        begun = self.done  # copies whose episode has ended: they begin the next one in this step
        with np.errstate(all="ignore"):
            step, failed = self._advance(action)
            self.elapsed = self.elapsed + 1
            reward = self._call("reward", self.reward, step, failed | begun)
            ends = self.terminate is not None and (
                self._call("terminate", self.terminate, step, failed | begun) != 0.0
            )
        terminated = (failed | ends) & ~begun
        truncated = (step.time > self.seconds - self.sample / 2) & ~terminated & ~begun
        self.done, info = terminated | truncated, dict[str, Any]()
        bad = failed & ~begun
        if bad.any():
            info = {"status": np.full(len(bad), None), "_status": bad}
            for k in np.flatnonzero(bad).tolist():
                text = "non_finite_input" if np.isnan(action[k]).any() else self.stepper.status_text(k)
                info["status"][k] = "non_finite_result" if text == "ok" else text  # of the observation
        if self.autoreset is MODES["same_step"] and self.done.any():
            begun, final = self.done.copy(), np.full(len(bad), None)
            for k in np.flatnonzero(begun).tolist():
                final[k] = self.observation[k].copy()
            info = {"final_obs": final, "_final_obs": begun, "final_info": info, "_final_info": begun}
        if begun.any():
            self._begin(np.flatnonzero(begun))
        return self.observation.copy(), reward, terminated, truncated, info

    def _call(self, name: str, function: Function, step: EnvironmentStep, idle: BoolArray) -> FloatArray:
        """Return what a function says of a step (n,), 0 of idle copies; NonFiniteError of others."""
        array = to_doubles(function(step), name, f"{self.num_envs} numbers")
        check_shape(array, (self.num_envs,), name)
        array = np.where(idle, 0.0, array)
        check_finite(array, name, f"of copy {np.argmin(np.isfinite(array))}: not finite")
        return array

    def _advance(self, action: FloatArray) -> tuple[EnvironmentStep, BoolArray]:
        """Return the step of all copies, and which of them failed."""
        previous, before, wound = self.actions.command, self.centre, self.wound
        tension = self.stepper.values[TENSION].copy()
        self.actions.push(action)
        for duration, command in self.actions.list_parts():
            self.inputs[:, self.place] = command
            self.stepper.step(self.inputs, duration)
        self._evaluate()
        seen = self._observe(np.arange(self.num_envs))
        failed = np.isnan(action).any(axis=1) | ~np.isfinite(seen).all(axis=1) | (self.stepper.status != 0)
        self.observation = np.where(failed[:, None], self.observation, seen)
        step = EnvironmentStep(
            time=np.asarray((self.elapsed + 1) * self.sample),
            sample=self.sample,
            start=self.start.copy(),
            before=before,
            after=self.centre,
            observation=self.observation,
            action=action,
            command=self.actions.command,
            last_command=previous,
            work=((wound - self.wound) * (tension + self.values[TENSION])).sum(axis=1) / 2,
            values=self.values,
        )
        return step, failed

    def _begin(self, rows: IntArray) -> None:
        """Begin episodes of some copies: draw numbers and a start."""
        starts, actions, stepper = self.starts, self.actions, self.stepper
        drawn = self.draws.draw(self.streams, rows)
        columns, devices = self.actuated
        for name, value in drawn.items():
            if name == "actuator_delay":
                delay = actions.delay[rows]
                delay[:, columns] = value[:, devices]
                actions.set_delays(rows, delay)
            elif name == "actuator_rate":
                rate = np.where(self.lags[devices], np.inf, value[:, devices])
                actions.rate[np.ix_(rows, columns)] = rate
            elif name == "sensor_noise":
                self.noise[rows] = value
            elif name == INPUT:
                self.base[rows] = value
            elif name in stepper.arguments:
                stepper.arguments[name][rows] = value
        actions.command[rows] = actions.sent[:, rows] = actions.first
        self.base[np.ix_(rows, self.place)] = actions.first
        self.inputs[rows] = stepper.inputs[rows] = self.base[rows]
        chosen = (self.streams.draw(1, rows)[:, 0] * len(starts.coordinate)).astype(int)
        stepper.reset(
            rows,
            coordinate=drawn.get("coordinate", starts.coordinate[chosen]),
            velocity=drawn.get("velocity", starts.velocity[chosen]),
            internal=None if starts.internal is None else starts.internal[chosen],
        )
        self.elapsed[rows], self.done[rows] = 0, False
        self._evaluate()
        self.observation[rows], self.start[rows] = self._observe(rows), self.centre[rows]

    def _observe(self, rows: IntArray) -> FloatArray:
        of, values = self.observations, {name: value[rows] for name, value in self.values.items()}
        seen = of.compute(values, self.actions.command[rows])
        if len(of.noisy):
            noise = self.streams.draw_normal(len(of.noisy), rows)
            seen[:, of.noisy] += self.noise[rows][:, of.owner] * noise
        return seen

    def _evaluate(self) -> None:
        """Compute quantities, places and velocities of nodes, centres of mass, changes of rest lengths."""
        manifest, stepper, values = self.model.manifest, self.stepper, dict(self.stepper.values)
        rows, columns = manifest.coordinate_place.T
        for name, state in ((POSITION, stepper.coordinate), (VELOCITY, stepper.velocity)):
            vectors = np.array([manifest.stated_position * (name == POSITION)] * self.num_envs)
            if name in values:
                vectors[:, :, list(manifest.axes)] = values[name]
            else:
                vectors[:, rows, columns] = state
                for body in manifest.body_places:
                    body.attach(vectors)
            values[name] = vectors
        # Sums over an axis have the same bits for any number of copies. Motors with a lag are where they are.
        self.values, self.centre = values, (self.share[:, None] * values[POSITION]).sum(axis=1)
        inputs = self.inputs.copy()
        inputs[:, self.motor_input] = stepper.internal[:, self.motor_state]
        self.wound = (inputs[:, :, None] * self.gain).sum(axis=1)

    def record(
        self,
        policy: Callable[[FloatArray], ArrayLike] | None = None,
        *,
        copy: int = 0,
        seed: int | None = None,
    ) -> Trajectory:
        """Return an episode of one copy, a sample a step, for pictures, films and live pages.

        policy: observations (n, n_observation) -> actions (n, n_actions); None: all are 0. The environment
        stays as it was.
        """
        check_whole(copy, "copy", 0, self.num_envs - 1)
        held = {name: np.copy(array) for name, array in self._list_held().items()}
        mode, is_seeded, self.autoreset = self.autoreset, self.is_seeded, MODES["next_step"]
        try:
            observation, _ = self.reset(seed=seed)
            samples, status = [self._list_sample(copy)], "ok"
            while not self.done[copy]:
                action = 0.0 * self.actions.command if policy is None else policy(observation)
                observation, _, _, _, info = self.step(action)
                status = (info["status"][copy] if info else None) or "ok"
                samples += [self._list_sample(copy)] * (status == "ok")
            return self._build_trajectory(samples, copy, "ok" if status == "ok" else "unstable")
        finally:
            self.autoreset, self.is_seeded = mode, is_seeded
            self._restore(held)

    def _list_sample(self, copy: int) -> tuple[FloatArray, ...]:
        stepper = self.stepper
        state = np.concatenate([stepper.coordinate[copy], stepper.velocity[copy]])
        return state, stepper.internal[copy].copy(), self.inputs[copy].copy()

    def _build_trajectory(self, samples: Any, copy: int, status: str = "ok") -> Trajectory:
        """Return a motion of samples of states, internal states and inputs."""
        state, internal, inputs = (np.array(rows) for rows in zip(*samples, strict=True))
        time = np.arange(float(len(state))) * self.sample
        raw = RawTrajectory(
            time, state, status, "", "stepper", 0, 0, internal=internal if internal.size else None
        )
        arguments = {name: array[copy].copy() for name, array in self.stepper.arguments.items()}
        schedule = (lambda when: {INPUT: inputs[np.searchsorted(time, when)]}) if inputs.size else None
        return evaluate_trajectory(self.model, raw, arguments, schedule)

    def render(self) -> tuple[Any, ...]:
        """Return a picture of each copy as it is, (height, width, 3) of bytes."""
        return tuple(self.render_copy(copy) for copy in range(self.num_envs))

    def render_copy(self, copy: int) -> Any:
        """Return a picture of one copy as it is, (height, width, 3) of bytes."""
        canvas: Any = draw(self._build_trajectory([self._list_sample(copy)], copy)).canvas
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    def save(self, path: str | Path) -> None:
        """Write all that episodes go on from into an .npz file, which replaces one that is there."""
        settings = {name: np.array(text) for name, text in self._list_settings().items()}
        write_arrays(path, self._list_held() | settings, overwrite=True)

    def load(self, path: str | Path) -> None:
        """Go on, bit by bit, from a file of `save`; raises SceneError for another one."""
        self._restore(read_saved(path), self._list_settings())
        self.is_seeded = True

    def _list_held(self) -> dict[str, Any]:
        held = {f"stepper.{name}": array for name, array in self.stepper.snapshot().items()}
        held |= {name: attrgetter(name)(self) for name in HELD}
        return held

    def _list_settings(self) -> dict[str, str]:
        """Return what must be the same where an episode goes on, as texts."""
        of = self.stepper.facts()[0][1].rpartition(",")[0]  # the method, without threads
        starts = hashlib.sha256(self.starts.coordinate.tobytes() + self.starts.velocity.tobytes())
        texts = {
            "description": self.description.to_json(),
            "seconds": str(self.seconds),
            "autoreset": self.autoreset.name,
            "stepper": of,
            "start": starts.hexdigest(),
            "library": self.model.manifest.scene_hash,
        }
        return {f"{SETTING}{name}": text for name, text in texts.items()}

    def _restore(self, held: Mapping[str, Any], own: Mapping[str, str] | None = None) -> None:
        """Go on from arrays; own: the settings that a file must have too."""
        arrays, now = dict(held), self._list_held()
        if own is not None:
            other = [name[len(SETTING) :] for name in own if str(arrays.pop(name, "")) != own[name]]
            if other:
                allowed = f"{self.num_envs} copies of {self.description.scene} with the same settings"
                given = f"another {', '.join(other)}"
                raise InvalidValueError("not of this environment", where="load", given=given, allowed=allowed)
        sent = np.asarray(arrays.get("actions.sent"))
        if sent.ndim == 3 and 0 < len(sent) <= MAX_DELAY + 2:
            now["actions.sent"] = np.zeros((len(sent), *now["actions.sent"].shape[1:]))
        arrays = fit_saved(arrays, now, "not of this environment")
        check_saved(arrays["actions.delay"], "actions.delay", 0.0, MAX_DELAY * self.sample)
        check_saved(arrays["actions.rate"], "actions.rate", 0.0, np.inf)
        check_saved(arrays["elapsed"], "elapsed", 0, np.inf)
        for name in ("actions.sent", "actions.command", "base", "inputs", "noise", "observation", "start"):
            check_finite(arrays[name], f"snapshot: {name}")
        self.stepper.restore(
            {name[8:]: array for name, array in arrays.items() if name.startswith("stepper.")}
        )
        self.actions.sent = arrays["actions.sent"]
        for name in HELD:
            attrgetter(name)(self)[...] = arrays[name]
        self.actions.set_delays(np.arange(self.num_envs), self.actions.delay)
        self._evaluate()


class StructureEnv(gymnasium.Env):
    """One structure: a thin view of `copies`, a `StructureVectorEnv` of one, whose methods it shares."""

    def __init__(self, copies: StructureVectorEnv) -> None:
        self.copies, self.description, self.model = copies, copies.description, copies.model
        self.render_mode = copies.render_mode
        self.metadata = {key: copies.metadata[key] for key in ("render_modes", "render_fps")}
        self.observation_space = copies.single_observation_space
        self.action_space = copies.single_action_space
        self.save, self.load, self.record = copies.save, copies.load, copies.record

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        return self.copies.reset(seed=seed)[0][0], {}

    def step(self, action: ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Send commands, and advance by one sample."""
        observation, reward, terminated, truncated, info = self.copies.step(np.asarray(action)[None])
        info = {"status": info["status"][0]} if info else {}
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Any:
        """Return a picture, (height, width, 3) of bytes."""
        return self.copies.render_copy(0)


def find_mass_shares(structure: Any) -> FloatArray:
    """Return weights (n_nodes,) by which places of nodes add up to the centre of mass."""
    if not isinstance(structure, BodySystem):
        return np.asarray(structure.lumped_mass / structure.lumped_mass.sum())
    weights, mass = np.zeros(structure.n_nodes), compute_body_mass(structure)
    for body in np.flatnonzero(mass).tolist():
        nodes = np.flatnonzero(structure.node_body == body)
        # The centre of a body is at 0 in its frame.
        rows = np.vstack([np.ones(len(nodes)), structure.node_local[nodes].T])
        weights[nodes] = mass[body] / mass.sum() * np.linalg.lstsq(rows, np.eye(4)[0])[0]
    return weights
