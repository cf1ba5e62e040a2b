"""One function that draws what there is, as a figure of matplotlib."""

from dataclasses import replace
from typing import TYPE_CHECKING

from tensegrity_codegen.live.settled import check_follow, settle_drawable
from tensegrity_codegen.report.pictures.choices import (
    Labels,
    PictureChoices,
    read_labels,
    read_size,
    read_view,
)
from tensegrity_codegen.report.pictures.draw import Drawable, Shot, draw_shot, find_shot
from tensegrity_codegen.system.checks import check_instance, check_switch

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        What colours show: ``"tension"``, ``"force_density"``, ``"stress"`` or ``"kind"``. What is not known,
        such as the tension of a rigid bar out of equilibrium, has a colour of its own.
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
        `follow` of what does not move, or a choice that does not exist.
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
    settled, found = settle_drawable(subject)
    shot: Shot = find_shot(found, time, sample)
    return draw_shot(replace(shot, subject=settled), choices, title)[0]
