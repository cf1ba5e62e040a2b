"""The formulations: a module each, and their registry."""

from importlib import import_module
from pkgutil import iter_modules

from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations.formulation import Formulation


def _collect() -> dict[str, Formulation]:
    names = [module.name for module in iter_modules(__path__) if module.name != "formulation"]
    formulations = [import_module(f"{__name__}.{name}").FORMULATION for name in names]
    return {module.name: module for module in sorted(formulations, key=lambda module: module.order)}


FORMULATIONS = _collect()


def find_formulation(name: str) -> Formulation:
    """Return the formulation of that name; raises FormulationError, which lists the known ones."""
    if name not in FORMULATIONS:
        problem, allowed = "unknown formulation", ", ".join(FORMULATIONS)
        hint = suggest(name, FORMULATIONS)
        raise FormulationError(problem, where="model.formulation", given=name, allowed=allowed, hint=hint)
    return FORMULATIONS[name]


def choose_formulation(*, rigid_bars: bool) -> Formulation:
    """Return the formulation in node coordinates that finds equilibria, with or without rigid bars."""
    return next(
        formulation
        for formulation in FORMULATIONS.values()
        if formulation.in_nodes and formulation.has_statics and formulation.has_rigid_bars == rigid_bars
    )
