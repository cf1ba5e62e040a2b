"""One function that draws structures and results, as a figure of matplotlib."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.pipeline.settle import find_settled, move_near_origin, with_statics
from tensegrity_codegen.report.pictures.draw import Drawable, Shot, draw_shot, find_shot
from tensegrity_codegen.report.pictures.view import (
    Labels,
    PictureChoices,
    read_labels,
    read_size,
    read_view,
)
from tensegrity_codegen.runtime.analysis.analyse import Analysis, analyse
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.plan_result import PlanResult
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.read import name_source, read_scene
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.subject import Subject, assemble_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_instance, check_switch
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError
from tensegrity_codegen.tables.request import ModelRequest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_COORDINATES = 1000  # of structures whose modes are found; the analysis takes dense matrices


def find_modes(
    subject: Subject, request: ModelRequest, count: int, warn: Callable[[str], None]
) -> tuple[Analysis | None, str]:
    """Return the analysis with natural modes and mechanisms, or None and why there is none."""
    if count == 0:
        return None, ""
    size = subject.n_coordinates
    if size > MAX_COORDINATES:
        return None, f"No modes: more than {MAX_COORDINATES} coordinates ({size})."
    if size == 0:
        return None, "No modes: no node can move."
    try:
        centred, _ = move_near_origin(subject, request)
        statics = with_statics(centred, request)
        needs = find_needs("analyse", centred, statics).alone(statics)
        return analyse(build_library(centred, needs, calls=FEW_CALLS).load(), n_modes=count), ""
    except TensegrityError as error:
        warn(f"the page has no modes: {error.problem}")
        return None, f"No modes: {error.problem}."


def check_follow(follow: bool, subject: Any) -> None:
    """Raise InvalidValueError if `follow` names something that does not move."""
    if follow and not isinstance(subject, Trajectory | PlanResult):
        raise InvalidValueError(
            "nothing moves that could be followed", where="follow", given=True,
            allowed="a Trajectory or a PlanResult as the subject",
        )  # fmt: skip


def settle_drawable(subject: Any) -> tuple[Subject, Equilibrium]:
    """Return a scene, structure or model at its equilibrium, and the equilibrium."""
    structure, request = find_request(subject)
    return find_settled(structure, request)


def find_request(subject: Any) -> tuple[Subject, ModelRequest]:
    """Return structure and request of a scene, structure or model; raises InvalidValueError for others."""
    if isinstance(subject, str | Path | Mapping | Scene):
        return assemble_scene(read_scene(subject), name_source(subject))
    if isinstance(subject, CompiledModel) and subject.structure is not None:
        return subject.structure, _guess_request(subject.structure, subject.manifest.rigid_bar)
    if isinstance(subject, Structure | BodySystem):
        return subject, _guess_request(subject, ())
    raise InvalidValueError(
        "only a scene, structure or model has an equilibrium to be found",
        where="settle",
        given=type(subject).__name__,
        allowed="a scene, Structure, BodySystem or CompiledModel of `compile_scene`",
        hint="an Equilibrium is drawn as it is",
    )


def _guess_request(subject: Subject, rigid_bar: tuple[str, ...]) -> ModelRequest:
    """Return a request in the formulation for a structure, with these bars rigid."""
    if isinstance(subject, BodySystem):
        return ModelRequest((), formulation="bodies")
    if not subject.is_rigid.any() and not rigid_bar:
        return ModelRequest(())
    every = len(rigid_bar) > int(subject.is_rigid.sum())
    return ModelRequest((), formulation="rigid_bar", options={"bars": "all"} if every else {})


def draw(
    subject: Drawable,
    *,
    time: float | None = None,
    sample: int | None = None,
    labels: Labels = False,
    title: str | None = None,
    view: str | tuple[float, float] | None = None,
    size: str | tuple[int, int] | None = None,
    color: str = "tension",
    forces: bool = True,
    settle: bool = False,
    follow: bool | None = None,
) -> "Figure":
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
    labels : bool, str or sequence of str
        Which names are written: True for all, ``"nodes"``, ``"members"``, ``"none"``. Of more than 100 nodes
        or 60 members none are.
    title : str, optional
        Title; by default the name of the scene.
    view : str or pair of float, optional
        ``"iso"``, ``"front"``, ``"side"``, ``"top"``, or azimuth and elevation of the eye [deg]; by default
        the direction from which the fewest members hide nodes.
    size : str or pair of int, optional
        Width and height in pixels, ``"1200x900"``; texts keep their proportion to it.
    color : str
        The quantity of the colours: ``"tension"``, ``"force_density"``, ``"stress"`` or ``"kind"``. An
        unknown value, such as the tension of a rigid bar out of equilibrium, has a colour of its own.
    forces : bool
        Whether loads and reactions are drawn, as arrows of one scale.
    settle : bool
        Whether a scene, structure or model is drawn at its equilibrium instead of its stated positions.
    follow : bool, optional
        Of a motion or plan: whether the axes fit this sample, as by default, instead of the whole motion.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which notebooks show; ``figure.savefig("prism.png")`` writes it to a file.

    Raises
    ------
    MissingExtraError
        matplotlib is not installed.
    InvalidValueError
        A sample that does not exist, a time with something else than a motion, a result without structure,
        `follow` of something that does not move, or a choice that does not exist.
    NonFiniteError
        A sample with positions or tensions of cables that are not finite.
    ConvergenceError
        With settle: no stable equilibrium was found.
    SceneError
        A scene that cannot be read.

    Examples
    --------
    >>> from tensegrity_codegen import draw
    >>> figure = draw("prism.toml", labels=True)
    >>> figure.savefig("prism.png")
    """
    if title is not None:
        check_instance(title, str, "title", "a text, or None")
    check_follow(follow is not None and check_switch(follow, "follow"), subject)
    choices = PictureChoices(
        view=read_view(view), size=read_size(size), labels=read_labels(labels), color=color,
        forces=check_switch(forces, "forces"), follow=follow is not False,
    )  # fmt: skip
    if not check_switch(settle, "settle"):
        return draw_shot(find_shot(subject, time, sample), choices, title)[0]
    settled, equilibrium = settle_drawable(subject)
    shot: Shot = find_shot(equilibrium, time, sample)
    return draw_shot(replace(shot, subject=settled), choices, title)[0]
