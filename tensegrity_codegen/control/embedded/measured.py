"""Measured numbers of a controller in C: which result of the model each one is."""

from dataclasses import dataclass

from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.tables.manifest import Manifest


@dataclass(frozen=True)
class MeasuredNumber:
    """One measured number.

    Attributes
    ----------
    source : str
        A quantity of the model, ``"coordinate"``, ``"velocity"``, or ``""`` for a constant.
    index : int
        Place in the source.
    value : float
        The constant.
    is_length : bool
        Whether it is a length, above 0.
    """

    source: str
    index: int = 0
    value: float = 0.0
    is_length: bool = False


def find_measured(sensors: tuple[Sensor, ...], manifest: Manifest) -> tuple[MeasuredNumber, ...]:
    """Return the numbers that sensors measure, in their order."""
    return tuple(number for sensor in sensors for number in _measure(sensor, manifest))


def _measure(sensor: Sensor, manifest: Manifest) -> list[MeasuredNumber]:
    if sensor.kind in ("member_length", "member_tension"):
        is_length = sensor.kind == "member_length"
        return [MeasuredNumber(sensor.kind, e, is_length=is_length) for e in sensor.targets]
    axes, places = manifest.axes, [tuple(row) for row in manifest.coordinate_node_axis]
    moves = sensor.kind == "node_velocity"
    found = []
    for node in sensor.targets:
        for column, axis in enumerate(axes):
            if not places:
                found.append(MeasuredNumber(sensor.kind, node * len(axes) + column))
            elif (node, axis) in places:
                source = "velocity" if moves else "coordinate"
                found.append(MeasuredNumber(source, places.index((node, axis))))
            else:
                value = 0.0 if moves else float(manifest.stated_position[node, axis])
                found.append(MeasuredNumber("", value=value))
    return found
