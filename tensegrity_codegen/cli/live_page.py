"""Live pages for verbs: three.js, motion, modes, and the file."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.scene_files import write_text
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

if TYPE_CHECKING:
    from tensegrity_codegen.cli.picture import ShowOptions
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


MOST_OFFERED = 2000  # members up to which pages offer radau unasked: for 9,384 its C took 45 s to write
USUAL_MODES = 6
METHODS = ("auto", "rk54", STIFF_INTEGRATOR)
SHOWN = ("acceleration", "member_tension", "kinetic_energy", "total_energy", "node_position", "node_velocity")

ThreeOption = Annotated[
    Path | None,
    typer.Option("--three", help="Wheel of NiceGUI that contains three.js, where pip cannot download it."),
]


def show_live(
    output: Output,
    scene: Path,
    out: Path,
    trajectory: Path | None,
    options: "ShowOptions",
) -> tuple[dict[str, Any], str]:
    """Write a live page of a scene; return the result of the verb as data and as text."""
    from tensegrity_codegen.cli.picture import describe_left_out
    from tensegrity_codegen.live.live_scene import MOST_NAMES, LiveStart, build_live_scene
    from tensegrity_codegen.live.modes import find_modes
    from tensegrity_codegen.live.render_live import render_live
    from tensegrity_codegen.live.three_module import find_three
    from tensegrity_codegen.pipeline.settle import find_settled
    from tensegrity_codegen.report.pictures.draw import find_rigid
    from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
    from tensegrity_codegen.structure.outline import outline_tendons

    subject, request = output.load(scene, settles=options.settle)
    motion = None if trajectory is None else read_trajectory(trajectory, outline_tendons(subject))
    module, licence = find_three(options.three)
    known: dict[str, Any] = {"rigid": find_rigid(subject, request)}
    if options.settle:
        subject, found = find_settled(subject, request, warn=output.warn)
        known = {"tension": found.member_tension}
    analysis, note = find_modes(
        subject, request, USUAL_MODES if options.modes is None else options.modes, output.warn
    )
    choices = options.choices
    start = LiveStart(choices.view, choices.labels, choices.follow)
    shown = build_live_scene(subject, motion, analysis, modes_note=note, start=start, **known)
    text = render_live(replace(shown, warnings=tuple(output.warned)), module, licence)
    write_text(text, out, overwrite=options.overwrite)
    size = len(text.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "n_frames": 1 if motion is None else len(motion.time),
        "n_modes": len(shown.data["modes"]),
        "modes_note": note,
        "rounding": dict(shown.data["rounding"]),
        **describe_left_out(output, subject, choices.labels, MOST_NAMES),
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def play_live(
    output: Output,
    scene: Path,
    out: Path,
    rtol: float,
    method: str,
    settle: bool,
    three: Path | None,
    overwrite: bool,
) -> tuple[dict[str, Any], str]:
    """Write a page in which the model of a scene runs; return the result of the verb as data and as text."""
    from tensegrity_codegen.live.engine import add_engine
    from tensegrity_codegen.live.live_scene import build_live_scene
    from tensegrity_codegen.live.render_live import render_live
    from tensegrity_codegen.live.three_module import find_three
    from tensegrity_codegen.pipeline.build_library import build_library, check_buildable

    _check_tolerance(rtol)
    check_choice(method, METHODS, "method", "--method")
    subject, request = output.load(scene, settles=settle)
    wanted = request_play(subject, request, method)
    check_buildable(subject, wanted)
    module, licence = find_three(three)
    if settle:
        subject = settle_subject(output, subject, request)
    built = build_library(subject, wanted, target="wasm32")
    shown = build_live_scene(subject)
    running = add_engine(shown, subject, built.manifest, built.path.read_bytes(), rtol=rtol, method=method)
    text = render_live(replace(running, warnings=tuple(output.warned)), module, licence)
    write_text(text, out, overwrite=overwrite)
    size = len(text.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "module_bytes": built.path.stat().st_size,
        "integrator": running.data["engine"]["method"],
        "integrators": [item.name for item in built.manifest.integrators],
        "rtol": rtol,
        "sliders": [slider["label"] for slider in running.data["engine"]["sliders"]],
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def settle_subject(output: Output, subject: "Subject", request: "ModelRequest") -> "Subject":
    """Return the structure at its equilibrium, at rest; raises ConvergenceError where none is found."""
    from tensegrity_codegen.pipeline.settle import find_settled

    settled, _ = find_settled(subject, request, warn=output.warn)
    return settled


def request_play(subject: "Subject", request: "ModelRequest", method: str = "auto") -> "ModelRequest":
    """Return the request for a model that runs in a page: loads, gravity and damping change at run time.

    method: integrator with which the page starts; the stiff one is offered besides where there is one.
    """
    import numpy as np

    from tensegrity_codegen.live.engine import EXPLICIT
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import check_buildable

    needs = find_needs("simulate", subject, request, method=EXPLICIT)
    shown = [name for name in needs.quantities if name in SHOWN]
    cables = tuple(int(e) for e in np.flatnonzero(subject.tension_only & (subject.mu > 0)))
    parameters = {"node_load": tuple(range(subject.n_nodes)), "gravity": (), "damping": cables}
    kept = {name: rows for name, rows in parameters.items() if rows or name == "gravity"}
    offered = (
        (EXPLICIT, STIFF_INTEGRATOR) if method == STIFF_INTEGRATOR or _offers_stiff(subject) else (EXPLICIT,)
    )
    wanted = request.wanting(*shown, integrators=offered, parameters=kept)
    wanted = replace(
        wanted, events=(), precision="double", batch_width=0, interfaces=(), keep=(), driven=("pull",)
    )
    try:
        check_buildable(subject, wanted)
    except FormulationError:
        if method == STIFF_INTEGRATOR:
            raise
        return replace(wanted, integrators=(EXPLICIT,))
    return wanted


def _offers_stiff(subject: "Subject") -> bool:
    """Return whether a page offers the implicit method: of many members only where they call for it."""
    from tensegrity_codegen.live.engine import EXPLICIT, choose_method
    from tensegrity_codegen.structure.outline import outline_bodies

    if subject.n_members <= MOST_OFFERED:
        return True
    return choose_method(outline_bodies(subject), (EXPLICIT, STIFF_INTEGRATOR)) == STIFF_INTEGRATOR


def _check_tolerance(rtol: float) -> None:
    if not 1e-12 <= rtol <= 1e-2:
        raise InvalidValueError(
            "the tolerance is out of range", where="--rtol", given=rtol, allowed="1e-12 to 1e-2"
        )
