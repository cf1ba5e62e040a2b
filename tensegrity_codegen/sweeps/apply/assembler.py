"""The structure of one case: the scene, a plain dictionary that keys read and write, assembled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.quantities import build_no_gust
from tensegrity_codegen.pipeline.settle import choose_request
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.checks.check_members import check_laws
from tensegrity_codegen.scene.read import name_source, parse_scene, read_document, to_plain
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.shapes import expand_shape
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import ARRAYS, INPUT, ArrayKey, find_array_key
from tensegrity_codegen.sweeps.key_schema import Bounds
from tensegrity_codegen.sweeps.keys import KeyPath, parse_path
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_path
from tensegrity_codegen.system.errors import DuplicateNameError, TensegrityError, UnknownKeyError
from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class FileKey:
    """A number of the scene; is_from_shape: of nodes or members that the scene's shape makes."""

    path: KeyPath
    is_from_shape: bool = False

    @property
    def text(self) -> str:
        """The key as it was given."""
        return self.path.text

    @property
    def bounds(self) -> Bounds:
        """Which numbers are allowed."""
        return self.path.bounds

    @property
    def place(self) -> tuple[object, ...]:
        """What the key is in its canonical form: equal for two spellings of one number."""
        return ("scene", *self.path.steps)


@dataclass(frozen=True)
class AssembledCase:
    """The structure of one case, its request, values of its inputs (n_inputs,), its scene, and its gust."""

    subject: Subject
    request: ModelRequest
    inputs: FloatArray
    scene: Scene | None = None
    gust: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True)
class CaseAssembler:
    """A scene and the keys that vary in it.

    document: the scene; where: its source, for messages; keys: what varies; analyses: what is done with the
    cases, which decides on the formulation, see `choose_request`.
    """

    document: dict[str, Any] = field(repr=False)
    where: str
    keys: tuple[FileKey | ArrayKey, ...]
    analyses: tuple[str, ...] = ()

    def assemble(self, values: Sequence[float] | FloatArray) -> AssembledCase:
        """Return the structure of the case with these values (n_keys,).

        Raises TensegrityError: the values are no scene.
        """
        with np.errstate(all="ignore"):
            scene = parse_scene(self.write(values), self.where)
            subject, request = assemble_scene(scene, self.where)
            request = choose_request(subject, request, self.analyses)
            return self._set_arrays(scene, subject, request, values)

    @cached_property
    def bounds(self) -> tuple[Bounds, ...]:
        """Which numbers each key may be."""
        return tuple(key.bounds for key in self.keys)

    def in_bounds(self, values: FloatArray) -> NDArray[np.bool_]:
        """Return which cases (n, n_keys) have numbers that the scene's schema allows, (n,)."""
        inside = np.ones(len(values), dtype=np.bool_)
        for column, bounds in zip(values.T, self.bounds, strict=True):
            inside &= bounds.contain(column)
        return inside

    def write(self, values: Sequence[float] | FloatArray) -> Mapping[str, Any]:
        """Return the scene with these values (n_keys,) of the numbers that stand in it, not checked.

        Keys of arrays of the structure, as ``rest_length.s1``, are not in it.
        """
        pairs = [(key, float(value)) for key, value in zip(self.keys, values, strict=True)]
        document: Mapping[str, Any] = self.document
        for key, value in pairs:
            if isinstance(key, FileKey) and not key.is_from_shape:
                document = key.path.write(document, value)
        from_shape = [(key, value) for key, value in pairs if isinstance(key, FileKey) and key.is_from_shape]
        if from_shape:
            document = expand_document(document, self.where)
            for key, value in from_shape:
                document = key.path.write(document, value)
        return document

    def _set_arrays(
        self, scene: Scene, subject: Subject, request: ModelRequest, values: Sequence[float] | FloatArray
    ) -> AssembledCase:
        chosen = [
            (key, float(value))
            for key, value in zip(self.keys, values, strict=True)
            if isinstance(key, ArrayKey)
        ]
        names = {key.array for key, _ in chosen}
        others = {INPUT: np.zeros(len(subject.inputs)), **build_no_gust(subject)}
        arrays = {name: np.array(getattr(subject, name)) for name in names - others.keys()}
        for key, value in chosen:
            key.write(arrays | others, value)
        inputs = others.pop(INPUT)
        if arrays:
            subject = subject.with_changes(**arrays)
            if isinstance(subject, Structure):
                check_structure(subject, self.where)
            else:
                check_laws(subject, self.where)
        return AssembledCase(subject, request, inputs, scene, others)


def build_assembler(
    scene: str | Path | Mapping[str, Any] | Scene, keys: Sequence[str], *, source: str = ""
) -> CaseAssembler:
    """Return the scene with the keys that vary in it.

    scene: as for `read_scene`.
    keys: paths of numbers of the scene, see `KeyPath`; of nodes and members that its shape makes, as
        ``nodes.t1.position[2]``; of its inputs and actuators, as ``input.motor``; of the assembled structure:
        ``rest_length.NAME`` (a member, group or class), ``node_load.NAME[axis]``,
        ``node_velocity.NAME[axis]`` and others of ARRAYS.
    source: where the keys come from, for errors, if not from the command: a table with its line.
    Raises UnknownKeyError, InvalidValueError: a key that is no number of the scene; the message lists near
    ones; DuplicateNameError: two keys that are one number; SceneError: the scene cannot be read.
    """
    document, where = read_scene_document(scene)
    subject, _ = assemble_scene(parse_scene(document, where), where)
    found: list[FileKey | ArrayKey] = []
    for text in keys:
        try:
            found.append(_find_key(text, document, subject, where))
        except TensegrityError as error:
            if source:
                error.where = f"{source}: column {text}"
            raise
    _check_different(found, source or where)
    return CaseAssembler(document, where, tuple(found))


def _find_key(text: str, document: dict[str, Any], subject: Subject, where: str) -> FileKey | ArrayKey:
    steps = parse_path(text)
    if steps[0] in ARRAYS:
        return find_array_key(text, steps, subject, where)
    try:
        return FileKey(KeyPath.find(text, document, where))
    except UnknownKeyError:
        if "shape" not in document or steps[0] not in ("nodes", "members"):
            raise
    return FileKey(KeyPath.find(text, expand_document(document, where), where), is_from_shape=True)


def _check_different(keys: Sequence[FileKey | ArrayKey], where: str) -> None:
    first: dict[tuple[object, ...], str] = {}
    for key in keys:
        other = first.setdefault(key.place, key.text)
        if other != key.text:
            raise DuplicateNameError(
                "two keys are the same number",
                where=where,
                given=f"{other}, {key.text}",
                allowed="one of them",
            )


def read_scene_document(scene: str | Path | Mapping[str, Any] | Scene) -> tuple[dict[str, Any], str]:
    """Return a scene as a plain dictionary, checked, and its source for messages; raises as `read_scene`."""
    if isinstance(scene, Scene):
        document = scene.to_document()
    elif isinstance(scene, Mapping):
        document = dict(scene)
    else:
        check_path(scene, "scene")
        document = read_document(scene, known=frozenset(Scene.model_fields))
    plain, where = to_plain(document), name_source(scene)
    parse_scene(plain, where)
    return plain, where


def expand_document(document: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the scene with the nodes, members and groups of its shape written out, in place of the shape."""
    shape = parse_scene(document, where).shape
    if shape is None:
        return dict(document)
    made = expand_shape(shape, f"{where}: shape")
    rest = {key: value for key, value in document.items() if key != "shape"}
    return rest | {
        section: {**made[section], **document.get(section, {})} for section in ("nodes", "members", "groups")
    }
