"""`tensegrity-codegen linearize`: the linear model, its natural frequencies and damping."""

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.linear.linearize import LinearModel
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


ROUNDING = 64 * sys.float_info.epsilon  # of lengths, over lengths and coordinates
SETTLED_ROUNDING = 1e-11  # the same, of lengths that the equilibrium gives
# Acceleration, over extent and square of the lowest angular frequency, that counts as none.
BALANCE_TOLERANCE = 1e-4


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
        linear, kinks = _linearize(scene, settle, compiler, output, input)
        if out is not None:
            linear.write(out, overwrite=overwrite)
        _report(output, linear, kinks, out)


def _linearize(
    scene: Path, settle: bool, compiler: str | None, output: Output, inputs: list[str] | None
) -> "tuple[LinearModel, Mapping[str, bool]]":
    """Return the linear model of a scene about its own state or the equilibrium, and its kinks."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
    from tensegrity_codegen.runtime.linear.kinks import find_kinks
    from tensegrity_codegen.runtime.linear.linearize import linearize as run
    from tensegrity_codegen.runtime.statics.equilibrium import choose_tolerance, find_equilibrium

    rounding = SETTLED_ROUNDING if settle else ROUNDING
    structure, request, values, settle = _read(scene, settle, compiler, output, inputs)
    cables = [name for name, bar in zip(structure.member_name, structure.is_bar, strict=True) if not bar]
    wanted = find_needs("linearize", structure, request).alone(request)
    wanted = find_needs("equilibrium", structure, request).besides(wanted) if settle else wanted
    model = build_library(structure, wanted, compiler=compiler, calls=FEW_CALLS).load()
    # What is left of the forces turns neutral motions into slow ones.
    found = (
        find_equilibrium(model, arguments=values, tolerance=choose_tolerance(structure)) if settle else None
    )
    if found is not None:
        output.warn(*found.warnings, *_find_slips(found))
    with output.progress("linearizing"):
        linear = run(model, found, arguments=values)
        return linear, find_kinks(model, cables, linear.state, rounding, values) if cables else {}


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


def _report(output: Output, linear: "LinearModel", kinks: Mapping[str, bool], out: Path | None) -> None:
    """Print what the linear model is, and where it was written."""
    from tensegrity_codegen.report.result_tables import modes_table, say_finding, say_spectrum

    output.warn(*_find_motion(linear))
    data = {
        "status": "ok",
        "n_states": len(linear.state),
        "n_inputs": len(linear.input_name),
        "n_variations": len(linear.state) if linear.variation is None else linear.variation.shape[1],
        "A_nonzeros": linear.A.nnz,
        "B_nonzeros": linear.B.nnz,
        "largest_affine_term": float(abs(linear.c).max()),
        "largest_residual_rate": float(abs(linear.residual_rate).max()),
        "residual_rate": linear.residual_rate,
        "natural_frequency": linear.natural_frequency,
        "damping_ratio": linear.damping_ratio,
        "zero_eigenvalues": linear.spectrum.zero_eigenvalues,
        "growing_eigenvalues": linear.spectrum.growing,
        "one_sided_cables": list(kinks),
        "state_name": linear.state_name,
        "input_name": linear.input_name,
        "inputs": dict(zip(linear.input_name, linear.input.tolist(), strict=True)),
        "out": None if out is None else str(out),
    }
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
    if kinks:
        output.warn(_say_kinks(kinks))


def _find_motion(linear: "LinearModel") -> list[str]:
    """Return warnings where the state is no equilibrium: eigenvalues then describe no vibration about it."""
    import numpy as np

    half = sum(name.endswith("'") for name in linear.state_name)
    speed = float(abs(linear.state[half : 2 * half]).max(initial=0.0))
    fall = float(abs(linear.residual_rate[half : 2 * half]).max(initial=0.0))
    found = []
    if speed > 0:
        found.append(
            f"the structure moves at x0 (largest velocity {speed:.3g}): eigenvalues hold for this moment only"
        )
    position = linear.state[:half]
    extent = float(np.ptp(position)) if half else 0.0
    slowest = float(linear.natural_frequency.min(initial=math.inf))
    square = (2 * math.pi * slowest) ** 2 if math.isfinite(slowest) else float(abs(linear.A).max())
    if fall > BALANCE_TOLERANCE * square * (extent or 1.0):
        found.append(
            f"the structure is out of balance at x0 (largest acceleration {fall:.3g}): eigenvalues and "
            "frequencies are not those of vibrations about an equilibrium, and rigid motions may appear as "
            "vibrations; --settle linearizes about the equilibrium"
        )
    return found


def _find_slips(found: "Equilibrium") -> list[str]:
    """Return the warning about feet at the limit of friction, where the stiffness jumps."""
    feet = found.feet
    if feet is None or "slip" not in feet.state:
        return []
    slipping = [name for name, state in zip(feet.node_name, feet.state, strict=True) if state == "slip"]
    return [
        f"feet at the limit of friction: {', '.join(slipping)}; their stiffness jumps there, and the linear "
        "model holds on one side only"
    ]


def _say_kinks(kinks: Mapping[str, bool]) -> str:
    """Return the warning about cables at their rest lengths."""
    sides = [
        f"as {word}: {', '.join(names[:10])}{' ...' if len(names) > 10 else ''}"
        for word, is_taut in (("taut", True), ("slack", False))
        if (names := [name for name, taut in kinks.items() if taut is is_taut])
    ]
    return (
        f"{len(kinks)} cable{'s are' if len(kinks) > 1 else ' is'} exactly at rest length, where the "
        f"stiffness jumps; the linear model holds on one side only. It treats {'; '.join(sides)}"
    )


VERB = Verb(linearize, order=220)
