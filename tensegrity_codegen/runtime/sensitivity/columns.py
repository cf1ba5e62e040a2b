"""Which changes of rest lengths the columns of a sensitivity stand for: members, or groups of members."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import sparse

from tensegrity_codegen.errors import DuplicateNameError, InvalidValueError, check_choice

__all__ = ["Columns", "select_columns"]

Columns = Sequence[str] | Mapping[str, Sequence[str]]


def select_columns(member_name: Sequence[str], columns: Columns | None) -> tuple[tuple[str, ...], Any]:
    """Return names of columns, and which members each of them changes.

    Parameters
    ----------
    member_name : sequence of str
        Names of all members.
    columns : sequence or mapping, optional
        Members; or name of an actuator -> its members; by default all members.

    Returns
    -------
    name : tuple of str
        Name of each column.
    matrix : sparse array, shape (n_members, n_columns)
        One where the column changes the rest length of the member.

    Raises
    ------
    UnknownNameError
        No member of that name.
    InvalidValueError
        No columns, or an actuator without members.
    DuplicateNameError
        A column, or a member of an actuator, given twice.
    """
    if columns is None:
        return tuple(member_name), sparse.eye_array(len(member_name), format="csc")
    if isinstance(columns, str):
        columns = (columns,)
    groups = {k: _names(v) for k, v in columns.items()} if isinstance(columns, Mapping) else None
    names = tuple(columns)
    if not names:
        raise InvalidValueError(
            "no columns are chosen", where="columns", given=columns, allowed="one or more members",
            hint="None stands for all members",
        )  # fmt: skip
    _check_distinct(names, "columns")
    known, rows, places = {name: k for k, name in enumerate(member_name)}, list[int](), list[int]()
    for place, name in enumerate(names):
        members = (name,) if groups is None else groups[name]
        where = "columns" if groups is None else f"columns.{name}"
        if not members:
            raise InvalidValueError("an actuator without members", where=where, allowed="one or more members")
        _check_distinct(members, where)
        for member in members:
            check_choice(member, known, "member", where)
            rows.append(known[member])
            places.append(place)
    matrix = sparse.csc_array((np.ones(len(rows)), (rows, places)), shape=(len(member_name), len(names)))
    return names, matrix


def _names(given: Sequence[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def _check_distinct(names: Sequence[str], where: str) -> None:
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise DuplicateNameError("given twice", where=where, given=twice[0], allowed="each name once")
