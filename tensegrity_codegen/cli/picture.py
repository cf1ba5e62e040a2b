"""Pictures and films for verbs: what is drawn, in which file, and what is said of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice
from tensegrity_codegen.system.files import write_text
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

if TYPE_CHECKING:
    from tensegrity_codegen.pipeline.forming.form import Form
    from tensegrity_codegen.report.pictures.view import PictureChoices
    from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

ANIMATED = (".gif", ".mp4")
PAGE = ".html"
USUAL_FPS = 25.0


@dataclass(frozen=True)
class ShowOptions:
    """Options of `show`; None: not given."""

    choices: "PictureChoices"
    fps: float | None = None
    slow_down: float | None = None
    settle: bool = False
    is_color_given: bool = False
    modes: int | None = None
    three: Path | None = None
    overwrite: bool = False


def check_kind(out: Path, trajectory: Path | None, options: ShowOptions) -> None:
    """Raise InvalidValueError for a kind of file that there is not, and options that it cannot have."""
    from tensegrity_codegen.report.pictures.canvas import PICTURE_SUFFIXES, check_suffix

    suffix = check_suffix(out, (*PICTURE_SUFFIXES, *ANIMATED, PAGE), where="--out")
    if suffix in ANIMATED and trajectory is None:
        problem, allowed = "a film needs a motion", "an .npz file of the verb simulate"
        hint = "tensegrity-codegen simulate SCENE --t-end 1 --out FILE.npz first"
        raise InvalidValueError(problem, where="--trajectory", given=None, allowed=allowed, hint=hint)
    is_page, choices = suffix == PAGE, options.choices
    color = choices.color if options.is_color_given else None
    # Options with their values, whether this file can have them, why not, which can
    rules: tuple[tuple[dict[str, Any], bool, str, str], ...] = (
        (
            {"--fps": options.fps, "--slow-down": options.slow_down}, suffix in ANIMATED,
            "only films have frames and a speed", "with .gif and .mp4",
        ),
        (
            {"--modes": options.modes, "--three": options.three}, is_page,
            "only live pages have modes and three.js", "with .html",
        ),
        (
            {"--settle": options.settle or None}, trajectory is None,
            "a motion has positions of its own", "without --trajectory",
        ),
        (
            {"--follow": choices.follow or None}, trajectory is not None,
            "nothing moves that axes could follow", "with --trajectory",
        ),
        ({"--size": choices.size}, not is_page, "a live page fills its window", "with pictures and films"),
        (
            {"--color": color, "--no-forces": None if choices.forces else True}, not is_page,
            "a live page has controls for this", "with pictures and films",
        ),
    )  # fmt: skip
    for values, is_allowed, problem, allowed in rules:
        for option, value in values.items():
            if value is not None and not is_allowed:
                shown = "x".join(map(str, value)) if isinstance(value, tuple) else value
                hint = f"{out.name} without {option}"
                raise InvalidValueError(problem, where=option, given=shown, allowed=allowed, hint=hint)


def show_picture(
    output: Output, scene: Path, out: Path, trajectory: Path | None, options: ShowOptions
) -> tuple[dict[str, Any], str]:
    """Write a picture or film of a scene; return the result of the verb as data and as text."""
    from tensegrity_codegen.report.loads import describe_other_loads
    from tensegrity_codegen.structure.structure import Structure

    _require_packages(out)
    subject, request = output.load(scene, settles=options.settle)
    motion = None
    if trajectory is not None:
        motion = _write_motion(output, subject, out, trajectory, options)
        unknown = 0
    else:
        unknown = _write_scene(output, subject, request, out, options)
    data: dict[str, Any] = {"status": "ok", "out": str(out)}
    if unknown:
        data["n_unknown"] = unknown
    data |= describe_left_out(output, subject, options.choices.labels)
    undrawn = describe_other_loads(subject, motion)
    if undrawn and options.choices.forces:
        output.warn(undrawn)
    summary = f"wrote {out}"
    if unknown:
        summary += f"; {unknown} tension{'s' * (unknown > 1)} unknown"
        if isinstance(subject, Structure) and not options.settle:
            summary += ", which --settle shows at the equilibrium"
    return data, summary


def _write_motion(
    output: Output, subject: "Subject", out: Path, trajectory: Path, options: ShowOptions
) -> "Trajectory":
    """Write a film, or a page with the first and last shape and diagrams; return the motion."""
    from tensegrity_codegen.report.pictures.animate import write_animation
    from tensegrity_codegen.report.pictures.draw import outline_motion
    from tensegrity_codegen.report.pictures.plots import plot_trajectory
    from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
    from tensegrity_codegen.structure.outline import outline_bodies, outline_tendons

    structure = outline_bodies(subject)
    motion = outline_motion(read_trajectory(trajectory, outline_tendons(subject)), structure)
    if out.suffix.lower() not in ANIMATED:
        plot_trajectory(
            structure, motion, out, choices=options.choices, subject=subject, overwrite=options.overwrite
        )
        return motion
    with output.progress("drawing") as progress:
        write_animation(
            structure, motion, out, fps=USUAL_FPS if options.fps is None else options.fps,
            slow_down=1.0 if options.slow_down is None else options.slow_down,
            progress=progress, choices=options.choices, subject=subject, overwrite=options.overwrite,
        )  # fmt: skip
    return motion


def _write_scene(
    output: Output, subject: "Subject", request: "ModelRequest", out: Path, options: ShowOptions
) -> int:
    """Write a picture of the stated positions or the equilibrium; return how many tensions are unknown."""
    import numpy as np

    from tensegrity_codegen.report.pictures.canvas import PICTURE_SUFFIXES, check_suffix, save_figure
    from tensegrity_codegen.report.pictures.draw import Shot, draw_shot, find_rigid, find_shot

    suffix = check_suffix(out, PICTURE_SUFFIXES)
    if options.settle:
        from tensegrity_codegen.pipeline.settle import find_settled

        output.entitle("finding the equilibrium")
        settled, equilibrium = find_settled(subject, request, warn=output.warn)
        shot = replace(find_shot(equilibrium), subject=settled, note="")
    else:
        shot = Shot(subject, rigid=find_rigid(subject, request))
        if options.choices.forces:
            warn_of_balance(output, subject)
    figure, tension = draw_shot(shot, options.choices, is_vector=suffix != ".png")
    save_figure(figure, out, overwrite=options.overwrite)
    return int(np.isnan(tension).sum())


def warn_of_balance(output: Output, subject: "Subject") -> None:
    """Warn where reactions and tensions of a picture balance other loads than those that it shows."""
    from tensegrity_codegen.report.pictures.marks import choose_unit, describe_force
    from tensegrity_codegen.report.pictures.shown import find_imbalance

    lacking = find_imbalance(subject)
    if lacking:
        node, force = lacking[0], describe_force(lacking[1], choose_unit(lacking[1]))
        output.warn(
            f"the stated positions are not in balance: {node} by {force}, which no tension "
            "or reaction shows; --settle draws the equilibrium"
        )


def describe_left_out(
    output: Output, subject: "Subject", labels: tuple[str, ...], most: int | None = None
) -> dict[str, Any]:
    """Warn of names that are left out since they are too many; return the key of the JSON that says so."""
    from tensegrity_codegen.report.pictures.marks import choose_names
    from tensegrity_codegen.structure.outline import hide_bodies, outline_bodies

    _, omitted = choose_names(hide_bodies(outline_bodies(subject)), labels, most)
    for entry in omitted:
        output.warn(entry.describe())
    rows = [{"kind": entry.kind, "count": entry.count, "limit": entry.limit} for entry in omitted]
    return {"labels_left_out": rows} if rows else {}


def _require_packages(out: Path) -> None:
    """Raise MissingExtraError if what draws this kind of file is not installed."""
    from tensegrity_codegen.report.pictures.animate import find_ffmpeg
    from tensegrity_codegen.system.extras import import_extra, require_plot

    require_plot()
    if out.suffix.lower() == ".gif":
        import_extra("PIL.Image")
    elif out.suffix.lower() == ".mp4":
        find_ffmpeg(out)


MOST_OFFERED = 2000  # members up to which pages offer implicit steps unasked: C for 9,384 took 45 s to write
USUAL_MODES = 6
METHODS = ("auto", "rk54", STIFF_INTEGRATOR)
SHOWN = ("acceleration", "member_tension", "kinetic_energy", "total_energy", "node_position", "node_velocity")

ThreeOption = Annotated[
    Path | None,
    typer.Option("--three", help="Wheel of NiceGUI that contains three.js, where pip cannot download it."),
]


def show_live(
    output: Output, scene: Path, out: Path, trajectory: Path | None, options: "ShowOptions"
) -> tuple[dict[str, Any], str]:
    """Write a live page of a scene; return the result of the verb as data and as text."""
    from tensegrity_codegen.live.draw import find_modes
    from tensegrity_codegen.live.live_page import render_live
    from tensegrity_codegen.live.live_scene import MAX_NAMES, LiveStart, build_live_scene
    from tensegrity_codegen.live.three_module import find_three
    from tensegrity_codegen.pipeline.settle import find_settled
    from tensegrity_codegen.report.pictures.draw import find_rigid
    from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
    from tensegrity_codegen.structure.outline import outline_tendons

    subject, request = output.load(scene, settles=options.settle)
    motion = None if trajectory is None else read_trajectory(trajectory, outline_tendons(subject))
    module, licence = find_three(options.three)
    tensions_known: dict[str, Any] = {"rigid": find_rigid(subject, request)}
    if options.settle:
        subject, equilibrium = find_settled(subject, request, warn=output.warn)
        tensions_known = {"tension": equilibrium.member_tension}
    elif motion is None:
        warn_of_balance(output, subject)
    analysis, note = find_modes(
        subject, request, USUAL_MODES if options.modes is None else options.modes, output.warn
    )
    choices = options.choices
    start = LiveStart(choices.view, choices.labels, choices.follow)
    shown = build_live_scene(subject, motion, analysis, modes_note=note, start=start, **tensions_known)
    html = render_live(replace(shown, warnings=tuple(output.warned)), module, licence)
    write_text(html, out, overwrite=options.overwrite)
    size = len(html.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "n_frames": 1 if motion is None else len(motion.time),
        "n_modes": len(shown.data["modes"]),
        "modes_note": note,
        "rounding": dict(shown.data["rounding"]),
        **describe_left_out(output, subject, choices.labels, MAX_NAMES),
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def play_live(
    output: Output,
    scene: Path,
    out: Path,
    rtol: float,
    method: str,
    settle: bool,
    profile: Path | None,
    three: Path | None,
    overwrite: bool,
) -> tuple[dict[str, Any], str]:
    """Write a page in which the model of a scene runs; return the result of the verb as data and as text."""
    from tensegrity_codegen.analyses.motions.schedule import list_excesses
    from tensegrity_codegen.live.engine import add_engine
    from tensegrity_codegen.live.live_page import render_live
    from tensegrity_codegen.live.live_scene import LiveStart, build_live_scene
    from tensegrity_codegen.live.three_module import find_three
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library, check_buildable
    from tensegrity_codegen.pipeline.settle import find_settled
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile

    if not 1e-12 <= rtol <= 1e-2:
        problem = "the tolerance is out of range"
        raise InvalidValueError(problem, where="--rtol", given=rtol, allowed="1e-12 to 1e-2")
    check_choice(method, METHODS, "method", "--method")
    subject, request = output.load(scene, settles=settle)
    model_request = request_play(subject, request, method)
    check_buildable(subject, model_request)
    schedule = None if profile is None else read_profile(profile, [source.name for source in subject.inputs])
    output.warn(*list_excesses(schedule, subject))
    module, licence = find_three(three)
    if settle:
        subject, _ = find_settled(subject, request, warn=output.warn)
    built = build_library(subject, model_request, target="wasm32", calls=MANY_CALLS)
    shown = build_live_scene(subject, start=LiveStart(follow=schedule is not None))
    module_bytes = built.path.read_bytes()
    running = add_engine(
        shown, subject, built.manifest, module_bytes, rtol=rtol, method=method, profile=schedule
    )
    html = render_live(replace(running, warnings=tuple(output.warned)), module, licence)
    write_text(html, out, overwrite=overwrite)
    size = len(html.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "module_bytes": built.path.stat().st_size,
        "integrator": running.data["engine"]["method"],
        "integrators": [source.name for source in built.manifest.integrators],
        "rtol": rtol,
        "sliders": [slider["label"] for slider in running.data["engine"]["sliders"]],
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def form_live(found: "Form", density: Mapping[str, float], out: Path, overwrite: bool) -> None:
    """Write a page in which sliders move the force densities of a shape."""
    from tensegrity_codegen.live.engine import add_forming
    from tensegrity_codegen.live.live_page import render_live
    from tensegrity_codegen.live.live_scene import build_live_scene
    from tensegrity_codegen.live.three_module import find_three

    shown = build_live_scene(found.structure, tension=found.member_tension)
    write_text(render_live(add_forming(shown, found, density), *find_three()), out, overwrite=overwrite)


def request_play(subject: "Subject", request: "ModelRequest", method: str = "auto") -> "ModelRequest":
    """Return the request for a model that runs in a page: loads, gravity and damping change at run time."""
    import numpy as np

    from tensegrity_codegen.live.engine import EXPLICIT
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import check_buildable

    needs = find_needs("simulate", subject, request, method=EXPLICIT)
    shown = [name for name in needs.quantities if name in SHOWN]
    cables = tuple(int(e) for e in np.flatnonzero(subject.tension_only & (subject.mu > 0)))
    parameters = {"node_load": tuple(range(subject.n_nodes)), "gravity": (), "damping": cables}
    changeable = {name: rows for name, rows in parameters.items() if rows or name == "gravity"}
    offered = (
        (EXPLICIT, STIFF_INTEGRATOR) if method == STIFF_INTEGRATOR or _offers_stiff(subject) else (EXPLICIT,)
    )
    model_request = request.wanting(*shown, integrators=offered, parameters=changeable)
    model_request = replace(
        model_request, events=(), precision="double", batch_width=0, interfaces=(), keep=(), driven=("pull",)
    )
    try:
        check_buildable(subject, model_request)
    except FormulationError:
        if method == STIFF_INTEGRATOR:
            raise
        return replace(model_request, integrators=(EXPLICIT,))
    return model_request


def _offers_stiff(subject: "Subject") -> bool:
    """Return whether a page offers the implicit method: not with contacts, of many members where due."""
    from tensegrity_codegen.live.engine import EXPLICIT, choose_method
    from tensegrity_codegen.structure.ground_support import has_contacts
    from tensegrity_codegen.structure.outline import outline_bodies

    if has_contacts(subject):
        return False
    if subject.n_members <= MOST_OFFERED:
        return True
    return choose_method(outline_bodies(subject), (EXPLICIT, STIFF_INTEGRATOR)) == STIFF_INTEGRATOR
