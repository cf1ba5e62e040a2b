"""The status of a generated function, as an error."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.errors import LibraryError, NonFiniteError
from tensegrity_codegen.tables.manifest import STATUS


def raise_for_status(status: int, where: str, arguments: Mapping[str, NDArray[Any]]) -> None:
    """Raise the error that a non-zero status stands for, naming the argument and entry at fault."""
    word = STATUS[status] if 0 <= status < len(STATUS) else f"status {status}"
    if word == "non_finite_input":
        for name, array in arguments.items():
            bad = np.argwhere(~np.isfinite(array))
            if bad.size:
                place = tuple(int(k) for k in bad[0])
                raise NonFiniteError(
                    f"argument {name!r} is not finite at {place}",
                    where=where,
                    given=float(array[place]),
                    allowed="finite numbers",
                )
    if word == "non_finite_result":
        raise NonFiniteError(
            "the result is not finite",
            where=where,
            hint="look for nodes that coincide, a rest length or mass of zero, or an overflow",
        )
    raise LibraryError(f"the library returned the status {word!r}", where=where)
