"""`tensegrity-codegen identify`: numbers of a scene from a measured motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.options import CompilerOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from tensegrity_codegen.sweeps.fitting.identification import Identification

DataArgument = Annotated[
    Path,
    typer.Argument(
        help="Table of what was measured (.csv): the column time [s], and t1.x [m], t1.vx [m/s], "
        "bar1.length [m], bar1.tension [N]; empty cells are missing values.",
        show_default=False,
        metavar="DATA",
    ),
]
ByOption = Annotated[
    list[str],
    typer.Option(
        "--by",
        help="Number of the scene that is sought: classes.cable.spring_constant, nodes.t1.mass, "
        "ground.friction; repeat for several.",
        show_default=False,
    ),
]
BoundsOption = Annotated[
    list[str] | None,
    typer.Option("--bounds", help="Least and largest value of a number: KEY=LOW:HIGH; may be repeated."),
]
NoiseOption = Annotated[
    list[str] | None,
    typer.Option(
        "--noise",
        help="Standard deviation of the measurements: one number, or KIND=SIZE for position, velocity, "
        "length, tension, frequency; default: estimated.",
    ),
]
ProfileOption = Annotated[
    Path | None,
    typer.Option("--profile", help="Inputs over time (.csv): the column time, and one for each input."),
]
HoldOutOption = Annotated[
    float, typer.Option("--hold-out", help="Part of the times, the last ones, that is predicted, not fitted.")
]
STRONG = 0.95  # correlations from which two values are named


def identify(
    scene: SceneArgument,
    data: DataArgument,
    by: ByOption,
    bounds: BoundsOption = None,
    noise: NoiseOption = None,
    hold_out: HoldOutOption = 0.0,
    profile: ProfileOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the scene with the values found (.toml).")
    ] = None,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    *,
    printing: PrintOptions,
) -> None:
    """Find stiffnesses, rest lengths, damping, masses or friction from a measured motion, or from shapes.

    The motion starts at time 0 in the state of the scene, whose values are where the search starts. A table
    without times has a row for each state at rest, with keys of the scene in further columns. Each value has
    its standard error; what the data do not show is said. After Ctrl-C the best values so far are
    written, and the scene of --out goes on from there. Exit code 3 where the search does not converge, the
    motion is too sensitive for derivatives, or the best one is more than ten times the stated noise off.

    Example: tensegrity-codegen identify prism.toml measured.csv --by classes.cable.spring_constant
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        from tensegrity_codegen.analyses.motions.schedule import list_excesses
        from tensegrity_codegen.runtime.profiles.read_profile import read_profile
        from tensegrity_codegen.sweeps.fitting.identify import identify as find

        check_result(out, ".toml", inputs=[scene], overwrite=overwrite)
        limits, sizes = _read_bounds(bounds or []), _read_noise(noise or [])
        subject, _ = output.load(scene)
        schedule = None
        if profile is not None:
            schedule = read_profile(profile, [source.name for source in subject.inputs])
            output.warn(*list_excesses(schedule, subject))
        with output.progress("identifying") as move:
            result = find(
                scene,
                data,
                by,
                bounds=limits,
                noise=sizes,
                hold_out=hold_out,
                schedule=schedule,
                compiler=compiler,
                progress=move,
            )
        if out is not None:
            result.write_scene(out, overwrite=overwrite)
        _report(output, result, out)
        if result.status != "ok":
            raise typer.Exit(3)


def _read_bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return KEY=LOW:HIGH as bounds by key; raises InvalidValueError for another text."""
    bounds = {}
    for entry in texts:
        key, _, ends = entry.partition("=")
        low, _, high = ends.partition(":")
        try:
            bounds[key] = float(low), float(high)
        except ValueError:
            problem = "not the bounds of a number"
            raise InvalidValueError(problem, where="--bounds", given=entry, allowed="KEY=LOW:HIGH") from None
    return bounds


def _read_noise(texts: Sequence[str]) -> float | dict[str, float] | None:
    """Return one size, sizes by kind, or None; raises InvalidValueError for another text."""
    try:
        if len(texts) == 1 and "=" not in texts[0]:
            return float(texts[0])
        pairs = [entry.partition("=") for entry in texts]
        return {kind: float(size) for kind, _, size in pairs} or None
    except ValueError:
        problem, value = "not a size of the noise", ", ".join(texts)
        raise InvalidValueError(problem, where="--noise", given=value, allowed="SIZE, or KIND=SIZE") from None


def _report(output: Output, found: "Identification", out: Path | None) -> None:
    """Print the verdict, the values, and what a careful reader should know."""
    from tensegrity_codegen.report.result_tables import values_table
    from tensegrity_codegen.sweeps.fitting.measurements import KINDS

    output.warn(*found.warnings)
    rows = [
        (key, *numbers)
        for key, *numbers in zip(
            found.key, found.value, found.standard_error, *found.interval.T, found.start, strict=True
        )
    ]
    noise = ", ".join(f"{kind} {size:.3g} {KINDS[kind][0]}" for kind, size in found.noise.items())
    lines = [f"noise: {noise}; residual {found.residual:.3g} times that"]
    lines += [
        f"{found.key[i]} and {found.key[j]} are correlated by {found.correlation[i, j]:.3f}"
        for j in range(len(found.key))
        for i in range(j)
        if abs(found.correlation[i, j]) > STRONG and not found.undetermined
    ]
    if out is not None:
        lines.append(str(out))
    data: dict[str, Any] = {**found.as_evidence(), "out": None if out is None else str(out)}
    output.result(data, found.headline(), values_table(rows), *lines)


VERB = Verb(identify, order=340)
