"""Beginnings of episodes: random numbers, numbers of the scene that are drawn anew, states at the start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation
from scipy.special import ndtri

from tensegrity_codegen.analyses.cases.quantities import GUST, GUST_TIME
from tensegrity_codegen.pipeline.settle import find_settled
from tensegrity_codegen.runtime.model.arrays import check_finite
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.simulate.motion_input import read_starts
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.apply.array_keys import ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import build_assembler, hash_constants, name_changed
from tensegrity_codegen.sweeps.apply.group_cases import find_groups
from tensegrity_codegen.sweeps.cases.build_cases import build_cases
from tensegrity_codegen.sweeps.cases.sampled import Sample
from tensegrity_codegen.sweeps.gaits.rolls import Facets
from tensegrity_codegen.system.arrays import BoolArray, FloatArray, IntArray
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    FormulationError,
    InvalidValueError,
    TensegrityError,
    check_choice,
)
from tensegrity_codegen.tables.request import ModelRequest

SceneLike = str | Path | Mapping[str, Any] | Scene
GOLDEN, *FACTORS = np.array([0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB], np.uint64)
SHIFTS = np.array([30, 27, 31, 11], np.uint64)


class Streams:
    """Random numbers of n copies: number c of a key is the finaliser of splitmix64 of key + c * GOLDEN.

    No copy depends on the others, and all are drawn at once (Steele, Lea, Flood 2014).
    """

    def __init__(self, n: int) -> None:
        self.key, self.drawn = np.zeros(n, np.uint64), np.zeros(n, np.uint64)

    def seed(self, seed: int | Sequence[int | None] | None, rows: IntArray) -> None:
        """Begin the streams of some copies: by one seed for all, or by one each; None: by the system's."""
        root = np.random.SeedSequence(seed).entropy if seed is None else seed
        for row in rows.tolist():
            entropy, path = (root[row], ()) if isinstance(root, Sequence) else (root, (row,))
            self.key[row] = np.random.SeedSequence(entropy, spawn_key=path).generate_state(1, np.uint64)[0]
        self.drawn[rows] = 0

    def draw(self, size: int, rows: IntArray) -> FloatArray:
        """Return the next numbers between 0 and 1 of some copies, (len(rows), size)."""
        count = self.drawn[rows, None] + np.arange(1, size + 1, dtype=np.uint64)
        self.drawn[rows] += np.uint64(size)
        bits: Any = self.key[rows, None] + GOLDEN * count
        for shift, factor in zip(SHIFTS[:2], FACTORS, strict=True):
            bits = (bits ^ (bits >> shift)) * factor
        return np.asarray((((bits ^ (bits >> SHIFTS[2])) >> SHIFTS[3]) + 0.5) * 2.0**-53)

    def draw_normal(self, size: int, rows: IntArray) -> FloatArray:
        """Return the next numbers of the normal distribution of some copies, (len(rows), size)."""
        return np.asarray(ndtri(self.draw(size, rows)))


TRIED = 32  # draws by which it is found which arguments of a library follow from the keys
MAX_DRAWS = 100  # until the values of a copy are a scene
CHANGEABLE = (
    "stiffnesses, rest lengths, damping, masses and loads of nodes, masses of rigid bodies, gravity, "
    "stiffness, damping and friction above 0 of the ground, delays and rates of actuators, noise of sensors"
)


