"""Masses of nodes and bars: forces to accelerations, kinetic energy."""

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.table.members.block_pattern import check_constant_masses
from tensegrity_codegen.codegen.table.members.external import mass_text
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.writer import Writer, loop
from tensegrity_codegen.structure.inertia_plan import refuse_bare
from tensegrity_codegen.structure.symmetric_factor import SymmetricFactor, factorise
from tensegrity_codegen.system.arrays import FloatArray, IntArray


def check_mass(model: TableModel) -> None:
    """Raise FormulationError if a free node has no mass, which is no argument either."""
    bare = model.free.any(axis=1) & (model.diagonal_mass == 0) & (model.argument_index("node_mass") < 0)
    refuse_bare(model.structure, np.flatnonzero(bare).tolist())


@dataclass(frozen=True)
class DivideByMass:
    """Turns the forces in `target`, on the coordinates of nodes that no bar couples, into accelerations."""

    model: TableModel
    target: str

    @cached_property
    def _coordinate(self) -> IntArray:
        """Coordinates of nodes that are coupled to no other."""
        return np.flatnonzero(~_is_coupled(self.model))

    @cached_property
    def _chosen(self) -> NDArray[np.bool_]:
        """Whether the node of each of these has its mass as an argument."""
        return np.asarray(self.model.mass_argument[self._coordinate] >= 0)

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return frozenset({"node_mass"} if self._chosen.any() else ())

    @property
    def operations(self) -> int:
        """One multiplication or division a coordinate."""
        return len(self._coordinate)

    @property
    def repeats(self) -> int:
        """Its coordinates."""
        return len(self._coordinate)

    def write(self, writer: Writer) -> list[str]:
        """Return the loops over coordinates of constant and of changeable mass."""
        model, node = self.model, self.model.coordinate_node
        constant, changeable = self._coordinate[~self._chosen], self._coordinate[self._chosen]
        lines = []
        if len(constant):
            mass = model.diagonal_mass[node[constant]]
            at = writer.index_at("constant_mass_coordinate", constant, "k")
            inverse = writer.real_at("inverse_mass", 1.0 / mass, "k")
            lines += loop("k", len(constant), [f"{self.target}[{at}] *= {inverse};"])
        if len(changeable):
            at = writer.index_at("changeable_mass_coordinate", changeable, "k")
            text = changeable_mass(writer, node[changeable], "k")
            lines += loop("k", len(changeable), [f"{self.target}[{at}] /= {text};"])
        return lines


def _is_coupled(model: TableModel) -> NDArray[np.bool_]:
    """Return (n_coordinates,): whether bars with own mass couple each coordinate to another."""
    row, second, _ = pairs_of_coordinates(model)
    is_coupled = np.zeros(model.n_coordinates, dtype=bool)
    is_coupled[row] = is_coupled[second] = True
    return is_coupled


@dataclass(frozen=True)
class KineticEnergy:
    """Adds v^T H v / 2 to the variable `target`: nodes in order, then pairs that bars couple."""

    model: TableModel
    target: str

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        changeable = self.model.mass_argument >= 0
        is_moving = changeable | (self.model.diagonal_mass[self.model.coordinate_node] != 0)
        used = {"velocity"} if is_moving.any() else set()
        return frozenset(used | ({"node_mass"} if changeable.any() else set()))

    @property
    def operations(self) -> int:
        """Three operations a coordinate and for each coupled pair."""
        return 3 * self.model.n_coordinates + 3 * len(pairs_of_coordinates(self.model)[0])

    @property
    def repeats(self) -> int:
        """Coordinates."""
        return self.model.n_coordinates

    def write(self, writer: Writer) -> list[str]:
        """Return the loops over coordinates and coupled pairs of them."""
        model = self.model
        node = model.coordinate_node
        if not len(node):
            return []
        if "node_mass" in self.arguments:
            node_text = writer.index_at("coordinate_node", node, "k")
            mass = mass_text(writer, "node", model.inertia.diagonal_share, "diagonal", True)
            lines = [f"const int node = {node_text};"] if "node" in mass else []
            half = f"{writer.number(0.5)} * {mass}"
        else:
            values = 0.5 * model.diagonal_mass[node]
            lines, half = [], writer.real_at("half_mass", values, "k")
        result = loop("k", len(node), [*lines, f"{self.target} += {half} * velocity[k] * velocity[k];"])
        row, second, coupling = pairs_of_coordinates(model)
        if len(row):
            row_velocity = f"velocity[{writer.index_at('pair_first', row, 'k')}]"
            column_velocity = f"velocity[{writer.index_at('pair_second', second, 'k')}]"
            between = writer.real_at("pair_mass", coupling, "k")
            result += loop(
                "k", len(row), [f"{self.target} += {between} * {row_velocity} * {column_velocity};"]
            )
        return result


