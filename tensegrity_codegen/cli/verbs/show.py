"""`tensegrity-codegen show`: pictures, films and live pages."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.picture import PAGE, ShowOptions, ThreeOption, check_kind, show_live, show_picture
from tensegrity_codegen.cli.verb import Verb, VerbCommand
from tensegrity_codegen.system.files import check_output

OPTION = "--labels"
ALL_LABELS = "nodes,members"
WORDS = ("nodes", "members", "none")


class LabelsCommand(VerbCommand):
    """A command whose --labels without a value means all names, as when it was a flag.

    What follows is the option's value if it is one of its words, or neither an option nor a file.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words after the verb."""
        # The words with the value of --labels written out
        shown_args: list[str] = []
        is_option = True
        for k, argument in enumerate(args):
            is_option = is_option and argument != "--"
            shown_args.append(argument)
            if is_option and argument == OPTION and not _is_value(args[k + 1 : k + 2]):
                shown_args[-1] = f"{OPTION}={ALL_LABELS}"
        return super().parse_args(ctx, shown_args)


def _is_value(following: list[str]) -> bool:
    """Return whether the next word, if there is one, is meant as the value."""
    if not following or following[0].startswith("-"):
        return False
    value = following[0]
    if {label.strip().lower() for label in value.split(",")} <= {*WORDS, ""}:
        return True
    return not (Path(value).suffix or "/" in value or Path(value).exists())


USUAL_COLOR = "tension"


@dataclass(frozen=True)
class PictureOptions:
    """What is seen of a structure, and from where."""

    view: Annotated[
        str | None,
        typer.Option(
            "--view",
            help="iso, front (along y), side (along x), top, or AZIMUTH,ELEVATION of the eye in degrees.",
        ),
    ] = None
    size: Annotated[
        str | None,
        typer.Option(
            "--size", help="WIDTHxHEIGHT in pixels; .svg, .pdf: 150 pixels an inch, 1200x900 is 8 x 6 in."
        ),
    ] = None
    labels: Annotated[
        str,
        typer.Option(
            "--labels",
            metavar="[nodes|members|none]",
            help="Write names of nodes, members or both (nodes,members); without a value: of both.",
        ),
    ] = "none"
    color: Annotated[
        str | None,
        typer.Option(
            "--color", help="What colours of members show: tension, force_density, stress, kind; tension."
        ),
    ] = None
    forces: Annotated[
        bool, typer.Option("--forces/--no-forces", help="Draw loads and reactions as arrows.")
    ] = True
    settle: Annotated[
        bool, typer.Option("--settle", help="Draw the equilibrium instead of the stated positions.")
    ] = False
    follow: Annotated[
        bool, typer.Option("--follow", help="Let the axes move with the structure and keep their size.")
    ] = False


@dataclass(frozen=True)
class FileOptions:
    """What films and live pages have besides."""

    fps: Annotated[float | None, typer.Option("--fps", help="Frames a second of a film; 25.")] = None
    slow_down: Annotated[
        float | None, typer.Option("--slow-down", help="Seconds of film per simulated second; 1.")
    ] = None
    modes: Annotated[
        int | None,
        typer.Option("--modes", min=0, help="Natural modes of a live page; 6; 0 without an analysis."),
    ] = None
    three: ThreeOption = None


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
    *,
    picture: PictureOptions,
    file: FileOptions,
    json: JsonOption = False,
) -> None:
    """Draw a structure or a simulated motion, as a picture, a film or a live page.

    Arrows are loads and reactions. A tension that is not known, such as that of a rigid bar out of
    equilibrium, has a colour of its own; with --settle that of rigid bars is known.

    A live page is one HTML file to turn, play and ask members and nodes, in any browser, without a network.

    Example: tensegrity-codegen show prism.toml --trajectory prism.npz --out prism.html
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.report.pictures.view import (
            PictureChoices,
            read_labels,
            read_size,
            read_view,
        )

        choices = PictureChoices(
            view=read_view(picture.view), size=read_size(picture.size), labels=read_labels(picture.labels),
            color=USUAL_COLOR if picture.color is None else picture.color,
            follow=picture.follow, forces=picture.forces,
        )  # fmt: skip
        options = ShowOptions(
            choices, file.fps, file.slow_down, picture.settle, picture.color is not None, file.modes,
            file.three, overwrite,
        )  # fmt: skip
        inputs = [scene] if trajectory is None else [scene, trajectory]
        check_output(out, inputs=inputs, overwrite=overwrite)
        check_kind(out, trajectory, options)
        if out.suffix.lower() == PAGE:
            output.result(*show_live(output, scene, out, trajectory, options))
            return
        output.result(*show_picture(output, scene, out, trajectory, options))


VERB = Verb(show, order=230, command=LabelsCommand)
