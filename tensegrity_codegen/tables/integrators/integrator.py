"""The record of one time integrator in C."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from tensegrity_codegen.tables.tableaus.tableau import Tableau

Kind = Literal["adaptive", "fixed", "implicit"]


@dataclass(frozen=True)
class Integrator:
    """The facts of one integrator, for generator, run time, exports and scene files.

    name: its name in scenes, in C and in methods of `simulate`. The C of one without a tableau is
        templates/c/NAME.h; see `kind`.
    kind: how it is called: with error control ("adaptive"), with a fixed step ("fixed"), or with error
        control and the tensions of stiff members as unknowns ("implicit"). A fixed one without tableau has
        the struct NAME_work and the function NAME_advance, as templates/c/rk4.h has; one with error control
        the struct NAME_memory, the functions NAME_try and NAME_prepare and the constants of
        templates/c/tableau.h.
    title: the name of the method.
    order: order of its steps.
    tableau: coefficients of an explicit Runge-Kutta method.
    quantities: quantities that it calls besides those of all integrators; with error control each one as the
        function motion_QUANTITY, its number of entries as N_QUANTITY.
    rates: with error control: how many vectors of the length of a state its steps keep.
    dense_order: with error control: order of its own dense output, and number of its terms; 0: quintic
        Hermite interpolation.
    noise_share, vibration_loss: with error control: as of a tableau.
    look: number of the colour, dash and marker of its line in diagrams of reports; tableaus have theirs
        there.
    counts: the counters of an implicit one, in the order of C.
    in_batches: whether it integrates several motions side by side.
    keeps_energy: whether its steps can end at the energy of the start.
    follows_events: whether its steps end at events, and follow values that change with time.
    in_single: whether it is there in single precision.
    files: names of its C files if it is not one called `name`; the last one's name stands for `name` in
        it.
    iterates: whether its steps iterate, count their evaluations, and know the derivative at their end.
    with_contacts: what this name stands for where nodes touch the ground, bars press each other or members
        remember, if not this.
    """

    name: str
    kind: Kind
    title: str
    order: int
    tableau: Tableau | None = None
    quantities: tuple[str, ...] = ()
    rates: int = 0
    dense_order: int = 0
    noise_share: float = 0.0
    vibration_loss: tuple[float, int] = (0.0, 0)
    look: tuple[int, Literal["line", "dashed", "dotted", "dashdot"], str] | None = None
    counts: tuple[str, ...] = ()
    in_batches: bool = False
    keeps_energy: bool = False
    follows_events: bool = True
    in_single: bool = True
    files: tuple[str, ...] = ()
    iterates: bool = False
    with_contacts: Integrator | None = None

    @property
    def c_files(self) -> tuple[str, ...]:
        """Names of the files in templates/c/ of one without a tableau."""
        return self.files or (self.name,)

    @property
    def dense_title(self) -> str:
        """The name of its dense output."""
        order = self.dense_order
        return f"a polynomial of order {order}" if order else "quintic Hermite interpolation"

    @property
    def has_step_control(self) -> bool:
        """Whether it chooses its steps by an error estimate."""
        return self.kind != "fixed"
