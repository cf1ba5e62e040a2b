"""Names of the methods that find an equilibrium."""

from __future__ import annotations

from typing import Literal, get_args

__all__ = ["METHODS", "Method"]

Method = Literal["auto", "newton", "relaxation"]
METHODS: tuple[str, ...] = get_args(Method)