def pairs_of_coordinates(model: TableModel) -> tuple[IntArray, IntArray, FloatArray]:
    """Return both coordinates and the mass of each pair of free coordinates that bars couple."""
    entry = model.coordinate[model.inertia.pair]  # (n_pairs, 2, n_axes)
    is_free = np.all(entry >= 0, axis=1)
    mass = np.repeat(model.inertia.pair_mass, model.n_axes).reshape(is_free.shape)
    return entry[:, 0][is_free], entry[:, 1][is_free], mass[is_free]


@dataclass(frozen=True)
class MassDiagonal:
    """Writes the mass matrix: constants, then the entries on the diagonal that are arguments.

    flat_index: column times n_coordinates plus row of each entry of `target`, rising.
    """

    model: TableModel
    target: str
    flat_index: IntArray

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return frozenset({"node_mass"} if len(self._changeable) else ())

    @property
    def _changeable(self) -> IntArray:
        return np.flatnonzero(self.model.mass_argument >= 0)

    @property
    def operations(self) -> int:
        """One addition for each changeable mass at the end of a bar."""
        node = self.model.coordinate_node[self._changeable]
        return int((self.model.inertia.diagonal_share[node] != 0).sum())

    @property
    def repeats(self) -> int:
        """Changeable masses."""
        return len(self._changeable)

    def write(self, writer: Writer) -> list[str]:
        """Return the loops over all entries, and over changeable ones."""
        model, count = self.model, self.model.n_coordinates
        node = model.coordinate_node
        first, second, between = pairs_of_coordinates(model)
        values = np.empty(len(self.flat_index))
        on_diagonal = np.arange(count)
        for row, column, mass in (
            (on_diagonal, on_diagonal, model.diagonal_mass[node]),
            (first, second, between),
            (second, first, between),
        ):
            values[np.searchsorted(self.flat_index, column * count + row)] = mass
        lines = loop("k", len(values), [f"{self.target}[k] = {writer.real_at('mass_value', values, 'k')};"])
        chosen = self._changeable
        if not len(chosen):
            return lines
        at = writer.index_at("mass_diagonal", np.searchsorted(self.flat_index, chosen * (count + 1)), "k")
        text = changeable_mass(writer, node[chosen], "k")
        return [*lines, *loop("k", len(chosen), [f"{self.target}[{at}] = {text};"])]


def changeable_mass(writer: Writer, node: IntArray, counter: str) -> str:
    """Return the C expression of the diagonal mass of nodes[counter]: an argument, plus the bars' share."""
    model = writer.model
    at = writer.index_at("changeable_mass_at", model.argument_index("node_mass")[node], counter)
    bar_mass = model.inertia.diagonal_share[node]
    if not bar_mass.any():
        return f"node_mass[{at}]"
    return f"(node_mass[{at}] + {writer.real_at('changeable_mass_share', bar_mass, counter)})"


@dataclass(frozen=True)
class ScaleRows:
    """Divides the rows of accelerations in some columns of a sparse Jacobian by their masses.

    Rows that bars with own mass couple keep their size: see ApplyMassInverse.

    target: the Jacobian, of which the first n_coordinates rows are rates of coordinates; column: first and
    last; skip: entries at the beginning of each column that stay; turn: change the sign.
    """

    model: TableModel
    target: str
    column: tuple[int, int]
    turn: bool = False
    skip: int = 0

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        return frozenset({"node_mass"} if (self.model.mass_argument >= 0).any() else ())

    @property
    def operations(self) -> int:
        """One operation an entry of a node with about a dozen neighbours."""
        return (2 if self.turn else 1) * self.model.n_axes * (self.column[1] - self.column[0])

    @property
    def repeats(self) -> int:
        """Its columns."""
        return self.column[1] - self.column[0]

    def write(self, writer: Writer) -> list[str]:
        """Return the loop over columns and their entries."""
        model, count = self.model, self.model.n_coordinates
        node = model.coordinate_node
        index = model.mass_argument
        entry, sign = f"{self.target}[k]", "-" if self.turn else ""
        mass = model.diagonal_mass[node]
        mass = np.where(_is_coupled(model), 1.0, mass)
        # Statements for rows of constant and of changeable mass
        fixed = changed = ""
        if (index < 0).any():
            inverse = 1.0 / np.where(index < 0, mass, 1.0)
            fixed = f"{entry} = {sign}({entry} * {writer.real_at('inverse_mass', inverse, 'row')});"
        if (index >= 0).any():
            changed = f"{entry} = {sign}({entry} / {changeable_mass(writer, node, 'row')});"
        at = writer.index_at("changeable_mass_at", index, "row")
        branches = f"if ({at} >= 0) {{ {changed} }} else {{ {fixed} }}"
        statement = branches if fixed and changed else fixed or changed
        row = f"const int row = {model.name}_{self.target}_row[k] - {count};"
        start = f"{model.name}_{self.target}_column_start"
        return [
            "{",
            "  int c, k;",
            f"  for (c = {self.column[0]}; c < {self.column[1]}; ++c) {{",
            f"    for (k = {start}[c]{f' + {self.skip}' if self.skip else ''}; k < {start}[c + 1]; ++k) {{",
            *([f"      {row}"] if re.search(r"\brow\b", statement) else []),
            f"      {statement}",
            "    }",
            "  }",
            "}",
        ]


