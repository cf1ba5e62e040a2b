"""What is wanted of a structure: quantities, run-time parameters, formulation and emitter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

__all__ = ["ModelRequest"]


@dataclass(frozen=True)
class ModelRequest:
    """The wanted functions and the choices that shape them, apart from the structure itself.

    parameters: argument name -> indices of the nodes or members that stay changeable at run time (gravity:
    an empty tuple); all else is baked in. integrators: names of integrators to emit.
    """

    quantities: tuple[str, ...]
    parameters: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    integrators: tuple[str, ...] = ()
    formulation: str = "node_position"
    emitter: str = "unrolled"

    def __post_init__(self) -> None:
        object.__setattr__(self, "quantities", tuple(dict.fromkeys(self.quantities)))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def wanting(
        self,
        *quantities: str,
        integrators: tuple[str, ...] = (),
        parameters: Mapping[str, tuple[int, ...]] | None = None,
    ) -> ModelRequest:
        """Return the request for just these functions, with some parameters added to the present ones."""
        return replace(
            self,
            quantities=quantities,
            integrators=integrators,
            parameters={**self.parameters, **(parameters or {})},
        )
