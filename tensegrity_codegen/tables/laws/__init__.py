"""Member laws: one file a law, and the list of them."""

from collections.abc import Callable
from typing import Any

from tensegrity_codegen.tables.laws.bilinear import Bilinear
from tensegrity_codegen.tables.laws.law import Law
from tensegrity_codegen.tables.laws.plastic import Plastic
from tensegrity_codegen.tables.laws.viscous import Viscous

LINEAR = Law()
LAWS: tuple[Law, ...] = (LINEAR, Bilinear(), Plastic(), Viscous())

LAW_PARAMETERS = tuple(parameter.name for law in LAWS for parameter in law.parameters)

# Values of a member that a law takes, in the order of kernels.
MEMBER_VALUES = ("spring_constant", "axial_stiffness", "rest_length", "damping", *LAW_PARAMETERS)


def find_law(has: Callable[[str], Any]) -> Law:
    """Return the law of a member; has: whether it has a parameter, by name."""
    return next((law for law in LAWS if law.parameters and has(law.parameters[0].name)), LINEAR)
