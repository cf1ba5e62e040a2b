"""`tensegrity-codegen size`: the sections with which a structure carries its loads at the least mass."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.cli.options import (
    OverwriteOption,
    PrintOptions,
    SceneArgument,
    parse_loads,
    parse_member_values,
)
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from tensegrity_codegen.structure.structure import Structure

OF = "VALUE of all members, or NAME=VALUE: a member, group, class, cables or bars; may be repeated."
ModulusOption = Annotated[list[str] | None, typer.Option("--youngs-modulus", help=f"[Pa], of bars. {OF}")]
DensityOption = Annotated[list[str] | None, typer.Option("--density", help=f"[kg/m3]. {OF}")]
YieldOption = Annotated[list[str] | None, typer.Option("--yield-stress", help=f"[Pa]. {OF}")]
CaseOption = Annotated[
    list[str] | None,
    typer.Option(
        "--case",
        help="Load CASE:NODE=fx,fy,fz [N] added to the scene's in a load case; may be repeated. CASE: alone "
        "is the loads of the scene, CASE:loads=FACTOR multiplies them, CASE:weight=FACTOR adds weights of "
        "members, CASE:NAME=FORCE is the tension [N] of a member, group or class, as a prestress has it.",
    ),
]
SectionsOption = Annotated[
    str, typer.Option("--sections", help="Areas of a catalogue [m2], A,B,...: the smallest that holds.")
]
JohnsonOption = Annotated[
    bool, typer.Option("--johnson", help="Stocky bars buckle by Johnson's parabola above half of yield.")
]
PullOption = Annotated[bool, typer.Option("--bars-pull", help="Let bars pull too.")]
SplitsOption = Annotated[
    int | None,
    typer.Option(
        help="Most intervals that the proof splits; by default 20,000 up to 40 members, 100 beyond.", min=0
    ),
]


def size(
    scene: SceneArgument,
    youngs_modulus: ModulusOption = None,
    density: DensityOption = None,
    yield_stress: YieldOption = None,
    case: CaseOption = None,
    sections: SectionsOption = "",
    johnson: JohnsonOption = False,
    bars_pull: PullOption = False,
    max_splits: SplitsOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Write the scene with these sections, as tense as in the first case."
        ),
    ] = None,
    overwrite: OverwriteOption = False,
    *,
    printing: PrintOptions,
) -> None:
    """Size bars and cables so that they carry the loads at the least mass, with a proof.

    Sections are any, or of a catalogue; load factors, weights of members and a prestress are stated in the
    cases, each of which is carried by any forces in balance. The shape is that of the scene:
    settle it first. Bars neither yield nor buckle (Euler), cables do not yield. What the scene states of
    sections is the material unless options state it. Up to about 40 members the mass is proved to be the
    least, beyond that it is the best of many local optima, with the bound that is proved. Exit code 3 where
    no forces balance the loads.

    Example: tensegrity-codegen size settled.toml --youngs-modulus 2e11 --density 7850 --yield-stress 235e6
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        check_result(out, ".toml", inputs=[scene], overwrite=overwrite)
        from tensegrity_codegen.pipeline.forming.form import require_nodes
        from tensegrity_codegen.pipeline.sizing.size_members import size_members
        from tensegrity_codegen.report.tables import sizes_table
        from tensegrity_codegen.scene.write import write_scene

        subject, _ = output.load(scene)
        sizing = size_members(
            scene,
            youngs_modulus=parse_member_values(youngs_modulus or [], "--youngs-modulus", alone="all"),
            density=parse_member_values(density or [], "--density", alone="all"),
            yield_stress=parse_member_values(yield_stress or [], "--yield-stress", alone="all"),
            load_cases=_parse_cases(case or [], require_nodes(subject, "least mass")),
            sections=_parse_sections(sections),
            column="johnson" if johnson else "euler",
            bars_pull=bars_pull,
            max_splits=max_splits,
        )
        if out is not None:
            write_scene(sizing.document, out, overwrite=overwrite)
        data = {**sizing.as_evidence(), "out": None if out is None else str(out)}
        lines = [f"proved: no sections carry the loads below {sizing.lower_bound:.9g} kg"]
        if out is not None:
            idle_mass = float(sizing.structure.member_mass[sizing.member_mass == 0].sum())
            lines.append(
                f"{out}: {idle_mass:.6g} kg more, of members without force" if idle_mass else str(out)
            )
        columns = (sizing.radius, sizing.member_mass, sizing.limit, sizing.governing_case)
        table = sizes_table(sizing.structure, sizing.member_tension, *columns)
        output.result(data, sizing.headline(), table, *lines)


def _parse_sections(text: str) -> list[float]:
    """Return the areas of a text of numbers; raises InvalidValueError."""
    try:
        return [float(area) for area in text.split(",") if text]
    except ValueError:
        raise InvalidValueError(
            "not areas", where="--sections", given=text, allowed="A,B,... [m2]", hint="for example 1e-5,2e-5"
        ) from None


def _parse_cases(texts: list[str], structure: "Structure") -> dict[str, dict[str, float | list[float]]]:
    """Return forces by node and numbers by name, by case, of CASE:NAME=... texts."""
    entries: dict[str, list[str]] = {}
    for entry in texts:
        name, colon, load = entry.partition(":")
        if not colon or not name.strip():
            problem, allowed = "not a load of a case", "CASE:NODE=fx,fy,fz"
            hint = "for example wind:t1=10,0,0"
            raise InvalidValueError(problem, where="--case", given=entry, allowed=allowed, hint=hint)
        entries.setdefault(name.strip(), []).extend([load] if load.strip() else [])
    cases: dict[str, dict[str, float | list[float]]] = {}
    for name, loads in entries.items():
        numbers = [
            load
            for load in loads
            if "," not in load and load.partition("=")[0].strip() not in structure.node_name
        ]
        forces = parse_loads([load for load in loads if load not in numbers], structure, "--case").tolist()
        by_node = {node: force for node, force in zip(structure.node_name, forces, strict=True) if any(force)}
        cases[name] = {**by_node, **parse_member_values(numbers, "--case")}
    return cases


VERB = Verb(size, order=107)
