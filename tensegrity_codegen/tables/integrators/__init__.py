"""Time integrators in C: one for each tableau, and a module here for each other one, with its INTEGRATOR.

Everything that is known of one stands in its record; the generator, the methods of `simulate`, exports,
scene files and documentation read it from here.
"""

import pkgutil
from collections.abc import Iterable, Mapping
from importlib import import_module
from types import MappingProxyType

from tensegrity_codegen.tables.integrators.integrator import Integrator
from tensegrity_codegen.tables.tableaus import EXPLICIT
from tensegrity_codegen.tables.tableaus.tableau import Tableau


def _from_tableau(name: str, table: Tableau) -> Integrator:
    return Integrator(
        name,
        "adaptive" if table.errors else "fixed",
        table.title,
        table.order,
        table,
        rates=table.rates,
        dense_order=table.dense_order if table.dense else 0,
        noise_share=table.noise_share,
        vibration_loss=table.vibration_loss,
        in_batches=True,
        keeps_energy=bool(table.errors),
    )


def _find_integrators() -> Mapping[str, Integrator]:
    names = sorted(entry.name for entry in pkgutil.iter_modules(__path__) if entry.name != "integrator")
    with_file = [import_module(f"{__name__}.{name}").INTEGRATOR for name in names]
    integrators = [*(_from_tableau(*entry) for entry in EXPLICIT.items()), *with_file]
    return MappingProxyType({entry.name: entry for entry in integrators})


INTEGRATORS = _find_integrators()

# The one for stiff members, which `auto` weighs against explicit ones.
STIFF_INTEGRATOR = next(name for name, item in INTEGRATORS.items() if item.kind == "implicit")
# The one with error control whose steps solve linear systems with the Jacobian, for much damping.
DAMPED_INTEGRATOR = next(
    name
    for name, item in INTEGRATORS.items()
    if item.kind == "adaptive" and "state_jacobian" in item.quantities
)


def find_row(name: str, needs_state_jacobian: bool) -> Integrator:
    """Return the record of an integrator, as it is for structures with or without contacts or memory."""
    row = INTEGRATORS[name]
    return row.with_contacts if needs_state_jacobian and row.with_contacts else row


def called_quantities(names: Iterable[str], needs_state_jacobian: bool) -> list[str]:
    """Return the quantities that these integrators call besides those that all do, each once."""
    rows = [find_row(name, needs_state_jacobian) for name in names if name in INTEGRATORS]
    return list(dict.fromkeys(quantity for row in rows for quantity in row.quantities))
