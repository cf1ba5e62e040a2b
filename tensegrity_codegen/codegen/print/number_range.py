"""The range of a precision, and whether a structure's own numbers fit into it."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.precision import Precision, check_precision

OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius")


def check_number_range(structure: Structure | BodySystem, precision: Precision) -> None:
    """Raise InvalidValueError for a number that the precision cannot hold, naming it and whose it is."""
    for item in dataclasses.fields(structure):
        names = structure.node_name if item.name.startswith("node_") else structure.member_name
        named = item.name in OF_MEMBERS or item.name.startswith("node_")
        for index, value in _numbers(getattr(structure, item.name)):
            owner = names[index[0]] if named else ".".join(map(str, index))
            check_precision(value, precision, f"{structure.name}: {item.name} of {owner}")


def _numbers(value: Any, index: tuple[int | str, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Give every number of more than 1 in arrays and containers, with the way that leads to it."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        for place in np.argwhere(np.abs(value) > 1.0):
            yield (*index, *map(int, place)), float(value[tuple(place)])
    elif isinstance(value, float):
        yield index, value
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from _numbers(part, (*index, key))
    elif isinstance(value, tuple):
        for number, part in enumerate(value):
            yield from _numbers(part, (*index, number))
    elif dataclasses.is_dataclass(value):
        for item in dataclasses.fields(value):
            yield from _numbers(getattr(value, item.name), (*index, item.name))
