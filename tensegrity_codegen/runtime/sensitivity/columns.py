"""Columns of a sensitivity: changes of rest lengths by members, inputs or groups."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.checks import check_names
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, check_choice

Columns = Sequence[str] | Mapping[str, Sequence[str]]


def select_columns(model: Model, columns: Columns | None) -> tuple[tuple[str, ...], Any]:
    """Return names of columns, and which members each of them changes.

    model: its members; and its inputs of kind rest_length, where it knows its structure; columns: members and
    inputs; or name of a group -> its members; by default all members.
    Returns name: name of each column; matrix (n_members, n_columns): change of the rest length of the member
    for one unit of the column: one, or the gain of an input. Raises UnknownNameError: no member or input of
    that name; InvalidValueError: no columns, or a group without members; DuplicateNameError: a column, or a
    member of a group, given twice.
    """
    member_name = model.manifest.member_name
    if columns is None:
        return tuple(member_name), scipy.sparse.eye_array(len(member_name), format="csc")
    names = check_names(columns, "columns")
    if not names:
        raise InvalidValueError(
            "no columns are chosen", where="columns", given=columns, allowed="one or more members or inputs",
            hint="None stands for all members",
        )  # fmt: skip
    _check_distinct(names, "columns")
    if isinstance(columns, Mapping):
        gains = [dict.fromkeys(_find_group(name, columns[name], member_name), 1.0) for name in names]
    else:
        structure = getattr(model, "structure", None)
        inputs = () if structure is None else structure.inputs
        known = {item.name: gain for item in inputs if (gain := item.rest_length_gain)}
        known |= {name: {e: 1.0} for e, name in enumerate(member_name)}
        for name in names:
            check_choice(name, known, "member or input", "columns")
        gains = [known[name] for name in names]
    rows = np.concatenate([np.array(list(item), dtype=np.int64) for item in gains])
    values = np.concatenate([np.array(list(item.values())) for item in gains])
    places = np.repeat(np.arange(len(names)), [len(item) for item in gains])
    shape = (len(member_name), len(names))
    return names, scipy.sparse.csc_array((values, (rows, places)), shape=shape)


def _find_group(name: str, given: Sequence[str], member_name: Sequence[str]) -> tuple[int, ...]:
    where = f"columns.{name}"
    members = check_names(given, where)
    if not members:
        raise InvalidValueError("a group without members", where=where, allowed="one or more members")
    _check_distinct(members, where)
    for member in members:
        check_choice(member, member_name, "member", where)
    return tuple(member_name.index(member) for member in members)


def _check_distinct(names: Sequence[str], where: str) -> None:
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise DuplicateNameError("given twice", where=where, given=twice[0], allowed="each name once")
