"""The parts of a controller: scene or model, motion, gains, estimator, distribution and actuators."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.control.feedback.design.gains import MAX_KNOTS, Estimator, Gains
from tensegrity_codegen.control.feedback.design.linear_samples import (
    build_rest,
    check_independent,
    check_motion,
    check_still_feet,
    hold_feet,
    require_no_rigid_bars,
    split_delays,
)
from tensegrity_codegen.control.feedback.loop.actuator_bounds import (
    ActuatorBounds,
    ActuatorLimits,
    DelayedInputs,
    find_bounds,
)
from tensegrity_codegen.control.feedback.loop.sampled_plant import check_parts, find_sample
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.control.feedback.mpc import Mpc
from tensegrity_codegen.control.feedback.policy import Policy
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.model.arguments import INPUT, merge_inputs
from tensegrity_codegen.runtime.model.interface import Described
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.actuators import Actuator, RestLengthGains, Sensor
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_path, check_switch, check_whole
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError, check_choice
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.request import ModelRequest

# Statuses of the steps of a controller in C. Word: sentence, in the order of the numbers. Simulated loops
# have the first six and the last one.
CONTROL_STATUS: Mapping[str, str] = {
    "ok": "the command is what feedback asks for, or gives the same forces",
    "rate_limited": "the command was cut to the rate of an actuator",
    "range_limited": "the command was cut to the range of an actuator",
    "tension_limited": "least tensions or ranges of coordinates prevent what feedback asks for",
    "least_tension": "a least tension or range of a coordinate cannot be kept within rates, and yields",
    "not_solved": "a quadratic program failed; the command is that of feedback or of the last plan, cut",
    "non_finite_input": "a time, measurement, state or observation is not finite; the last command holds",
    "invalid_length": "a measured length is not above 0; the last command holds",
    "late": "more than 1.5 samples after the expected time; the last command holds",
    "repeated_time": "not after the time of the last step; the last command holds",
    "estimate_lost": "the estimate was not finite and starts again from the motion; the last command holds",
    "null_pointer": "a pointer that is needed is NULL; the last command holds",
    "not_initialised": "init was not called with this memory; the command is that of the start",
    "outlier": "a measurement is too far from its prediction and is not used; the last command holds",
}
QP_ITERATIONS = 100  # of the solver in one quadratic program, at least
ITERATIONS_A_CONSTRAINT = 3  # of it, where these are more
START_TOLERANCE = 1e-9  # [m], by which the start may be outside of the range of an actuator
DESCRIBED_QUANTITIES = ("member_length",)  # of a model that is described and not compiled
MAX_QP_ITERATIONS = 10_000  # that may be stated
SIMULATED_LOOP_NAME = "loop"  # of a controller that is simulated in C


@dataclass(frozen=True)
class ControllerCode:
    """How a controller is written in C, and compiled.

    Attributes
    ----------
    name : str, optional
        First word of all names in C and of the files; by default the name of the scene.
    precision : str
        ``"double"`` or ``"single"``, for every number of the controller and its model.
    knots : int or None
        Largest number of stored gains of feedback, see `Gains.at_knots`; None: all samples.
    qp_iterations : int, optional
        Most iterations of the solver in one quadratic program; a step that needs more has the status
        ``"not_solved"``. By default three for each constraint of the program, and at least 100.
    daqp_sdist : str or Path, optional
        Source package of DAQP, of which a distribution needs C text; by default that in the cache, else pip
        downloads it. Version and SHA-256 are fixed.
    library : bool
        Whether to compile a shared library too, which `load_controller` needs.
    compiler : str, optional
        ``"gcc"``, ``"clang"``, ``"zig"`` or a command; by default the first compiler found.
    inputs : iterable of Path
        Files that are never replaced.
    """

    name: str | None = None
    precision: str = "double"
    knots: int | None = MAX_KNOTS
    qp_iterations: int | None = None
    daqp_sdist: str | Path | None = None
    library: bool = True
    compiler: str | None = None
    inputs: Iterable[Path] = ()


# Arguments of `build_controller` and `simulate_control_batch` that `ControllerCode` has.
MOVED_TO_CODE = {field.name: f"code=ControllerCode({field.name}=...)" for field in fields(ControllerCode)}


def read_code(code: ControllerCode | None) -> ControllerCode:
    """Return how a controller is written, as usual for None; raises InvalidValueError, UnknownNameError."""
    check_instance(code, (ControllerCode, type(None)), "code", "a ControllerCode, or None")
    stated = code or ControllerCode()
    check_instance(stated.precision, str, "precision", '"double" or "single"')
    find_precision(stated.precision, "precision")
    check_switch(stated.library, "library")
    check_instance(stated.compiler, (str, type(None)), "compiler", "the name of a compiler, or None")
    check_instance(stated.inputs, Iterable, "inputs", "a list of paths")
    stated = replace(stated, inputs=tuple(stated.inputs))
    for path in stated.inputs:
        check_path(path, "inputs")
    if stated.qp_iterations is not None:
        check_whole(stated.qp_iterations, "qp_iterations", 1, MAX_QP_ITERATIONS)
    return stated


def limit_iterations(stated: int | None, n_constraints: int) -> int:
    """Return the most iterations in one quadratic program, by default as many as its constraints need."""
    return stated or max(QP_ITERATIONS, ITERATIONS_A_CONSTRAINT * n_constraints)


@dataclass(frozen=True)
class ControllerParts:
    """The parts from which a controller in C is made."""

    name: str  # first word of all names in C
    subject: Subject  # the scene; its feet stick where they stand
    manifest: Manifest  # of a model of the scene
    motion: Motion
    gains: Gains | None  # feedback, at the stored knots
    estimator: Estimator | None  # estimates the state from measurements
    distribution: TensionDistribution | None  # distributes tensions
    bounds: ActuatorBounds  # rates, ranges and delays
    sample: float  # [s]: time between two commands
    mpc: Mpc | None = None  # plans ahead, in place of gains and distribution
    # most iterations of the solver in one quadratic program; None: as `limit_iterations`
    qp_iterations: int | None = None
    # source package of DAQP, for a quadratic program; None: the usual one
    daqp_sdist: str | Path | None = None
    policy: Policy | None = None  # observes and acts, in place of all feedback

    @property
    def model_name(self) -> str:
        """Name of the model that is written beside the controller."""
        return f"{self.name}_control_model"

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors."""
        return () if self.estimator is None else self.estimator.sensing.sensors

    @property
    def disturbed(self) -> NDArray[np.int64]:
        """Coordinates with a disturbance force."""
        return np.zeros(0, dtype=np.int64) if self.estimator is None else self.estimator.disturbed

    @property
    def n_past(self) -> int:
        """Number of commands on their way that the gains know."""
        return 0 if self.gains is None else int(split_delays(self.gains.delay, self.sample)[2].sum())

    @property
    def integral_action(self) -> FloatArray:
        """Outputs whose errors are summed, (n_integrals, n_states)."""
        stated = self.gains if self.mpc is None else self.mpc.gains
        return np.zeros((0, 0)) if stated is None else stated.integral_action

    def delays(self) -> DelayedInputs:
        """Return the delays of the actuators in samples."""
        return DelayedInputs(self.bounds, np.zeros(len(self.bounds.names)), self.sample)


