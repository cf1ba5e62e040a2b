"""Freezing: dataclasses whose arrays nobody can write to."""

from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np


def freeze_fields(instance: Any) -> None:
    """Replace arrays of a frozen dataclass by read-only copies in C order, dicts by read-only views."""
    for field in fields(instance):
        value = getattr(instance, field.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(instance, field.name, _freeze(value))
        elif isinstance(value, dict):
            frozen = {key: _freeze(entry) for key, entry in value.items()}
            object.__setattr__(instance, field.name, MappingProxyType(frozen))


def _freeze(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    frozen = np.array(value, order="C")
    frozen.flags.writeable = False
    return frozen
