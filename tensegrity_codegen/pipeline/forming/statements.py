"""Statements of members by name: force densities, forces and lengths."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import is_number
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, check_choice
from tensegrity_codegen.system.summaries import count_names

KINDS = {"bars": True, "cables": False}


def read_statements(
    structure: Structure,
    density: Mapping[str, float],
    force: Mapping[str, float],
    length: Mapping[str, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return density, force and length of each member, nan where another one is stated."""
    values = np.full((3, structure.n_members), np.nan)
    rank = np.full(structure.n_members, 9)  # behind all that can be stated
    said = [""] * structure.n_members
    for which, (word, given) in enumerate((("density", density), ("force", force), ("length", length))):
        for name, value in given.items():
            members, order = find_members(structure, name, word)
            _check_value(structure, word, name, value, members)
            for e in members:
                if rank[e] == order:
                    raise DuplicateNameError(
                        "two statements of one member",
                        where=f"{structure.name}: {word}",
                        given=f"{said[e]} and {word} {name}, of {structure.member_name[e]}",
                        allowed="one, or another one of fewer members",
                    )
                if order < rank[e]:
                    values[:, e], rank[e], said[e] = np.nan, order, f"{word} {name}"
                    values[which, e] = value
    bare = np.isnan(values).all(axis=0)
    if (bare & ~structure.is_bar).any():
        names = [structure.member_name[e] for e in np.flatnonzero(bare & ~structure.is_bar)]
        raise InvalidValueError(
            "nothing is stated of some cables",
            where=structure.name,
            given=count_names(names),
            allowed="a force density, force or length of each cable",
            hint='density={"cables": 100} [N/m]; a prestress that keeps the stated positions is found by '
            "`analyse SCENE --prestress 100 --scene-out FILE`",
        )
    values[2, bare] = structure.member_length()[bare]
    return values[0], values[1], values[2]


def find_members(structure: Structure, name: str, word: str) -> tuple[list[int], int]:
    """Return the members of a name, and how far it comes behind: of a member, group, class or kind."""
    if name in structure.member_name:
        return [structure.member_name.index(name)], 0
    if name in structure.groups:
        return list(structure.groups[name]), 1
    if name in structure.member_class:
        return [e for e, own in enumerate(structure.member_class) if own == name], 2
    known = (
        *KINDS,
        *structure.groups,
        *dict.fromkeys(filter(None, structure.member_class)),
        *structure.member_name,
    )
    check_choice(name, known, "member, group, class or kind", f"{structure.name}: {word}")
    return np.flatnonzero(structure.is_bar == KINDS[name]).tolist(), 3


def _check_value(structure: Structure, word: str, name: str, value: Any, members: list[int]) -> None:
    """Raise InvalidValueError for a value that these members cannot have."""
    cables = structure.tension_only[members].any()
    is_good = is_number(value) and value != 0 and (value > 0 or (word != "length" and not cables))
    if not is_good:
        raise InvalidValueError(
            f"not a {word} that these members can have",
            where=f"{structure.name}: {word}",
            given=f"{name} = {value!r}",
            allowed="above 0" + ("" if cables or word == "length" else ", or below 0 for bars that push"),
        )
