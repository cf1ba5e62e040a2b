"""Explicit Runge-Kutta methods, one file each: a module here that holds a TABLEAU is a method of its name.

Everything that is known of a method stands in its `Tableau`; integrators in C, the methods of `simulate` and
batches, scene files and documentation read it from here.
"""

import pkgutil
from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType

from tensegrity_codegen.tables.tableaus.tableau import Tableau


def _find_tableaus() -> Mapping[str, Tableau]:
    """Return the tableau of every module of this package that holds one, by the name of the module."""
    modules = {name: import_module(f"{__name__}.{name}") for _, name, _ in pkgutil.iter_modules(__path__)}
    return MappingProxyType(
        {name: module.TABLEAU for name, module in sorted(modules.items()) if hasattr(module, "TABLEAU")}
    )


EXPLICIT = _find_tableaus()
TABLEAUS = MappingProxyType({name: table for name, table in EXPLICIT.items() if table.errors})
