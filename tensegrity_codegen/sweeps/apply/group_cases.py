"""Groups of cases that share a library: some are assembled, and compared in all that is constant."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from tensegrity_codegen.analyses.cases.quantities import GUST, GUST_TIME, OF_LOOPS
from tensegrity_codegen.sweeps.apply.array_keys import ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import (
    STATE,
    AssembledCase,
    CaseAssembler,
    flatten_slots,
    hash_constants,
    list_slots,
    name_changed,
)
from tensegrity_codegen.sweeps.apply.direct_keys import NO_DIRECT_KEYS, DirectKeys, find_direct_keys
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup, CaseMapper
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.system.arrays import FloatArray, IntArray
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError

MOST_LIBRARIES = 50  # without an express yes
MOST_CONFIRMED = 1000  # with it
MOST_TRIED = 300  # cases that are tried before a sweep without a good one is given up
BLOCK = 65_536  # cases that are looked at together
ROUNDED = 1e-12  # part by which rest lengths may differ from those of the assembled scene
MOST_KEYS_ALONE = 60  # keys whose least and largest values are tried


@dataclass(frozen=True, eq=False)
class _Probe:
    """One set of values (n_keys,), the structure that they make, and the hash of its constants."""

    values: FloatArray
    case: AssembledCase
    constants: str

    @property
    def entries(self) -> FloatArray:
        """All slots in one row."""
        return flatten_slots(list_slots(self.case))


def find_groups(
    assembler: CaseAssembler, cases: Cases, *, yes: bool = False, option: str = "yes"
) -> tuple[CaseGroup, ...]:
    """Return the cases by the library that they share, those that are no scene with their neighbours."""
    finder = _GroupFinder(assembler, cases)
    probes = finder.try_rows(range(cases.count))
    keys = finder.find_code_keys(probes)
    if not keys:
        return (finder.build_group(0, probes, range(cases.count)),)
    row_sets = finder.divide(keys, probes, yes, option)
    return tuple(
        finder.build_group(number, finder.try_rows(rows), rows, keys) for number, rows in enumerate(row_sets)
    )


class _GroupFinder:
    def __init__(self, assembler: CaseAssembler, cases: Cases) -> None:
        self.assembler, self.cases = assembler, cases
        self.random = np.random.default_rng(20)
        self.first_error: TensegrityError | None = None

    def probe(self, values: FloatArray) -> _Probe | None:
        """Return the structure of these values, None if they are no scene."""
        try:
            case = self.assembler.assemble(values)
        except TensegrityError as error:
            self.first_error = self.first_error or error
            return None
        return _Probe(np.array(values), case, hash_constants(case))

    def try_rows(self, rows: range | IntArray) -> list[_Probe]:
        """Return probes of some of these cases that are scenes; raises the first error if none is."""
        count = len(rows)
        spread = [0, count - 1, *self.random.integers(0, count, MOST_TRIED).tolist()]
        tried = list(dict.fromkeys(spread))
        good: list[_Probe] = []
        for index in tried:
            number = int(rows[index])
            probe = self.probe(self.cases.values(number, number + 1)[0])
            if probe is not None:
                good.append(probe)
            if len(good) == 4:
                break
        if not good:
            self._raise_nothing_good(len(tried))
        return good

    def _raise_nothing_good(self, tried: int) -> None:
        assert self.first_error is not None
        count = f"none of {tried} cases" if tried < self.cases.count else "no case"
        self.first_error.problem = (
            f"{count} of the sweep is a scene; the first one: {self.first_error.problem}"
        )
        raise self.first_error

    def find_code_keys(self, probes: Sequence[_Probe]) -> tuple[int, ...]:
        """Return the keys of which the constants of the library depend, () where all probes share one."""
        if len({probe.constants for probe in probes}) == 1:
            return ()
        base = probes[0]
        code_keys = [
            key
            for key in range(len(self.assembler.keys))
            if any(
                second.values[key] != base.values[key] and self._differs(base, key, second.values[key])
                for second in probes[1:]
            )
        ]
        return tuple(code_keys) or tuple(range(len(self.assembler.keys)))

    def _change_key(self, base: _Probe, key: int, value: float) -> _Probe | None:
        values = base.values.copy()
        values[key] = value
        return self.probe(values)

    def _differs(self, base: _Probe, key: int, value: float) -> bool:
        probe = self._change_key(base, key, value)
        return probe is not None and probe.constants != base.constants

    def divide(
        self, keys: tuple[int, ...], probes: Sequence[_Probe], yes: bool, option: str
    ) -> list[range | IntArray]:
        """Return the cases of each library, those that are no scene with the cases of the first one."""
        limit = MOST_CONFIRMED if yes else MOST_LIBRARIES
        option = "" if yes else option
        labels, sets = self._label_sets(keys, 20 * limit)
        if not labels.size:
            self._refuse(keys, probes, limit, option)
        hashes: list[str] = []
        distinct: dict[str, int] = {}
        for number in range(len(sets)):
            hashes.append(self._hash_set(labels, number))
            if hashes[-1]:
                distinct.setdefault(hashes[-1], len(distinct))
            if len(distinct) > limit:
                self._refuse(keys, probes, limit, option)
        if not distinct:
            self._raise_nothing_good(min(MOST_TRIED, self.cases.count))
        group = np.array([distinct[digest] if digest else 0 for digest in hashes], dtype=np.int64)
        row_sets: list[range | IntArray] = []
        for number in range(len(distinct)):
            rows = np.flatnonzero(group[labels] == number)
            is_whole = len(rows) > 0 and rows[-1] - rows[0] + 1 == len(rows)
            row_sets.append(range(int(rows[0]), int(rows[-1]) + 1) if is_whole else rows)
        return row_sets

    def _label_sets(self, keys: tuple[int, ...], most: int | None) -> tuple[IntArray, dict[bytes, int]]:
        """Return the number of the set of values of each case, and the sets; no numbers if too many."""
        sets: dict[bytes, int] = {}
        labels = np.empty(self.cases.count, dtype=np.int64)
        for start in range(0, self.cases.count, BLOCK):
            stop = min(start + BLOCK, self.cases.count)
            values = np.ascontiguousarray(self.cases.values(start, stop)[:, keys])
            unique, inverse = np.unique(values, axis=0, return_inverse=True)
            numbers = [sets.setdefault(row.tobytes(), len(sets)) for row in unique]
            labels[start:stop] = np.array(numbers, dtype=np.int64)[inverse.ravel()]
            if most is not None and len(sets) > most:
                return labels[:0], sets
        return labels, sets

    def _hash_set(self, labels: IntArray, number: int) -> str:
        """Return the hash of the constants of a set of values, "" if no case with it is a scene."""
        rows = np.flatnonzero(labels == number)
        for row in rows[:: max(len(rows) // 8, 1)][:8].tolist():
            probe = self.probe(self.cases.values(row, row + 1)[0])
            if probe is not None:
                return probe.constants
        return ""

    def _refuse(self, keys: tuple[int, ...], probes: Sequence[_Probe], most: int, option: str) -> None:
        names = ", ".join(self.assembler.keys[key].text for key in keys)
        changes = (name_changed(probes[0].case, probe.case) for probe in probes[1:])
        changed = next((names for names in changes if names), [])
        reason = f", since {' and '.join(changed)} cannot change at run time" if changed else ""
        raise InvalidValueError(
            f"more than {most:,} libraries for the values of {names}{reason}",
            where=self.assembler.where,
            allowed=f"up to {most:,} libraries"
            + (f"; up to {MOST_CONFIRMED:,} with {option}" if option else ""),
            hint="give bars a mass in place of a density"
            if changed == ["member_mass"] and not any("density" in self.assembler.keys[k].text for k in keys)
            else f"fewer values, as {self.assembler.keys[keys[0]].text}=a,b,c",
        )

    def build_group(
        self, number: int, probes: Sequence[_Probe], rows: range | IntArray, keys: tuple[int, ...] = ()
    ) -> CaseGroup:
        """Return the group of some cases; keys: those that other groups differ in."""
        base, slots = probes[0], list_slots(probes[0].case)
        ends, varies = self._find_ends(rows)
        at_ends = [self.probe(row) for row in ends]
        # Gusts of all cases are arguments too, since no scene has one.
        arrays = [key.array if isinstance(key, ArrayKey) else "" for key in self.assembler.keys]
        gusts = (k for k, array in enumerate(arrays) if array in (GUST, GUST_TIME))
        of_keys = sorted({*varies, *keys, *gusts})
        direct = find_direct_keys(base.case, self.assembler.keys, base.values, of_keys)
        indirect = [k for k in of_keys if k not in direct.keys]
        tried = [base, *(probe for probe in (*probes, *at_ends) if probe is not None)]
        varying = _find_varying(tried, slots, direct)
        parameters = _choose_parameters(base.case, slots, varying)
        mapper = CaseMapper(
            assembler=self.assembler,
            base=base.values,
            template=slots,
            constants=base.constants,
            varying=varying,
            direct=direct,
            indirect_keys=tuple(indirect),
            parameters=parameters,
            idle_keys=tuple(k for k in indirect if k not in keys and self._is_idle(k, base, ends)),
        )
        if not _agrees(mapper, ends, at_ends):
            every = tuple(range(len(base.values)))
            mapper = replace(
                mapper, direct=NO_DIRECT_KEYS, indirect_keys=every, idle_keys=(), assembles_all=True
            )
        request = replace(base.case.request, parameters=parameters)
        return CaseGroup(number, base.constants, base.case.subject, request, rows, mapper)

    def _is_idle(self, key: int, base: _Probe, ends: FloatArray) -> bool:
        """Return whether neither end of a key, changed alone, changes an entry or the library."""
        for value in {ends[:, key].min(), ends[:, key].max()}:
            probe = self._change_key(base, key, value)
            if probe is None or probe.constants != base.constants:
                return False
            if not np.array_equal(probe.entries, base.entries):
                return False
        return True

    def _find_ends(self, rows: range | IntArray) -> tuple[FloatArray, list[int]]:
        """Return allowed cases with the limits of the first MOST_KEYS_ALONE keys, and varying keys."""
        lower = np.full(len(self.cases.keys), np.inf)
        upper, at = -lower, np.full((2, len(lower)), -1)
        for start in range(0, len(rows), BLOCK):
            numbers = np.asarray(rows[start : start + BLOCK], dtype=np.int64)
            values = self.cases.select(numbers)
            inside = self.assembler.in_bounds(values)
            if not inside.any():
                continue
            values, numbers = values[inside], numbers[inside]
            for sign, best in ((1, lower), (-1, upper)):
                index = (sign * values).argmin(axis=0)
                extreme = values[index, np.arange(values.shape[1])]
                better = sign * extreme < sign * best
                best[better] = extreme[better]
                at[(1 - sign) // 2, better] = numbers[index][better]
        ends = at[:, :MOST_KEYS_ALONE]
        return self.cases.select(np.unique(ends[ends >= 0])), np.flatnonzero(lower < upper).tolist()


def _find_varying(probes: Sequence[_Probe], slots: Mapping[str, FloatArray], direct: DirectKeys) -> IntArray:
    """Return the entries that differ between probes or follow from direct keys, and non-zero inputs."""
    starts = dict(zip(slots, accumulate((array.size for array in slots.values()), initial=0), strict=False))
    entries = list(direct.entries)
    if direct.rest_lengths is not None:
        entries += [("rest_length", row) for row in direct.rest_lengths.members.tolist()]
    named = np.array([starts[slot] + index for slot, index in entries], dtype=np.int64)
    named = np.concatenate([named, starts["input"] + np.flatnonzero(slots["input"])])
    same = np.array([probe.entries for probe in probes if probe.constants == probes[0].constants])
    return np.union1d(named, np.flatnonzero((same != same[0]).any(axis=0)))


def _agrees(mapper: CaseMapper, values: FloatArray, probes: Sequence[_Probe | None]) -> bool:
    """Return whether cases (n_cases, n_keys) have the entries of the scenes that they are assembled to."""
    entries, messages = mapper.fill(values)
    for filled, message, probe in zip(entries, messages, probes, strict=True):
        is_served = probe is not None and probe.constants == mapper.constants
        if is_served == bool(message):
            return False
        if probe is None or not is_served:
            continue
        if not np.allclose(filled, probe.entries[mapper.varying], rtol=ROUNDED, atol=0.0):
            return False
    return True


def _choose_parameters(
    case: AssembledCase, slots: Mapping[str, FloatArray], varying: IntArray
) -> dict[str, tuple[int, ...]]:
    """Return the run-time parameters of the scene, and those that hold entries that vary."""
    parameters = dict(case.request.parameters)
    start = 0
    for name, array in slots.items():
        inside = varying[(varying >= start) & (varying < start + array.size)] - start
        start += array.size
        if not len(inside) or (name in (*STATE, *OF_LOOPS) and name != GUST):
            continue
        if name == "gravity":
            parameters[name] = ()
        else:
            argument = "node_load" if name == GUST else name
            rows = set((inside // (array.size // len(array))).tolist())
            if name == "node_load":  # those that stay grow from zero with those that vary
                rows |= set(np.flatnonzero(array.any(axis=1)).tolist())
            parameters[argument] = tuple(sorted({*parameters.get(argument, ()), *rows}))
    return parameters
