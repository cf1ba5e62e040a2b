"""A scene, and what libraries take of it, as functions of some of its numbers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import INPUT, ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import CaseAssembler, build_assembler, expand_document
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.apply.mapper import CaseGroup
from tensegrity_codegen.sweeps.cases.cases import Cases
from tensegrity_codegen.sweeps.cases.table import Table
from tensegrity_codegen.sweeps.key_schema import ANY
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_mapping, check_pair
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    FormulationError,
    InvalidValueError,
    check_choice,
)

MARGIN = 1e-4  # of a number: distance from a bound that it must not reach
STEP = 1e-5  # of a number: half the distance of the differences by which scenes are differentiated


class KeyedScene:
    """A scene as a function of some of its numbers, by the keys of sweeps.

    scene: as for `read_scene`.
    keys: numbers of the scene, or of the assembled structure, as for sweeps.
    given: further keys, whose values each state of the scene says.
    source: where `given` comes from, for errors.
    Raises UnknownKeyError, InvalidValueError, DuplicateNameError: a key that is no number of the scene, or
    has no value there; keys that change the code; a key twice; FormulationError: a scene of bodies.
    """

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        given: Sequence[str] = (),
        source: str = "",
    ) -> None:
        self.keys, self.given = tuple(keys), tuple(given)
        twice = [key for k, key in enumerate(self.keys) if key in self.keys[:k]]
        if twice:
            raise DuplicateNameError("a key twice", where="keys", given=twice[0], allowed="each key once")
        build_assembler(scene, self.given, source=source)
        self.assembler = build_assembler(scene, (*self.keys, *self.given))
        for key in self.assembler.keys[: len(self.keys)]:
            if key.bounds.is_whole:
                raise InvalidValueError(
                    "a motion has no derivative to a whole number",
                    where=self.assembler.where,
                    given=key.text,
                    allowed="numbers that can change by a little",
                )
        start = np.array([_read_start(self.assembler, k) for k in range(len(self.assembler.keys))])
        size = np.where(start != 0.0, np.abs(start), 1.0)
        self.start, self.size = start[: len(self.keys)], size[: len(self.keys)]
        self.group = self._find_group(start, size)
        self.structure = require_nodes(self.group.structure, self.assembler.where)

    def vary(self, values: FloatArray, given: FloatArray, step: float) -> FloatArray:
        """Return values (n_keys,), and these with each one larger, then smaller; (2 n_keys + 1, n_all).

        given: values of the further keys, (n_given,); step: part of the sizes at the start. A value stays
        where its key does not allow more or less.
        """
        steps = step * self.size[: len(values)]
        moved = values + np.vstack([np.zeros(len(values)), np.diag(steps), -np.diag(steps)])
        rows = np.hstack([moved, np.tile(given, (len(moved), 1))])
        outside = ~self.assembler.in_bounds(rows)
        outside[0] = False
        rows[outside, : len(values)] = values
        return rows

    def apply(self, rows: FloatArray) -> dict[str, FloatArray]:
        """Return the arguments of the library for values (n_rows, n_all), one row each.

        Raises InvalidValueError for values that make no scene.
        """
        found = self.group.arguments(rows)
        if not found.good.all():
            bad = int(np.flatnonzero(~found.good)[0])
            pairs = zip((*self.keys, *self.given), rows[bad], strict=True)
            raise InvalidValueError(
                "these values make no scene",
                where=self.assembler.where,
                given=", ".join(f"{key} = {value:g}" for key, value in pairs),
                allowed="numbers that the scene's keys allow, on both sides of these",
                hint=found.messages[bad],
            )
        return found.arguments

    def write(self, values: FloatArray) -> dict[str, Any]:
        """Return the scene with these values (n_keys,); empty for keys of the assembled structure."""
        keys = self.assembler.keys[: len(self.assembler.keys) - len(self.given)]
        if any(isinstance(key, ArrayKey) for key in keys):
            return {}
        return dict(
            CaseAssembler(self.assembler.document, self.assembler.where, keys).write(values[: len(keys)])
        )

    def _find_group(self, start: FloatArray, size: FloatArray) -> CaseGroup:
        """Return the cases near the start; raises InvalidValueError for keys that change the code."""
        keys, steps = (*self.keys, *self.given), np.diag(STEP * size)
        rows = start + np.vstack([np.zeros(len(start)), steps])
        groups = find_groups(self.assembler, Cases((), Table(keys, rows)), yes=True)
        first = next(group for group in groups if 0 in group.rows)
        others = [k for k in range(1, len(rows)) if k not in first.rows]
        if others:
            raise InvalidValueError(
                "these numbers are constants of the code, and no derivative is to them",
                where=self.assembler.where,
                given=", ".join(keys[k - 1] for k in others),
                allowed="stiffnesses, rest lengths, damping, masses and loads of nodes, gravity, positions "
                "and velocities of nodes at the start, inputs, and numbers of the ground",
                hint="masses of bars are constants, also where they follow from a density: state a mass",
            )
        return first


def read_bounds(problem: KeyedScene, given: Mapping[str, tuple[float, float]] | None) -> FloatArray:
    """Return least and largest values of the keys, (2, n_keys); raises for those that exclude the start."""
    bounds = check_mapping(given, "bounds", "least and largest value by key")
    for key in bounds:
        check_choice(key, problem.keys, "key", "bounds")
    own_keys = len(problem.assembler.keys) - len(problem.given)
    allowed = [*problem.assembler.bounds[:own_keys], *[ANY] * (len(problem.keys) - own_keys)]
    rows = []
    for key, own, start, size in zip(
        problem.keys, allowed, problem.start.tolist(), problem.size, strict=True
    ):
        pair = bounds.get(key, (own.lower, own.upper))
        low, high = check_pair(pair, f"bounds: {key}", "least and largest value")
        if not (low < high and low <= start <= high):
            raise InvalidValueError(
                "the bounds exclude the value that the search starts from",
                where=f"bounds: {key}",
                given=f"{low:g} to {high:g}",
                allowed=f"bounds around {start:g}, the value in the scene",
                hint="change the scene, or the bounds",
            )
        # An end that is not allowed itself is kept away from.
        near, far = MARGIN * size * own.lower_is_open, MARGIN * size * own.upper_is_open
        rows.append((max(low, own.lower + near), min(high, own.upper - far)))
    return np.array(rows).T


def require_nodes(subject: Subject, where: str) -> Structure:
    """Return a structure of nodes; raises FormulationError for bodies."""
    if not isinstance(subject, Structure):
        raise FormulationError(
            "numbers of bodies are not found from measurements",
            where=where,
            allowed="a scene of nodes, bars and cables",
        )
    return subject


def _read_start(assembler: CaseAssembler, place: int) -> float:
    """Return the value of a key in the scene; raises InvalidValueError where there is none."""
    key, where = assembler.keys[place], assembler.where
    value: float | None
    if isinstance(key, ArrayKey):
        if key.array == INPUT:
            return 0.0
        from tensegrity_codegen.pipeline.compile_scene import load_scene

        subject, _ = load_scene(assembler.document)
        found = np.asarray(getattr(subject, key.array))[list(key.rows)]
        found = found if key.axis < 0 else found[:, key.axis]
        if np.ptp(found) > 0.0:
            raise InvalidValueError(
                "the entries of this key differ in the scene, and it would give them all one value",
                where=where,
                given=key.text,
                allowed="a key whose entries are equal at the start",
                hint="one key for each, or a number of the scene that they follow from",
            )
        return float(found[0])
    document = expand_document(assembler.document, where) if key.is_from_shape else assembler.document
    value = key.path.read(document)
    if value is None:
        raise InvalidValueError(
            "the scene does not state this number, so that there is no value to start from",
            where=where,
            given=key.text,
            allowed="numbers that the scene states",
            hint=f"write {key.text} into the scene",
        )
    return float(value)
