"""The record of one time integrator in C."""

from dataclasses import dataclass
from typing import Literal

from tensegrity_codegen.tables.tableaus.tableau import Tableau

Kind = Literal["adaptive", "fixed", "implicit"]


@dataclass(frozen=True)
class Integrator:
    """What generator, run time, exports and scene files know of one integrator.

    Attributes
    ----------
    name : str
        Its name in scenes, in C and in methods of `simulate`. The C of one without a tableau is
        templates/c/NAME.h; see `kind`.
    kind : str
        How it is called: with error control ("adaptive"), with a fixed step ("fixed"), or with error control
        and the tensions of stiff members as unknowns ("implicit"). A fixed one without tableau has the struct
        NAME_work and the function NAME_advance, as templates/c/rk4.h has.
    title : str
        What the method is.
    order : int
        Order of its steps.
    tableau : Tableau, optional
        Coefficients of an explicit Runge-Kutta method.
    quantities : tuple of str
        Quantities that it calls besides those of all integrators.
    in_batches : bool
        Whether it integrates several motions side by side.
    keeps_energy : bool
        Whether its steps can end at the energy of the start.
    follows_events : bool
        Whether its steps end at events, and follow values that change with time.
    in_single : bool
        Whether it is there in single precision.
    """

    name: str
    kind: Kind
    title: str
    order: int
    tableau: Tableau | None = None
    quantities: tuple[str, ...] = ()
    in_batches: bool = False
    keeps_energy: bool = False
    follows_events: bool = True
    in_single: bool = True

    @property
    def has_step_control(self) -> bool:
        """Whether it chooses its steps by an error estimate."""
        return self.kind != "fixed"
