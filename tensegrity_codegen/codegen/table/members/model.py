"""A structure as index tables: where each node's coordinates are, and which values are arguments.

Unrolled expressions examine symbols; this examines integers.
"""

from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.assembly import plan_assembly
from tensegrity_codegen.structure.inertia_plan import InertiaPlan
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.arguments import check_parameters, describe_argument, nominal_value
from tensegrity_codegen.symbolic.formulations.rigid_bar import WORDS
from tensegrity_codegen.symbolic.model import Frame, ModelArgument, frame_structure
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.quantities import ARGUMENTS
from tensegrity_codegen.tables.request import ModelRequest


class TableModel:
    """The structure as loops over its members in node positions read it.

    quantities: names of all quantities that loops over tables serve in this formulation. Indices are -1 where
    there is nothing: no coordinate of an anchored node, no argument of a constant.
    """

    def __init__(self, structure: Structure, request: ModelRequest, quantities: tuple[str, ...]) -> None:
        check_parameters(request.parameters)
        self.structure = self.subject = structure
        self.name = structure.name
        self.quantities = quantities
        self.formulation = request.formulation
        self.has_rigid_bars = find_formulation(request.formulation).has_rigid_bars
        self.parameters = request.parameters
        self.words: dict[str, tuple[str, str]] = dict(WORDS) if self.has_rigid_bars else {}
        self.axes = list(structure.axes)
        self.n_axes = len(self.axes)
        self.plan = plan_assembly(structure, request.parameters)
        self.ends = structure.connectivity.reshape(-1, 2)
        self.inertia = InertiaPlan(structure)

    @cached_property
    def is_elastic(self) -> NDArray[np.bool_]:
        """(n_members,): whether a member has a stiffness; rigid bars have none."""
        is_elastic = np.zeros(self.structure.n_members, dtype=np.bool_)
        for group in self.plan.groups:
            is_elastic[group.member] = group.member_class.is_elastic
        return is_elastic

    @cached_property
    def frame(self) -> Frame:
        """Frame of the results."""
        frame = frame_structure(self.structure)
        if not self.has_rigid_bars:
            return frame
        rigid = np.flatnonzero(self.structure.is_rigid)
        return replace(frame, rigid_bar=tuple(self.structure.member_name[e] for e in rigid))

    @cached_property
    def arguments(self) -> dict[str, ModelArgument]:
        """All arguments in the order of C signatures, with the scene's values and without symbols."""
        always = {"coordinate", "velocity", "input", *(("internal",) if self.structure.internal_name else ())}
        names = [n for n in ARGUMENTS if n in self.parameters or n in always]
        return {
            name: ModelArgument(
                ca.SX(),
                *nominal_value(self.structure, self.parameters, name),
                *describe_argument(self.structure, name),
            )
            for name in names
        }

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(n_nodes, n_axes): whether a node is free along a modelled axis."""
        return np.asarray(~self.structure.node_anchored[:, self.axes])

    @cached_property
    def coordinate(self) -> IntArray:
        """(n_nodes, n_axes): index of each free coordinate."""
        return number_places(self.free)

    @cached_property
    def anchored(self) -> IntArray:
        """(n_nodes, n_axes): index of each anchored coordinate."""
        return number_places(~self.free)

    @property
    def n_coordinates(self) -> int:
        """Number of free coordinates."""
        return int(self.free.sum())

    def argument_index(self, name: str) -> IntArray:
        """Return (n_nodes,) or (n_members,): position of each node or member in the argument `name`."""
        of_nodes = name in ("node_mass", "node_load", "anchor_position")
        index = np.full(self.structure.n_nodes if of_nodes else self.structure.n_members, -1)
        chosen = list(self.parameters.get(name, ()))
        index[chosen] = np.arange(len(chosen))
        return index

    @cached_property
    def place(self) -> IntArray:
        """(n_nodes, n_axes): coordinate of a free component; -1 - k for entry k of the held positions.

        Held positions are those in the argument `anchor_position`, then the constant ones `held_position`.
        """
        chosen = self.argument_index("anchor_position")
        offset = self.n_axes * int((chosen >= 0).sum())
        argument = self.n_axes * chosen[:, None] + np.arange(self.n_axes)
        constant = offset + number_places(~self.free & (chosen < 0)[:, None])
        return np.where(self.free, self.coordinate, -1 - np.where(chosen[:, None] >= 0, argument, constant))

    @cached_property
    def held_position(self) -> FloatArray:
        """(k,): constant positions of anchored components, node by node [m]."""
        constant = ~self.free & (self.argument_index("anchor_position") < 0)[:, None]
        held: FloatArray = self.structure.node_position[:, self.axes][constant]
        return held

    @property
    def gravity(self) -> FloatArray:
        """(n_axes,): the scene's gravity [m/s2]."""
        gravity: FloatArray = self.structure.gravity[self.axes]
        return gravity

    @cached_property
    def coordinate_node(self) -> IntArray:
        """(n_coordinates,): node of each free coordinate."""
        return np.nonzero(self.free)[0]

    @cached_property
    def diagonal_mass(self) -> FloatArray:
        """(n_nodes,): mass of each node on the diagonal of the mass matrix, with those of its bars [kg]."""
        return self.structure.node_mass + self.inertia.diagonal_share

    @cached_property
    def mass_argument(self) -> IntArray:
        """(n_coordinates,): entry of `node_mass` of the node of each coordinate, -1 for a constant mass."""
        return self.argument_index("node_mass")[self.coordinate_node]

    @cached_property
    def weight_mass(self) -> FloatArray:
        """(n_nodes,): mass whose weight each node carries, with the scene's own values [kg]."""
        return self.structure.node_mass + self.inertia.weight_share

    @cached_property
    def force_inputs(self) -> list[tuple[int, int, FloatArray]]:
        """Input, node and direction (n_axes,) of each force of an input, in the order of the inputs."""
        return [
            (number, target, np.array(source.direction)[self.axes])
            for number, source in enumerate(self.structure.inputs)
            if source.kind == "force"
            for target in source.targets
        ]

    @cached_property
    def force_input_table(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Those of node n are entries start[n] to start[n + 1]: start (n_nodes + 1,), input and direction."""
        node = np.array([node for _, node, _ in self.force_inputs], dtype=np.int64)
        order = np.argsort(node, kind="stable")
        start = np.searchsorted(node[order], np.arange(self.structure.n_nodes + 1))
        inputs = np.array([number for number, _, _ in self.force_inputs], dtype=np.int64)[order]
        direction = np.array([vector for _, _, vector in self.force_inputs]).reshape(-1, self.n_axes)[order]
        return start, inputs, direction

    @cached_property
    def rest_inputs(self) -> tuple[IntArray, IntArray, FloatArray]:
        """(k,): member, input and gain of each rest length that an input changes, member by member."""
        targets = [
            (target, number, gain)
            for number, source in enumerate(self.structure.inputs)
            for target, gain in source.rest_length_gain.items()
        ]
        table = np.array(targets).reshape(-1, 3)
        table = table[np.argsort(table[:, 0], kind="stable")]
        return table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2]

    @property
    def n_held_arguments(self) -> int:
        """Number of entries of the argument `anchor_position`."""
        return self.n_axes * len(self.parameters.get("anchor_position", ()))


def number_places(mask: NDArray[np.bool_]) -> IntArray:
    """Return the running number of each true entry in C order, -1 elsewhere."""
    number = np.cumsum(mask.reshape(-1)).reshape(mask.shape) - 1
    return np.where(mask, number, -1)
