"""The verb `export`: a scene is written in the format of another program."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from tensegrity_codegen.cli.control_options import design_prediction, list_export_options, read_export_options
from tensegrity_codegen.cli.options import CompilerOption, JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import OptionGroup, Verb, VerbCommand
from tensegrity_codegen.tables.request import ModelRequest

FormatArgument = Annotated[
    str, typer.Argument(metavar="FORMAT", help="One of the formats below.", show_default=False)
]
TrajectoryOption = Annotated[
    Path | None,
    typer.Option("--trajectory", help="csv, dxf, gltf, vtk: result file of the verb simulate (.npz)."),
]
SampleOption = Annotated[
    float | None,
    typer.Option(
        "--sample",
        help="dxf: sample of --trajectory, from 0 (the last); acados: time between two commands [s] (0.005).",
    ),
]
OutOption = Annotated[
    Path, typer.Option("--out", "-o", help="File to write; for csv and acados a folder.", show_default=False)
]


class ExportCommand(VerbCommand):
    """Lists the formats below the options of `export --help`."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the formats."""
        from tensegrity_codegen.export.exporter import find_exporters

        rows = [(exporter.name, exporter.title) for exporter in find_exporters()]
        if rows:
            with formatter.section("Formats"):
                formatter.write_dl(rows)


@dataclass(frozen=True)
class FmuOptions:
    """Options that only FMUs have; None where they are not given."""

    fmi: Annotated[
        str | None, typer.Option("--fmi", help="fmu: version of the standard, 2.0 or 3.0 (2.0).")
    ] = None
    kind: Annotated[
        str | None,
        typer.Option("--kind", help="fmu: me (model exchange), cs (co-simulation) or both (both)."),
    ] = None
    outputs: Annotated[
        list[str] | None,
        typer.Option("--output", help="fmu: quantity that is an output; repeat for several."),
    ] = None
    method: Annotated[
        str | None, typer.Option("--method", help="fmu: integrator of the co-simulation (auto).")
    ] = None
    t_end: Annotated[
        float | None, typer.Option("--t-end", help="fmu: stop time of the default experiment [s] (1).")
    ] = None
    rtol: Annotated[
        float | None, typer.Option("--rtol", help="fmu: relative tolerance of the default experiment (1e-6).")
    ] = None
    sources_only: Annotated[
        bool,
        typer.Option("--sources-only", help="fmu: no binary for this machine, which needs a C compiler."),
    ] = False
    targets: Annotated[
        list[str] | None,
        typer.Option(
            "--target",
            help="fmu: machine that a binary is compiled for, by zig, instead of this one; repeat for "
            "several.",
        ),
    ] = None


def export_scene(
    format_name: FormatArgument,
    scene: SceneArgument,
    out: OutOption,
    *,
    trajectory: TrajectoryOption = None,
    sample: SampleOption = None,
    fmu: FmuOptions,
    controlled: Annotated[dict[str, Any], OptionGroup(list_export_options)],
    compiler: CompilerOption = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Write a scene in the format of another program, its shape or a motion of it for viewers.

    acados: the motion and model-predictive control of the verb control, by the same options.

    Example: tensegrity-codegen export fmu prism.toml --out prism.fmu
    """
    # An option that is not given is None.
    options: dict[str, Any] = {
        name: None if value is False or value == [] else value for name, value in vars(fmu).items()
    }
    options |= {"compiler": compiler, "trajectory": trajectory, "sample": sample}
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.export.exporter import ExportSource, check_export, write_export

        inputs = (scene,) if trajectory is None else (scene, trajectory)
        of_design = {key: None if value == [] else value for key, value in controlled.items()}
        of_design["sample"] = sample
        chosen = check_export(
            format_name, out, overwrite=overwrite, inputs=inputs, of_design=of_design, **options
        )
        if "design" in chosen.options:
            held, stated = read_export_options(of_design)
            subject, design = design_prediction(output, scene, held, stated, compiler)
            source, options = ExportSource(scene, subject, ModelRequest(())), {"design": design}
        else:
            source = ExportSource(scene, *output.load(scene))
        exported = write_export(format_name, source, out, overwrite=overwrite, **options)
        for note in exported.notes:
            output.warn(note)
        output.result(
            {"status": "ok", "format": format_name, "out": str(out)}
            | dict(exported.facts)
            | {"notes": list(exported.notes)},
            f"wrote {out}: " + ", ".join(f"{key} {value}" for key, value in exported.facts.items()),
        )


VERB = Verb(export_scene, order=520, name="export", command=ExportCommand)
