"""`tensegrity-codegen sensitivity`: which rest length moves which node, and which tension."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import (
    CompilerOption,
    OverwriteOption,
    PrintOptions,
    SceneArgument,
    parse_loads,
)
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import check_choice

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.sensitivity.record import Sensitivity
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


SETTLED = 1e-10  # tolerance of the equilibrium

ByOption = Annotated[
    list[str] | None,
    typer.Option(
        "--by",
        help="Member, input or actuator whose rest lengths change; may be repeated; default: all members.",
        show_default=False,
    ),
]
NodeOption = Annotated[
    list[str] | None,
    typer.Option("--node", help="List what moves this node most; may be repeated.", show_default=False),
]
MemberOption = Annotated[
    list[str] | None,
    typer.Option(
        "--member", help="List what changes the tension of this member most; may be repeated.",
        show_default=False,
    ),
]  # fmt: skip
LoadOption = Annotated[
    list[str] | None,
    typer.Option("--load", help="Load NODE=fx,fy,fz [N] added to the scene's; may be repeated."),
]


def sensitivity(
    scene: SceneArgument,
    node: NodeOption = None,
    member: MemberOption = None,
    columns: ByOption = None,
    most: Annotated[int, typer.Option(min=1, help="Entries of each list.")] = 5,
    load: LoadOption = None,
    input: InputOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the derivatives of positions and tensions (.npz)."),
    ] = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: PrintOptions,
) -> None:
    """Find the equilibrium, and differentiate positions and tensions by the rest lengths.

    Longer rest lengths are positive; pulling a cable in changes the signs. Of a structure that can slide or
    turn freely, motions are relative to the mean of its nodes.

    Example: tensegrity-codegen sensitivity prism.toml --node t1 --json
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        check_result(out, ".npz", inputs=[scene], overwrite=overwrite)
        subject, request = output.load(scene, settles=True)
        for name in node or []:  # before the work begins
            check_choice(name, subject.node_name, "node", "--node")
        for name in member or []:
            check_choice(name, subject.member_name, "member", "--member")
        arguments: dict[str, Any] = {**read_inputs(input, subject, output)}
        added = parse_loads(load or [], subject)
        if added.any():
            axes = list(subject.axes)
            arguments["node_load"] = (subject.node_load + added)[:, axes]
        found = _find(output, subject, request, arguments, columns=columns or None, compiler=compiler)
        if out is not None:
            write_sensitivity(found, out, overwrite)
        _report(output, found, node or [], member or [], most, out)


def _find(
    output: Output,
    subject: "Subject",
    request: "ModelRequest",
    arguments: dict[str, Any],
    *,
    columns: list[str] | None,
    compiler: str | None,
) -> "Sensitivity":
    """Return the sensitivity at the equilibrium under these arguments."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import move_near_origin, with_statics
    from tensegrity_codegen.runtime.sensitivity.sensitivity import equilibrium_sensitivity
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    statics = with_statics(subject, request)
    loads = {"node_load": tuple(range(subject.n_nodes))} if "node_load" in arguments else {}
    wanted = statics.wanting(*find_needs("sensitivity", subject, statics).quantities, parameters=loads)
    near, _ = move_near_origin(subject, request)
    model = build_library(near, wanted, compiler=compiler, calls=FEW_CALLS).load()
    start = find_equilibrium(model, arguments=arguments, tolerance=SETTLED)
    output.warn(*start.warnings)
    with output.progress("differentiating"):
        found = equilibrium_sensitivity(model, start, arguments, columns=columns)
    if found.one_sided:
        output.warn(
            f"at rest length: {', '.join(found.one_sided)}; the stiffness jumps there, and the derivatives "
            "hold on one side only"
        )
    return found


def _report(
    output: Output, found: "Sensitivity", nodes: list[str], members: list[str], most: int, out: Path | None
) -> None:
    """Print what each column does most, and the lists that were asked for."""
    from tensegrity_codegen.report.result_tables import columns_table, list_columns, ranks_table

    by_node = {name: {axis: found.rank_for_node(name, axis, most) for axis in "xyz"} for name in nodes}
    by_member = {name: found.rank_for_tension(name, most) for name in members}
    data = {
        "status": "ok",
        **found.as_evidence(),
        "columns": list_columns(found),
        "nodes": {name: {axis: dict(row) for axis, row in rows.items()} for name, rows in by_node.items()},
        "members": {name: dict(row) for name, row in by_member.items()},
        "out": None if out is None else str(out),
    }
    tables: list[Any] = [columns_table(data["columns"])] if not nodes and not members else []
    for name, rows in by_node.items():
        tables += [ranks_table(f"{name} along {axis}", "m/m", row) for axis, row in rows.items() if row]
    tables += [ranks_table(f"tension of {name}", "N/m", row) for name, row in by_member.items()]
    lines = ["rigid bars alone hold every node"]
    if math.isfinite(found.smallest_eigenvalue):
        lines = [f"smallest eigenvalue of the stiffness {found.smallest_eigenvalue:.6g} N/m"]
    if found.gauge:
        lines.append(f"free to {', '.join(found.gauge)}: motions are relative to the mean of the nodes")
    if found.slack:
        lines.append(f"slack, and without effect: {', '.join(found.slack)}")
    output.result(data, _find_largest(data["columns"]), *tables, *lines)


def _find_largest(columns: dict[str, dict[str, Any]]) -> str:
    """Return the rest length that moves a node most, and the one that changes a tension most."""
    if not columns:
        return "no rest length can change"
    moving = max(columns, key=lambda name: math.hypot(*columns[name]["motion"]))
    facts = columns[moving]
    text = f"{moving} moves {facts['node']} most, by {math.hypot(*facts['motion']):.3g} mm for each mm"
    changes = [
        (abs(change["derivative"]), name, change["member"])
        for name, facts in columns.items()
        for change in (facts["raised"], facts["lowered"])
        if change is not None
    ]
    if not changes:
        return text
    most, name, member = max(changes)
    return f"{text}; {name} changes the tension of {member} most, by {most / 1e3:.3g} N for each mm"


def write_sensitivity(found: "Sensitivity", path: Path, overwrite: bool) -> None:
    """Write a sensitivity to an .npz file: `coordinate`, `tension`, `node`, their names, and the gauge."""
    import numpy as np

    from tensegrity_codegen.runtime.model.array_file import write_arrays

    arrays = {name: getattr(found, name) for name in ("coordinate", "tension", "node", "gauge_motion")}
    words = ("coordinate_name", "node_name", "member_name", "column_name", "gauge", "slack", "one_sided")
    arrays |= {name: np.array(getattr(found, name), dtype=str) for name in words}
    write_arrays(path, arrays, overwrite=overwrite)


VERB = Verb(sensitivity, order=140)
