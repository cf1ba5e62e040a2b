"""Analyses of many cases by their names, as `sweep --do` has them: a module of `analyses/` each."""

import pkgutil
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

from tensegrity_codegen import analyses
from tensegrity_codegen.analyses.cases.record import CaseAnalysis
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError, check_choice, suggest


def _import_analyses() -> Mapping[str, type[CaseAnalysis]]:
    """Return the records of the modules of `analyses/` that serve many cases."""
    modules = [item.name for item in pkgutil.iter_modules(analyses.__path__) if not item.ispkg]
    imported = [import_module(f"{analyses.__name__}.{module}").ANALYSIS for module in sorted(modules)]
    records = [record for record in imported if issubclass(record, CaseAnalysis)]
    return MappingProxyType({record.name: record for record in records})


ANALYSES = _import_analyses()


def build_analysis(do: str, keep: str | Sequence[str] = (), **options: Any) -> CaseAnalysis:
    """Return an operation.

    do: one of ANALYSES; keep: what is kept of each case; empty for the usual results of the operation;
    **options: options that this operation has; None for those at their defaults.
    Raises UnknownNameError, UnknownKeyError: an unknown operation, or an option that it does not have;
    InvalidValueError: something else than texts is to be kept, or an option that needs a number is none.
    """
    check_choice(do, ANALYSES, "operation", "do")
    kind = ANALYSES[do]
    texts = _list_texts(keep)
    types = {item.name: item.kind for item in kind.list_sweep_options()}
    known = list(types)
    stated = {name: value for name, value in options.items() if value is not None}
    for name, value in stated.items():
        if name not in known:
            raise UnknownKeyError(
                f"the operation {do!r} has no such option",
                where="sweep",
                given=name,
                allowed=", ".join(known) or "no options",
                hint=suggest(name, known),
            )
        stated[name] = _read_option(name, value, types[name])
    return kind(keep=texts, **stated)


def _list_texts(keep: Any) -> tuple[str, ...]:
    """Return what is to be kept as a tuple; None for nothing stated."""
    texts = (keep,) if isinstance(keep, str) or not isinstance(keep, Iterable) else tuple(keep)
    if keep is None:
        return ()
    if not all(isinstance(text, str) for text in texts):
        raise InvalidValueError(
            "not a text", where="keep", given=keep, allowed="texts such as member_tension"
        )
    return texts


def _read_option(name: str, value: Any, kind: type) -> Any:
    """Return an option, a number where its field is one; raises InvalidValueError."""
    if kind not in (int, float):
        return value
    is_whole = kind is int
    if isinstance(value, Integral) and not isinstance(value, bool):
        return int(value) if is_whole else float(value)
    if isinstance(value, Real) and not (is_whole or isinstance(value, bool)):
        return float(value)
    words = "a whole number" if is_whole else "a number"
    raise InvalidValueError(f"not {words}", where=name, given=value, allowed=words)