def collect_parts(
    described: Described,
    motion: Motion,
    *,
    gains: Gains | Mpc | None,
    estimator: Estimator | None,
    distribution: TensionDistribution | None,
    sample: float | None,
    limits: ActuatorLimits | None,
    code: ControllerCode,
) -> ControllerParts:
    """Return the parts of a controller, of the parameters of `build_controller`, after their checks."""
    manifest = described.manifest
    check_independent(described)
    check_motion(described, motion)
    mpc, regulator = (gains, gains.gains) if isinstance(gains, Mpc) else (None, gains)
    check_parts(manifest, motion, regulator, estimator, distribution)
    if mpc is not None and distribution is not None:
        raise InvalidValueError(
            "model-predictive control keeps least tensions itself",
            where="distribution",
            given="a distribution of tensions after an Mpc",
            allowed="an Mpc alone, or gains with a distribution",
            hint="design_mpc(..., least_tension=...)",
        )
    check_same_motion(distribution, motion)
    if estimator is not None:
        hint = "measure the state otherwise, or simulate the estimator in Python (simulate_control)"
        require_no_rigid_bars(described, "an estimator in C", hint)
    if mpc is not None or estimator is not None:
        check_still_feet(described, motion, "a controller that predicts")
    assert described.structure is not None  # find_model_and_request refuses models without
    _check_gains(described.structure)
    stored = None if mpc is not None else regulator
    if stored is not None and code.knots is not None:
        stored = stored.at_knots(code.knots)
    parts = ControllerParts(
        name=manifest.name if code.name is None else code.name,
        subject=hold_feet(described.structure, described, motion),
        manifest=manifest,
        motion=motion,
        gains=stored,
        estimator=estimator,
        distribution=distribution,
        bounds=find_bounds(described, motion, limits, may_lag=mpc is not None),
        sample=find_sample(regulator, estimator, sample),
        mpc=mpc,
        qp_iterations=code.qp_iterations,
        daqp_sdist=code.daqp_sdist,
    )
    check_start(parts)
    return parts


