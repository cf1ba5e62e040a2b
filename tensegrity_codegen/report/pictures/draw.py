"""Subjects of pictures: a scene, a model, an equilibrium, a sample of a motion or of a plan."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tensegrity_codegen.report.loads import compute_loads, compute_static_loads
from tensegrity_codegen.report.pictures.drawing import BodyParts
from tensegrity_codegen.report.pictures.marks import describe_force
from tensegrity_codegen.report.pictures.panel import describe_size, set_up
from tensegrity_codegen.report.pictures.plots import draw_shown
from tensegrity_codegen.report.pictures.shown import (
    Shown,
    find_imbalance,
    find_rest_tension,
    show_motion,
    show_structure,
)
from tensegrity_codegen.report.pictures.view import PictureChoices, check_array, check_tension
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.rigid_bars import find_rigid_bars
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Drawable: TypeAlias = (
    str
    | Path
    | Mapping[str, Any]
    | Scene
    | Structure
    | BodySystem
    | CompiledModel
    | Equilibrium
    | Trajectory
    | PlanResult
)


@dataclass(frozen=True)
class Shot:
    """The content of a picture; None for values of the structure at its stated positions.

    node_position (n_nodes, 3) [m], member_tension (n_members,) [N], node_load (n_nodes, 3) [N]; rigid
    (n_members,): members that the formulation keeps rigid; note: the line below the title; whole: the motion
    or plan of which this is one sample, with the sample's number.
    """

    subject: Structure | BodySystem
    node_position: FloatArray | None = None
    member_tension: FloatArray | None = None
    node_load: FloatArray | None = None
    rigid: BoolArray | None = None
    note: str = ""
    whole: tuple[Trajectory | PlanResult, int] | None = None


def draw_shot(
    shot: Shot, choices: PictureChoices, title: str | None = None, *, is_vector: bool = False
) -> "tuple[Figure, FloatArray]":
    """Return the figure of a shot and the tensions in it (n_members,) [N], NaN if unknown.

    Without `choices.follow` the axes of a sample hold the whole motion, else this sample alone. Edges of
    rigid bodies, which have no tension, are not among the tensions.
    """
    structure = outline_bodies(shot.subject)
    position = structure.node_position if shot.node_position is None else shot.node_position
    if shot.member_tension is None:
        tension = find_rest_tension(shot.subject, shot.rigid)
    else:
        tension = pad_tension(shot.member_tension, structure)
    bodies = BodyParts.of(shot.subject)
    shown = show_structure(structure, position, tension, load=shot.node_load, bodies=bodies)
    number = 0
    if shot.whole is not None and not choices.follow:
        result, number = shot.whole
        shown = show_whole(structure, result, shot.subject)
    setting = set_up(shown, replace(choices, follow=False))
    heading = structure.name if title is None else title
    note = shot.note or describe_size(structure, bodies)
    lacking = find_imbalance(shot.subject) if shot.node_position is None else None
    if lacking:
        note += f"; not in balance: {lacking[0]} lacks {describe_force(lacking[1], setting.unit)}"
    if setting.limit is None and choices.color != "kind":
        note += "; no tension is known" if np.isnan(tension).all() else "; no member has a tension"
    return draw_shown(setting, number, heading, note, is_vector=is_vector), tension[~bodies.edge]


def show_whole(
    structure: Structure, result: Trajectory | PlanResult, subject: Structure | BodySystem
) -> Shown:
    """Return the content of pictures of all samples."""
    for number in range(len(result.node_position)):
        check_sample(structure, result, number)
    if isinstance(result, Trajectory):
        return show_motion(structure, outline_motion(result, structure), subject)
    load = np.broadcast_to(subject.node_load, result.node_position.shape)
    tension = pad_tension(result.member_tension, structure)
    return Shown(structure, result.node_position, tension, load, BodyParts.of(subject))


def outline_motion(motion: Trajectory, structure: Structure) -> Trajectory:
    """Return the motion with the bars and edges of bodies, after its tendons, whose tensions are unknown."""
    tension = pad_tension(motion.member_tension, structure)
    return replace(motion, member_name=structure.member_name, member_tension=tension)


def find_rigid(subject: Structure | BodySystem, request: ModelRequest) -> BoolArray | None:
    """Return which members the formulation keeps rigid, (n_members,); None: those without a stiffness."""
    return find_rigid_bars(subject, request) if isinstance(subject, Structure) else None


def pad_tension(tension: FloatArray, structure: Structure) -> FloatArray:
    """Return tensions (..., n_members) with NaN for the bars and edges of bodies of `structure`."""
    omitted = structure.n_members - tension.shape[-1]
    widths = [(0, 0)] * (tension.ndim - 1) + [(0, omitted)]
    padded: FloatArray = np.pad(tension, widths, constant_values=np.nan)
    if structure.bodies:
        padded[..., structure.is_edge] = np.nan  # stresses within a body are no matter of pictures
    return padded


def find_shot(subject: Any, time: float | None = None, sample: int | None = None) -> Shot:
    """Return the shot of `subject`."""
    if isinstance(subject, Trajectory | PlanResult):
        return _find_sample(subject, time, sample)
    if time is not None or sample is not None:
        raise InvalidValueError(
            "only motions and plans have samples",
            where="sample" if time is None else "time",
            given=sample if time is None else time,
            allowed="a Trajectory or a PlanResult as the subject",
        )
    if isinstance(subject, str | Path | Mapping | Scene):
        structure, request = assemble_scene(read_scene(subject), name_source(subject))
        return Shot(structure, rigid=find_rigid(structure, request))
    if isinstance(subject, Structure | BodySystem):
        return Shot(subject)
    if isinstance(subject, Equilibrium):
        note = f"equilibrium: {subject.headline()}"
        structure = _require(subject)
        load = compute_static_loads(structure, subject)
        return Shot(structure, subject.node_position, subject.member_tension, load, note=note)
    if isinstance(subject, CompiledModel):
        rigid = np.isin(subject.manifest.member_name, subject.manifest.rigid_bar)
        return Shot(_require(subject), rigid=rigid)
    raise InvalidValueError(
        f"a {type(subject).__name__} cannot be drawn",
        where="subject",
        given=type(subject).__name__,
        allowed="a scene, Structure, CompiledModel, Equilibrium, Trajectory or PlanResult",
    )


def _find_sample(subject: Trajectory | PlanResult, time: float | None, sample: int | None) -> Shot:
    """Return the shot of one sample of a motion, or of one point of a plan."""
    count, times = len(subject.node_position), subject.time
    if time is not None and (sample is not None or times is None):
        raise InvalidValueError(
            "a sample and a time are given" if times is not None else "the plan has no times",
            where="time",
            given=time,
            allowed="`sample`, the number of a sample",
        )
    number = -1 if sample is None else sample
    if time is not None and times is not None and len(times):
        check_time(time, float(times[0]), float(times[-1]))
        number = int(np.abs(times - time).argmin())
    if not -count <= number < count:
        raise InvalidValueError(
            "there is no such sample" if count else "there are no samples",
            where="sample",
            given=number,
            allowed=f"{-count} to {count - 1}" if count else "",
        )
    drawable = _require(subject)
    check_sample(outline_bodies(drawable), subject, number % count)
    note = f"point {number % count} of {count}" if times is None else f"t = {times[number]:.6g} s"
    load = compute_loads(drawable, subject)[number] if isinstance(subject, Trajectory) else None
    return Shot(
        drawable, subject.node_position[number], subject.member_tension[number], load, note=note,
        whole=(subject, number % count),
    )  # fmt: skip


def check_sample(structure: Structure, result: Trajectory | PlanResult, number: int) -> None:
    """Raise NonFiniteError for a sample with positions, or tensions of cables, that are not finite."""
    position, tension = result.node_position[number], pad_tension(result.member_tension[number], structure)
    check_array(f"node_position of sample {number}", position, (structure.n_nodes, 3), "nodes, axes")
    name = f"member_tension of sample {number}"
    check_tension(tension, (structure.n_members,), structure, "members", name)


def check_time(time: float, start: float, end: float) -> None:
    """Raise InvalidValueError for a time [s] that is not within a motion, up to rounding."""
    slack = 1e-9 * (end - start)
    if not (isinstance(time, int | float) and start - slack <= time <= end + slack):
        raise InvalidValueError(
            "the motion has no such time", where="time", given=time, allowed=f"{start:g} to {end:g} s"
        )


def _require(subject: CompiledModel | Equilibrium | Trajectory | PlanResult) -> Structure | BodySystem:
    """Return the structure of a result; raises InvalidValueError if it is not known."""
    if subject.structure is None:
        raise InvalidValueError(
            "the structure is not known, since the library was loaded without its scene",
            where="subject",
            given=type(subject).__name__,
            allowed="results of models of `compile_scene`",
            hint="draw(structure), with the structure of load_scene",
        )
    return subject.structure