Sweep = tuple[IntArray, IntArray, FloatArray]  # target, source, factor


@dataclass(frozen=True)
class SolveCoupled:
    """Solves H x = f in place in `target`, for the coordinates that bars couple; masses are constants."""

    model: TableModel
    target: str

    def __post_init__(self) -> None:
        check_constant_masses(self.model, np.flatnonzero(_is_coupled(self.model)))

    @property
    def arguments(self) -> frozenset[str]:
        """No argument."""
        return frozenset()

    @property
    def operations(self) -> int:
        """Two operations for each factor, there and back, and one division a coordinate."""
        forward, _, pivot = self._sweeps
        return 4 * len(forward[0]) + len(pivot[0])

    @cached_property
    def _sweeps(self) -> tuple[Sweep, Sweep, tuple[IntArray, FloatArray]]:
        """Forward and backward substitution over all groups and axes, and the pivots."""
        forward, backward, pivots = [], [], []
        factors: dict[tuple[int, ...], SymmetricFactor] = {}
        for column, axis in enumerate(self.model.axes):
            coordinate = self.model.coordinate[:, column]
            pair, between, groups = self.model.inertia.coupled(axis)
            eliminations, pivot = self._of_pairs(coordinate[pair], pair, between)
            forward.append(eliminations)
            backward.append(eliminations[:, [1, 0, 2]])
            pivots.append(pivot)
            for group in groups:
                nodes = tuple(group)
                factors[nodes] = factors.get(nodes) or factorise(
                    self.model.diagonal_mass[list(nodes)].tolist(), self.model.inertia.coupling_of(nodes)
                )
                eliminations, back, pivot = _sweep_group(factors[nodes], coordinate[group].tolist())
                forward.append(eliminations)
                backward.append(back)
                pivots.append(pivot)
        pivot = np.concatenate(pivots)
        pivot = pivot[np.argsort(pivot[:, 0], kind="stable")]
        return _sweep(forward), _sweep(backward), (pivot[:, 0].astype(np.int64), pivot[:, 1])

    def _of_pairs(self, at: IntArray, pair: IntArray, between: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (n, 3) target, source and factor, and (2 n, 2) place and pivot, of groups of two nodes."""
        pivot_mass, second = self.model.diagonal_mass[pair].T
        factor = between / pivot_mass
        eliminations = np.column_stack([at[:, 1], at[:, 0], factor])
        pivot = np.column_stack([at.T.reshape(-1), np.concatenate([pivot_mass, second - factor * between])])
        return eliminations, pivot

    @property
    def repeats(self) -> int:
        """Coupled coordinates."""
        return len(self._sweeps[2][0])

    def write(self, writer: Writer) -> list[str]:
        """Return the loops: forward, divide, backward."""
        forward, backward, (at, value) = self._sweeps
        if not len(at):
            return []
        coordinate = writer.index_at("coupled_coordinate", at, "k")
        divide = f"{self.target}[{coordinate}] /= {writer.real_at('coupled_pivot', value, 'k')};"
        return [
            *self._substitute(writer, "forward", forward),
            *loop("k", len(at), [divide]),
            *self._substitute(writer, "backward", backward),
        ]

    def _substitute(self, writer: Writer, name: str, sweep: Sweep) -> list[str]:
        target, source, factor = sweep
        to = f"{self.target}[{writer.index_at(f'{name}_target', target, 'k')}]"
        from_ = f"{self.target}[{writer.index_at(f'{name}_source', source, 'k')}]"
        by = writer.real_at(f"{name}_factor", factor, "k")
        return loop("k", len(target), [f"{to} -= {by} * {from_};"])


def _sweep_group(factor: SymmetricFactor, at: list[int]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return forward and backward rows (n, 3) of target, source and factor, and (n, 2) places and pivots."""
    columns = list(zip(factor.order, factor.below, strict=True))
    forward = [(at[row], at[k], value) for k, below in columns for row, value in below]
    backward = [(at[k], at[row], value) for k, below in reversed(columns) for row, value in below]
    pivots = [(at[k], value) for k, value in zip(factor.order, factor.pivot, strict=True)]
    return np.array(forward), np.array(backward), np.array(pivots)


def _sweep(tables: list[FloatArray]) -> Sweep:
    table = np.concatenate(tables)
    return table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2]
