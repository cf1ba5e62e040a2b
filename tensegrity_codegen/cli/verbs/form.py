"""`tensegrity-codegen form`: a shape in balance, and the rest lengths that hold it."""

from pathlib import Path
from typing import Annotated, Any

import typer

from tensegrity_codegen.cli.options import (
    CompilerOption,
    OverwriteOption,
    PrintOptions,
    SceneArgument,
    parse_member_numbers,
    parse_member_values,
)
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.picture import PAGE, form_live
from tensegrity_codegen.cli.verb import Verb

OF = "NAME is a member, a group, a class, cables or bars; may be repeated."
DensityOption = Annotated[
    list[str] | None,
    typer.Option(
        "--density", help=f"Tension over length [N/m]: NAME=VALUE, below 0 for bars that push. {OF}"
    ),
]
ForceOption = Annotated[list[str] | None, typer.Option("--force", help=f"Tension [N]: NAME=VALUE. {OF}")]
LengthOption = Annotated[list[str] | None, typer.Option("--length", help=f"Length [m]: NAME=VALUE. {OF}")]

TargetLengthOption = Annotated[
    list[str] | None,
    typer.Option(
        "--target-length", help=f"Length to come near to [m]: NAME=VALUE or NAME=VALUE,WEIGHT. {OF}"
    ),
]
TargetForceOption = Annotated[
    list[str] | None,
    typer.Option(
        "--target-force", help=f"Tension to come near to [N]: NAME=VALUE or NAME=VALUE,WEIGHT. {OF}"
    ),
]
RangeOption = Annotated[
    list[str] | None, typer.Option("--length-range", help=f"Least and largest length [m]: NAME=A,B. {OF}")
]
LoadPathOption = Annotated[
    bool, typer.Option("--least-load-path", help="Minimise the sum of |tension| times length.")
]


def form(
    scene: SceneArgument,
    density: DensityOption = None,
    force: ForceOption = None,
    length: LengthOption = None,
    target_length: TargetLengthOption = None,
    target_force: TargetForceOption = None,
    length_range: RangeOption = None,
    least_load_path: LoadPathOption = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Write the scene in this shape, with rest lengths (.toml), or a page with a slider for each "
            "force density (.html).",
        ),
    ] = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: PrintOptions,
) -> None:
    """Find a shape in which the forces balance, from force densities, forces and lengths of members.

    Bars keep their lengths unless something else is stated; beside cables of stated lengths, --density
    bars=-100 finds how long bars that push must be. Loads, weights, anchors and stiffnesses are
    those of the scene; its rest lengths are not used. Exit code 3 where there is no such shape, where it is
    not determined, or where the structure would leave it. With targets, ranges or --least-load-path the
    densities are where a search over all of them begins.

    Example: tensegrity-codegen form icosahedron.toml --density cables=100 --out formed.toml
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        check_result(out, ".toml", PAGE, inputs=[scene], overwrite=overwrite)
        stated: dict[str, Any] = {
            kind: parse_member_values(texts or [], f"--{kind}")
            for kind, texts in (("density", density), ("force", force), ("length", length))
        }
        goals: dict[str, Any] = {
            "target_length": parse_member_numbers(target_length or [], "--target-length", (1, 2)),
            "target_force": parse_member_numbers(target_force or [], "--target-force", (1, 2)),
            "length_range": parse_member_numbers(length_range or [], "--length-range", (2,)),
        }
        from tensegrity_codegen.pipeline.forming.form import form as find
        from tensegrity_codegen.report.tables import members_table
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.system.threads import limit_threads

        if least_load_path or any(goals.values()):
            limit_threads()  # the matrices are too small for several: waiting for each other takes longer
        shape = find(scene, **stated, **goals, least_load_path=least_load_path, compiler=compiler)
        if out is not None and out.suffix.lower() == PAGE:
            form_live(shape, stated["density"], out, overwrite)
        elif out is not None:
            write_scene(shape.document, out, overwrite=overwrite)
        data = {**shape.as_evidence(), "out": None if out is None else str(out)}
        lines = [f"largest force that is not balanced: {shape.residual:.3g} N"]
        if out is not None:
            lines.append(str(out))
        table = members_table(shape.structure, shape.member_length, shape.member_tension)
        output.result(data, shape.headline(), table, *lines)
        if shape.status != "stable":
            raise typer.Exit(3)


VERB = Verb(form, order=105)