class DrawnNumbers:
    """Numbers of a scene that are drawn anew for each episode, by the keys and distributions of sweeps.

    Masses and inertias of rigid bodies that keep their centres and axes are parameters of a library whose
    corners stay; the scene is assembled for them. What follows from all other keys sweeps find.
    """

    def __init__(self, scene: SceneLike, randomise: Sequence[str], *, moves_start: bool) -> None:
        """moves_start: whether starts are elsewhere than the scene says."""
        self.texts: tuple[str, ...] = ()
        case = build_assembler(scene, ()).assemble(())
        self.structure, self.request = case.subject, case.request
        if not randomise:
            return
        cases = build_cases(sample=randomise, n=TRIED, options={"sample": "randomise"})
        assert isinstance(cases.points, Sample)
        self.laws = cases.points.distributions
        self.texts = tuple(f"{key}={law}" for key, law in zip(cases.keys, self.laws, strict=True))
        self.assembler = build_assembler(scene, cases.keys)
        middle, upper = ([law.compute_quantile(np.array(p)) for law in self.laws] for p in (0.5, 0.9))
        base = self.assembler.assemble(np.array(middle))
        self.of_bodies, self.bodies = np.zeros(len(cases.keys), dtype=np.bool_), set[int]()
        for k, key in enumerate(self.assembler.keys):
            case = self.assembler.assemble(np.array([*middle[:k], upper[k], *middle[k + 1 :]]))
            is_gust = isinstance(key, ArrayKey) and key.array in (GUST, GUST_TIME)
            if hash_constants(case) == hash_constants(base) and not is_gust:
                continue
            names = name_changed(base, case) or [key.text.split(".")[0]]
            inertias = [list_inertias(self.structure, subject) for subject in (case.subject, base.subject)]
            rows = np.flatnonzero((inertias[0] != inertias[1]).any(axis=1)).tolist()
            self.of_bodies[k] = {*names} <= {"bodies", "ground"} and rows and np.isfinite(inertias).all()
            if not self.of_bodies[k]:
                problem = f"this number cannot change at run time, since {' and '.join(names)} cannot"
                hint = "of a rigid body that keeps its centre and axes the mass can" * ("bodies" in names)
                raise InvalidValueError(
                    problem, where="randomise", given=key.text, allowed=CHANGEABLE, hint=hint
                )
            self.bodies |= {*rows}
        self.group = None
        texts = [text for text, of_body in zip(self.texts, self.of_bodies, strict=True) if not of_body]
        if texts:
            cases = build_cases(sample=texts, n=TRIED)
            self.group = find_groups(build_assembler(scene, cases.keys), cases)[0]
            self.structure, self.request = self.group.structure, self.group.request
            if self.group.mapper.idle_keys:
                problem, keys = "this number changes no motion", cases.keys[self.group.mapper.idle_keys[0]]
                raise InvalidValueError(problem, where="randomise", given=keys, allowed=CHANGEABLE)
            held = {"anchor_position", *(("coordinate", "velocity") if moves_start else ())}
            if held & {*self.group.arguments(cases.values(0, 1)).arguments}:
                problem, keys = "episodes start elsewhere", ", ".join(cases.keys)
                allowed = "keys that leave places and velocities of nodes as they are, or start='scene'"
                raise InvalidValueError(problem, where="randomise", given=keys, allowed=allowed)
        if self.bodies:
            parameters = dict.fromkeys(("body_mass", "body_inertia"), tuple(sorted(self.bodies)))
            self.request = replace(self.request, parameters={**self.request.parameters, **parameters})

    def draw(self, streams: Streams, rows: IntArray) -> dict[str, FloatArray]:
        """Return arguments of some copies, (len(rows), ...) each; raises where no draw is a scene."""
        if not self.texts:
            return {}
        values, bad = np.zeros((len(rows), len(self.laws))), np.ones(len(rows), dtype=np.bool_)
        for _ in range(MAX_DRAWS):
            numbers = streams.draw(len(self.laws), rows[bad]).T
            columns = zip(self.laws, numbers, strict=True)
            values[bad] = np.stack([law.compute_quantile(column) for law, column in columns], axis=1)
            arguments, bad, message = self._apply(values)
            if not bad.any():
                return arguments
        problem, texts = f"none of {MAX_DRAWS} draws is a scene", ", ".join(self.texts)
        raise InvalidValueError(problem, where="randomise", given=texts, allowed=CHANGEABLE, hint=message)

    def _apply(self, values: FloatArray) -> tuple[dict[str, FloatArray], BoolArray, str]:
        """Return the arguments of values (n, n_keys), which of them are no scene, and why one is not."""
        arguments, bad, message = dict[str, FloatArray](), ~self.assembler.in_bounds(values), ""
        if self.group is not None:
            cases = self.group.arguments(values[:, ~self.of_bodies])
            arguments, bad = cases.arguments, bad | ~cases.good
            message = next(filter(None, cases.messages), "")
        if self.bodies:
            inertias = np.full((len(values), len(self.bodies), 4), np.nan)
            for k in np.flatnonzero(~bad).tolist():
                try:
                    subject = self.assembler.assemble(values[k]).subject
                    inertias[k] = list_inertias(self.structure, subject)[sorted(self.bodies)]
                except TensegrityError as error:
                    message = str(error)
            arguments |= {"body_mass": inertias[:, :, 0], "body_inertia": inertias[:, :, 1:]}
            bad |= ~np.isfinite(inertias).all(axis=(1, 2))
        return arguments, bad, message


def list_inertias(structure: Subject, other: Subject) -> FloatArray:
    """Return masses and ascending principal inertias (n_bodies, 4) of the bodies of another structure.

    NaN where the centre of mass, the principal axes or the points are not those of the structure.
    """
    if not isinstance(structure, Structure) or not isinstance(other, Structure):
        return np.full((1, 4), np.nan)
    rows = np.full((len(structure.bodies), 4), np.nan)
    for row, body, changed in zip(rows, structure.bodies, other.bodies, strict=True):
        inertia = body.tetrahedron[0].T @ changed.inertia @ body.tetrahedron[0]  # the largest one first
        rounding, principal = 1e-9 * np.trace(inertia), np.diag(inertia)[::-1]
        is_turned = np.abs(inertia - np.diag(np.diag(inertia))).max() > rounding
        is_moved = np.abs(changed.centre - body.centre).max() > 1e-9 * np.abs(body.corner_local).max()
        is_moved |= not np.array_equal(changed.point_local, body.point_local)
        if not (is_turned or is_moved or np.diff(principal).min() < -rounding):
            row[:] = changed.mass, *np.sort(principal)
    return rows


SCENE, SETTLED, FACET = "scene", "settled", "facet"
SLOW = 1e-3  # [m/s]: at rest after MAX_REST
MAX_REST, REST_TIME, REST_SPEED = 30.0, 0.5, 1e-4  # [s], [s], [m/s]: at rest while all rates are that low
REST_RTOL = 1e-6  # errors of looser steps are motions
GAP = 1e-4  # of the size: how far above the ground a structure is that is laid onto a facet


