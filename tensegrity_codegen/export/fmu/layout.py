"""The layout of a unit: arguments, states and blocks of calculated values, each with its place."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import prod

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.codegen.print.printer import print_body
from tensegrity_codegen.codegen.unrolled import MAX_MEMBERS
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.symbolic.model import SymbolicModel, count_operations
from tensegrity_codegen.tables.manifest import ArgumentSpec, FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.quantities import QUANTITIES, STATE
from tensegrity_codegen.tables.quantities.arguments import ABOVE_ZERO, FROM_ZERO, INPUT_UNITS
from tensegrity_codegen.tables.request import ModelRequest

POSITION = "node_position"
MARGINS = ("cable_margin", "switch_margin", "contact_margin", "stick_margin")
LEAST = dict.fromkeys(ABOVE_ZERO, "above_zero") | dict.fromkeys(FROM_ZERO, "from_zero")
Parts = tuple[str | int, ...]


@dataclass(frozen=True)
class Argument:
    """One argument of the library: its numbers start at `place` among all arguments."""

    spec: ArgumentSpec
    place: int
    parts: tuple[Parts, ...]
    units: tuple[str, ...]

    @property
    def name(self) -> str:
        """Name of the argument."""
        return self.spec.name

    @property
    def least(self) -> str:
        """The lower bound of its values: "above_zero", "from_zero" or "any"."""
        return LEAST.get(self.spec.name, "any")


@dataclass(frozen=True)
class Block:
    """Values of one quantity, from `start` on among all calculated values."""

    quantity: str
    spec: FunctionSpec | None  # the function that computes them; None: node positions that are coordinates
    start: int
    parts: tuple[Parts, ...]
    unit: str
    sentence: str
    is_margin: bool = False

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.parts)


@dataclass(frozen=True)
class Layout:
    """All that a unit has, from a library's manifest."""

    manifest: Manifest  # the library
    structure: Subject  # the source of the unit
    outputs: tuple[str, ...]  # quantities that are outputs

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates."""
        return len(self.manifest.coordinate_name)

    @property
    def n_internal(self) -> int:
        """Number of internal states, which stand behind the velocities."""
        return len(self.manifest.internal_name)

    @property
    def n_states(self) -> int:
        """Number of coordinates, velocities and internal states."""
        return 2 * self.n_coordinates + self.n_internal

    @property
    def axes(self) -> tuple[str, ...]:
        """Letters of the axes that the scene models."""
        return tuple("xyz"[axis] for axis in self.manifest.axes)

    @cached_property
    def arguments(self) -> tuple[Argument, ...]:
        """Inputs first, then parameters, in the library's order."""
        specs = [argument for argument in self.manifest.arguments if argument.name not in STATE]
        arguments, place = [], 0
        for spec in sorted(specs, key=lambda argument: argument.name != "input"):
            if prod(spec.shape):
                entries = _combine(spec.over or None, spec.shape, self.axes)
                units = self._input_units if spec.name == "input" else (spec.unit,) * len(entries)
                arguments.append(Argument(spec, place, entries, units))
                place += len(entries)
        return tuple(arguments)

    @property
    def _input_units(self) -> tuple[str, ...]:
        return tuple(INPUT_UNITS[scene_input.kind] for scene_input in self.structure.inputs)

    @property
    def n_arguments(self) -> int:
        """Number of inputs and parameters."""
        return sum(len(argument.parts) for argument in self.arguments)

    @property
    def n_inputs(self) -> int:
        """Number of inputs."""
        return len(self.manifest.input_name)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Outputs, then the margins of events, which may be outputs too."""
        specs = {function.quantity: function for function in self.manifest.functions}
        blocks: list[Block] = []
        start = 0
        for quantity, is_margin in (
            *((name, False) for name in self.outputs if name not in MARGINS),
            *((name, True) for name in MARGINS if name in specs and self.manifest_margins(name)),
        ):
            spec = specs.get(quantity)
            row = QUANTITIES[quantity]
            entries = self._parts(row.shape, spec)
            blocks.append(Block(quantity, spec, start, entries, row.unit, row.sentence, is_margin))
            start += len(entries)
        return tuple(blocks)

    def manifest_margins(self, quantity: str) -> tuple[str, ...]:
        """Return the names of the members, or nodes that can touch the ground, that a margin is of."""
        if quantity in MARGINS[2:]:
            return self.manifest.contact_name
        names = self.manifest.member_name
        mask = self.structure.tension_only if quantity == MARGINS[0] else self.structure.has_switch
        return tuple(name for name, has in zip(names, mask.tolist(), strict=True) if has)

    def _parts(self, shape: tuple[str, ...], spec: FunctionSpec | None) -> tuple[Parts, ...]:
        names_of: dict[str, Callable[[], tuple[str, ...]]] = {
            "n_nodes": lambda: self.manifest.node_name,
            "n_axes": lambda: self.axes,
            "n_members": lambda: self.manifest.member_name,
            "n_coordinates": lambda: self.manifest.coordinate_name,
            "n_inputs": lambda: self.manifest.input_name,
            "n_bar_pairs": lambda: self.manifest.bar_pair_name,
            "n_tension_only": lambda: self.manifest_margins(MARGINS[0]),
            "n_switches": lambda: self.manifest_margins(MARGINS[1]),
            "n_contacts": lambda: self.manifest.contact_name,
            "n_internal": lambda: self.manifest.internal_name,
        }
        lists: list[tuple[str | int, ...]] = []
        for k, dimension in enumerate(shape):
            names: tuple[str | int, ...] = names_of[dimension]() if dimension in names_of else ()
            size = len(names) if spec is None else spec.shape[k]
            lists.append(names if len(names) == size else tuple(range(size)))
        return tuple(itertools.product(*lists))

    @property
    def n_values(self) -> int:
        """Number of calculated values, margins included."""
        return sum(block.size for block in self.blocks)

    @property
    def margins(self) -> tuple[tuple[str, int], ...]:
        """Member or node, and kind, the place among MARGINS, of each margin."""
        return tuple(
            (name, MARGINS.index(block.quantity))
            for block in self.blocks
            if block.is_margin
            for name in self.manifest_margins(block.quantity)
        )

    def integrator(self, name: str) -> IntegratorSpec:
        """Return the integrator of that name."""
        return next(integrator for integrator in self.manifest.integrators if integrator.name == name)

    def coordinate_units(self) -> tuple[str, ...]:
        """Return the unit of each coordinate."""
        unit = self.manifest.argument("coordinate").unit
        if "," not in unit:
            return (unit,) * self.n_coordinates
        return tuple(
            "m" if name.rpartition("_")[2] in ("x", "y", "z") else "rad"
            for name in self.manifest.coordinate_name
        )


def _combine(
    over: tuple[str, ...] | None, shape: tuple[int, ...], axes: tuple[str, ...]
) -> tuple[Parts, ...]:
    """Return the names of the entries of an argument: of nodes, members or inputs, and of axes."""
    lists: list[tuple[str | int, ...]] = []
    for k, size in enumerate(shape):
        if k == 0 and over is not None and len(over) == size:
            lists.append(over)
        elif k == len(shape) - 1 and size == len(axes):
            lists.append(axes)
        else:
            lists.append(tuple(range(size)))
    return tuple(itertools.product(*lists))


MAX_OPERATIONS = 60_000  # of the C function, which compilers take some ten seconds for


@dataclass(frozen=True)
class Tangent:
    """The statements of the function, and which unknowns depend on which knowns."""

    lines: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]  # names of its arrays in C, and their owners
    outputs: tuple[tuple[str, str], ...]
    # (n_unknowns, n_knowns) of accelerations, rates of internal states and calculated values on arguments and
    # states
    pattern: NDArray[np.bool_]


def find_tangent(layout: Layout, request: ModelRequest) -> Tangent | None:
    """Return the derivatives of a unit, None if the structure is too large for straight-line code."""
    if layout.structure.n_members > MAX_MEMBERS:
        return None
    model = build_model(layout.structure, request)
    names, sources = _list_sources(layout)
    symbols = [ca.vec(model.arguments[name].symbol) for name in names]
    seeds = [ca.SX.sym(f"seed_{name}", symbol.numel()) for name, symbol in zip(names, symbols, strict=True)]
    variables, seed = ca.vertcat(*symbols), ca.vertcat(*seeds)
    unknowns = _list_unknowns(model, layout)
    results = [ca.cse(ca.densify(ca.jtimes(expression, variables, seed))) for _, _, expression in unknowns]
    function = ca.Function("tangent", [*symbols, *seeds], results)
    if count_operations(function) > MAX_OPERATIONS:
        return None
    labels = [*names, *(f"change_of_{name}" for name in names)]
    outputs = [name for name, _, _ in unknowns]
    body = print_body(function, labels, outputs)
    addresses = [*(f"{array} + {place}" for array, place in sources)]
    changes = [*(f"seed_{array} + {place}" for array, place in sources)]
    return Tangent(
        body.lines,
        tuple(zip(labels, [*addresses, *changes], strict=True)),
        tuple((name, place) for name, place, _ in unknowns),
        _compute_pattern(layout, variables, [expression for _, _, expression in unknowns]),
    )


def _list_sources(layout: Layout) -> tuple[list[str], list[tuple[str, int]]]:
    """Return the names of all arguments, and array and place of each in C."""
    n = layout.n_coordinates
    states = dict(zip(STATE, (0, n, 2 * n), strict=True))
    moving = [name for name in STATE if name != "internal" or layout.n_internal]
    names = [argument.name for argument in layout.arguments] + moving
    sources = [("argument", argument.place) for argument in layout.arguments]
    return names, [*sources, *(("state", states[name]) for name in moving)]


def _list_unknowns(model: SymbolicModel, layout: Layout) -> list[tuple[str, str, ca.SX]]:
    """Return name in C, place and expression (a column) of the rates behind velocities, and of each block."""
    unknowns = [("change_of_acceleration", "seed_acceleration", _column(model, "acceleration"))]
    if layout.n_internal:
        address = f"seed_acceleration + {layout.n_coordinates}"
        unknowns.append(("change_of_internal_rate", address, _column(model, "internal_rate")))
    for block in layout.blocks:
        if block.spec is not None:
            address = f"seed_value + {block.start}"
            unknowns.append((f"change_of_value_{block.quantity}", address, _column(model, block.quantity)))
    return unknowns


def _column(model: SymbolicModel, quantity: str) -> ca.SX:
    return ca.vec(ca.densify(model.expression(quantity)))


def _compute_pattern(layout: Layout, variables: ca.SX, unknowns: list[ca.SX]) -> NDArray[np.bool_]:
    """Return which accelerations, rates and values depend on which arguments and states."""
    everything = ca.vertcat(*unknowns)
    sparsity = ca.Function("values", [variables], [everything]).jac_sparsity(0, 0)
    rows, columns = sparsity.get_triplet()
    dependent = np.zeros((everything.numel(), variables.numel()), dtype=np.bool_)
    dependent[rows, columns] = True
    n = layout.n_coordinates + layout.n_internal
    pattern = np.zeros((n + layout.n_values, variables.numel()), dtype=np.bool_)
    pattern[:n] = dependent[:n]
    at = n
    for block in layout.blocks:
        if block.spec is not None:
            pattern[n + block.start : n + block.start + block.size] = dependent[at : at + block.size]
            at += block.size
    return pattern
