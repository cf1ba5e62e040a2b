"""The implicit integrator (Radau IIA, order 5), and those that keep the energy: functions and tables.

Mixed form: the tension of every two-sided member that joins a free coordinate is an unknown, the multiplier
of that member's law. Newton matrices hold masses and directions of these members; cables, soft beside them,
enter the equations only: the iteration converges as long as a step is not much longer than a period of the
cables, which accuracy asks for as well. Those with much damping, or whose damping is a run-time parameter,
are in the matrices too, by rows of their own: the iteration would ask for steps of m / c.

To keep the energy, after each step velocities are changed by as little as brings it back, in the metric of
the mass matrix, along what of them is no rigid motion, so that momentum and angular momentum stay.

The saddle matrices of nodes and multipliers, of which G has one row a multiplier, are

        [ A    G^T ]     A: over the free coordinates, G: directions of the members,
        [ G   -kappa ]   kappa >= 0: diagonal

L D L^T without pivoting, in an order that is found here once: nodes by least degree, a multiplier after the
nodes that it joins. Where A is positive definite every pivot then has its sign, for kappa = 0 too (Vanderbei
1995, quasi-definite matrices). Results are plain tables for the generated C.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emitter import EmittedModel
from tensegrity_codegen.codegen.integrators.events import WatchedEvents, event_memory
from tensegrity_codegen.codegen.integrators.work_memory import count_bytes, count_entries
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.model import Frame
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.integrators import INTEGRATORS, STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import FunctionSpec, IntegratorSpec, Manifest, Pattern
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class SaddlePattern:
    """The factors of one saddle matrix of `size` rows, coordinates first, then multipliers.

    elimination_row: row of each unknown in the order of elimination. The lower triangle, row by row:
    entry_start (size + 1,), entry_column, entries of the diagonal left out; the same of the factor L:
    factor_start, factor_column (ascending in a row); update_start (number of entries of L + 1,): for entry
    (r, c) of L the entries (i, c) with i < r, as update_row = i and update_entry, its index.
    """

    size: int
    elimination_row: tuple[int, ...]
    entry_start: tuple[int, ...]
    entry_column: tuple[int, ...]
    factor_start: tuple[int, ...]
    factor_column: tuple[int, ...]
    update_start: tuple[int, ...]
    update_row: tuple[int, ...]
    update_entry: tuple[int, ...]

    def entry(self, a: int, b: int) -> int:
        """Return the index in entry_column of the entry of two unknowns a and b, off the diagonal."""
        row, column = sorted((self.elimination_row[a], self.elimination_row[b]), reverse=True)
        start, end = self.entry_start[row], self.entry_start[row + 1]
        return start + self.entry_column[start:end].index(column)


def build_saddle_pattern(
    n_coordinates: int,
    blocks: Sequence[Sequence[int]],
    couplings: Iterable[tuple[int, int]],
    multipliers: Sequence[Sequence[int]],
) -> SaddlePattern:
    """Return the pattern of the factors."""
    size = n_coordinates + len(multipliers)
    # Entries off the diagonal, as pairs of unknowns: of A, then of G.
    pairs = {(max(a, b), min(a, b)) for a, b in couplings if a != b}
    pairs |= {(n_coordinates + row, column) for row, columns in enumerate(multipliers) for column in columns}
    # Each multiplier is a block of its own, after the blocks of the nodes that it joins.
    block_of_unknown = {unknown: index for index, block in enumerate(blocks) for unknown in block}
    unknowns_of_block = [tuple(block) for block in blocks]
    predecessors: list[set[int]] = [set() for _ in blocks]
    for row, columns in enumerate(multipliers):
        block_of_unknown[n_coordinates + row] = len(unknowns_of_block)
        unknowns_of_block.append((n_coordinates + row,))
        predecessors.append({block_of_unknown[column] for column in columns})
    edges = {
        (block_of_unknown[a], block_of_unknown[b])
        for a, b in pairs
        if block_of_unknown[a] != block_of_unknown[b]
    }
    # The row of each unknown is its position in the order of elimination.
    order = [unknown for block in order_blocks(predecessors, edges) for unknown in unknowns_of_block[block]]
    elimination_row = [0] * size
    for position, unknown in enumerate(order):
        elimination_row[unknown] = position
    return _build_tables(size, elimination_row, pairs)


def order_blocks(predecessors: Sequence[set[int]], edges: Iterable[tuple[int, int]]) -> list[int]:
    """Return the blocks of a graph in an order of least degree."""
    neighbours: list[set[int]] = [set() for _ in predecessors]
    for a, b in edges:
        neighbours[a].add(b)
        neighbours[b].add(a)
    open_predecessors = [set(blocks) for blocks in predecessors]
    successors: list[list[int]] = [[] for _ in predecessors]
    for block, blocks in enumerate(predecessors):
        for predecessor in blocks:
            successors[predecessor].append(block)
    remaining, order = set(range(len(predecessors))), []
    while remaining:
        chosen = min(
            (block for block in remaining if not open_predecessors[block]),
            key=lambda b: (len(neighbours[b]), b),
        )
        order.append(chosen)
        remaining.remove(chosen)
        # Elimination joins all neighbours of the chosen block with each other.
        clique = neighbours[chosen]
        for block in clique:
            neighbours[block] |= clique
            neighbours[block] -= {block, chosen}
        for block in successors[chosen]:
            open_predecessors[block].discard(chosen)
    return order


def _build_tables(
    size: int, elimination_row: Sequence[int], pairs: Iterable[tuple[int, int]]
) -> SaddlePattern:
    """Return the tables of the matrix and of its factor in the order of `elimination_row`."""
    entries: list[list[int]] = [[] for _ in range(size)]
    for a, b in pairs:
        row, column = max(elimination_row[a], elimination_row[b]), min(elimination_row[a], elimination_row[b])
        entries[row].append(column)
    factor_rows = [sorted(columns) for columns in _find_factor_rows(size, entries)]
    entry_index: dict[tuple[int, int], int] = {}
    for row, columns in enumerate(factor_rows):
        for column in columns:
            entry_index[row, column] = len(entry_index)
    # Rows with an entry in each column, of those so far.
    rows_of_column: list[list[int]] = [[] for _ in range(size)]
    update_start, update_row, update_entry = [0], [], []
    for row, columns in enumerate(factor_rows):
        for column in columns:
            update_row += rows_of_column[column]
            update_entry += [entry_index[i, column] for i in rows_of_column[column]]
            update_start.append(len(update_row))
            rows_of_column[column].append(row)
    entries = [sorted(columns) for columns in entries]
    return SaddlePattern(
        size,
        tuple(elimination_row),
        _count_up(entries),
        tuple(column for columns in entries for column in columns),
        _count_up(factor_rows),
        tuple(column for columns in factor_rows for column in columns),
        tuple(update_start),
        tuple(update_row),
        tuple(update_entry),
    )


def _find_factor_rows(size: int, entries: Sequence[Sequence[int]]) -> list[set[int]]:
    """Return the columns of L row by row: those of the matrix, and the fill-in of elimination."""
    rows_of_column: list[set[int]] = [set() for _ in range(size)]
    for row, columns in enumerate(entries):
        for column in columns:
            rows_of_column[column].add(row)
    # Eliminating a column adds its rows to that of its first row (the parent in the elimination tree).
    for column in range(size):
        if rows_of_column[column]:
            parent = min(rows_of_column[column])
            rows_of_column[parent] |= rows_of_column[column] - {parent}
    rows: list[set[int]] = [set() for _ in range(size)]
    for column, column_rows in enumerate(rows_of_column):
        for row in column_rows:
            rows[row].add(column)
    return rows


def _count_up(rows: Sequence[Sequence[int]]) -> tuple[int, ...]:
    """Return the index of the first entry of each row, and the number of all entries."""
    starts = [0]
    for row in rows:
        starts.append(starts[-1] + len(row))
    return tuple(starts)


IMPLICIT = INTEGRATORS[STIFF_INTEGRATOR]
PREFIX = STIFF_INTEGRATOR.upper()  # of its constants in C
NEWTON_SHARE = 1e-4  # of the tolerance, that Newton's method may leave
NO_PLACE = 2**30


def implicit_spec(
    name: str, model: EmittedModel, functions: Sequence[FunctionSpec], events: WatchedEvents, driven: int = 0
) -> IntegratorSpec:
    """Return the description of the integrator in a manifest."""
    by_name, subject, frame = (
        {function.quantity: function for function in functions},
        model.subject,
        model.frame,
    )
    if not all(quantity in by_name for quantity in IMPLICIT.quantities) or not isinstance(subject, Structure):
        in_nodes = " or ".join(
            repr(formulation.name) for formulation in FORMULATIONS.values() if formulation.in_nodes
        )
        raise FormulationError(
            f"the integrator {name!r} needs node coordinates and member forces",
            where=f"{model.name}: model.integrators",
            given=name,
            allowed=f"formulation {in_nodes}, emitters 'unrolled' and 'table'",
            hint="use rk54 in other formulations",
        )
    if len(bars := np.flatnonzero(subject.is_rigid & subject.ends_at_body)):
        raise FormulationError(
            f"the integrator {name!r} does not know rigid bars that end at points of bodies",
            where=f"{model.name}: model.integrators",
            given=subject.member_name[bars[0]],
            allowed="cables and bars with a stiffness there",
            hint="use rk853, or give the bars a spring_constant",
        )
    free = set(frame.coordinate_node_axis)

    def moving(mask: NDArray[np.bool_]) -> tuple[int, ...]:
        """Return those of the members that join a free coordinate."""
        ends = frame.connectivity
        candidates = np.flatnonzero(mask).tolist()
        return tuple(e for e in candidates if any((n, axis) in free for n in ends[e] for axis in frame.axes))

    members = moving(subject.is_mixed)
    changing = model.arguments["damping"].over if "damping" in model.arguments else ()
    # Cables through rings join more than two nodes: their damping stays outside the matrix
    much = subject.has_much_damping | (subject.tension_only & np.isin(subject.member_name, changing))
    damped = moving(much & ~subject.passes_rings)
    used = {
        argument
        for quantity in (*IMPLICIT.quantities, *events.quantities)
        for argument in by_name[quantity].arguments
    }
    passed = tuple(argument for argument in ARGUMENTS if argument in used - {"coordinate", "velocity"})
    tables = implicit_tables(members, damped, frame, by_name, events.memory, driven)
    return IntegratorSpec(
        name,
        f"{model.name}_integrate_{name}",
        passed,
        tables["work_size"],
        events.kinds,
        events.cables,
        tensions=members,
        damped=damped,
        unwatched=events.unwatched,
    )


def implicit_tables(
    members: Sequence[int],
    damped: Sequence[int],
    frame: Frame | Manifest,
    functions: Mapping[str, FunctionSpec],
    margins: int,
    driven: int = 0,
) -> dict[str, Any]:
    """Return the tables that the template of the integrator reads, and the size of its work memory."""
    coordinate_index = {tuple(key): k for k, key in enumerate(frame.coordinate_node_axis)}
    axes, n = frame.axes, len(frame.coordinate_name)
    ends = [frame.connectivity[member] for member in (*members, *damped)]
    coordinate = [[coordinate_index.get((node, axis), -1) for node in pair for axis in axes] for pair in ends]
    # Elimination: coordinates of a node are one block
    masses = _mass_entries(functions["mass_matrix"].pattern, n)
    nodes: dict[int, list[int]] = {}
    for k, (node, _) in enumerate(frame.coordinate_node_axis):
        nodes.setdefault(node, []).append(k)
    saddle = build_saddle_pattern(
        n, list(nodes.values()), masses, [[k for k in row if k >= 0] for row in coordinate]
    )
    # Values of the constants in the struct of its work memory
    law = int(np.prod(functions["member_law"].shape))
    entries, factors = len(saddle.entry_column), len(saddle.factor_column)
    sizes = {
        "N": n,
        "AXES": len(axes),
        "N_UNKNOWNS": saddle.size,
        "TENSION_ROOM": max(len(members), 1),
        f"WITH_{PREFIX}_DAMPED": len(damped),
        "N_DAMPED": len(damped),
        f"{PREFIX}_LAW": law,
        f"{PREFIX}_MASSES": len(masses),
        f"{PREFIX}_ENTRY_ROOM": max(entries, 1),
        f"{PREFIX}_FACTOR_ROOM": max(factors, 1),
        "WITH_EVENTS": margins,
        "event_memory": 8 * margins,
        "WITH_PROFILE": driven,
        "N_DRIVEN": driven,
    }
    return {
        "axes": len(axes),
        "multipliers": len(members),
        "member": list(members),
        "damped": list(damped),
        "coordinate": [k for row in coordinate for k in row],
        "direction_entry": [
            saddle.entry(n + row, k) if k >= 0 else -1 for row, ks in enumerate(coordinate) for k in ks
        ],
        "mass_entry": [
            -1 - saddle.elimination_row[a] if a == b else saddle.entry(a, b) if a > b else NO_PLACE
            for a, b in masses
        ],
        "is_mass_diagonal": all(a == b for a, b in masses),
        "entries": len(saddle.entry_column),
        "factors": len(saddle.factor_column),
        "rows": [
            row for row in range(saddle.size) if saddle.factor_start[row + 1] > saddle.factor_start[row]
        ],
        **{field.name: getattr(saddle, field.name) for field in fields(saddle)},
        "law_size": law,
        "work_size": count_bytes(f"{STIFF_INTEGRATOR}_work", f"{STIFF_INTEGRATOR}_work.h", sizes) // 8,
    }


def implicit_context(
    spec: IntegratorSpec, manifest: Manifest, functions: Mapping[str, FunctionSpec]
) -> dict[str, Any]:
    """Return the context of the integrator's templates, besides that of every integrator."""
    n = len(manifest.coordinate_name)
    margins = event_memory(spec.events, functions.values(), {"N": n, "N_STATES": 2 * n})
    tables = implicit_tables(spec.tensions, spec.damped, manifest, functions, margins)
    return {
        **tables,
        "settings": {
            "METHOD_ITERATES": False,
            f"WITH_{PREFIX}_DIAGONAL_MASS": tables["is_mass_diagonal"],
            f"WITH_{PREFIX}_DAMPED": bool(spec.damped),
        },
        "counts": IMPLICIT.counts,
        "newton_share": NEWTON_SHARE,
        "kernels": {name: functions[name].arguments for name in IMPLICIT.quantities},
    }


