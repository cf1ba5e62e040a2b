"""Names of the methods that find an equilibrium, and of the status that says so."""

from typing import Literal, get_args

Method = Literal["auto", "newton", "relaxation"]
METHODS: tuple[str, ...] = get_args(Method)
FOUND = ("converged", "rounding_limited")  # status of searches that end in an equilibrium
