"""Memory of members at rest: the internal states that they come from, and those behind their way."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.arrays import check_finite, to_sized
from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import name_list
from tensegrity_codegen.tables.manifest import MOTOR_END, SET_STATES, VISCOUS_WORK

# Quantities that take members along a straight way from the internal states, not as these say they are.
ALONG_THE_WAY = (
    *("node_residual", "spring_tension", "tangent_stiffness", "material_stiffness", "geometric_stiffness"),
    *("potential_energy", "elastic_energy", "residual_rest_length_jacobian"),
    *("yield_margin", "settled_internal", "plastic_elongation"),
)
REST_QUANTITIES = ("settled_internal", "yield_margin", "plastic_elongation")  # that statics need besides
RING_QUANTITIES = ("ring_excess",)  # of cables with friction at rings
RELAXED_QUANTITIES = ("relaxed_internal",)  # the same of viscous members
ROUNDING = 1e-13  # of the largest flow
MAX_SHOWN = 6


class RestMemory:
    """Internal states of members with memory, and of motors with a lag, at rest.

    start (n_internal,): states that the members come from, nothing flowing: those of the argument
    ``internal``, until `turn` has members remember.
    """

    def __init__(self, model: Model, arguments: Mapping[str, Any]) -> None:
        names = model.manifest.internal_name
        nominal = model.nominal("internal")
        states = to_sized(arguments.get("internal", nominal), nominal.shape, "internal")
        check_finite(states, "internal", "the internal states are not finite")
        flags = tuple(f"_{flag}" for flag in SET_STATES.values())
        self.model, self.begun = model, np.where([name.endswith(flags) for name in names], 0.0, states)
        # Motors, which are at their commands at rest: internal state and input of each
        inputs = model.manifest.input_name
        self.motors = [(names.index(f"{m}{MOTOR_END}"), inputs.index(m)) for m in model.manifest.motor_name]
        self.start: FloatArray = self.begun
        # Flow of each member, whose plastic elongation stands before it.
        self.viscous = [k for k, name in enumerate(names) if name.endswith("_viscous")]
        self.flow = np.array([k for k, name in enumerate(names) if name.endswith("_accumulated")], dtype=int)
        self.members = bool(self.viscous) or bool(self.flow.size)  # whether members have memory

    def begin(self) -> None:
        """Forget all but the states that were given."""
        self.start = self.begun

    def settle(self, given: Mapping[str, Any]) -> FloatArray:
        """Return the states behind the way from `start` to these arguments, coordinates among them."""
        start = self._put_motors(self.start, given)
        quantity = "relaxed_internal" if self.viscous else "settled_internal" if len(self.flow) else ""
        return np.array(self.model.compute(quantity, **{**given, "internal": start})) if quantity else start

    def choose(self, quantity: str, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments of a quantity with its internal states."""
        states = self._put_motors(self.start, given)
        if quantity not in ALONG_THE_WAY:
            states = self.settle(given)
        elif self.viscous:  # which have forgotten the way
            states = states.copy()
            states[self.viscous] = self.settle(given)[self.viscous]
        return {**given, "internal": states}

    def _put_motors(self, states: FloatArray, given: Mapping[str, Any]) -> FloatArray:
        """Return states with motors at their commands."""
        if not self.motors:
            return states
        command = np.asarray(given.get("input", self.model.nominal("input")), dtype=np.float64).reshape(-1)
        states = states.copy()
        for k, column in self.motors:
            states[k] = command[column]
        return states

    def find_turned(self, here: FloatArray, behind: FloatArray, ahead: FloatArray) -> BoolArray:
        """Return which members (n_plastic,) have flowed up to here and flow back ahead of it."""
        flow = self.flow
        size = ROUNDING * float(np.abs(here[flow]).max(initial=0.0))
        has_flowed = here[flow] - self.start[flow] > size
        turned: BoolArray = has_flowed & (ahead[flow] - behind[flow] < -size)
        return turned

    def remember(self, turned: BoolArray, states: FloatArray) -> None:
        """Let these members (n_plastic,) come from settled states (n_internal,) from now on."""
        self.start = self.start.copy()
        for k in self.flow[turned]:
            self.start[k - 1 : k + 1] = states[k - 1 : k + 1]


def name_plastic(
    names: Sequence[str], internal: FloatArray | None, ends: str = "_plastic"
) -> dict[str, float]:
    """Return the plastic elongations [m], or other states with these ends of names, by member."""
    values = [] if internal is None else internal.tolist()
    return {
        name.removesuffix(ends): value
        for name, value in zip(names, values, strict=bool(values))
        if name.endswith(ends)
    }


def describe_plastic(elongation: Mapping[str, float]) -> list[str]:
    """Return a line on members that have flowed, the farthest first; none if none has."""
    flowed = sorted((entry for entry in elongation.items() if entry[1]), key=lambda entry: -abs(entry[1]))
    shown = name_list([f"{name} {value:.6g} m" for name, value in flowed], MAX_SHOWN)
    return [f"plastic elongations at the end: {shown}"] if flowed else []


def describe_slip(slid: Mapping[str, float]) -> list[str]:
    """Return a line on slips at rings, the most first; none if nothing has."""
    moved = sorted((entry for entry in slid.items() if entry[1]), key=lambda entry: -abs(entry[1]))
    shown = name_list([f"behind {name} {value:.6g} m" for name, value in moved], MAX_SHOWN)
    return [f"slipped through rings: {shown}"] if moved else []


def find_rest_memory(model: Model, arguments: Mapping[str, Any]) -> RestMemory | None:
    """Return the memory of a model's members and motors, None if they have none."""
    manifest = model.manifest
    remembers = manifest.subjects_of("yield") or VISCOUS_WORK in manifest.internal_name
    return RestMemory(model, arguments) if remembers or manifest.motor_name else None
