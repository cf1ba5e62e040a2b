"""Live pages in notebooks."""

import html
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.live.draw import check_follow, find_modes, find_request, settle_drawable
from tensegrity_codegen.live.live_scene import LiveScene, LiveStart, build_live_scene, pack_text
from tensegrity_codegen.live.three_module import find_three
from tensegrity_codegen.report.pages.page import html_template
from tensegrity_codegen.report.pictures.draw import Drawable, find_shot
from tensegrity_codegen.report.pictures.view import Labels, read_labels, read_view
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.checks import check_path, check_switch, check_whole
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.files import write_text

FIRST, WORKER = "boot", "worker"  # scripts that are no modules
HINT = "Point at a member or node; click to keep it here."
PULL_HINT = "Drag a node to pull it; click a member to keep its numbers here."


def live_folder() -> Path:
    """Return the folder of the page's scripts and styles."""
    return template_folder() / "live"


def render_live(scene: LiveScene, three: str, licence: str) -> str:
    """Return the page as HTML, with the module of three.js and its licences."""
    folder = live_folder()
    texts = {path.stem: path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.js"))}
    channels = [{"name": name, "data": channel.data} for name, channel in scene.channels.items()]
    data = {
        **scene.data,
        "channels": {name: array.describe() for name, array in scene.channels.items()},
    }
    is_running = "engine" in scene.data
    return html_template("live", "page.html.j2").render(
        title=scene.title,
        headline=scene.headline,
        facts=scene.facts,
        warnings=scene.warnings,
        style=_raw((folder / "style.css").read_text(encoding="utf-8")),
        # JSON that ends no script element.
        scene=_raw(json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")),
        channels=channels,
        modules=[
            {"name": name, "text": _raw(script)}
            for name, script in texts.items()
            if name not in (FIRST, WORKER)
        ],
        worker=_raw(texts[WORKER]) if is_running else "",
        hint=PULL_HINT if is_running else HINT,
        boot=_raw(texts[FIRST]),
        three=pack_text(three),
        licence=licence,
    )


def _raw(text: str) -> Markup:
    """Return text that stands in the page as it is; it must not end the element that it stands in."""
    if "</s" in text.lower():
        raise ValueError("text of a script or style that would end its element")
    return Markup(text)


HEIGHTS = (200, 4000)  # pixels


@dataclass(frozen=True, repr=False)
class LivePage:
    """A live page, which notebooks show.

    Attributes
    ----------
    html : str
        The page, one HTML file without requests to anywhere.
    title : str
        Name of the structure.
    height : int
        Height of the frame in a notebook [pixels].
    """

    html: str
    title: str
    height: int

    def __repr__(self) -> str:
        """Return the text for a terminal."""
        return f"LivePage of {self.title}: {len(self.html) / 1e6:.2g} MB, `write(path)` writes it to a file"

    def _repr_html_(self) -> str:
        """Return a frame with the page inside, for notebooks and pages made from them."""
        inside = html.escape(self.html, quote=True)
        return (
            f'<iframe title="{html.escape(self.title, quote=True)}" srcdoc="{inside}" loading="lazy" '
            f'style="width:100%;height:{self.height}px;border:1px solid #8884;border-radius:6px"></iframe>'
        )

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the page to a file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            Name of the file.
        overwrite : bool
            Whether a file that exists is replaced.

        Raises
        ------
        OutputError
            The file cannot be written, or exists already.
        """
        write_text(self.html, path, overwrite=overwrite)


def view(
    subject: Drawable,
    *,
    height: int = 560,
    view: str | tuple[float, float] | None = None,
    labels: Labels = False,
    settle: bool = False,
    follow: bool = False,
    modes: int = 0,
    three: str | Path | None = None,
) -> LivePage:
    """Make a live page of a structure or a motion: to turn, play and ask, in a notebook or a file.

    Parameters
    ----------
    subject : Drawable
        A scene as for `read_scene`, a Structure, BodySystem, CompiledModel, Equilibrium or Trajectory.
    height : int
        Height of the frame in a notebook [pixels].
    view : str or pair of float, optional
        First direction: ``"iso"``, ``"front"``, ``"side"``, ``"top"``, or azimuth and elevation of the eye
        [deg].
    labels : bool, str or sequence of str
        Which names are written at first: True for all, ``"nodes"``, ``"members"``, ``"none"``.
    settle : bool
        Whether a scene, structure or model is shown at its equilibrium.
    follow : bool
        Whether the camera moves with the structure.
    modes : int
        Number of natural modes; they take an analysis, which compiles a library.
    three : str or Path, optional
        Wheel of NiceGUI that contains three.js, where pip cannot download it.

    Returns
    -------
    LivePage
        The page; ``page.write("prism.html")`` writes it to a file.

    Raises
    ------
    MissingSourceError
        three.js is neither in the cache nor can it be downloaded.
    InvalidValueError
        Something that cannot be shown, `follow` of a fixed thing, or a choice that does not exist.
    NonFiniteError
        A motion with a sample that is not finite.
    ConvergenceError
        With settle: no stable equilibrium was found.
    SceneError
        A scene that cannot be read.

    Examples
    --------
    >>> from tensegrity_codegen import view
    >>> page = view("prism.toml", labels="nodes")  # doctest: +SKIP
    >>> page.write("prism.html")  # doctest: +SKIP
    """
    if isinstance(height, bool) or not isinstance(height, int) or not HEIGHTS[0] <= height <= HEIGHTS[1]:
        allowed = f"a whole number of pixels from {HEIGHTS[0]} to {HEIGHTS[1]}"
        raise InvalidValueError("the height is out of range", where="height", given=height, allowed=allowed)
    start = LiveStart(read_view(view), read_labels(labels), check_switch(follow, "follow"))
    if three is not None:
        check_path(three, "three")
    is_settled = check_switch(settle, "settle")
    check_follow(follow, subject)
    module, licence = find_three(three)
    shown, motion, arrays = _read_shown(subject, is_settled)
    analysis, note = None, ""
    if check_whole(modes, "modes", 0):
        _, request = find_request(shown)
        analysis, note = find_modes(shown, request, modes, lambda text: warnings.warn(text, stacklevel=3))
    scene = build_live_scene(shown, motion, analysis, modes_note=note, start=start, **arrays)
    return LivePage(render_live(scene, module, licence), scene.title, height)


def _read_shown(subject: Any, settle: bool) -> tuple[Subject, Trajectory | None, dict[str, Any]]:
    """Return structure, motion, and tensions or rigid members, of the content of a page."""
    if settle:
        settled, equilibrium = settle_drawable(subject)
        return settled, None, {"tension": equilibrium.member_tension}
    shot = find_shot(subject)
    if isinstance(subject, Trajectory):
        return shot.subject, subject, {}
    if isinstance(subject, Equilibrium):
        arrays = {"tension": subject.member_tension, "load": shot.node_load}
        return _place(shot.subject, subject), None, arrays
    if shot.node_position is not None:
        raise InvalidValueError(
            f"a {type(subject).__name__} has no live page",
            where="subject",
            given=type(subject).__name__,
            allowed="a scene, Structure, CompiledModel, Equilibrium or Trajectory",
        )
    return shot.subject, None, {"rigid": shot.rigid}


def _place(subject: Subject, equilibrium: Equilibrium) -> Subject:
    """Return the structure or bodies at an equilibrium."""
    if isinstance(subject, Structure):
        return subject.with_changes(node_position=equilibrium.node_position)
    return subject.with_changes(coordinate=equilibrium.coordinate)