def _mass_entries(pattern: Pattern | None, n: int) -> list[tuple[int, int]]:
    """Return row and column of each non-zero of the mass matrix."""
    if pattern is None:
        return [(k, k) for k in range(n)]
    columns = np.repeat(np.arange(n), np.diff(pattern.column_start))
    return [(int(row), int(column)) for row, column in zip(pattern.row, columns, strict=True)]


KEEP_CHOICES = ("energy",)
KEPT_QUANTITIES = ("total_energy", "mass_matrix", "energy_rate")
N_RIGID = {1: 1, 2: 3, 3: 6}  # axes -> rigid motions


def check_keep(request: ModelRequest, name: str) -> None:
    """Raise FormulationError for a quantity that no integrator can keep here; name: of the scene."""
    for quantity in request.keep:
        if quantity not in KEEP_CHOICES:
            raise FormulationError(
                "unknown thing to keep",
                where="model.keep",
                given=quantity,
                hint=suggest(quantity, KEEP_CHOICES),
            )
    in_nodes = [formulation.name for formulation in FORMULATIONS.values() if formulation.in_nodes]
    if request.keep and (request.formulation not in in_nodes or request.precision != "double"):
        raise FormulationError(
            "the energy is kept in node coordinates and double precision alone",
            where=f"{name}: model.keep",
            given=f"{request.formulation}, {request.precision}",
            allowed=f"formulations {', '.join(in_nodes)} in double precision",
            hint="omit it, and tighten the tolerance",
        )


