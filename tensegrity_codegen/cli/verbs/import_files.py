"""The verb `import`: a scene is made from files in other formats."""

from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, parse_vector
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb, VerbCommand
from tensegrity_codegen.system.files import check_ending, check_output

GravityOption = Annotated[
    str | None, typer.Option("--gravity", help="gx,gy,gz [m/s2], in the axes of the scene.")
]
UpOption = Annotated[
    str, typer.Option("--up", help="Axis of the file that points up (x, y, z); it becomes z.")
]
ScaleOption = Annotated[
    float, typer.Option("--scale", help="Metres per unit of length of the file; kg and s stay.")
]


@dataclass(frozen=True)
class FormatOptions:
    """Options that only some formats have; None where they are not given."""

    bar_stiffness_ratio: Annotated[
        float | None,
        typer.Option(help="NTRT only: spring constant of rods over that of the stiffest cable (1000)."),
    ] = None
    rigid: Annotated[
        bool, typer.Option("--rigid", help="NTRT only: rods keep their length exactly, as in the toolkit.")
    ] = False
    pretension_scale: Annotated[
        float | None, typer.Option(help="NTRT only: factor on the pretension of all cables (1).")
    ] = None
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="DXF, glTF: distance of ends that are one node, as in the file (1e-6 of the size)."
        ),
    ] = None
    axial_stiffness: Annotated[
        float | None, typer.Option("--axial-stiffness", help="DXF, glTF: EA of cables [N] (1000).")
    ] = None


class ImportCommand(VerbCommand):
    """Lists the formats below the options of `import --help`."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the formats."""
        from tensegrity_codegen.scene.formats.format import find_formats

        with formatter.section("Formats"):
            formatter.write_dl([(format.example, format.title) for format in find_formats()])


def import_foreign(
    sources: Annotated[
        list[Path], typer.Argument(metavar="SOURCE...", help="Files in one of the formats below.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Scene file to write.", show_default=False)],
    gravity: GravityOption = None,
    up: UpOption = "z",
    scale: ScaleOption = 1.0,
    name: Annotated[
        str | None, typer.Option("--name", help="Name of the scene; from the file if not given.")
    ] = None,
    *,
    formats: FormatOptions,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Import a structure from files in another format, and write it as a scene file.

    Example: tensegrity-codegen import nodes.csv members.csv -o scene.toml --gravity 0,0,-9.81
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.scene.checks.scene_warnings import find_scene_warnings
        from tensegrity_codegen.scene.formats.format import read_files
        from tensegrity_codegen.scene.read import parse_scene
        from tensegrity_codegen.scene.subject import assemble_scene
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.structure.outline import hide_bodies, outline_tendons
        from tensegrity_codegen.system.summaries import describe_count

        check_ending(out, ".toml")
        imported = read_files(
            sources,
            name=name,
            up=up,
            scale=scale,
            gravity=None if gravity is None else parse_vector(gravity, "--gravity"),
            **{key: None if value is False else value for key, value in vars(formats).items()},
        )
        with imported.locate_errors():
            structure, _ = assemble_scene(parse_scene(imported.document, str(sources[0])), str(sources[0]))
        check_output(out, inputs=sources, overwrite=overwrite)
        write_scene(imported.document, out, overwrite=overwrite)
        turned = any("lies on its side" in note for note in imported.notes)
        doubts = find_scene_warnings(structure)
        notes = (*imported.notes, *(note for note in doubts if not (turned and "on its side" in note)))
        output.warn(*notes)
        if name is None and structure.name != out.stem:
            output.note(_describe_name(structure.name, out.stem))
        shown = hide_bodies(outline_tendons(structure))
        data = {"n_nodes": shown.n_nodes, "n_members": shown.n_members, "notes": notes}
        output.result(
            {"status": "ok", "out": str(out)} | data,
            f"wrote {out}: {describe_count(shown.n_nodes, 'node')}, "
            f"{describe_count(shown.n_members, 'member')}",
            f"next: tensegrity-codegen check {quote(str(out))}",
        )


def _describe_name(name: str, stem: str) -> str:
    """Return what the scene is called, and how it gets the name of its file, `stem`, or another one."""
    from tensegrity_codegen.scene.names import is_scene_name

    name_shown = stem if is_scene_name(stem) else "NAME"
    return (
        f'the scene is called "{name}", and so are its library and C functions; --name {name_shown} gives it '
        "another name"
    )


VERB = Verb(import_foreign, order=30, name="import", command=ImportCommand)
