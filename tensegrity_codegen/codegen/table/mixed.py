"""Quantities of the mixed form: forces of cables alone, laws of members as a table of numbers."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tensegrity_codegen.codegen.table.members.access import AddToNodes
from tensegrity_codegen.codegen.table.members.model import TableModel
from tensegrity_codegen.codegen.table.members.stage import Recipe, loop
from tensegrity_codegen.codegen.table.members.writer import Writer
from tensegrity_codegen.system.arrays import FloatArray, IntArray

CHANGEABLE = ("rest_length", "spring_constant", "axial_stiffness", "damping")


@dataclass(frozen=True)
class AddCablesToNodes(AddToNodes):
    """Adds the pull of members that are not part of the mixed form."""

    def select(self, model: TableModel, member: IntArray) -> IntArray:
        """Return the members that touch a wanted node and whose tension is no unknown."""
        chosen = super().select(model, member)
        return chosen[~model.structure.is_mixed[chosen]]


def member_law(model: TableModel) -> Recipe:
    """Return how rest length, spring constant, damping and anchored part of d_e come about."""
    return Recipe((3 + model.n_axes, model.structure.n_members), (FillLaws(model),))


@dataclass(frozen=True)
class FillLaws:
    """Fills `member_law`: constants from a table, then what arguments and inputs change."""

    model: TableModel

    @property
    def width(self) -> int:
        """Numbers a member."""
        return 3 + self.model.n_axes

    @cached_property
    def stretched(self) -> list[tuple[int, int, float]]:
        """Entry of a rest length, the input that is added to it, and its gain."""
        return [
            (self.width * target, number, gain)
            for number, item in enumerate(self.model.structure.inputs)
            for target, gain in item.rest_length_gain.items()
        ]

    @cached_property
    def anchors(self) -> list[tuple[int, int, int]]:
        """Entry of an anchored part, its sign and the entry of `anchor_position` that makes it."""
        model, found = self.model, []
        at = model.argument_index("anchor_position")
        for e, ends in enumerate(model.ends.tolist()):
            for node, sign in zip(ends, (1, -1), strict=True):
                for k in np.flatnonzero(~model.free[node]).tolist() if at[node] >= 0 else []:
                    found.append((self.width * e + 3 + k, sign, model.n_axes * int(at[node]) + k))
        return found

    @property
    def arguments(self) -> frozenset[str]:
        """Names of the arguments that it reads."""
        used = {name for name in CHANGEABLE if name in self.model.parameters}
        return frozenset(
            used | ({"input"} if self.stretched else set()) | ({"anchor_position"} if self.anchors else set())
        )

    @property
    def operations(self) -> int:
        """Floating-point operations."""
        axial = 2 * int(self._axial.sum())
        return axial + len(self.stretched) + len(self.anchors)

    @cached_property
    def _axial(self) -> np.ndarray:
        structure = self.model.structure
        return np.asarray(
            (structure.axial_stiffness != 0) | (self.model.argument_index("axial_stiffness") >= 0)
        )

    def _constants(self) -> FloatArray:
        """Return what no argument changes; the spring constant without EA / rho."""
        model, s = self.model, self.model.structure
        held = np.where(model.free, 0.0, s.node_position[:, model.axes])
        held[model.argument_index("anchor_position") >= 0] = 0.0
        offset = held[model.ends[:, 0]] - held[model.ends[:, 1]]
        return np.column_stack([s.rest_length, s.spring_constant, s.damping, offset])

    @property
    def repeats(self) -> int:
        """Members."""
        return self.model.structure.n_members

    def write(self, writer: Writer) -> list[str]:
        """Return the loops."""
        width, values = self.width, self._constants().ravel()
        lines = loop(
            "k", len(values), [f"member_law[k] = {writer.real_at('member_law_constant', values, 'k')};"]
        )
        for name, column in (("rest_length", 0), ("spring_constant", 1), ("damping", 2)):
            chosen = self.model.parameters.get(name, ())
            entry = width * np.array(chosen, dtype=np.int64) + column
            lines += self._assign(writer, f"law_{name}", entry, f"{name}[n]", "=")
        to = np.array([entry for entry, _, _ in self.stretched], dtype=np.int64)
        which = np.array([number for _, number, _ in self.stretched], dtype=np.int64)
        if len(to):
            gain = np.array([gain for _, _, gain in self.stretched])
            source = f"input[{writer.index_at('law_input', which, 'n')}]"
            source = writer.scaled("law_gain", gain, "n", source)
            lines += self._assign(writer, "law_stretched", to, source, "+=")
        for sign, mark in ((1, "+="), (-1, "-=")):
            part = [(entry, source) for entry, s, source in self.anchors if s == sign]
            if part:
                entry, source = np.array(part, dtype=np.int64).T
                name = "first" if sign > 0 else "second"
                text = f"anchor_position[{writer.index_at(f'law_anchor_{name}', source, 'n')}]"
                lines += self._assign(writer, f"law_{name}_end", entry, text, mark)
        return lines + self._add_axial(writer) + self._stiffen(writer)

    def _assign(self, writer: Writer, name: str, entry: IntArray, source: str, mark: str) -> list[str]:
        if not len(entry):
            return []
        return loop("n", len(entry), [f"member_law[{writer.index_at(name, entry, 'n')}] {mark} {source};"])

    def _add_axial(self, writer: Writer) -> list[str]:
        """Return the loop that adds EA / rho to spring constants."""
        member = np.flatnonzero(self._axial)
        if not len(member):
            return []
        at = self.model.argument_index("axial_stiffness")[member]
        index = writer.index_at("law_axial_at", at, "n") if (at >= 0).any() else ""
        stiffness = f"axial_stiffness[{index}]"
        if (at < 0).any():
            constant = writer.real_at("law_axial", self.model.structure.axial_stiffness[member], "n")
            stiffness = f"({index} >= 0 ? {stiffness} : {constant})" if index else constant
        entry = writer.index_at("law_axial_entry", self.width * member, "n")
        return loop("n", len(member), [f"member_law[{entry} + 1] += {stiffness} / member_law[{entry}];"])

    def _stiffen(self, writer: Writer) -> list[str]:
        """Return the loop that makes spring constants the largest slopes of laws that are not linear."""
        factor = self.model.structure.largest_slope()
        member = np.flatnonzero(factor != 1.0)
        if not len(member):
            return []
        entry = writer.index_at("law_slope_entry", self.width * member, "n")
        slope = writer.real_at("law_slope", factor[member], "n")
        return loop("n", len(member), [f"member_law[{entry} + 1] *= {slope};"])
