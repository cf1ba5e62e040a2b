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
    names = [info.name for info in pkgutil.iter_modules(analyses.__path__) if not info.ispkg]
    imported = [import_module(f"{analyses.__name__}.{module}").ANALYSIS for module in sorted(names)]
    records = [record for record in imported if issubclass(record, CaseAnalysis)]
    return MappingProxyType({record.name: record for record in records})


ANALYSES = _import_analyses()


def build_analysis(do: str, keep: str | Sequence[str] = (), **options: Any) -> CaseAnalysis:
    """Return an operation with the results to keep; an empty `keep`, or an option None, is the default."""
    check_choice(do, ANALYSES, "operation", "do")
    kind = ANALYSES[do]
    texts = _list_texts(keep)
    types = {option.name: option.kind for option in kind.list_sweep_options()}
    valid_names = list(types)
    stated = {name: value for name, value in options.items() if value is not None}
    for name, value in stated.items():
        if name not in valid_names:
            raise UnknownKeyError(
                f"the operation {do!r} has no such option",
                where="sweep",
                given=name,
                allowed=", ".join(valid_names) or "no options",
                hint=suggest(name, valid_names),
            )
        stated[name] = _read_option(name, value, types[name])
    return kind(keep=texts, **stated)


def _list_texts(keep: Any) -> tuple[str, ...]:
    """Return the texts of `keep` as a tuple, empty for None."""
    texts = (keep,) if isinstance(keep, str) or not isinstance(keep, Iterable) else tuple(keep)
    if keep is None:
        return ()
    if not all(isinstance(entry, str) for entry in texts):
        raise InvalidValueError(
            "not a text", where="keep", given=keep, allowed="texts such as member_tension"
        )
    return texts


def _read_option(name: str, value: Any, kind: type) -> Any:
    """Return an option, as a number if its field is one; raises InvalidValueError."""
    if kind not in (int, float):
        return value
    is_whole = kind is int
    if isinstance(value, Integral) and not isinstance(value, bool):
        return int(value) if is_whole else float(value)
    if isinstance(value, Real) and not (is_whole or isinstance(value, bool)):
        return float(value)
    expected = "a whole number" if is_whole else "a number"
    raise InvalidValueError(f"not {expected}", where=name, given=value, allowed=expected)
