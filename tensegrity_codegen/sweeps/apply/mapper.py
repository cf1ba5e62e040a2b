"""From the values of cases to the arguments of the library that they share.

Keys that name entries of arrays are filled in for all cases at once, see direct_keys. For all others the
scene is assembled again; cases that agree in these keys share one assembly.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.sweeps.apply.assembler import (
    WITHOUT_ROWS,
    CaseAssembler,
    flatten_slots,
    hash_constants,
    list_slots,
)
from tensegrity_codegen.sweeps.apply.direct_keys import DirectKeys
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.errors import TensegrityError
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class AppliedCases:
    """Arguments of a library for some cases, and the reasons why other cases are no scene.

    arguments: (n_cases, ...) arguments that differ from case to case, by name: ``"coordinate"`` and
    ``"velocity"`` at the start, run-time parameters, ``"input"``. Other arguments have the nominal values
    of the library; messages: "" for a good case; else why the values of the case are no scene (status
    ``bad_input``). The rows of such cases in `arguments` are NaN.
    """

    arguments: dict[str, FloatArray]
    messages: tuple[str, ...]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n_cases,): which cases are scenes."""
        return np.array([not message for message in self.messages], dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class CaseGroup:
    """The cases that one library serves.

    request: the request of the scene, with the run-time parameters that the keys need; without what
    operations need, which `CaseAnalysis.needs` adds.
    """

    number: int  # place among the groups of the plan, from 0
    hash: str  # of the structure without varied numbers, and of the request: equal groups, equal libraries
    structure: Subject  # the structure of the first good case of the group, from which the library is built
    request: ModelRequest
    rows: range | NDArray[np.int64]  # numbers of its cases, ascending
    mapper: "CaseMapper" = field(repr=False)  # from values to arguments

    def arguments(self, values: FloatArray) -> AppliedCases:
        """Return the arguments of the library for cases of this group with values (n_cases, n_keys)."""
        return self.mapper(values)

    def rows_between(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the numbers of its cases from first to last - 1."""
        if isinstance(self.rows, range):
            return np.arange(max(first, self.rows.start), min(last, self.rows.stop), dtype=np.int64)
        start, stop = np.searchsorted(self.rows, [first, last])
        return self.rows[start:stop]


MAX_REST_LENGTHS_AT_ONCE = 2_000_000  # rest lengths that are computed together
MAX_CACHED_ASSEMBLIES = 50_000  # assemblies that a process keeps
OTHER_LIBRARY = "the values of this case need another library than those of its group; run it alone"


@dataclass(frozen=True, eq=False)
class CaseMapper:
    """From values to arguments; picklable.

    idle_keys: keys of `indirect_keys` that change no entry where only one of them changes; assembles_all:
    whether every case has to be assembled, since its values may be no scene although each is allowed;
    cache: entries and message of each assembly, by the bytes of the indirect keys' values.
    """

    assembler: CaseAssembler  # the scene and its keys
    base: FloatArray  # (n_keys,) values of a case of the group that is a scene
    template: Mapping[str, FloatArray]  # all slots of that case, see `list_slots`
    constants: str  # hash of all that the cases of the group have in common
    varying: IntArray  # (n_varying,) entries, of all slots in one row, that differ between cases
    direct: DirectKeys  # entries that are computed from keys without the scene being assembled
    indirect_keys: tuple[int, ...]  # keys that vary and are not direct
    parameters: Mapping[str, tuple[int, ...]]  # rows of the run-time parameters of the library, in its order
    idle_keys: tuple[int, ...] = ()
    assembles_all: bool = False
    cache: dict[bytes, tuple[FloatArray, str]] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"cache": {}}

    def __call__(self, values: FloatArray) -> AppliedCases:
        """Return the arguments of cases with these values (n_cases, n_keys)."""
        entries, messages = self.fill(np.ascontiguousarray(values, dtype=np.float64))
        return AppliedCases(self._build_arguments(entries), tuple(messages))

    def fill(self, values: FloatArray) -> tuple[FloatArray, list[str]]:
        """Return the varying entries of cases, (n_cases, n_varying), and why some have none."""
        entries = np.tile(self._flat_template[self.varying], (len(values), 1))
        messages = [""] * len(values)
        needs_own_assembly = ~self.assembler.in_bounds(values)
        if self.indirect_keys:
            # Cases of equal values share one assembly, in which direct keys have their values of the base.
            indirect_values = np.ascontiguousarray(values[:, list(self.indirect_keys)])
            for row in np.flatnonzero(~needs_own_assembly).tolist():
                entries[row], message = self._assemble_cached(indirect_values[row])
                needs_own_assembly[row] = bool(message)
        good = np.flatnonzero(~needs_own_assembly)
        needs_own_assembly[good] = ~self._fill_direct(values, good, entries)
        # A case that is no scene says why; assembled with its own direct values it may be one.
        for row in np.flatnonzero(needs_own_assembly).tolist():
            entries[row], messages[row] = self._assemble(values[row])
        return entries, messages

    def explain(self, values: FloatArray) -> str:
        """Return why a case with these values (n_keys,) is not served by the library, "" if it is."""
        return self._assemble(values)[1]

    def find_used_keys(self, arguments: Collection[str]) -> set[int]:
        """Return the keys that change one of these arguments, or the library."""
        return self.direct.find_used_keys(arguments) | (set(self.indirect_keys) - set(self.idle_keys))

    def _fill_direct(self, values: FloatArray, rows: IntArray, entries: FloatArray) -> BoolArray:
        """Fill in the entries of direct keys; return which of the rows have them, (n_rows,) of bool."""
        is_good = np.ones(len(rows), dtype=np.bool_)
        rest_lengths = self.direct.rest_lengths
        if rest_lengths is not None:
            columns = self._find_places([("rest_length", row) for row in rest_lengths.members.tolist()])
            n_at_once = max(MAX_REST_LENGTHS_AT_ONCE // len(columns), 1)
            for start in range(0, len(rows), n_at_once):
                rows_at_once = rows[start : start + n_at_once]
                computed = rest_lengths.compute(values[rows_at_once])
                entries[np.ix_(rows_at_once, columns)] = computed
                is_good[start : start + n_at_once] = ~np.isnan(computed).any(axis=1)
        # These come last: keys of arrays replace rest lengths that follow from others.
        columns = self._find_places(list(self.direct.entries))
        keys = np.array([*self.direct.entries.values()], dtype=np.int64)
        entries[np.ix_(rows, columns)] = values[np.ix_(rows, keys)]
        return is_good

    def _assemble_cached(self, indirect_values: FloatArray) -> tuple[FloatArray, str]:
        """Return the varying entries of the case of the base with these values of the indirect keys."""
        cache_key = indirect_values.tobytes()
        if cache_key not in self.cache:
            if len(self.cache) >= MAX_CACHED_ASSEMBLIES:
                self.cache.clear()
            values = self.base.copy()
            values[list(self.indirect_keys)] = indirect_values
            self.cache[cache_key] = self._assemble(values)
        return self.cache[cache_key]

    def _assemble(self, values: FloatArray) -> tuple[FloatArray, str]:
        """Return the varying entries of one case, and "" or why it has none."""
        no_entries = np.full(len(self.varying), np.nan)
        try:
            case = self.assembler.assemble(values)
        except TensegrityError as error:
            return no_entries, str(error)
        if hash_constants(case) != self.constants:
            return no_entries, OTHER_LIBRARY
        all_entries = flatten_slots(list_slots(case))
        is_constant = np.ones(len(all_entries), dtype=np.bool_)
        is_constant[self.varying] = False
        if not np.array_equal(all_entries[is_constant], self._flat_template[is_constant]):
            return no_entries, OTHER_LIBRARY
        return all_entries[self.varying], ""

    @cached_property
    def _flat_template(self) -> FloatArray:
        return flatten_slots(self.template)

    @cached_property
    def _slot_starts(self) -> dict[str, int]:
        """Start of each slot in one row of all."""
        ends = np.cumsum([array.size for array in self.template.values()]).tolist()
        return dict(zip(self.template, [0, *ends[:-1]], strict=True))

    def _find_places(self, entries: list[tuple[str, int]]) -> IntArray:
        """Return the places of entries in `varying`."""
        flat = np.array([self._slot_starts[slot] + index for slot, index in entries], dtype=np.int64)
        return np.searchsorted(self.varying, flat)

    def _build_arguments(self, entries: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments with some entry that varies, (n_cases, ...) each; NaN where no scene."""
        has_no_entries = np.isnan(entries).any(axis=1)
        arguments: dict[str, FloatArray] = {}
        for name, nominal in self.template.items():
            start = self._slot_starts[name]
            inside = (self.varying >= start) & (self.varying < start + nominal.size)
            if not inside.any():
                continue
            flat_values = np.tile(nominal.ravel(), (len(entries), 1))
            flat_values[:, self.varying[inside] - start] = entries[:, inside]
            array = flat_values.reshape(len(entries), *nominal.shape)
            array[has_no_entries] = np.nan
            used_rows = array if name in WITHOUT_ROWS else array[:, list(self.parameters[name])]
            arguments[name] = np.ascontiguousarray(used_rows)
        return arguments
