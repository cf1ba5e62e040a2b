"""Names of the methods that find an equilibrium."""

from typing import Literal, get_args

Method = Literal["auto", "newton", "relaxation"]
METHODS: tuple[str, ...] = get_args(Method)
