"""What a simulated loop starts from: number of samples, state, arguments of the simulated model."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arguments import check_arguments
from tensegrity_codegen.runtime.model.arrays import check_finite, to_doubles, to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import merge_inputs
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import InvalidValueError

MOST_SAMPLES = 1_000_000


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


def find_start(motion: Motion, coordinate: ArrayLike | None, velocity: ArrayLike | None) -> FloatArray:
    """Return the state of the motion at its start, with errors."""
    point = motion.at(0.0)
    state = np.concatenate([point.coordinate, point.velocity])
    n = len(point.coordinate)
    for place, value, name in ((0, coordinate, "coordinate_error"), (n, velocity, "velocity_error")):
        if value is not None:
            error = to_sized(value, (n,), name).ravel()
            check_finite(error, name)
            state[place : place + n] += error
    return state


def find_given(
    model: CompiledModel, arguments: Mapping[str, Any] | None, axial_stiffness: ArrayLike | None
) -> dict[str, Any]:
    """Return the run-time arguments of the simulated model by name; raises for those that it lacks."""
    given = merge_inputs(model.manifest, arguments)
    if axial_stiffness is not None:
        allowed = "one stiffness for each member of the run-time parameter [N]"
        given["axial_stiffness"] = to_doubles(axial_stiffness, "axial_stiffness", allowed)
    check_arguments(model.manifest, given)
    return given
