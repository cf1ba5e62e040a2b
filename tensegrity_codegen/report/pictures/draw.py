"""One function that draws what there is: a scene, a model, an equilibrium, a sample of a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.errors import InvalidValueError
from tensegrity_codegen.report.pictures.plots import draw_structure
from tensegrity_codegen.report.pictures.rest_tension import find_rest_tension
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.planning.outcome import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.outline import outline_bodies
from tensegrity_codegen.structure.structure import Structure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Drawable", "draw", "outline_motion"]

FloatArray = NDArray[np.float64]
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
class _Shot:
    """What a picture shows; node_position, member_tension: None for those of the structure."""

    subject: Structure | BodySystem
    node_position: FloatArray | None = None
    member_tension: FloatArray | None = None
    note: str = ""


def draw(
    subject: Drawable,
    *,
    time: float | None = None,
    sample: int | None = None,
    labels: bool = False,
    title: str | None = None,
) -> Figure:
    """Draw a structure as a figure of matplotlib, its members coloured by their tensions.

    Parameters
    ----------
    subject : Drawable
        A scene as for `read_scene` (file, mapping or Scene), a Structure, BodySystem or CompiledModel at the
        positions of the scene, an Equilibrium, a sample of a Trajectory, or a point of a PlanResult.
    time : float, optional
        Of a motion: the sample nearest to this time [s].
    sample : int, optional
        Of a motion or plan: the number of the sample or point, negative from the end; by default the last.
    labels : bool
        Whether names of nodes and members are written.
    title : str, optional
        Title; by default the name of the scene.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which notebooks show; ``figure.savefig("prism.png")`` writes it to a file.

    Raises
    ------
    MissingExtraError
        matplotlib is not installed.
    InvalidValueError
        A sample that does not exist, a time with something else than a motion, or a result without structure.
    SceneError
        A scene that cannot be read.

    Examples
    --------
    >>> from tensegrity_codegen import draw
    >>> figure = draw("prism.toml", labels=True)
    >>> figure.savefig("prism.png")
    """
    shot = _find_shot(subject, time, sample)
    structure = outline_bodies(shot.subject)
    tension = find_rest_tension(shot.subject) if shot.member_tension is None else shot.member_tension
    if shot.member_tension is not None:
        tension = _with_bodies(tension, structure)
    return draw_structure(
        structure,
        node_position=shot.node_position,
        member_tension=tension,
        title=title,
        note=shot.note or None,
        labels=labels,
    )


def outline_motion(motion: Trajectory, structure: Structure) -> Trajectory:
    """Return the motion with the bars and edges of bodies, after its tendons, whose tensions are unknown."""
    tension = _with_bodies(motion.member_tension, structure)
    return replace(motion, member_name=structure.member_name, member_tension=tension)


def _with_bodies(tension: FloatArray, structure: Structure) -> FloatArray:
    """Return tensions (..., n_members) with NaN for the bars and edges of bodies of `structure`."""
    more = structure.n_members - tension.shape[-1]
    widths = [(0, 0)] * (tension.ndim - 1) + [(0, more)]
    padded: FloatArray = np.pad(tension, widths, constant_values=np.nan)
    return padded


def _find_shot(subject: Any, time: float | None, sample: int | None) -> _Shot:
    """Return what a picture of `subject` shows."""
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
        found, _ = assemble_scene(read_scene(subject), name_source(subject))
        return _Shot(found)
    if isinstance(subject, Structure | BodySystem):
        return _Shot(subject)
    if isinstance(subject, Equilibrium):
        note = f"equilibrium: {subject.headline()}"
        return _Shot(_require(subject), subject.node_position, subject.member_tension, note)
    if isinstance(subject, CompiledModel):
        return _Shot(_require(subject))
    raise InvalidValueError(
        f"a {type(subject).__name__} cannot be drawn",
        where="subject",
        given=type(subject).__name__,
        allowed="a scene, Structure, CompiledModel, Equilibrium, Trajectory or PlanResult",
    )


def _find_sample(subject: Trajectory | PlanResult, time: float | None, sample: int | None) -> _Shot:
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
    note = f"point {number % count} of {count}" if times is None else f"t = {times[number]:.6g} s"
    return _Shot(_require(subject), subject.node_position[number], subject.member_tension[number], note)


def check_time(time: float, first: float, last: float) -> None:
    """Raise InvalidValueError for a time [s] that is not within a motion, up to rounding."""
    slack = 1e-9 * (last - first)
    if not (isinstance(time, int | float) and first - slack <= time <= last + slack):
        raise InvalidValueError(
            "the motion has no such time", where="time", given=time, allowed=f"{first:g} to {last:g} s"
        )


def _require(subject: CompiledModel | Equilibrium | Trajectory | PlanResult) -> Structure | BodySystem:
    """Return the structure of a result; raises InvalidValueError where it is not known."""
    if subject.structure is None:
        raise InvalidValueError(
            "the structure is not known, since the library was loaded without its scene",
            where="subject",
            given=type(subject).__name__,
            allowed="results of models of `compile_scene`",
            hint="draw(structure), with the structure of load_scene",
        )
    return subject.structure
