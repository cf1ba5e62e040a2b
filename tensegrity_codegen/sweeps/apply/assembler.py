"""The structure of one case: the scene, a plain dictionary that keys read and write, assembled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.analyses.cases.quantities import GUST, OF_LOOPS, build_no_gust
from tensegrity_codegen.codegen.compilation.fingerprint import hash_request, hash_structure, hash_text
from tensegrity_codegen.pipeline.settle import choose_request
from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.checks.check_members import check_laws
from tensegrity_codegen.scene.read import name_source, parse_scene, read_document, to_plain
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.shapes import expand_shape
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.ground import CHANGEABLE, Ground
from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import ARRAYS, INPUT, ArrayKey, find_array_key
from tensegrity_codegen.sweeps.keys import Bounds, KeyPath, parse_path
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_path
from tensegrity_codegen.system.errors import DuplicateNameError, TensegrityError, UnknownKeyError
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.request import ModelRequest, complete_options


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
        """The key in its canonical form: equal for two spellings of one number."""
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

    analyses: what is done with the cases, which decides on the formulation, see `choose_request`.
    """

    document: dict[str, Any] = field(repr=False)  # the scene
    where: str  # its source, for messages
    keys: tuple[FileKey | ArrayKey, ...]  # names of varied numbers
    analyses: tuple[str, ...] = ()

    def assemble(self, values: Sequence[float] | FloatArray) -> AssembledCase:
        """Return the structure of the case with these values (n_keys,); raises TensegrityError."""
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
        """Return the scene with values (n_keys,) of its numbers, not checked, without those of arrays."""
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
        loop_arrays = {INPUT: np.zeros(len(subject.inputs)), **build_no_gust(subject)}
        arrays = {name: np.array(getattr(subject, name)) for name in names - loop_arrays.keys()}
        for key, value in chosen:
            key.write(arrays | loop_arrays, value)
        inputs = loop_arrays.pop(INPUT)
        if arrays:
            subject = subject.with_changes(**arrays)
            if isinstance(subject, Structure):
                check_structure(subject, self.where)
            else:
                check_laws(subject, self.where)
        return AssembledCase(subject, request, inputs, scene, loop_arrays)


def build_assembler(
    scene: str | Path | Mapping[str, Any] | Scene, keys: Sequence[str], *, source: str = ""
) -> CaseAssembler:
    """Return the scene with the numbers that vary in it, by their paths; source: of the keys."""
    document, where = read_scene_document(scene)
    subject, _ = assemble_scene(parse_scene(document, where), where)
    case_keys: list[FileKey | ArrayKey] = []
    for path in keys:
        try:
            case_keys.append(_find_key(path, document, subject, where))
        except TensegrityError as error:
            if source:
                error.where = f"{source}: column {path}"
            raise
    _check_different(case_keys, source or where)
    return CaseAssembler(document, where, tuple(case_keys))


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
    spelling: dict[tuple[object, ...], str] = {}
    for key in keys:
        earlier = spelling.setdefault(key.place, key.text)
        if earlier != key.text:
            problem, value = "two keys are the same number", f"{earlier}, {key.text}"
            raise DuplicateNameError(problem, where=where, given=value, allowed="one of them")


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
    sections = {key: value for key, value in document.items() if key != "shape"}
    return sections | {
        section: {**made[section], **document.get(section, {})} for section in ("nodes", "members", "groups")
    }


STATE = ("coordinate", "velocity", "input")  # slots that are arguments of every library
WITHOUT_ROWS = (*STATE, *OF_LOOPS, "gravity")  # slots that are arguments as a whole
OF_MEMBERS = ("rest_length", "spring_constant", "axial_stiffness", "damping")
# Parts by which lengths of rigid bars differ that are the same but for rounding.
DIGITS = 12


def list_slots(case: AssembledCase) -> dict[str, FloatArray]:
    """Return the values that may differ between cases, by argument: all rows, zero without meaning."""
    subject = case.subject
    slots = {"input": case.inputs}
    if isinstance(subject, BodySystem):
        slots |= {"coordinate": subject.coordinate, "velocity": subject.velocity, "gravity": subject.gravity}
        slots |= {name: getattr(subject, name) for name in (*OF_MEMBERS, "node_load")}
    else:
        slots |= _slots_of_nodes(subject, case.request)
    slots["actuator_delay"] = np.array([device.delay for device in subject.actuators])
    slots["actuator_rate"] = np.array([device.rate for device in subject.actuators])
    slots["sensor_noise"] = np.array([device.noise for device in subject.sensors])
    slots |= case.gust or build_no_gust(subject)
    slots[GUST] = slots[GUST] if isinstance(subject, BodySystem) else slots[GUST][:, list(subject.axes)]
    return {name: np.asarray(slots[name], dtype=np.float64) for name in sorted(slots)}


def flatten_slots(slots: Mapping[str, FloatArray]) -> FloatArray:
    """Return the entries of all slots in one row."""
    return np.concatenate([slot.ravel() for slot in slots.values()])


