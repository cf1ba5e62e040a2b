"""Inputs over time of `--profile`: reading, and warnings of actuators whose limits they exceed."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.runtime.profiles.driven import check_end, check_not_constant
from tensegrity_codegen.runtime.profiles.profile import KINDS
from tensegrity_codegen.system.errors import check_choice

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.structure.actuators import Actuator

ROUNDING = 1e-9  # relative excess of a limit that is rounding


def read_schedule(
    path: Path | None, kind: str, t_end: float, case: "SceneCase", values: Mapping[str, float]
) -> "Profile | None":
    """Return the inputs over time of a file, None without one, after warnings of actuators that they exceed.

    t_end [s]: of the motion; values: constant values of inputs. Raises InvalidValueError for a profile that
    ends before, or of an input with a constant value, and the errors of read_profile.
    """
    check_choice(kind, KINDS, "kind of profile", "--profile-kind")
    if path is None:
        return None
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile

    profile = read_profile(path, [scene_input.name for scene_input in case.subject.inputs], kind)
    check_end(profile, t_end, str(path))
    check_not_constant(profile, values, where=str(path))
    case.warn(*list_excesses(profile, case.subject))
    return profile


def list_excesses(profile: "Profile | None", subject: "Subject") -> list[str]:
    """Return warnings of actuators whose range or rate a profile exceeds: the model has no such limits."""
    return [
        f"the profile of {actuator.name} {sentence}, which the simulation does not limit"
        for actuator in subject.actuators
        if profile is not None and actuator.name in profile.values
        for sentence in _compare(profile, actuator, subject)
    ]


def _compare(profile: "Profile", actuator: "Actuator", subject: "Subject") -> list[str]:
    """Return how a profile exceeds an actuator: the rest length farthest outside, the largest rate."""
    import numpy as np

    column = list(profile.values).index(actuator.name)
    shift, rate = profile.pieces.find_extremes(column)
    sentences, largest = [], 0.0
    lower, upper = actuator.range
    outside = ""
    # The member and the extreme that are farthest outside the range.
    for e in actuator.members:
        for length in subject.rest_length[e] + np.array(shift):
            excess = max(lower - length, length - upper)
            if excess > ROUNDING * max(abs(length), 1e-300) and excess > largest:
                largest = excess
                outside = (
                    f"sets the rest length of {subject.member_name[e]} to {length:.6g} m, outside its range, "
                    f"{lower:g} to {upper:g} m"
                )
    sentences += [outside] if outside else []
    if math.isinf(rate) and math.isfinite(actuator.rate):
        sentences.append(f"jumps, faster than its rate, {actuator.rate:g} m/s")
    elif rate > actuator.rate * (1 + ROUNDING):
        sentences.append(
            f"changes rest lengths at {rate:.6g} m/s, faster than its rate, {actuator.rate:g} m/s"
        )
    return sentences