def check_alone(policy: Policy, others: Mapping[str, Any]) -> None:
    """Raise InvalidValueError for parts of a controller that have no place beside a policy."""
    check_instance(policy, Policy, "policy", "a Policy, as of read_policy")
    for name, value in others.items():
        if value is not None:
            raise InvalidValueError(
                "this has no place beside a policy",
                where=name,
                given=type(value).__name__,
                allowed="a policy alone, which states sample, rates, ranges and delays",
                hint=f"build_controller(scene, policy=policy, out=...) without {name}",
            )


def collect_policy(described: Described, policy: Policy, code: ControllerCode) -> ControllerParts:
    """Return the parts of a controller that runs a policy, after checks of its actuators."""
    structure, actions = described.structure, policy.description.action
    assert structure is not None  # find_model_and_request refuses models without
    _check_gains(structure)
    inputs: Sequence[Any] = structure.inputs
    members = {item.name: tuple(item.rest_length_gain) for item in inputs if item.rest_length_gain}
    for k, acted in enumerate(actions):
        if acted.name in described.manifest.input_name and acted.name not in members:
            raise InvalidValueError(
                "a policy in C moves rest lengths alone",
                where=f"policy.description.action[{k}]",
                given=f"{acted.name}, which is a force or torque",
                allowed="actuators and inputs that change rest lengths",
                hint="run it in Python: policy(observation)",
            )
        check_choice(acted.name, members, "actuator", f"policy.description.action[{k}]")
    centre, half, rate, delay = np.array([(a.centre, a.half_range, a.rate, a.delay) for a in actions]).T
    bounds = ActuatorBounds(
        tuple(acted.name for acted in actions),
        np.array([described.manifest.input_name.index(acted.name) for acted in actions]),
        tuple(members[acted.name] for acted in actions),
        centre - half, centre + half, rate, delay,
    )  # fmt: skip
    motors = {motor.name: motor for motor in structure.actuators}
    for k, name in enumerate(bounds.names):
        motor = motors.get(name, Actuator(name, members[name]))
        largest = np.inf if motor.time_constant else motor.rate  # commands of motors that lag may jump
        lengths = structure.rest_length[list(motor.members)]
        low, high = lengths.min() + bounds.least[k], lengths.max() + bounds.most[k]
        outside = max(motor.range[0] - low, high - motor.range[1]) > START_TOLERANCE
        if outside or rate[k] > largest * (1.0 + START_TOLERANCE):
            raise InvalidValueError(
                "the policy asks for more than the actuator can",
                where=f"policy.description.action[{k}]",
                given=f"{name}: rest lengths of {low:g} to {high:g} m, {rate[k]:g} m/s",
                allowed=f"{motor.range[0]:g} to {motor.range[1]:g} m, {largest:g} m/s",
                hint="the scene for which the policy was trained",
            )
    # Inputs of the scene, which are zero, where that is within the range.
    start, none = np.zeros(len(inputs)), np.zeros((1, 0))
    start[bounds.place] = np.where((bounds.least <= 0.0) & (bounds.most >= 0.0), 0.0, centre)
    still = Motion(
        np.zeros(1), none, none, none, none, start[None], none, np.zeros(0), bounds.names,
        described.manifest.input_name,
    )  # fmt: skip
    return ControllerParts(
        described.manifest.name if code.name is None else code.name, structure, described.manifest, still,
        None, None, None, bounds, policy.description.sample, policy=policy,
    )  # fmt: skip


def _check_gains(structure: Subject) -> None:
    """Raise InvalidValueError for an input that changes rest lengths by other gains than 1."""
    inputs: Sequence[RestLengthGains] = structure.inputs
    for number, scene_input in enumerate(inputs):
        if any(gain != 1.0 for gain in scene_input.rest_length_gain.values()):
            raise InvalidValueError(
                "a controller in C does not know inputs of temperature, nor of cables in segments",
                where=f"{structure.name}: inputs.{number}",
                given=structure.inputs[number].name,
                allowed="inputs whose value is added to rest lengths as it is",
                hint="remove the input from the scene of the controller",
            )