@dataclass(frozen=True, eq=False)
class Starts:
    """States of which each episode takes one at random; (m, ...) each, internal None: the library's."""

    coordinate: FloatArray
    velocity: FloatArray
    internal: FloatArray | None = None


def find_starts(
    start: str | Path, model: CompiledModel, request: ModelRequest, inputs: Sequence[float], options: Any
) -> Starts:
    """Return the states; inputs (n_inputs,) that hold; options: of the stepper by which it comes to rest."""
    nominal = {name: model.nominal(name)[None] for name in ("coordinate", "velocity")}
    if Path(start).suffix == ".npz":
        starts = nominal | read_starts(start, model.manifest)
        m = max(len(starts[name]) for name in nominal)
        shape = (m, nominal["velocity"].size)
        for name in nominal:
            check_finite(starts[name], f"{start}: {name}")
        names = (*nominal, *starts.pop("arguments"))
        if len(names) > 2 or any(starts[name].shape not in (shape, (1, shape[1])) for name in names):
            allowed = f"positions and velocities (n, {shape[1]}), a row for each state"
            raise InvalidValueError("not starts", where=str(start), given=", ".join(names), allowed=allowed)
        return Starts(*(np.broadcast_to(starts[name], shape) for name in names))
    check_choice(start, (SETTLED, FACET, SCENE), "start", "start")
    structure: Any = model.structure
    node, axis = model.manifest.coordinate_place.T
    if start == SCENE:
        return Starts(*nominal.values())
    is_free = isinstance(structure, Structure) and not structure.node_anchored.any()
    is_free = is_free and len(structure.axes) == 3
    if start == FACET and not (is_free and structure.ground and structure.ground.normal[2] == 1.0):
        problem, allowed = (
            "this structure has no facets to stand on",
            "no anchors, a ground with the normal z",
        )
        raise FormulationError(problem, where="start", given=start, allowed=allowed)
    if structure.ground is None:
        settled, _ = find_settled(structure, request, arguments={"input": inputs} if len(inputs) else {})
        if not isinstance(settled, Structure):
            return Starts(settled.coordinate[None], 0.0 * nominal["velocity"])
        if len(node) < nominal["velocity"].size:
            problem, allowed = "coordinates of this formulation are no places", f"start={SCENE!r}"
            raise FormulationError(problem, where="start", given=start, allowed=allowed)
        return Starts(settled.node_position[node, axis][None], 0.0 * nominal["velocity"])
    fallen = _come_to_rest(model, nominal["coordinate"], inputs, options)
    if start == SETTLED:
        return fallen
    # Each facet of the convex hull turned down, in the middle of where the structure rests.
    ground, position = structure.ground, place_nodes(model, fallen.coordinate[0])
    try:
        facets = Facets(structure.with_changes(node_position=position), [])
    except QhullError:
        problem, allowed = "this structure has no facets to stand on", "four nodes that are not in a plane"
        raise FormulationError(problem, where="start", given=start, allowed=allowed) from None
    centre, laid = position[ground.node].mean(axis=0), []
    for facet in facets.facet:
        a, b, c = position[list(facet)]
        normal = np.cross(b - a, c - a) * np.sign(np.cross(b - a, c - a) @ (a - centre))
        turn, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [normal])
        turned = centre + turn.apply(position - centre)
        lowest = (turned[ground.node, 2] - ground.radius).min() - ground.offset - GAP * facets.size
        laid.append((turned - [0.0, 0.0, lowest])[node, axis])
    return _come_to_rest(model, np.array(laid), inputs, options)


def _come_to_rest(model: CompiledModel, start: FloatArray, inputs: Sequence[float], options: Any) -> Starts:
    """Return the states at which motions from starts (m, n_coordinates) end, without those that do not."""
    own = {"quantities": (), "rtol": min(options.get("rtol", REST_RTOL), REST_RTOL)}
    stepper = model.stepper(len(start), sample=REST_TIME / 10, **{**options, **own})
    stepper.reset(coordinate=start, velocity=np.zeros_like(start))
    calm = np.zeros(len(start))  # samples at rest in a row
    for _ in range(round(10 * MAX_REST / REST_TIME)):
        stepper.step(inputs)
        calm = np.where(np.abs(stepper.velocity).max(axis=1) < REST_SPEED, calm + 1, 0)
        if ((calm >= 10) | (stepper.status != 0)).all():
            break
    speed = np.nan_to_num(np.abs(stepper.velocity).max(axis=1), nan=np.inf)
    still = (calm >= 10) | (speed < SLOW)
    if not still.any():
        problem = (
            f"the structure does not come to rest: after {MAX_REST:g} s it moves with {speed.min():.1e} m/s"
        )
        hint = "damping of cables, friction of the ground, or start='scene'"
        raise ConvergenceError(problem, where="start", hint=hint)
    return Starts(stepper.coordinate[still], stepper.velocity[still], stepper.internal[still])
