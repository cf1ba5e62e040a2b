"""Actuators that cannot do their work: cables between fixed points, cables without force."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.bodies import BodySystem, FixedBody
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError

NOTHING = 1e-12  # of the largest effect of any actuator


def list_actuators(model: CompiledModel, names: Sequence[str]) -> tuple[Actuator | None, ...]:
    """Return the scene's actuators of these inputs, None for an input that is no actuator."""
    known = () if model.structure is None else model.structure.actuators
    by_name = {item.name: item for item in known}
    return tuple(by_name.get(name) for name in names)


def check_effects(model: CompiledModel, gain: FloatArray, names: Sequence[str]) -> None:
    """Raise InvalidValueError for an actuator that changes nothing along a whole motion.

    Parameters
    ----------
    model : CompiledModel
        With its structure, which names the reason.
    gain : ndarray, shape (n_t, n_states, n_actuators)
        Derivatives of the state's rate by the actuators' inputs.
    names : sequence of str
        Names of the actuators.
    """
    size = np.abs(gain).max(axis=(0, 1), initial=0.0)
    idle = np.flatnonzero(size <= NOTHING * size.max(initial=0.0))
    if not idle.size:
        return
    chosen = [names[int(k)] for k in idle]
    actuator = list_actuators(model, chosen)[0]
    reason = _find_reason(model, actuator)
    raise InvalidValueError(
        "an actuator has no effect",
        where=f"actuators.{chosen[0]}",
        given=", ".join(chosen),
        allowed="actuators that move the structure",
        hint=f"{reason}: remove it from the actuators",
    )


def _find_reason(model: CompiledModel, actuator: Actuator | None) -> str:
    structure = model.structure
    if actuator is None or structure is None:
        return "the accelerations do not depend on it"
    names = ", ".join(structure.member_name[e] for e in actuator.members)
    ends = structure.connectivity[list(actuator.members)]
    if _find_fixed(structure)[ends].all():
        return f"{names} connects points that cannot move"
    return f"{names} is slack during the whole motion, or its force has no component along a coordinate"


def _find_fixed(structure: Structure | BodySystem) -> NDArray[np.bool_]:
    """Return which nodes cannot move, (n_nodes,)."""
    if isinstance(structure, BodySystem):
        return np.array([isinstance(structure.bodies[k], FixedBody) for k in structure.node_body.tolist()])
    return np.asarray(structure.node_anchored[:, list(structure.axes)].all(axis=1))