def check_conservative(model: EmittedModel, functions: Mapping[str, FunctionSpec]) -> None:
    """Raise FormulationError for a model whose motion does not keep its energy."""
    rate = functions.get("energy_rate")
    depends = "velocity" in functions["acceleration"].arguments if rate is None else bool(rate.arguments)
    if depends:
        raise FormulationError(
            "nothing keeps the energy where damping takes some",
            where=f"{model.name}: model.keep",
            given="energy",
            allowed="structures without damping",
            hint="set all damping to 0, or leave `keep` out",
        )


def keeper_memory(model: EmittedModel, functions: Mapping[str, FunctionSpec]) -> int:
    """Return the bytes of work memory that it takes; raises as check_conservative."""
    check_conservative(model, functions)
    sizes = {"N": len(model.frame.coordinate_name), "N_MASSES": count_entries(functions["mass_matrix"])}
    return count_bytes("energy_memory", "energy.h", sizes)


def keeper_context(manifest: Manifest, functions: Mapping[str, FunctionSpec]) -> dict[str, Any]:
    """Return the context of the template of the energy correction."""
    mass = functions["mass_matrix"]
    axes, n = len(manifest.axes), len(manifest.coordinate_name)
    is_free = n == axes * len(manifest.node_name)
    pattern = mass.pattern
    diagonal = pattern is None or (
        len(pattern.row) == n and np.array_equal(pattern.row, np.arange(n, dtype=np.int32))
    )
    return {
        "energy_arguments": functions["total_energy"].arguments,
        "mass_arguments": mass.arguments,
        "mass_size": count_entries(mass),
        "is_mass_diagonal": diagonal,
        "axes": axes,
        "rigid": N_RIGID[axes] if is_free else 0,
    }
