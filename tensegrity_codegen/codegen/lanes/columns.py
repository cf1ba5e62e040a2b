"""C statements that add blocks of members into compressed columns, three rows of a node at a time.

The blocks of four members are turned into columns of three rows, one vector each. A column of the matrix is
what the nodes next to its own have in it, from top to bottom: vectors are stored whole, one row too many,
which the next store overwrites. Sums follow the assembly plan: the bits are those of sums entry by entry.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from tensegrity_codegen.codegen.print.identifiers import plain_comment
from tensegrity_codegen.codegen.print.printer import LONGEST_LINE
from tensegrity_codegen.symbolic.formulations.node_position import NodePosition

# The columns of a symmetric block: where their rows stand in its upper triangle, row by row.
COLUMNS = ((0, 1, 2), (1, 3, 4), (2, 4, 5))

Terms = list[tuple[int, int]]  # (member, sign), in the order in which they add up


@dataclass(frozen=True)
class _Run:
    """Rows of one node in one column: the first of them among the non-zeros, how many."""

    column: int
    node: int
    first: int
    count: int


def write_columns(
    parts: NodePosition, sparsity: ca.Sparsity, result: str, place: Mapping[int, tuple[int, int]]
) -> list[str] | None:
    """Return the statements; None where the rows of a node are not x, x and y, or x, y and z in a row.

    place: member -> (number of its four, lane), of members whose blocks stand in block0, block1, ...
    """
    runs = _find_runs(parts, sparsity)
    if runs is None:
        return None
    terms = _find_terms(parts, place)
    lines = []
    for number in sorted({number for number, _ in place.values()}):
        lines += [f"lanes_xyz column{number}[12];", f"four_join_columns(block{number}, column{number});"]
    axis_of = {coordinate: key for key, coordinate in parts.map.index.items()}
    names = parts.structure.node_name
    for run in runs:
        node, axis = axis_of[run.column]
        value = _sum(terms[run.node, node], parts.map.axes.index(axis), place)
        rows, column = names[run.node], f"{names[node]}_{'xyz'[axis]}"
        lines += _store(result, run, sparsity.nnz(), value, plain_comment(f"{rows}, {column}"))
    return lines


def _find_runs(parts: NodePosition, sparsity: ca.Sparsity) -> list[_Run] | None:
    node_axis = {coordinate: key for key, coordinate in parts.map.index.items()}
    runs, (start, rows) = [], (sparsity.colind(), sparsity.row())
    for column in range(sparsity.size2()):
        place = start[column]
        keys = [node_axis[row] for row in rows[start[column] : start[column + 1]]]
        for node, group in itertools.groupby(keys, key=lambda key: key[0]):
            axes = [axis for _, axis in group]
            n_free = sum((node, axis) in parts.map.index for axis in parts.map.axes)
            if axes != list(range(len(axes))) or len(axes) != n_free:
                return None
            runs.append(_Run(column, node, place, len(axes)))
            place += len(axes)
    return runs


def _find_terms(parts: NodePosition, place: Mapping[int, tuple[int, int]]) -> dict[tuple[int, int], Terms]:
    """Return (node of the rows, node of the columns) -> terms, as CoordinateMap.member_matrix adds them."""
    terms: dict[tuple[int, int], Terms] = {}
    for e, end in parts.members.plan.ends.tolist():
        if e in place:
            own, other = parts.ends[e][end], parts.ends[e][1 - end]
            terms.setdefault((own, own), []).append((e, 1))
            terms.setdefault((other, own), []).append((e, -1))
    return terms


def _sum(terms: Sequence[tuple[int, int]], axis: int, place: Mapping[int, tuple[int, int]]) -> str:
    value = ""
    for e, sign in terms:
        number, lane = place[e]
        term = f"column{number}[{4 * axis + lane}]"
        if not value:
            value = term if sign > 0 else f"xyz_negative({term})"
        else:
            value = f"xyz_{'plus' if sign > 0 else 'minus'}({value}, {term})"
    return value


def _with_comment(statement: str, comment: str) -> str:
    """Return a statement with a comment behind it, where the line has room for it."""
    line = f"{statement} /* {comment} */"
    return line if len(line) <= LONGEST_LINE else statement


def _store(result: str, run: _Run, size: int, value: str, comment: str) -> list[str]:
    at = f"{result} + {run.first}"
    if run.first + 4 <= size:
        return [_with_comment(f"xyz_store({at}, {value});", comment)]
    if run.count == 3:
        return [_with_comment(f"xyz_store_last({at}, {value});", comment)]
    part = f"part{run.column}_{run.node}"
    return [
        f"double {part}[4];",
        _with_comment(f"xyz_store({part}, {value});", comment),
        *(f"{result}[{run.first + k}] = {part}[{k}];" for k in range(run.count)),
    ]
