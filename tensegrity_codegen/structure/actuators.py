"""Actuators with rate, range and delay; sensors with noise."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from tensegrity_codegen.tables.manifest import MOTOR_END

SensorKind: TypeAlias = Literal[
    "member_length", "member_tension", "node_position", "node_velocity", "angular_velocity"
]

MEMBER_SENSORS: tuple[SensorKind, ...] = ("member_length", "member_tension")
NODE_SENSORS: tuple[SensorKind, ...] = ("node_position", "node_velocity")
BODY_SENSORS: tuple[SensorKind, ...] = ("angular_velocity",)
UNLIMITED = (0.0, math.inf)  # the range of an actuator that has none
REST_LENGTH_KINDS = ("rest_length", "temperature")  # kinds of inputs that change rest lengths


class RestLengthGains:
    """Rest lengths that an input changes; shared by the inputs of structures and of body systems."""

    kind: str
    targets: tuple[int, ...]
    gain: tuple[float, ...]

    @property
    def rest_length_gain(self) -> dict[int, float]:
        """Change of the rest length for one unit of the input [1, m/K], by member; empty for forces."""
        gain_of: dict[int, float] = {}
        gains = self.gain or (1.0,) * len(self.targets)
        for e, gain in zip(self.targets, gains, strict=True) if self.kind in REST_LENGTH_KINDS else ():
            gain_of[e] = gain_of.get(e, 0.0) + gain  # a member that is listed twice
        return gain_of


@dataclass(frozen=True)
class Actuator:
    """An input of kind ``rest_length``, with what its motor can do.

    The input of the same name in ``structure.inputs`` adds its value u [m] to the rest length of each member
    of the actuator; the inputs of the actuators are the last ones, in the order of the actuators.

    Attributes
    ----------
    name : str
        Name of the actuator and of its input.
    members : tuple of int
        Indices of the members.
    rate : float [m/s]
        Largest rate of the rest lengths, in both directions; infinite without a limit.
    range : tuple of float, shape (2,) [m]
        Least and largest rest length of each of its members; (0, infinity) without a limit.
    delay : float [s]
        Time from the command to the motion, in feedback.
    time_constant : float [s]
        Time constant tau of the motor in motions, u' = clip((command - u) / tau, -rate, rate), with the input
        for the command and u an internal state; 0: u is the input.
    """

    name: str
    members: tuple[int, ...]
    rate: float = math.inf
    range: tuple[float, float] = UNLIMITED
    delay: float = 0.0
    time_constant: float = 0.0

    @property
    def has_rate(self) -> bool:
        """Whether its rate has a limit."""
        return math.isfinite(self.rate)

    @property
    def state_name(self) -> str:
        """Name of its internal state."""
        return f"{self.name}{MOTOR_END}"


@dataclass(frozen=True)
class Sensor:
    """A measurement of members or nodes.

    Attributes
    ----------
    kind : str
        ``"member_length"`` [m], ``"member_tension"`` [N], ``"node_position"`` [m], ``"node_velocity"``
        [m/s], or ``"angular_velocity"`` [rad/s], a gyro in the axes of its body.
    targets : tuple of int
        Indices of members, of nodes, or of bodies.
    noise : float
        Standard deviation of each measured number, in the unit of the kind.
    name : str
        Name of the sensor, ``""`` without one.
    """

    kind: SensorKind
    targets: tuple[int, ...]
    noise: float = 0.0
    name: str = ""
