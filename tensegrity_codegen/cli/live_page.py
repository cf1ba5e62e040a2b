"""Live pages for verbs: three.js, motion, modes, and the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.errors import InvalidValueError, TensegrityError
from tensegrity_codegen.files import replaced

if TYPE_CHECKING:
    from tensegrity_codegen.request import ModelRequest
    from tensegrity_codegen.runtime.analysis.analysis import Analysis
    from tensegrity_codegen.scene.subject import Subject

__all__ = ["ThreeOption", "play_live", "show_live"]

PLAYED = "rk54"
SHOWN = ("acceleration", "member_tension", "kinetic_energy", "total_energy", "node_position", "node_velocity")
MOST_COORDINATES = 1000  # of structures whose modes are found; the analysis takes dense matrices

ThreeOption = Annotated[
    Path | None,
    typer.Option("--three", help="Wheel of NiceGUI that contains three.js, where pip cannot download it."),
]


def show_live(
    output: Output, scene: Path, out: Path, trajectory: Path | None, modes: int, three: Path | None
) -> tuple[dict[str, Any], str]:
    """Write a live page of a scene; return the result of the verb as data and as text."""
    from tensegrity_codegen.report.live.live_scene import build_live_scene
    from tensegrity_codegen.report.live.render_live import render_live
    from tensegrity_codegen.report.live.three_module import find_three
    from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
    from tensegrity_codegen.structure.outline import outline_tendons

    subject, request = output.load(scene)
    motion = None if trajectory is None else read_trajectory(trajectory, outline_tendons(subject))
    module, licence = find_three(three)
    analysis, note = find_modes(output, subject, request, modes)
    shown = build_live_scene(subject, motion, analysis, modes_note=note)
    text = render_live(shown, module, licence)
    with replaced(out) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    size = len(text.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "n_frames": 1 if motion is None else len(motion.time),
        "n_modes": len(shown.data["modes"]),
        "modes_note": note,
        "rounding": dict(shown.data["rounding"]),
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def play_live(
    output: Output, scene: Path, out: Path, rtol: float, settle: bool, three: Path | None
) -> tuple[dict[str, Any], str]:
    """Write a page in which the model of a scene runs; return the result of the verb as data and as text."""
    from tensegrity_codegen.pipeline import build_library, check_buildable
    from tensegrity_codegen.report.live.engine import add_engine
    from tensegrity_codegen.report.live.live_scene import build_live_scene
    from tensegrity_codegen.report.live.render_live import render_live
    from tensegrity_codegen.report.live.three_module import find_three

    _check_tolerance(rtol)
    subject, request = output.load(scene, settles=settle)
    wanted = request_play(subject, request)
    check_buildable(subject, wanted)
    module, licence = find_three(three)
    if settle:
        subject = settle_subject(output, subject, request)
    built = build_library(subject, wanted, target="wasm32")
    shown = build_live_scene(subject)
    running = add_engine(shown, subject, built.manifest, built.path.read_bytes(), rtol=rtol)
    text = render_live(running, module, licence)
    with replaced(out) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    size = len(text.encode("utf-8"))
    data = {
        "status": "ok",
        "out": str(out),
        "bytes": size,
        "module_bytes": built.path.stat().st_size,
        "integrator": built.manifest.integrators[0].name,
        "rtol": rtol,
        "sliders": [slider["label"] for slider in running.data["engine"]["sliders"]],
    }
    return data, f"wrote {out} ({size / 1e6:.2g} MB)"


def settle_subject(output: Output, subject: Subject, request: ModelRequest) -> Subject:
    """Return the structure at its equilibrium, at rest; raises ConvergenceError where none is found."""
    import numpy as np

    from tensegrity_codegen.pipeline import build_library, find_needs, settle_structure
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
    from tensegrity_codegen.structure.structure import Structure

    if isinstance(subject, Structure):
        settled = settle_structure(subject, request, warn=output.warn)
        return settled.with_changes(node_velocity=np.zeros_like(settled.node_position))
    wanted = find_needs("equilibrium", subject, request).alone(request)
    found = find_equilibrium(build_library(subject, wanted).load())
    for text in found.warnings:
        output.warn(text)
    return replace(subject, coordinate=found.coordinate, velocity=np.zeros_like(found.coordinate))


def request_play(subject: Subject, request: ModelRequest) -> ModelRequest:
    """Return the request for a model that runs in a page: loads, gravity and damping change at run time."""
    import numpy as np

    from tensegrity_codegen.pipeline import find_needs

    needs = find_needs("simulate", subject, request, method=PLAYED)
    shown = [name for name in needs.quantities if name in SHOWN]
    cables = tuple(int(e) for e in np.flatnonzero(subject.tension_only & (subject.mu > 0)))
    parameters = {"node_load": tuple(range(subject.n_nodes)), "gravity": (), "damping": cables}
    kept = {name: rows for name, rows in parameters.items() if rows or name == "gravity"}
    wanted = request.wanting(*shown, integrators=(PLAYED,), parameters=kept)
    return replace(wanted, events=(), precision="double", batch_width=0, interfaces=(), keep=())


def _check_tolerance(rtol: float) -> None:
    if not 1e-12 <= rtol <= 1e-2:
        raise InvalidValueError(
            "the tolerance is out of range", where="--rtol", given=rtol, allowed="1e-12 to 1e-2"
        )


def find_modes(
    output: Output, subject: Subject, request: ModelRequest, count: int
) -> tuple[Analysis | None, str]:
    """Return the analysis with natural modes and mechanisms, or None and why there is none."""
    from tensegrity_codegen.pipeline import build_library, find_needs, move_near_origin, with_statics
    from tensegrity_codegen.runtime.analysis.analyse import analyse

    if count == 0:
        return None, ""
    size = subject.n_coordinates
    if size > MOST_COORDINATES:
        return None, f"No modes: more than {MOST_COORDINATES} coordinates ({size})."
    if size == 0:
        return None, "No modes: no node can move."
    try:
        near, _ = move_near_origin(subject, request)
        statics = with_statics(near, request)
        wanted = find_needs("analyse", near, statics).alone(statics)
        return analyse(build_library(near, wanted).load(), n_modes=count), ""
    except TensegrityError as error:
        output.warn(f"the page has no modes: {error.problem}")
        return None, f"No modes: {error.problem}."
