"""`tensegrity-codegen linearize`: the linear model, its natural frequencies and damping."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.linear.linearize import LinearModel
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


def linearize(
    scene: SceneArgument,
    settle: Annotated[
        bool, typer.Option("--settle", help="Linearize about the equilibrium instead of the scene's state.")
    ] = False,
    input: InputOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write A, B, vectors and names (.npz, .mat or .csv)."),
    ] = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: PrintOptions,
) -> None:
    """Linearize the equations of motion: x' = A (x - x0) + B (u - u0) + r, exact sparse derivatives.

    r is the state derivative at (x0, u0): zero at an equilibrium, up to its tolerance. The file has x0, u0
    and r as `state`, `input` and `residual_rate`; its `c` belongs to the same model as x' = A x + B u + c.
    In .npz files matrices are rows, columns and values, in .mat files sparse; .csv files have the columns
    matrix, row, column, value, with names of states and inputs.

    Example: tensegrity-codegen linearize prism.toml --settle --json
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        from tensegrity_codegen.runtime.linear.write_linear import LINEAR_ENDINGS

        check_result(out, *LINEAR_ENDINGS, inputs=[scene], overwrite=overwrite)
        linear = _linearize(scene, settle, compiler, output, input)
        if out is not None:
            linear.write(out, overwrite=overwrite)
        _report(output, linear, out)


def _linearize(
    scene: Path, settle: bool, compiler: str | None, output: Output, inputs: list[str] | None
) -> "LinearModel":
    """Return the linear model of a scene about its own state or the equilibrium."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.runtime.linear.linearize import linearize as run
    from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance, find_equilibrium

    structure, request, values, is_left = _read(scene, settle, compiler, output, inputs)
    wanted = find_needs("linearize", structure, request).alone(request)
    wanted = find_needs("equilibrium", structure, request).besides(wanted) if is_left else wanted
    model = build_library(structure, wanted, compiler=compiler, calls=FEW_CALLS).load()
    about: Any = model.nominal("coordinate") if settle else None  # settled already, in node positions
    if is_left:
        # What is left of the forces turns neutral motions into slow ones.
        about = find_equilibrium(model, arguments=values, tolerance=choose_tolerance(structure))
        output.warn(*about.warnings)
    with output.progress("linearizing"):
        return run(model, about, arguments=values)


def _read(
    scene: Path, settle: bool, compiler: str | None, output: Output, inputs: list[str] | None
) -> "tuple[Subject, ModelRequest, dict[str, float], bool]":
    """Return structure, request and inputs, and whether the structure is still to be settled."""
    from tensegrity_codegen.pipeline.settle import has_statics, is_corrected, settle_structure, with_statics
    from tensegrity_codegen.structure.structure import Structure

    structure, request = output.load(scene, settles=settle)
    values = read_inputs(inputs, structure, output)
    if isinstance(structure, Structure) and is_corrected(request):
        request = with_statics(structure, request)  # springs are exact, and however stiff cost nothing here
    if not (settle and isinstance(structure, Structure) and not has_statics(request)):
        return structure, request, values, settle
    structure = settle_structure(structure, request, compiler=compiler, warn=output.warn, arguments=values)
    return structure.with_changes(node_velocity=0 * structure.node_velocity), request, values, False


def _report(output: Output, linear: "LinearModel", out: Path | None) -> None:
    """Print what the linear model is, and where it was written."""
    from tensegrity_codegen.report.result_tables import modes_table, say_finding, say_spectrum

    output.warn(*linear.warnings)
    data = {"status": "ok", **linear.as_evidence(), "out": None if out is None else str(out)}
    output.result(
        data,
        say_finding(linear.natural_frequency, linear.spectrum),
        f"{data['n_states']} states, {data['n_inputs']} inputs; A has {linear.A.nnz} non-zeros, "
        f"B {linear.B.nnz}",
        modes_table(linear.natural_frequency, linear.damping_ratio),
        *say_spectrum(linear.spectrum),
        "x' = A (x - x0) + B (u - u0) + r; largest entry of r, the state derivative at x0: "
        f"{data['largest_residual_rate']:.3g}",
    )


VERB = Verb(linearize, order=220)
