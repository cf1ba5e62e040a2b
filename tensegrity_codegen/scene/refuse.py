"""One way to refuse a key, and rows of a table: the first bad row in full, the others counted."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.names import key_path
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, name_list


def require(is_met: bool, problem: str, place: str, given: Any, allowed: str, hint: str = "") -> None:
    """Raise InvalidValueError about the key at a place unless a condition is met."""
    if not is_met:
        raise InvalidValueError(problem, where=place, given=given, allowed=allowed, hint=hint)


def refuse(
    bad: NDArray[np.bool_],
    error: type[SceneError],
    problem: str,
    *,
    section: str,
    names: Sequence[str],
    where: str,
    key: str = "",
    given: Any = None,
    allowed: str = "",
    hint: str = "",
) -> None:
    """Raise `error` for the first row that is `bad` (n_rows,), if any; the others are listed in `problem`.

    The place is "<where>: <section>.<names[row]>.<key>"; `given` holds one value a row, or is None.
    """
    rows = np.flatnonzero(bad)
    if not rows.size:
        return
    repeats = f" (also in {name_list(names[row] for row in rows[1:])})" if rows.size > 1 else ""
    value = None if given is None else given[rows[0]]
    location = key_path(where, section, names[rows[0]], key)
    value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    raise error(problem + repeats, where=location, given=value, allowed=allowed, hint=hint)
