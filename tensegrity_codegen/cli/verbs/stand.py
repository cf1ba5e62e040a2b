"""`tensegrity-codegen stand`: whether the ground can hold a structure, and what tips it."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, PrintOptions, SceneArgument, parse_loads
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.analysis.stand import Tip
    from tensegrity_codegen.runtime.contacts.judge_stand import Stand
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.structure.structure import Structure

from tensegrity_codegen.cli.analysis_verb import LoadOption

FrictionlessOption = Annotated[
    bool, typer.Option("--frictionless", help="On the ground: without friction, whatever the scene says.")
]
AsDrawnOption = Annotated[
    bool, typer.Option("--as-drawn", help="Judge the positions in the scene instead of the equilibrium.")
]
TipOption = Annotated[
    list[str] | None,
    typer.Option(
        "--tip",
        help="Find how far this cable must be shortened until the structure tips; may be repeated. all: each "
        "cable.",
    ),
]
TIP_ALL = "all"


def stand(
    scene: SceneArgument,
    as_drawn: AsDrawnOption = False,
    load: LoadOption = None,
    input: InputOption = None,
    frictionless: FrictionlessOption = False,
    tip: TipOption = None,
    compiler: CompilerOption = None,
    *,
    printing: PrintOptions,
) -> None:
    """Say whether a structure stands on the ground: forces of its feet, tipping margin, friction needed.

    The scene has a table [ground]. The structure counts as rigid in its equilibrium. Where no forces of the
    feet can hold it, a rigid motion proves it. --tip shortens cables, one at a time, until the structure
    tips. Exit code 3 if it does not stand.

    Example: tensegrity-codegen stand standing.toml --load t1=1,0,0
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        structure, found, verdict, tips = _find(
            output, scene, as_drawn, load or [], input, frictionless, tip or [], compiler
        )
        _report(output, structure, found, verdict, tips)
        if not verdict.is_standing or (found is not None and not found.is_found):
            raise typer.Exit(3)


def _find(
    output: Output,
    scene: Any,
    as_drawn: bool,
    load: list[str],
    texts: list[str] | None,
    frictionless: bool,
    tip: list[str],
    compiler: str | None,
) -> "tuple[Structure, Equilibrium | None, Stand, tuple[Tip, ...]]":
    """Return the structure, its equilibrium unless it is judged as drawn, the verdict, and what tips it."""
    import numpy as np

    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import with_statics
    from tensegrity_codegen.runtime.analysis.stand import find_tips, require_ground
    from tensegrity_codegen.runtime.analysis.stand import stand as judge
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
    from tensegrity_codegen.system.errors import check_choice

    subject, request = output.load(scene, settles=not as_drawn)
    structure = require_ground(subject, subject.name)
    cables = [name for name, bar in zip(structure.member_name, structure.is_bar, strict=True) if not bar]
    for name in tip:
        check_choice(name, (*cables, TIP_ALL), "cable", "--tip")
    wanted_cables = cables if TIP_ALL in tip else tip
    statics = with_statics(structure, request)
    parameters: dict[str, tuple[int, ...]] = {"node_load": tuple(range(structure.n_nodes))}
    if wanted_cables:
        rows = np.flatnonzero(np.isin(structure.member_name, wanted_cables))
        parameters["rest_length"] = tuple(rows.tolist())
    wanted = statics.wanting(*find_needs("equilibrium", structure, statics).quantities, parameters=parameters)
    model = build_library(structure, wanted, compiler=compiler, calls=FEW_CALLS).load()
    axes = list(structure.axes)
    loads = (structure.node_load + parse_loads(load, structure))[:, axes]
    arguments = {**read_inputs(texts, structure, output), "node_load": loads}
    found, shape = None, None
    if not as_drawn:
        found = find_equilibrium(
            model, arguments=arguments, frictionless=frictionless, raise_on_failure=False
        )
        output.warn(*found.warnings)
        shape = found if found.is_found else found.coordinate
    verdict = judge(model, shape, arguments=arguments, frictionless=frictionless)
    tips: tuple[Tip, ...] = ()
    if wanted_cables and found is not None and found.is_found:
        with output.progress("shortening cables") as move:
            tips = find_tips(
                model,
                arguments=arguments,
                frictionless=frictionless,
                progress=lambda number, _: move(number / len(wanted_cables)),
            )
    return structure, found, verdict, tips


def _report(
    output: Output,
    structure: "Structure",
    found: "Equilibrium | None",
    verdict: "Stand",
    tips: "tuple[Tip, ...]",
) -> None:
    """Print the verdict, the feet, and the cables that tip the structure."""
    from tensegrity_codegen.report.tables import feet_table, tips_table

    data = {
        "status": _find_status(found, verdict),
        **verdict.as_evidence(),
        "equilibrium": None if found is None else found.as_evidence(),
        "tips": [tip.as_evidence() for tip in tips],
    }
    lines = [verdict.message]
    if found is not None and not found.is_found:
        lines = [f"{found.status}: {found.message}"]
    if verdict.is_standing:
        lines.append(
            f"friction needed {verdict.friction_needed:.6g} of {verdict.friction:.6g}; forces of the feet: "
            + DISTRIBUTIONS[verdict.distribution]
        )
    elif verdict.motion is not None:
        lines.append("proof: a rigid motion that the loads drive and no foot can stop, in --json")
    tables: list[Any] = []
    if verdict.is_standing:
        tables.append(feet_table(structure.name, verdict.foot, verdict.force))
    if tips:
        tables.append(tips_table(structure.name, tips))
    output.result(data, "\n".join(lines), *tables)


def _find_status(found: "Equilibrium | None", verdict: "Stand") -> str:
    """Return "ok" where the structure stands, else what happens to it."""
    if found is not None and not found.is_found:
        return found.status
    return "ok" if verdict.is_standing else verdict.verdict


DISTRIBUTIONS = {
    "equilibrium": "those of the equilibrium",
    "statics": "they follow from the balance alone",
    "least_squares": "not determined by the balance, those with the least sum of squares",
    "feasible": "not determined by the balance, one distribution that friction allows",
}

VERB = Verb(stand, order=115)