def hash_constants(case: AssembledCase) -> str:
    """Return the hash of all that no argument of the library can change: equal hashes, one library."""
    subject, request = case.subject, case.request
    blank: dict[str, Any] = {
        name: np.zeros_like(getattr(subject, name)) for name in (*OF_MEMBERS, "node_load")
    }
    blank |= {"gravity": np.zeros(3)}
    # The rate of a motor with a lag is a constant of its equation.
    blank |= {
        "actuators": tuple(
            replace(device, delay=0.0, rate=device.rate if device.time_constant else np.inf)
            for device in subject.actuators
        )
    }
    blank |= {"sensors": tuple(replace(device, noise=0.0) for device in subject.sensors)}
    patterns = [subject.spring_constant > 0, subject.axial_stiffness > 0]
    extra: list[Any] = []
    if isinstance(subject, BodySystem):
        blank |= {"coordinate": np.zeros(subject.n_coordinates), "velocity": np.zeros(subject.n_coordinates)}
    else:
        position = np.zeros_like(subject.node_position)
        if not _moves_anchors(request.formulation):
            position[subject.node_anchored] = subject.node_position[subject.node_anchored]
        blank |= {"node_position": position, "node_velocity": np.zeros_like(subject.node_velocity)}
        blank |= {"node_mass": np.zeros(subject.n_nodes)}
        patterns.append(subject.node_mass > 0)
        if subject.ground is not None:
            blank["ground"] = _blank_ground(subject.ground)
            patterns.append(np.array([subject.ground.friction > 0]))
        rigid = find_rigid_bars(subject, request)
        extra = [f"{length:.{DIGITS}g}" for length in subject.member_length()[rigid]]
    shape = hash_structure(subject.with_changes(**blank))
    masks = ["".join("01"[int(x)] for x in pattern) for pattern in patterns]
    return hash_text(shape, hash_request(request), *masks, *extra)


def _blank_ground(ground: Ground) -> Ground:
    """Return the ground with one in place of each number that a library can change at run time."""
    changed: dict[str, Any] = dict.fromkeys(CHANGEABLE, 1.0)
    if ground.static_friction is not None or not ground.friction:
        changed["friction"] = ground.friction
    return replace(ground, **changed)


def name_changed(first: AssembledCase, second: AssembledCase) -> list[str]:
    """Return the names of the constants that differ between two cases, as `member_mass`."""
    variable = {*OF_MEMBERS, "node_load", "gravity", "coordinate", "velocity", "node_mass", "node_velocity"}
    variable |= {"node_position", "actuators", "sensors", "limits"}
    if type(first.subject) is not type(second.subject):
        return []
    return [
        field.name
        for field in fields(first.subject)
        if field.name not in variable
        and not _equal(getattr(first.subject, field.name), getattr(second.subject, field.name))
    ]


def _equal(first: Any, second: Any) -> bool:
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(_equal(first[key], second[key]) for key in first)
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(_equal, first, second))
    if is_dataclass(first) and type(first) is type(second):
        return all(_equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first))
    return bool(first == second)


def _slots_of_nodes(structure: Structure, request: ModelRequest) -> dict[str, FloatArray]:
    axes = list(structure.axes)
    elastic = ~find_rigid_bars(structure, request)
    slots = {name: np.where(elastic, getattr(structure, name), 0.0) for name in OF_MEMBERS}
    slots |= {"gravity": structure.gravity[axes], "node_mass": structure.node_mass}
    slots |= {"node_load": structure.node_load[:, axes]}
    ground = structure.ground
    slots |= {} if ground is None else {"ground": np.array([getattr(ground, name) for name in CHANGEABLE])}
    if _moves_anchors(request.formulation):
        held = structure.node_anchored[:, axes]
        slots["anchor_position"] = np.where(held, structure.node_position[:, axes], 0.0)
    if find_formulation(request.formulation).in_nodes:
        node, axis = structure.coordinate_node_axis.T
        slots |= {
            "coordinate": structure.node_position[node, axis],
            "velocity": structure.node_velocity[node, axis],
        }
    else:
        slots |= _distances(structure, request)
    return slots


def _moves_anchors(formulation: str) -> bool:
    """Return whether positions of anchored nodes can be run-time parameters."""
    return find_formulation(formulation).in_nodes


def _distances(structure: Structure, request: ModelRequest) -> dict[str, FloatArray]:
    """Return the state in differences of node positions and centres of mass."""
    import casadi as ca  # which this formulation alone needs here

    from tensegrity_codegen.symbolic.inertia import Inertia
    from tensegrity_codegen.symbolic.pair_coordinates import PairCoordinates

    options = complete_options(request.formulation, request.options)
    inertia = Inertia(structure, [ca.SX(float(value)) for value in structure.node_mass])
    masses = inertia.weight_mass()
    layout = PairCoordinates(structure, options["pairs"], options["order"], masses)
    weight = np.array([float(value) for value in masses])
    return {
        "coordinate": layout.compute(structure.node_position, weight),
        "velocity": layout.compute(structure.node_velocity, weight),
    }
