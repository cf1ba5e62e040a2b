"""`tensegrity-codegen simulate`: motion over time, by the generated C."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.options import CompilerOption, FlagsOption, JsonOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.simulate_batch import build_for_batch, check_no_other, simulate_starts
from tensegrity_codegen.cli.until import read_until, watching
from tensegrity_codegen.files import check_target
from tensegrity_codegen.structure import Structure

if TYPE_CHECKING:
    from tensegrity_codegen.pipeline import BuiltLibrary

__all__ = ["simulate"]


def simulate(
    scene: SceneArgument,
    t_end: Annotated[float, typer.Option("--t-end", help="Simulated time [s].", show_default=False)],
    samples: Annotated[int, typer.Option("--samples", help="Number of equally spaced samples.")] = 101,
    rtol: Annotated[
        float, typer.Option("--rtol", help="Relative tolerance of methods with error control.")
    ] = 1e-6,
    atol: Annotated[
        float, typer.Option("--atol", help="Absolute tolerance of methods with error control.")
    ] = 1e-9,
    method: Annotated[
        str,
        typer.Option(
            "--method",
            help="auto (says why), rk853, rk54, radau (stiff bars), rk4, or through SciPy: scipy_radau, ...",
        ),
    ] = "auto",
    step: Annotated[float | None, typer.Option("--step", help="Step of fixed-step methods [s].")] = None,
    max_steps: Annotated[
        int, typer.Option("--max-steps", help="Steps that one run of a method in C may try.")
    ] = 1_000_000,
    keep: Annotated[
        str, typer.Option("--keep", help="energy: hold it at each step, for long undamped motions.")
    ] = "",
    control: Annotated[
        str,
        typer.Option("--control", help="What the tolerance bounds: samples (whole error), or steps (each)."),
    ] = "samples",
    settle: Annotated[bool, typer.Option("--settle", help="Start from the equilibrium.")] = False,
    until: Annotated[
        str | None,
        typer.Option("--until", help="End early: contact of two bars, or a condition: 'top.z < 0.1'."),
    ] = None,
    batch: Annotated[
        Path | None, typer.Option("--batch", help="File of many starts (.npz), simulated side by side.")
    ] = None,
    threads: Annotated[int, typer.Option("--threads", help="Threads that share a batch.")] = 1,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Result file (.npz).")] = None,
    compiler: CompilerOption = None,
    flags: FlagsOption = None,
    json: JsonOption = False,
) -> None:
    """Simulate the motion of a scene and write it to an .npz file.

    With --until contact the last sample is the first contact of two bars, if there is one by --t-end; it
    is in "events" of the result, and in event_time, event_kind, event_name of the file. So it is with a
    condition: the run ends where a comparison becomes true, or another expression changes its sign.

    With --batch every row of coordinate, velocity, node_position, node_velocity, or of a run-time argument,
    in that file is a motion of its own; methods rk853, rk54 and rk4 run eight of them in one core.

    Example: tensegrity-codegen simulate prism.toml --t-end 2 --samples 201 --out prism.npz
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.report.tables import run_table
        from tensegrity_codegen.runtime.simulate import check_options
        from tensegrity_codegen.runtime.simulate import simulate as run

        until_contact, condition = read_until(until)
        check_options(
            t_end,
            samples,
            method,
            step,
            rtol,
            atol,
            until_contact=until_contact,
            max_steps=max_steps,
            keep=keep,
            control=control,
        )
        if out is not None:
            check_target(out)
        if batch is not None:
            check_no_other(settle=settle, until=until, keep=keep)
            of_method: dict[str, Any] = {
                "samples": samples,
                "step": step,
                "rtol": rtol,
                "atol": atol,
                "threads": threads,
            }
            build = build_for_batch(scene, method, compiler, flags)
            simulate_starts(output, build, batch, out, t_end=t_end, method=method, **of_method)
            return
        built, start = _build(scene, method, rtol, keep, settle, until_contact, condition, compiler, flags)
        model = built.load()
        with output.progress("simulating") as progress:
            trajectory = run(
                model,
                t_end,
                samples=samples,
                method=method,
                step=step,
                rtol=rtol,
                atol=atol,
                coordinate=start,
                until_contact=until_contact,
                condition=condition,
                until_condition=condition is not None,
                progress=progress,
                max_steps=max_steps,
                keep=keep,
                control=control,
            )
        if out is not None:
            trajectory.write(out)
        data = trajectory.summary() | {"library": str(built.path), "out": None if out is None else str(out)}
        output.result(data, run_table(data))
        if trajectory.status != "ok":
            output.warn(f"{trajectory.status}: {trajectory.message}")
            raise typer.Exit(3)


def _build(
    scene: Path,
    method: str,
    rtol: float,
    keep: str,
    settle: bool,
    until_contact: bool,
    condition: str | None,
    compiler: str | None,
    flags: str | None,
) -> tuple[BuiltLibrary, Any]:
    """Return the library that the run needs, and where it starts (None: where the scene says)."""
    from tensegrity_codegen.pipeline import (
        build_library,
        equilibrium_quantities,
        has_statics,
        load_scene,
        settle_structure,
        simulation_quantities,
    )
    from tensegrity_codegen.runtime.equilibrium import find_equilibrium
    from tensegrity_codegen.runtime.margins import CONTACT_QUANTITIES
    from tensegrity_codegen.runtime.simulate import integrators_for

    structure, request = load_scene(scene)
    if settle and isinstance(structure, Structure) and not has_statics(request):
        structure = settle_structure(structure, request, compiler=compiler, flags=flags)
        settle = False
    quantities = simulation_quantities(request.formulation)
    quantities += equilibrium_quantities(structure, request) if settle else ()
    nodes = structure if isinstance(structure, Structure) else None
    integrators = integrators_for(method, nodes, request.formulation, rtol)
    if until_contact:
        quantities += CONTACT_QUANTITIES
        integrators = tuple(dict.fromkeys((*integrators, "rk54")))  # which locates the contact
    wanted = request.wanting(*quantities, integrators=integrators)
    wanted = wanted if condition is None else watching(structure, wanted, condition)
    wanted = replace(wanted, keep=(keep,)) if keep else wanted
    built = build_library(structure, wanted, compiler=compiler, flags=flags)
    return built, find_equilibrium(built.load()).coordinate if settle else None
