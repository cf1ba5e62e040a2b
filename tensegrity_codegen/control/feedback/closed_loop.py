"""Closed loops in simulation: the controller acts at samples, the full model moves in between."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    check_motion,
    find_bristles,
    find_reference,
    invert_mass,
    shift_commands,
)
from tensegrity_codegen.control.feedback.loop.actuator_bounds import (
    MOVED_TO_LIMITS,
    ActuatorBounds,
    ActuatorLimits,
    DelayedInputs,
    find_bounds,
)
from tensegrity_codegen.control.feedback.loop.control_run import ControlRun, build_run, compare_with_open_loop
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    Disturbance,
    SampledPlant,
    check_parts,
    count_samples,
    describe_unknown_delays,
    find_sample,
    keep_bars,
    read_disturbance,
)
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.interface import require_double, require_model, require_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_positive, check_switch, with_moved
from tensegrity_codegen.system.errors import NonFiniteError

MOVED_TO_DISTURBANCE = {
    field.name: f"disturbance=Disturbance({field.name}=...)" for field in fields(Disturbance)
}

COMMAND_ROUNDING = 1e-12  # [m], by which a command may differ from the requested one
OUTLIER_BOUND = 6.0  # standard deviations, up to which measurements may differ from their predictions
FIRST_INNOVATION = 100.0  # recent largest difference, which is not known at the start
INNOVATION_DECAY = 0.7  # of it from sample to sample
MAX_DOUBLINGS = 30  # of the accepted deviation after outliers, at most


class Controller:
    """Feedback u = u_motion - K (x - x_motion) at each sample, cut to rates and ranges.

    gains: feedback; None: the inputs of the motion alone.
    bounds: rates and ranges.
    sample [s]: time between two commands.
    distribution: finds tensions above the least ones that give the same forces.
    yielding (n_members,): members whose least tension the last command could not reach; None without a
        distribution.

    The input of the motion is that of the middle of the time in which the command holds, delays included. The
    sums of errors stand still while a command is cut, so that they do not grow without effect.
    """

    def __init__(
        self,
        motion: Motion,
        gains: Gains | None,
        bounds: ActuatorBounds,
        sample: float,
        distribution: TensionDistribution | None = None,
    ) -> None:
        self.motion, self.gains, self.bounds, self.sample = motion, gains, bounds, sample
        self.distribution = distribution
        self.yielding: NDArray[np.bool_] | None = None
        self.sums = np.zeros(0 if gains is None else len(gains.integral_action))
        self.shift, self.enter = shift_commands(np.zeros(0) if gains is None else gains.delay, sample)
        self.past = np.zeros(len(self.shift))
        self.command = motion.at(0.0).input[bounds.place]

    def step(self, k: int, state: FloatArray) -> tuple[FloatArray, str]:
        """Return the command of a sample, (n_actuators,) [m], and its status."""
        requested, error = self.find_wanted(k, state)
        if self.distribution is None:
            command, status = self.cut(requested)
        else:
            n = len(state) // 2
            distributed = self.distribution.distribute(k * self.sample, state[:n], requested, *self.reach())
            command, status, self.yielding = distributed.command, distributed.status, distributed.yielding
        if status == "ok" and self.gains is not None:
            self.sums = self.sums + self.gains.integral_action @ error
        self.command = command
        self._remember(command - self.find_planned(k))
        return command, status

    def hold(self, k: int) -> tuple[FloatArray, str]:
        """Return the last command for another sample, where measurements were not used."""
        self._remember(self.command - self.find_planned(k))
        return self.command, "outlier"

    def _remember(self, change: FloatArray) -> None:
        """Append the difference of a command from the motion, (n_actuators,) [m], to those on their way."""
        if len(self.past):
            self.past = self.shift @ self.past + self.enter @ change

    def find_wanted(self, k: int, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the change of the command by the gains [m], and the error of the state."""
        now = self.motion.at(k * self.sample)
        requested = self.find_planned(k)
        error = state - np.concatenate([now.coordinate, now.velocity])
        if self.gains is not None:
            requested = requested - self.gains.at(k) @ np.concatenate([error, self.sums, self.past])
        return requested, error

    def find_planned(self, k: int) -> FloatArray:
        """Return the inputs of the motion for the command of a sample, (n_actuators,) [m]."""
        middle, late = (k + 0.5) * self.sample, self.bounds.delay
        inputs = {time: self.motion.at(middle + time).input for time in np.unique(late).tolist()}
        return np.array(
            [inputs[time][column] for time, column in zip(late.tolist(), self.bounds.place, strict=True)]
        )

    def reach(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the next command within rates and ranges, (n_actuators,) each [m]."""
        step = self.bounds.rate * self.sample
        low = np.maximum(self.bounds.least, self.command - step)
        high = np.minimum(self.bounds.most, self.command + step)
        return np.minimum(low, high), high

    def cut(self, requested: FloatArray) -> tuple[FloatArray, str]:
        """Return the nearest command within rates and ranges, and the status."""
        low, high = self.reach()
        command = np.clip(requested, low, high)
        moved = np.abs(command - requested) > COMMAND_ROUNDING
        if not moved.any():
            return command, "ok"
        ranged = np.clip(requested, self.bounds.least, self.bounds.most)
        return command, "range_limited" if (
            np.abs(ranged - requested) > COMMAND_ROUNDING
        ).any() else "rate_limited"


# The estimator at work: predictions of the full model, corrected by measurements.


class Filter:
    """An estimator that runs from the start of a motion on.

    model: the model that the estimator knows.
    motion: whose start is the first prediction, without disturbances.
    arguments: run-time parameters if they differ from the scene.
    is_outlier: whether the last measurements were too far from their predictions, and were not used: further
        than six standard deviations, or twice what was accepted lately, or twice as far again after each
        outlier.
    """

    def __init__(
        self, model: CompiledModel, estimator: Estimator, motion: Motion, arguments: Mapping[str, Any]
    ) -> None:
        self.model, self.estimator, self.arguments = model, estimator, dict(arguments)
        self.start = start = motion.at(0.0)
        self.n = len(start.coordinate)
        self.state = np.concatenate([start.coordinate, start.velocity, np.zeros(len(estimator.disturbed))])
        self.is_outlier, self.n_outliers, self.innovation = False, 0, FIRST_INNOVATION

    @property
    def disturbance(self) -> FloatArray:
        """Estimated disturbance force on each coordinate, (n_coordinates,)."""
        force = np.zeros(self.n)
        force[self.estimator.disturbed] = self.state[2 * self.n :]
        return force

    def correct(self, time: float, measured: FloatArray, value: FloatArray) -> FloatArray:
        """Return the state (q, q') after a measurement, of which outliers are not used."""
        off = measured - self.estimator.sensing.measure(self._at(self.state, value))
        largest = float(np.abs(off * self.estimator.weight(time)).max(initial=0.0))
        self.is_outlier = largest > max(OUTLIER_BOUND, 2.0 * self.innovation) * 2.0**self.n_outliers
        if self.is_outlier:
            self.n_outliers = min(self.n_outliers + 1, MAX_DOUBLINGS)
        else:
            self.innovation, self.n_outliers = max(largest, INNOVATION_DECAY * self.innovation), 0
            self.state = self.state + self.estimator.at(time) @ off
            keep_bars(self.model, self.state[: 2 * self.n])
        return self.state[: 2 * self.n].copy()

    def predict(self, span: float, value: FloatArray) -> None:
        """Move the state over a time span [s] with inputs (n_inputs,), by Runge-Kutta steps of order 4."""
        fraction = span / self.estimator.sample
        count = max(1, int(np.ceil(self.estimator.substeps * fraction - 1e-9)))
        step, x = span / count, self.state[: 2 * self.n]
        for _ in range(count):
            at = self._at(x, value)
            push = (
                invert_mass(self.model, at) @ self.disturbance
                if self.disturbance.any()
                else 0.0 * x[: self.n]
            )
            k1 = self._rate(x, value, push)
            k2 = self._rate(x + 0.5 * step * k1, value, push)
            k3 = self._rate(x + 0.5 * step * k2, value, push)
            k4 = self._rate(x + step * k3, value, push)
            x = keep_bars(self.model, x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
        self.state = np.concatenate([x, self.state[2 * self.n :]])

    def _rate(self, x: FloatArray, value: FloatArray, push: FloatArray) -> FloatArray:
        moved = np.asarray(self.model.compute("acceleration", **self._at(x, value)))
        return np.concatenate([x[self.n :], moved + push])

    def _at(self, state: FloatArray, value: FloatArray) -> dict[str, Any]:
        n = self.n
        return {
            **self.arguments,
            "coordinate": state[:n].copy(),
            "velocity": state[n : 2 * n].copy(),
            INPUT: value,
            **find_bristles(self.model, self.start, state[:n]),
        }


# The simulated loop: the controller acts at samples, the full model moves in between.


@with_moved(**MOVED_TO_DISTURBANCE, **MOVED_TO_LIMITS)
def simulate_control(
    model: CompiledModel,
    motion: Motion | Equilibrium,
    gains: Gains | None = None,
    *,
    estimator: Estimator | None = None,
    distribution: TensionDistribution | None = None,
    t_end: float | None = None,
    sample: float | None = None,
    disturbance: Disturbance | None = None,
    limits: ActuatorLimits | None = None,
    compare: bool = True,
) -> ControlRun:
    """Simulate a motion of the full model with sampled feedback.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``, see compile_scene.
    motion : Motion or Equilibrium
        The motion to hold; after its end its last point is held. An equilibrium is held for 1 s, or `t_end`.
    gains : Gains, optional
        Feedback; without it the inputs of the motion alone act (open loop).
    estimator : Estimator, optional
        Estimates the state from noisy measurements; without it feedback acts on the true state.
    distribution : TensionDistribution, optional
        Keeps tensions above the least ones; it must be for the same motion.
    t_end : float, optional [s]
        End of the simulation, cut to whole samples; by default the end of the motion.
    sample : float, optional [s]
        Time between two commands; by default that of the gains, 0.005 s without.
    disturbance : Disturbance, optional
        Errors of the start, other parameters of the simulated model, gusts, and the seed of the noise.
    limits : ActuatorLimits, optional
        Rates, ranges and delays of the actuators, by default those of the scene.
    compare : bool
        Whether a loop that ends far from the motion is compared with the open loop, which is simulated too.

    Returns
    -------
    ControlRun
        States, commands, tensions and the status of each sample; status, message and warnings of the run.

    Raises
    ------
    InvalidValueError, NonFiniteError, UnknownNameError
        A value of another shape or out of range, a motion that an actuator is too slow for, an unknown
        argument or node.
    FormulationError
        The library lacks a quantity, integrator or run-time parameter.

    Notes
    -----
    The controller and its estimator know the scene and the motion, not the disturbance.
    Commands are held between samples, and arrive after the delays of the actuators. The motion in between is
    integrated in C (rk853, relative tolerance 1e-9), stretch by stretch between changes of
    inputs or loads.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import Disturbance, compile_scene, design_lqr, find_equilibrium
    >>> from tensegrity_codegen import simulate_control
    >>> winch = '[[actuators]]\\nname = "winch"\\nmembers = "cord"\\n'
    >>> _ = Path("lift.toml").write_text('axes = "z"\\n' + Path("two_nodes.toml").read_text() + winch)
    >>> model = compile_scene("lift.toml", for_=("equilibrium", "control"))
    >>> found = find_equilibrium(model)
    >>> gains = design_lqr(model, found, [100.0, 1.0], [1.0], sample=0.02)
    >>> away = Disturbance(coordinate_error=[0.01])
    >>> run = simulate_control(model, found, gains, t_end=1.0, disturbance=away)
    >>> run.status, run.worst_error(last=0.2) < 1e-4
    ('ok', True)
    """
    require_model(model)
    require_double(model.manifest, "a simulated closed loop")
    require_quantities(model, ("member_tension",), "a simulated closed loop needs")
    check_switch(compare, "compare")
    # The motion, and whether all parts belong to it.
    held = 1.0 if t_end is None else check_positive(t_end, "t_end", "[s]")
    check_instance(disturbance, (Disturbance, type(None)), "disturbance", "a Disturbance, or None")
    arguments = None if disturbance is None else disturbance.arguments
    reference = find_reference(model, motion, held, arguments)
    check_motion(model, reference)
    check_parts(model.manifest, reference, gains, estimator, distribution)
    # The simulated parts: plant, controller, estimator.
    step = find_sample(gains, estimator, sample)
    bounds = find_bounds(model, reference, limits)
    count = count_samples(reference.duration if t_end is None else t_end, step)
    start = read_disturbance(model, reference, disturbance)
    plant = SampledPlant(model, start.state, start.given, start.gusts)
    senses = None if estimator is None else Filter(model, estimator, reference, {})
    tensions = None if distribution is None else replace(distribution, bounds=bounds)
    loop = _Loop(
        model,
        reference,
        Controller(reference, gains, bounds, step, tensions),
        plant,
        bounds,
        senses,
        start.seed,
    )
    late = describe_unknown_delays(gains, bounds)
    run = loop.run(count)
    run = replace(run, warnings=((late,) if late else ()) + run.warnings)
    if gains is None or not compare:
        return run

    def run_open() -> ControlRun:
        return simulate_control(
            model, reference, t_end=count * step, sample=step, disturbance=disturbance, limits=limits
        )

    return compare_with_open_loop(model, reference, run, run_open)


@dataclass
class _Loop:
    """One closed loop."""

    model: CompiledModel
    motion: Motion
    controller: Controller
    plant: SampledPlant
    bounds: ActuatorBounds
    senses: Filter | None
    seed: int

    def run(self, count: int) -> ControlRun:
        """Return the run over so many samples."""
        step = self.controller.sample
        delayed = DelayedInputs(self.bounds, self.controller.command, step)
        states, commands, inputs, statuses, yielding = [self.plant.state], [], [], [], []
        value = self.motion.at(0.0).input.copy()
        tensions, estimates = [self._tension(states[0], value)], []
        noise, n = np.random.default_rng(self.seed), len(self.model.manifest.coordinate_name)
        for k in range(count):
            try:
                # The controller acts on the estimated state.
                estimate = self._estimate(k * step, states[-1], value, noise)
                if self.senses is not None and self.senses.is_outlier:
                    command, status = self.controller.hold(k)
                else:
                    command, status = self.controller.step(k, estimate[: 2 * n])
                # The plant moves on, with the commands that have arrived.
                value = self.motion.at((k + 0.5) * step).input.copy()
                if not self._advance(k * step, delayed.push(command), value):
                    break
            except NonFiniteError:
                self.plant.word = "the estimate is not finite"
                break
            estimates.append(estimate)
            states.append(self.plant.state)
            commands.append(command)
            inputs.append(value.copy())
            statuses.append(status)
            none = np.zeros(len(self.model.manifest.member_name), dtype=bool)
            yielding.append(none if self.controller.yielding is None else self.controller.yielding)
            tensions.append(self._tension(states[-1], value))
        return build_run(
            self.model,
            self.motion,
            step,
            state=np.array(states),
            command=np.array(commands),
            input=np.array(inputs),
            tension=np.array(tensions),
            known=None if self.senses is None else np.array(estimates),
            statuses=statuses,
            word=self.plant.word,
            yielding=None if self.controller.distribution is None else np.array(yielding, dtype=bool),
        )

    def _estimate(
        self, time: float, state: FloatArray, value: FloatArray, noise: np.random.Generator
    ) -> FloatArray:
        """Return the true state, or the estimated one with the disturbance force on each coordinate."""
        if self.senses is None:
            return state
        sensing, at = self.senses.estimator.sensing, self._at(state, value)
        measured = sensing.measure(at) + sensing.noise * noise.normal(size=len(sensing.noise))
        return np.concatenate([self.senses.correct(time, measured, value), self.senses.disturbance])

    def _advance(self, start: float, stretches: list[tuple[float, FloatArray]], value: FloatArray) -> bool:
        """Move the model to the next sample; `value` (n_inputs,) becomes the inputs at its end."""
        ends = [*(since for since, _ in stretches[1:]), self.controller.sample]
        for (since, arrived), end in zip(stretches, ends, strict=True):
            value[self.bounds.place] = arrived
            if not self.plant.advance(start + since, start + end, value):
                return False
            if self.senses is not None:
                self.senses.predict(end - since, value)
        return True

    def _tension(self, state: FloatArray, value: FloatArray) -> FloatArray:
        return np.asarray(self.model.compute("member_tension", **self._at(state, value))).copy()

    def _at(self, state: FloatArray, value: FloatArray) -> dict[str, FloatArray]:
        n = len(self.model.manifest.coordinate_name)
        moving = {"coordinate": state[:n], "velocity": state[n : 2 * n], INPUT: value}
        return {**self.plant.arguments(), **moving}
