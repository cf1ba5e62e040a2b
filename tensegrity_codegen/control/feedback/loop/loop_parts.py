"""Parts of one loop: whether they fit each other and the motion, and what the simulation starts from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.design.estimator import Estimator
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    NODE_LOAD,
    Disturbance,
    GustLoad,
    bind_gust,
)
from tensegrity_codegen.control.feedback.loop.tension_distribution import TensionDistribution
from tensegrity_codegen.runtime.model.arguments import check_arguments
from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles, to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.model.state_names import name_moving_states
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, check_positive, check_whole, is_number
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.manifest import Manifest

SAMPLE = 0.005  # [s], where no gains state another
MOST_SAMPLES = 1_000_000


def check_parts(
    manifest: Manifest,
    motion: Motion,
    gains: Gains | None,
    estimator: Estimator | None,
    distribution: TensionDistribution | None,
) -> None:
    """Raise InvalidValueError for gains, an estimator or a distribution of another model or motion."""
    check_instance(gains, (Gains, type(None)), "gains", "Gains of design_lqr, or None")
    check_instance(estimator, (Estimator, type(None)), "estimator", "an Estimator of design_kalman, or None")
    if distribution is not None:
        made = getattr(distribution, "bounds", None)
        check_instance(made, ActuatorBounds, "distribution", "a TensionDistribution of design_distribution")
    states, members = name_moving_states(manifest), manifest.member_name
    parts = {
        "gains": gains is None or (gains.actuators == motion.actuators and gains.state_name == states),
        "estimator": estimator is None or estimator.state_name[: len(states)] == states,
        "distribution": distribution is None
        or (
            distribution.bounds.names == motion.actuators
            and distribution.model.manifest.member_name == members
        ),
    }
    for name, fits in parts.items():
        if not fits:
            raise InvalidValueError(
                "designed for another model or motion",
                where=name,
                given=f"a design for other actuators, states or members than those of {manifest.name}",
                allowed=f"a design for the actuators {', '.join(motion.actuators)}",
            )


def describe_unknown_delays(gains: Gains | None, bounds: ActuatorBounds) -> str:
    """Return a sentence where gains are designed for other delays than those of the actuators, else ""."""
    if gains is None or np.allclose(gains.delay, bounds.delay, rtol=1e-9, atol=1e-12):
        return ""
    known, late = 1000 * float(gains.delay.max(initial=0.0)), 1000 * float(bounds.delay.max(initial=0.0))
    return (
        f"the gains are designed for delays of up to {known:.3g} ms, and the actuators answer up to "
        f"{late:.3g} ms late: design_lqr(..., delay=...) takes the delays of the actuators"
    )


def find_sample(gains: Gains | None, estimator: Estimator | None, sample: float | None) -> float:
    """Return the time between two commands [s], which gains and estimator must share."""
    stated = [item.sample for item in (gains, estimator) if item is not None]
    stated += [] if sample is None else [check_positive(sample, "sample", "[s]")]
    found = stated[0] if stated else SAMPLE
    if any(other != found for other in stated):
        raise InvalidValueError(
            "gains and estimator are for another sample time",
            where="sample",
            given=", ".join(f"{other!r} s" for other in stated),
            allowed="one sample time of gains, estimator and simulation",
        )
    return check_positive(found, "sample", "[s]")


# What a simulated loop starts from: number of samples, state, arguments of the simulated model.


def count_samples(t_end: float, sample: float) -> int:
    """Return the whole samples until an end [s]; raises InvalidValueError for none or too many."""
    count = t_end / sample if is_number(t_end) else np.nan
    if not np.isfinite(count) or not 1.0 - 1e-9 <= count <= MOST_SAMPLES:
        raise InvalidValueError(
            "out of range",
            where="t_end",
            given=t_end,
            allowed=f"{sample:g} to {MOST_SAMPLES * sample:g} s, 1 to {MOST_SAMPLES} samples",
        )
    return int(np.floor(count + 1e-9))


@dataclass(frozen=True, eq=False)
class LoopStart:
    """Start (n_states,) of a simulated loop, arguments of its model, loads that change, seed of the noise."""

    state: FloatArray
    given: Mapping[str, Any]
    gusts: GustLoad | None
    seed: int


def read_disturbance(
    model: CompiledModel, motion: Motion, disturbance: Disturbance | None, where: str = "disturbance"
) -> LoopStart:
    """Return what a loop starts from.

    Raises InvalidValueError, NonFiniteError or UnknownNameError for a value of another shape or out of range,
    and for arguments that the model lacks.
    """
    check_instance(disturbance, (Disturbance, type(None)), where, "a Disturbance")
    stated = disturbance or Disturbance()
    seed = check_whole(stated.seed, "seed" if where == "disturbance" else f"{where}.seed", 0)
    given = merge_inputs(model.manifest, stated.arguments)
    if stated.axial_stiffness is not None:
        allowed = "one stiffness for each member of the run-time parameter [N]"
        given["axial_stiffness"] = to_doubles(stated.axial_stiffness, "axial_stiffness", allowed)
    check_arguments(model.manifest, given)
    if model.manifest.internal_name:
        given["internal"] = motion.at(0.0).internal
    start = _find_state(motion, stated)
    return LoopStart(start, given, bind_gust(model, stated.gust, given.get(NODE_LOAD)), seed)


def _find_state(motion: Motion, stated: Disturbance) -> FloatArray:
    """Return the state of the motion at its start, with errors."""
    point = motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    n = len(point.coordinate)
    for place, name in ((0, "coordinate_error"), (n, "velocity_error")):
        value = getattr(stated, name)
        if value is not None:
            error = to_sized(value, (n,), name).ravel()
            check_finite(error, name)
            state[place : place + n] += error
    return state
