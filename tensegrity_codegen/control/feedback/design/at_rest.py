"""An equilibrium as a motion: at rest, with constant inputs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.control.planning.actuation import find_actuation
from tensegrity_codegen.control.planning.plan_point import PlanModel
from tensegrity_codegen.runtime.model.arrays import check_shape, to_sized
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.named_inputs import INPUT, merge_inputs
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.system.checks import check_instance, check_positive
from tensegrity_codegen.system.errors import InvalidValueError

FOUND = ("converged", "rounding_limited")


def build_rest(
    model: CompiledModel,
    equilibrium: Equilibrium,
    duration: float = 1.0,
    arguments: Mapping[str, Any] | None = None,
    actuators: Sequence[str] | None = None,
) -> Motion:
    """Return the motion that stays at an equilibrium.

    Parameters
    ----------
    model : CompiledModel
        With its structure, which has actuators.
    equilibrium : Equilibrium
        As of find_equilibrium, with the same arguments.
    duration : float [s]
        Time of the last knot.
    arguments : mapping, optional
        Inputs and run-time parameters where they differ from the scene.
    actuators : sequence of str, optional
        Names of the actuators that may move; by default all of the scene.

    Returns
    -------
    Motion
        Two knots.

    Raises
    ------
    InvalidValueError
        The equilibrium was not found, or is one of another model; the duration is no number > 0.
    StructureError
        The structure has no actuators.
    """
    check_instance(equilibrium, Equilibrium, "motion", "a Motion of time_motion, or an Equilibrium")
    if equilibrium.status not in FOUND:
        raise InvalidValueError(
            "not an equilibrium", where="motion", given=equilibrium.status, allowed=", ".join(FOUND)
        )
    check_positive(duration, "duration", "[s]")
    check_shape(equilibrium.coordinate, (len(model.manifest.coordinate_name),), "motion.coordinate")
    actuation = find_actuation(model, actuators)
    given = merge_inputs(model.manifest, arguments)
    nominal = model.nominal(INPUT)
    value = to_sized(given.get(INPUT, nominal), nominal.shape, f"arguments.{INPUT}").ravel()
    still = np.zeros((2, len(equilibrium.coordinate)))
    rest = PlanModel(model, actuation, arguments).rest_length(value[actuation.place])
    return Motion(
        time=np.array([0.0, duration]),
        coordinate=np.array([equilibrium.coordinate] * 2),
        velocity=still,
        acceleration=still,
        rest_length=np.array([rest] * 2),
        input=np.array([value] * 2),
        member_tension=np.array([equilibrium.member_tension] * 2),
        peak_rate=np.zeros(len(rest)),
        actuators=actuation.names,
        input_name=model.manifest.input_name,
    )