def find_quantities(parts: ControllerParts) -> tuple[str, ...]:
    """Return the quantities of the model that the controller calls."""
    quantities: list[str] = []
    if parts.estimator is not None:
        quantities.append("acceleration")
        quantities += ["mass_matrix"] if len(parts.disturbed) else []
        # Places of nodes are coordinates themselves in some models.
        points = set(parts.manifest.body_points)
        in_nodes = bool(parts.manifest.coordinate_node_axis)
        for sensor in parts.sensors:
            is_stated = in_nodes and points.isdisjoint(sensor.targets)
            if not (sensor.kind.startswith("node_") and is_stated):
                quantities.append({"angular_velocity": "body_angular_velocity"}.get(sensor.kind, sensor.kind))
    if parts.mpc is not None:
        quantities += ["acceleration", "state_jacobian", "input_jacobian"]
    if parts.distribution is not None or (parts.mpc is not None and len(parts.mpc.cables.limited)):
        quantities += ["member_length", "equilibrium_matrix"]
    return tuple(dict.fromkeys(quantities))


def check_start(parts: ControllerParts) -> None:
    """Raise InvalidValueError if the first command would be outside of the range of an actuator."""
    bounds = parts.bounds
    start = parts.motion.at(0.0).input[bounds.place]
    outside = (start < bounds.least - START_TOLERANCE) | (start > bounds.most + START_TOLERANCE)
    if not outside.any():
        return
    k = int(np.argmax(outside))
    structure = parts.subject
    length = np.array([structure.rest_length[e] for e in bounds.members[k]])
    raise InvalidValueError(
        "the motion starts outside of the range of an actuator",
        where=f"actuators.{bounds.names[k]}.range",
        given=f"rest lengths of {(length + start[k]).min():.6g} to {(length + start[k]).max():.6g} m",
        allowed=f"{length.min() + bounds.least[k]:.6g} to {length.max() + bounds.most[k]:.6g} m",
        hint="a larger range, or another motion",
    )


def check_same_motion(distribution: TensionDistribution | None, motion: Motion) -> None:
    """Raise InvalidValueError for a distribution that prefers the tensions of another motion."""
    if distribution is None:
        return
    preferred = distribution.motion
    names = ("time", "input", "member_tension")
    if not all(np.array_equal(getattr(preferred, name), getattr(motion, name)) for name in names):
        raise InvalidValueError(
            "designed for another motion",
            where="distribution",
            given=f"a motion of {preferred.duration:g} s with {len(preferred.time)} knots",
            allowed=f"the motion of the controller, of {motion.duration:g} s with {len(motion.time)} knots",
            hint="design_distribution(model, motion, ...) with this motion",
        )


# The input of `build_controller`: a scene file or a compiled model, a motion or an equilibrium.


@dataclass(frozen=True)
class _Description:
    """A model that is described but not compiled."""

    manifest: Manifest
    structure: Subject


def find_model_and_request(
    scene: str | Path | CompiledModel, motion: Motion | Equilibrium | None
) -> tuple[Described, ModelRequest]:
    """Return the model of a scene or a compiled one, and the request for its formulation alone."""
    if isinstance(scene, CompiledModel):
        if scene.structure is None:
            raise LibraryError(
                "the model does not contain its structure",
                where=str(scene.path),
                given="a library that was loaded alone",
                allowed="a model of compile_scene, or the scene file",
            )
        manifest = scene.manifest
        return scene, ModelRequest((), formulation=manifest.formulation, emitter=manifest.emitter)
    structure, request = load_scene(scene)
    alone = ModelRequest(
        (), formulation=request.formulation, emitter=request.emitter, options=request.options
    )
    if isinstance(motion, Equilibrium):
        return compile_scene(scene, for_=("control",)), alone
    return _Description(
        emit(structure, replace(alone, quantities=DESCRIBED_QUANTITIES)).manifest, structure
    ), alone


def find_motion(
    model: Described, motion: Motion | Equilibrium | None, arguments: Mapping[str, Any] | None = None
) -> Motion:
    """Return the motion; an equilibrium as a motion that stays there. Raises as `build_rest`."""
    merged = merge_inputs(model.manifest, arguments)
    if isinstance(motion, Motion) and not merged:
        return motion
    if isinstance(motion, Motion) or set(merged) - {INPUT}:
        raise InvalidValueError(
            "these arguments have no place in a controller",
            where="arguments",
            given=", ".join(arguments or {}),
            allowed="inputs of an equilibrium" if isinstance(motion, Equilibrium) else "none with a Motion",
            hint="state loads and stiffnesses in the scene",
        )
    if not isinstance(motion, Equilibrium) or not isinstance(model, CompiledModel):
        raise InvalidValueError(
            "not a motion", where="motion", given=type(motion).__name__, allowed="a Motion or an Equilibrium"
        )
    return build_rest(model, motion, arguments=merged)
