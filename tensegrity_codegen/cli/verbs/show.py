"""`tensegrity-codegen show`: pictures, films and live pages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.cli.live_page import ThreeOption, show_live
from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.files import check_output

__all__ = ["VERB"]

ANIMATED = (".gif", ".mp4")
PAGE = ".html"


def show(
    scene: SceneArgument,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Picture (.png, .svg, .pdf), film (.gif, .mp4) or live page (.html)."
        ),
    ],
    overwrite: OverwriteOption = False,
    trajectory: Annotated[
        Path | None, typer.Option("--trajectory", help="Result file of the verb simulate (.npz).")
    ] = None,
    labels: Annotated[bool, typer.Option("--labels", help="Write the names of nodes and members.")] = False,
    slow_down: Annotated[
        float, typer.Option("--slow-down", help="Seconds of film per simulated second.")
    ] = 1.0,
    modes: Annotated[
        int, typer.Option("--modes", min=0, help="Natural modes of a live page; 0 without an analysis.")
    ] = 6,
    three: ThreeOption = None,
    json: JsonOption = False,
) -> None:
    """Draw a structure or a simulated motion, as a picture, a film or a live page.

    A live page is one HTML file to turn, play and ask members and nodes, in any browser, without a network.

    Example: tensegrity-codegen show prism.toml --trajectory prism.npz --out prism.html
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.errors import InvalidValueError
        from tensegrity_codegen.report.pictures.animate import write_animation
        from tensegrity_codegen.report.pictures.draw import outline_motion
        from tensegrity_codegen.report.pictures.plots import plot_structure, plot_trajectory
        from tensegrity_codegen.report.pictures.rest_tension import find_rest_tension
        from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
        from tensegrity_codegen.structure.outline import outline_bodies, outline_tendons

        inputs = [scene] if trajectory is None else [scene, trajectory]
        check_output(out, inputs=inputs, overwrite=overwrite)
        if out.suffix.lower() == PAGE:
            output.result(*show_live(output, scene, out, trajectory, modes, three))
            return
        _require_packages(out)
        subject, _ = output.load(scene)
        structure = outline_bodies(subject)
        motion = None
        if trajectory is not None:
            motion = outline_motion(read_trajectory(trajectory, outline_tendons(subject)), structure)
        if out.suffix.lower() in ANIMATED:
            if motion is None:
                raise InvalidValueError(
                    "a film needs a motion",
                    where="--trajectory",
                    given=None,
                    allowed="an .npz file of the verb simulate",
                    hint="tensegrity-codegen simulate SCENE --t-end 1 --out FILE.npz first",
                )
            with output.progress("drawing") as progress:
                write_animation(structure, motion, out, slow_down=slow_down, progress=progress)
        elif motion is not None:
            plot_trajectory(structure, motion, out)
        else:
            plot_structure(structure, out, member_tension=find_rest_tension(subject), labels=labels)
        output.result({"status": "ok", "out": str(out)}, f"wrote {out}")


def _require_packages(out: Path) -> None:
    """Raise MissingExtraError if what draws this kind of file is not installed."""
    from tensegrity_codegen.extras import import_extra, require_plot
    from tensegrity_codegen.report.pictures.film import find_ffmpeg

    require_plot()
    if out.suffix.lower() == ".gif":
        import_extra("PIL.Image")
    elif out.suffix.lower() == ".mp4":
        find_ffmpeg(out)


VERB = Verb(show, order=80)
