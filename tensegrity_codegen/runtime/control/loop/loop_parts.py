"""Gains, estimator and distribution of one loop: whether they fit each other and the motion."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.manifest import Manifest
from tensegrity_codegen.runtime.control.design.estimator import Estimator
from tensegrity_codegen.runtime.control.design.gains import Gains
from tensegrity_codegen.runtime.control.loop.actuator_bounds import ActuatorBounds
from tensegrity_codegen.runtime.control.motion import Motion
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.state_names import name_states

__all__ = ["check_parts", "find_sample"]

SAMPLE = 0.005  # [s], where no gains state another


class DesignedDistribution(Protocol):
    """A distribution of tensions with the actuators and the model that it was designed for."""

    @property
    def bounds(self) -> ActuatorBounds:
        """Its actuators."""
        ...

    @property
    def model(self) -> CompiledModel:
        """Its model."""
        ...


def check_parts(
    manifest: Manifest,
    motion: Motion,
    gains: Gains | None,
    estimator: Estimator | None,
    distribution: DesignedDistribution | None,
) -> None:
    """Raise InvalidValueError for gains, an estimator or a distribution of another model or motion."""
    states, members = name_states(manifest), manifest.member_name
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


def find_sample(gains: Gains | None, estimator: Estimator | None, sample: float | None) -> float:
    """Return the time between two commands [s], which gains and estimator must share."""
    stated = [item.sample for item in (gains, estimator) if item is not None]
    stated += [] if sample is None else [sample]
    found = stated[0] if stated else SAMPLE
    if any(other != found for other in stated):
        raise InvalidValueError(
            "gains and estimator are for another sample time",
            where="sample",
            given=", ".join(f"{other!r} s" for other in stated),
            allowed="one sample time of gains, estimator and simulation",
        )
    if not np.isfinite(found) or found <= 0.0:
        raise InvalidValueError(
            "out of range", where="sample", given=found, allowed="a finite number > 0 [s]"
        )
    return found
