"""A formulation's expressions of one structure, each built when first asked for."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, suggest
from tensegrity_codegen.tables.body_places import BodyPlace
from tensegrity_codegen.tables.manifest import count_internal
from tensegrity_codegen.tables.quantities import find_quantity

# The state of formulation `node_position`.
OF_NODES = ("node_position", "node_velocity")


@dataclass(frozen=True)
class ModelArgument:
    """One run-time argument: its symbols, its value in the scene (C order), the names it runs over.

    The symbols of a (k, n) argument are n x k, so that CasADi's columns are the rows of a C array.
    sentence, unit: its meaning in this formulation, if that differs from the table of arguments.
    """

    symbol: ca.SX
    nominal: NDArray[np.float64]
    over: tuple[str, ...] = ()
    sentence: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Frame:
    """The indices of a model's results: names of nodes, members, coordinates and inputs, and where nodes are.

    coordinate_node_axis: node and axis of each coordinate, empty if coordinates are no node coordinates.
    find_bar_pair: returns the names of the two bars of each pair whose distance can be asked for; a call,
    since n bars make n (n - 1) / 2 pairs that few models need. rigid_bar: the members that keep constant
    lengths, in the order of their multipliers. internal_name: of internal states; contact_name: of nodes that
    can touch the ground; column_name: of numbers that motions are differentiated to. ring_nodes: nodes that
    each member passes between its ends, empty if no member does. body_places: free rigid bodies by
    their corners.
    """

    axes: tuple[int, ...]
    node_name: tuple[str, ...]
    node_position: NDArray[np.float64]  # (n_nodes, 3) [m]
    node_velocity: NDArray[np.float64]  # (n_nodes, 3) [m/s]
    member_name: tuple[str, ...]
    connectivity: tuple[tuple[int, int], ...]
    coordinate_name: tuple[str, ...]
    coordinate_node_axis: tuple[tuple[int, int], ...]
    input_name: tuple[str, ...]
    find_bar_pair: Callable[[], tuple[tuple[str, str], ...]] = tuple
    rigid_bar: tuple[str, ...] = ()
    internal_name: tuple[str, ...] = ()
    contact_name: tuple[str, ...] = ()
    column_name: tuple[str, ...] = ()
    ring_nodes: tuple[tuple[int, ...], ...] = ()
    body_places: tuple[BodyPlace, ...] = ()

    @property
    def n_internal(self) -> int:
        """Number of states behind the velocities: internal ones, then derivatives of the motion."""
        return count_internal(len(self.coordinate_name), len(self.internal_name), len(self.column_name))


def frame_structure(structure: Structure) -> Frame:
    """Return the frame of a model whose coordinates are the structure's free node coordinates."""
    node_axes = _pairs(structure.coordinate_node_axis)
    name = structure.member_name
    return Frame(
        axes=structure.axes,
        node_name=structure.node_name,
        node_position=structure.node_position,
        node_velocity=structure.node_velocity,
        member_name=structure.member_name,
        connectivity=_pairs(structure.connectivity),
        coordinate_name=tuple(f"{structure.node_name[node]}_{'xyz'[axis]}" for node, axis in node_axes),
        coordinate_node_axis=node_axes,
        input_name=tuple(source.name for source in structure.inputs),
        find_bar_pair=lambda: tuple((name[i], name[j]) for i, j in structure.bar_pairs),
        internal_name=structure.internal_name,
        contact_name=structure.contact_name,
        ring_nodes=structure.ring_nodes,
        body_places=structure.body_places,
    )


def _pairs(table: NDArray[np.int64]) -> tuple[tuple[int, int], ...]:
    return tuple((i, j) for i, j in table.tolist())


class SymbolicModel:
    """Named expressions over shared run-time symbols.

    subject: the structure that it models; arguments: name -> argument, in the order of C signatures;
    builders: quantity name -> function without arguments that returns its SX, in the quantity's shape
    transposed if it is a table of vectors, so that CasADi's columns are the rows of a C array.
    words: quantity name -> unit and sentence, if they differ from the table of quantities.
    parts: what the builders share, where an emitter can make something of it.
    """

    def __init__(
        self,
        formulation: str,
        subject: Any,
        frame: Frame,
        arguments: Mapping[str, ModelArgument],
        builders: Mapping[str, Callable[[], Any]],
        words: Mapping[str, tuple[str, str]] = MappingProxyType({}),
        parts: Any = None,
    ) -> None:
        self.formulation = formulation
        self.subject = subject
        self.name: str = subject.name
        self.frame = frame
        self.arguments = dict(arguments)
        self.words = dict(words)
        self.parts = parts
        self._builders = builders
        self._built: dict[str, ca.SX] = {}

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities that the formulation offers."""
        return tuple(self._builders)

    def stack(self, names: Iterable[str]) -> ca.SX:
        """Return those of these arguments that the model has, stacked in this order, (n, 1)."""
        chosen = [ca.vec(self.arguments[name].symbol) for name in names if name in self.arguments]
        return ca.vertcat(ca.SX(0, 1), *chosen)

    def arguments_of(self, expression: ca.SX) -> dict[str, ca.SX]:
        """Return the symbols of the arguments that an expression depends on, by their names."""
        return {
            name: argument.symbol
            for name, argument in self.arguments.items()
            if argument.symbol.numel() and ca.depends_on(expression, argument.symbol)
        }

    def offer(self, builders: Mapping[str, Callable[[], Any]]) -> None:
        """Add quantities to those that the formulation offers."""
        self._builders = {**self._builders, **builders}

    def expression(self, quantity: str) -> ca.SX:
        """Return the expression of `quantity`."""
        find_quantity(quantity)
        if quantity not in self._builders:
            if quantity in OF_NODES and self.formulation in OF_NODES:
                raise FormulationError(
                    f"formulation {self.formulation!r} does not compute this: it is its state",
                    where="model.quantities", given=quantity,
                    hint="omit it: positions and velocities of nodes are in every result",
                )  # fmt: skip
            raise FormulationError(
                f"formulation {self.formulation!r} has no quantity of that name",
                where="model.quantities",
                given=quantity,
                hint=suggest(quantity, self._builders),
            ).unless_chosen_otherwise(quantity)
        if quantity not in self._built:
            self._built[quantity] = ca.SX(self._builders[quantity]())
        return self._built[quantity]


def count_operations(function: ca.Function) -> int:
    """Return the number of floating-point operations in one evaluation of an SX function."""
    codes = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    count = function.n_instructions()
    return sum(function.instruction_id(k) not in codes for k in range(count))
