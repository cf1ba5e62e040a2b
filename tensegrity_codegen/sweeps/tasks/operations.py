"""The operations of a sweep by their names, as `do` names them."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral, Real
from types import MappingProxyType
from typing import Any

from tensegrity_codegen.sweeps.tasks.equilibrium import FindEquilibrium
from tensegrity_codegen.sweeps.tasks.evaluate import Evaluate
from tensegrity_codegen.sweeps.tasks.linearize import Linearize
from tensegrity_codegen.sweeps.tasks.operation import Operation
from tensegrity_codegen.sweeps.tasks.simulate import Simulate
from tensegrity_codegen.system.errors import InvalidValueError, UnknownKeyError, check_choice, suggest

OPERATIONS: Mapping[str, type[Operation]] = MappingProxyType(
    {kind.name: kind for kind in (Simulate, FindEquilibrium, Linearize, Evaluate)}
)


def build_operation(do: str, keep: str | Sequence[str] = (), **options: Any) -> Operation:
    """Return an operation.

    Parameters
    ----------
    do : str
        One of OPERATIONS.
    keep : str or sequence of str
        What is kept of each case; empty for the usual results of the operation.
    **options : object
        Options that this operation has; None for those at their defaults.

    Returns
    -------
    Operation
        Frozen; can be pickled.

    Raises
    ------
    UnknownNameError, UnknownKeyError
        An unknown operation, or an option that it does not have.
    InvalidValueError
        Something else than texts is to be kept, or an option that needs a number is none.
    """
    check_choice(do, OPERATIONS, "operation", "do")
    kind = OPERATIONS[do]
    texts = _list_texts(keep)
    fields = [item for item in dataclasses.fields(kind) if item.name != "keep"]
    types = {item.name: getattr(item.type, "__name__", str(item.type)) for item in fields}
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


def _read_option(name: str, value: Any, declared: str) -> Any:
    """Return an option, a number where the annotation of its field says so; raises InvalidValueError."""
    if not declared.startswith(("int", "float")):
        return value
    is_whole = declared.startswith("int")
    if isinstance(value, Integral) and not isinstance(value, bool):
        return int(value) if is_whole else float(value)
    if isinstance(value, Real) and not (is_whole or isinstance(value, bool)):
        return float(value)
    words = "a whole number" if is_whole else "a number"
    raise InvalidValueError(f"not {words}", where=name, given=value, allowed=words)
