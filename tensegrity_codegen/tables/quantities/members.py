"""Quantities of single members: each record has all that is known of one.

A record has the row of the table of quantities, the entries of one member as a function of it, the name of
the kernel that computes them in C, and the values that members need. Formulations, emitters, the loops over
tables and the documentation read it from here: to add a quantity, add a record.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import FormulationError, name_list
from tensegrity_codegen.tables.quantities.quantity import Quantity

Scalar = Any  # an expression
Mask = Callable[[Any], NDArray[np.bool_]]  # of the members of a structure or body system


@dataclass(frozen=True)
class MemberQuantity:
    """One quantity with a result for each member.

    row: name, symbol, unit, shape and sentence.
    kernel: name of the C function that computes the result of one member.
    entries: member -> its result, a list of one entry, or of one for each axis. The member is a `Member` or
        has the same attributes.
    follows_tension: whether it depends on the tension, which is a multiplier in rigid bars: loops over tables
        do not serve it there.
    needs_section, needs_stiffness: structure -> (n_members,) mask of the members that need a section, or a
        stiffness.
    """

    row: Quantity
    kernel: str
    entries: Callable[[Any], list[Scalar]]
    follows_tension: bool = False
    needs_section: Mask | None = None
    needs_stiffness: Mask | None = None

    @property
    def name(self) -> str:
        """Name of the quantity."""
        return self.row.name

    @property
    def is_vector(self) -> bool:
        """Whether the result has one entry for each axis."""
        return len(self.row.shape) == 2


def check_values(quantity: MemberQuantity, subject: Any) -> None:
    """Raise FormulationError if members of a structure or body system lack a need of a quantity."""
    needs = (
        (quantity.needs_section, subject.radius > 0, "section", "radius [m]"),
        (
            quantity.needs_stiffness,
            subject.mu > 0,
            "stiffness",
            "axial_stiffness [N] or spring_constant [N/m]",
        ),
    )
    for find, has, noun, key in needs:
        lacking = np.flatnonzero(find(subject) & ~has) if find is not None else ()
        if len(lacking):
            names = name_list([subject.member_name[e] for e in lacking], 3)
            problem = f"the quantity {quantity.name!r} needs the {noun} of members that have none"
            location = f"{subject.name}: model.quantities"
            value = f"{names} without {key.split()[0]}"
            allowed = f"{key} of each member that the quantity needs"
            hint = f"give {key} to these members or to their class"
            raise FormulationError(problem, where=location, given=value, allowed=allowed, hint=hint)


MAX_MARGIN = 1e6


def _compute_buckling_margin(member: Any) -> Scalar:
    """Return P / max(-t, P / 1e6), with P = pi^2 EA i^2 / l^2 and the radius of gyration i."""
    if member.tension_only:
        return MAX_MARGIN
    load = np.pi**2 * member.axial_stiffness * member.gyration_square / (member.length * member.length)
    return load / member.fmax(-member.tension, load / MAX_MARGIN)


MEMBER_QUANTITIES = (
    MemberQuantity(
        Quantity("member_vector", "d", "m", ("n_members", "n_axes"), "Member vectors d_e = r_i - r_j."),
        kernel="vector",
        entries=lambda m: m.vector,
    ),
    MemberQuantity(
        Quantity("member_length", "l", "m", ("n_members",), "Member lengths l_e = |d_e|."),
        kernel="length",
        entries=lambda m: [m.plain_length],
    ),
    MemberQuantity(
        Quantity(
            "member_tension", "t", "N", ("n_members",),
            "Member tensions t_e = mu_e (l_e - rho_e) + c_e l_e', positive in tension; zero in slack cables.",
        ),
        kernel="tension",
        entries=lambda m: [m.tension],
        follows_tension=True,
    ),
    MemberQuantity(
        Quantity("force_density", "t/l", "N/m", ("n_members",), "Force densities t_e / l_e."),
        kernel="density",
        entries=lambda m: [m.density],
        follows_tension=True,
    ),
    MemberQuantity(
        Quantity(
            "member_extension", "l - rho", "m", ("n_members",),
            "Extensions l_e - rho_e of members; negative in slack cables.",
        ),
        kernel="extension",
        entries=lambda m: [m.extension],
    ),
    MemberQuantity(
        Quantity(
            "tension_rest_length_derivative", "dt/drho", "N/m", ("n_members",),
            "Derivative of each member tension to the member's own rest length at constant node positions; "
            "zero in slack cables and in rigid bars, whose tensions are multipliers.",
        ),
        kernel="rest_slope",
        entries=lambda m: [m.tension_by_rest_length],
    ),
    MemberQuantity(
        Quantity(
            "member_stress", "sigma", "Pa", ("n_members",),
            "Axial stresses t_e / A_e of members with section A_e, positive in tension.",
            "Strength of materials",
        ),
        kernel="stress",
        entries=lambda m: [m.tension / m.section_area],
        follows_tension=True,
        needs_section=lambda subject: np.ones(len(subject.member_name), dtype=np.bool_),
    ),
    MemberQuantity(
        Quantity(
            "buckling_margin", "P_E / -t", "1", ("n_members",),
            "Euler's buckling load pi^2 E_e I_e / l_e^2 of pinned ends over the compression; below 1 the "
            "member buckles. At most 1e6, also in tension and in cables.",
            "Euler",
        ),
        kernel="buckling",
        entries=lambda m: [_compute_buckling_margin(m)],
        follows_tension=True,
        needs_section=lambda subject: ~subject.tension_only,
        needs_stiffness=lambda subject: ~subject.tension_only,
    ),
)  # fmt: skip

MEMBERS = tuple(quantity.row for quantity in MEMBER_QUANTITIES)
