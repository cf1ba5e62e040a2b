"""Frozen dataclasses with read-only views of dicts, which pickle by itself refuses."""

from dataclasses import fields
from types import MappingProxyType
from typing import Any


def reduce_fields(instance: Any) -> tuple[Any, ...]:
    """Return the value of `__reduce__` of a frozen dataclass, which is made again from its fields."""
    values = {field.name: getattr(instance, field.name) for field in fields(instance)}
    plain = {
        name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in values.items()
    }
    return _build_again, (type(instance), plain)


def _build_again(kind: type, values: dict[str, Any]) -> Any:
    return kind(**values)
