"""Sets of nodes by name: lists, patterns such as "t6_*", and the rings of the shapes prism and tower."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from tensegrity_codegen.system.arrays import IntArray
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest

RING = re.compile(r"([bt])(?:(\d+)_)?(\d+)")


def find_nodes(names: Sequence[str], node_name: Sequence[str], where: str) -> IntArray:
    """Return the indices of nodes.

    Parameters
    ----------
    names : sequence of str
        Names, or patterns with ``*``.
    node_name : sequence of str
        All nodes of the structure.
    where : str
        The target, for errors.

    Returns
    -------
    ndarray of int
        Indices in the order of the names; those of a pattern in the order of the structure.

    Raises
    ------
    UnknownNameError
        A name or pattern matches no node.
    InvalidValueError
        A node is named twice.
    """
    found: list[int] = []
    for name in names:
        rows = [k for k, known in enumerate(node_name) if known == name]
        if "*" in name:
            rows = [k for k, known in enumerate(node_name) if fnmatchcase(known, name)]
        if not rows:
            raise UnknownNameError(
                "unknown node",
                where=where,
                given=name,
                allowed="nodes of the structure",
                hint=suggest(name, node_name),
            )
        found += rows
    twice = [node_name[k] for k in found if found.count(k) > 1]
    if twice:
        raise InvalidValueError(
            "a node is named twice", where=where, given=twice[0], allowed="each node once"
        )
    return np.array(found, dtype=np.int64)


def find_rings(node_name: Sequence[str]) -> tuple[IntArray, IntArray] | None:
    """Return the top and bottom ring of a structure whose nodes have the names of a prism or tower.

    Parameters
    ----------
    node_name : sequence of str
        All nodes: b1.., t1.. of a prism; b1_1.., t1_1.. of a tower.

    Returns
    -------
    top, base : ndarray of int
        Their indices, in the order of their numbers; None for other names.
    """
    place: dict[tuple[str, int, int], int] = {}
    for index, name in enumerate(node_name):
        match = RING.fullmatch(name)
        if match:
            place[match[1], int(match[2] or 0), int(match[3])] = index
    stages = [stage for _, stage, _ in place]
    if not stages:
        return None
    rings = [
        [place[key] for key in sorted(place) if key[:2] == ring]
        for ring in (("t", max(stages)), ("b", min(stages)))
    ]
    if len(rings[0]) != len(rings[1]) or len(rings[0]) < 3:
        return None
    return np.array(rings[0], dtype=np.int64), np.array(rings[1], dtype=np.int64)
