"""From the values of cases to the arguments of the library that they share.

Entries that equal a key, or a multiple of it, are filled for all cases at once, and so are rest lengths that
follow from prestress, strain or positions. Others, such as positions that follow from an angle, are taken
from the assembled structure of each case; cases that agree in the keys that matter for them share one
assembly. In every call one case is assembled as a whole and compared; were it to differ, all cases of the
call would be assembled.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tensegrity_codegen.sweeps.apply.assembler import CaseAssembler
from tensegrity_codegen.sweeps.apply.group import AppliedCases
from tensegrity_codegen.sweeps.apply.relations import Relations
from tensegrity_codegen.sweeps.apply.rest_lengths import SAME, RestLengths
from tensegrity_codegen.sweeps.apply.slots import STATE, hash_constants, list_slots
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import TensegrityError

BLOCK = 2_000_000  # numbers of slots that are computed together
MOST_KEPT = 50_000  # assemblies that a process remembers
OTHER_LIBRARY = "the values of this case need another library than those of its group; run it alone"


@dataclass(frozen=True, eq=False)
class CaseMapper:
    """From values to arguments; picklable.

    Attributes
    ----------
    assembler : CaseAssembler
        The scene and its keys.
    base : ndarray, shape (n_keys,)
        Values of a case of the group that is a scene.
    template : mapping of str to ndarray
        All slots of a case of the group, see `list_slots`.
    constants : str
        Hash of what the cases of the group have in common.
    varying : ndarray of int, shape (n_varying,)
        Entries, of all slots in one row, that differ between cases.
    relations : Relations
        Those of `varying` that follow from one key each, by their places in it.
    rest_lengths : RestLengths or None
        Rest lengths that follow by formulas.
    rest_places : ndarray of int
        Their places in `varying`.
    indirect : ndarray of int
        The other places of `varying`.
    indirect_keys : tuple of int
        Keys that those depend on, and keys in which groups differ; values of these are always assembled.
    parameters : mapping of str to tuple of int
        Rows of the run-time parameters of the library, in its order.
    seen_keys : tuple of int
        Keys of which cases with different values were tried.
    assembles_all : bool
        Whether every case has to be assembled, since its values may be no scene although each is allowed.
    """

    assembler: CaseAssembler
    base: FloatArray
    template: Mapping[str, FloatArray]
    constants: str
    varying: IntArray
    relations: Relations
    rest_lengths: RestLengths | None
    rest_places: IntArray
    indirect: IntArray
    indirect_keys: tuple[int, ...]
    parameters: Mapping[str, tuple[int, ...]]
    seen_keys: tuple[int, ...] = ()
    assembles_all: bool = False
    kept: dict[bytes, tuple[FloatArray, str]] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"kept": {}}

    def __call__(self, values: FloatArray) -> AppliedCases:
        """Return the arguments of cases with these values (n_cases, n_keys)."""
        values = np.ascontiguousarray(values, dtype=np.float64)
        if self.assembles_all:
            return self._assemble_all(values)
        entries, messages = self.fill(values)
        if not self._is_confirmed(values, entries, messages):
            return self._assemble_all(values)
        return AppliedCases(self._spread(entries), tuple(messages))

    def fill(self, values: FloatArray) -> tuple[FloatArray, list[str]]:
        """Return the varying entries of cases, (n_cases, n_varying), and why some have none."""
        entries = np.full((len(values), len(self.varying)), np.nan)
        messages = [""] * len(values)
        inside = self.assembler.in_bounds(values)
        for row in np.flatnonzero(~inside).tolist():
            entries[row], messages[row] = self._assemble(values[row])
        good = np.flatnonzero(inside)
        entries[np.ix_(good, self.relations.entries)] = self.relations.compute(values[good])
        self._fill_indirect(values, good, entries, messages)
        self._fill_rest_lengths(values, good, entries, messages)
        return entries, messages

    def explain(self, values: FloatArray) -> str:
        """Return why a case with these values (n_keys,) is not served by the library, "" if it is."""
        return self._assemble(values)[1]

    def find_used_keys(self, arguments: Collection[str]) -> set[int]:
        """Return the keys that change one of these arguments, or the library."""
        names = [name for name, array in self.template.items() for _ in range(array.size)]
        related = zip(
            self.relations.keys.tolist(), self.varying[self.relations.entries].tolist(), strict=True
        )
        needed, used = set(arguments), set(self.indirect_keys)
        if self.rest_lengths is not None and "rest_length" in arguments:
            needed |= set(self.rest_lengths.slots)
            for relations in self.rest_lengths.relations.values():
                used |= set(relations.keys.tolist())
        return used | {key for key, entry in related if names[entry] in needed}

    def fails_alone(self, values: FloatArray) -> bool:
        """Return whether the keys that are always assembled make a case fail, whatever the others are."""
        rest = self.base.copy()
        chosen = list(self.indirect_keys)
        rest[chosen] = values[chosen]
        return bool(chosen) and bool(self.explain(rest))

    def _assemble_all(self, values: FloatArray) -> AppliedCases:
        found = [self._assemble(row) for row in values]
        entries = np.array([part for part, _ in found]).reshape(len(values), len(self.varying))
        return AppliedCases(self._spread(entries), tuple(text for _, text in found))

    def _assemble(self, values: FloatArray) -> tuple[FloatArray, str]:
        """Return the varying entries of one case, and "" or why it has none."""
        nothing = np.full(len(self.varying), np.nan)
        try:
            case = self.assembler.assemble(values)
        except TensegrityError as error:
            return nothing, str(error)
        if hash_constants(case) != self.constants:
            return nothing, OTHER_LIBRARY
        whole = np.concatenate([part.ravel() for part in list_slots(case).values()])
        is_constant = np.ones(len(whole), dtype=np.bool_)
        is_constant[self.varying] = False
        if not np.array_equal(whole[is_constant], self._flat_template[is_constant]):
            return nothing, OTHER_LIBRARY
        return whole[self.varying], ""

    def _fill_indirect(
        self, values: FloatArray, rows: IntArray, entries: FloatArray, messages: list[str]
    ) -> None:
        """Fill the entries that follow from structures; cases of equal values share one."""
        if not self.indirect_keys:
            return
        chosen = np.ascontiguousarray(values[:, list(self.indirect_keys)])
        for row in rows.tolist():
            name = chosen[row].tobytes()
            if name not in self.kept:
                found, text = self._assemble(values[row])
                if text and not self.fails_alone(values[row]):
                    entries[row], messages[row] = np.nan, text
                    continue
                if len(self.kept) >= MOST_KEPT:
                    self.kept.clear()
                self.kept[name] = found[self.indirect], text
            entries[row, self.indirect], messages[row] = self.kept[name]
            if messages[row]:
                entries[row] = np.nan

    def _fill_rest_lengths(
        self, values: FloatArray, rows: IntArray, entries: FloatArray, messages: list[str]
    ) -> None:
        """Fill the rest lengths that follow by formulas; where there is none, the structure says why."""
        if self.rest_lengths is None:
            return
        rows = rows[[not messages[row] for row in rows.tolist()]]
        size = max(BLOCK // sum(array.size for array in self.template.values()), 1)
        for first in range(0, len(rows), size):
            part = rows[first : first + size]
            slots = {name: self._slot(name, entries[part]) for name in self.rest_lengths.slots}
            found = self.rest_lengths.compute(values[part], slots)
            entries[np.ix_(part, self.rest_places)] = found
            for row in part[np.isnan(found).any(axis=1)].tolist():
                entries[row], messages[row] = self._assemble(values[row])

    def _is_confirmed(self, values: FloatArray, entries: FloatArray, messages: list[str]) -> bool:
        """Return whether one of the cases, assembled, has just these entries."""
        good = [row for row, text in enumerate(messages) if not text]
        if not good:
            return True
        row = good[len(good) * 5 // 8]
        alone, text = self._assemble(values[row])
        exact = np.ones(len(self.varying), dtype=np.bool_)
        exact[self.rest_places] = False
        return (
            not text
            and np.array_equal(alone[exact], entries[row, exact])
            and np.allclose(alone[~exact], entries[row, ~exact], rtol=SAME, atol=0.0)
        )

    @property
    def _flat_template(self) -> FloatArray:
        return np.concatenate([part.ravel() for part in self.template.values()])

    def _slot(self, name: str, entries: FloatArray) -> FloatArray:
        """Return the values of a slot in cases with these varying entries, (n_cases, ...)."""
        start = 0
        for other, array in self.template.items():
            if other == name:
                break
            start += array.size
        nominal = self.template[name]
        inside = (self.varying >= start) & (self.varying < start + nominal.size)
        result = np.tile(nominal.ravel(), (len(entries), 1))
        result[:, self.varying[inside] - start] = entries[:, inside]
        return result.reshape(len(entries), *nominal.shape)

    def _spread(self, entries: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments of which some entry varies, (n_cases, ...) each."""
        owner = np.array([name for name, array in self.template.items() for _ in range(array.size)])
        varies = set(owner[self.varying].tolist())
        bad = np.isnan(entries).any(axis=1)
        arguments: dict[str, FloatArray] = {}
        for name in self.template:
            if name in varies:
                array = self._slot(name, entries)
                array[bad] = np.nan
                chosen = array if name in (*STATE, "gravity") else array[:, list(self.parameters[name])]
                arguments[name] = np.ascontiguousarray(chosen)
        return arguments
