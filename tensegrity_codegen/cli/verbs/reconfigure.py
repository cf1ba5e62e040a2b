"""`tensegrity-codegen reconfigure`: a two-stage tower from one symmetrical configuration to another."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from tensegrity_codegen.cli.options import JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import InvalidValueError

MOST_SAMPLES = 100_000

StartOption = Annotated[
    str, typer.Option("--from", help="Azimuth, declination [deg], height [m]: al,de,Z.", show_default=False)
]
EndOption = Annotated[
    str,
    typer.Option(
        "--to", help="Azimuth and declination [deg]: al,de; al alone with --zero-torque.", show_default=False
    ),
]
TauOption = Annotated[float, typer.Option("--tau", help="Duration [s].", show_default=False)]
ZeroTorqueOption = Annotated[
    bool, typer.Option("--zero-torque", help="Let the declination follow, so that no torque is needed.")
]
ForceOption = Annotated[
    float | None, typer.Option("--force", help="Force F_3 on the top [N]; the scene's if not given.")
]
SamplesOption = Annotated[int, typer.Option("--samples", help="Number of equally spaced samples.")]
TrackOption = Annotated[
    bool,
    typer.Option("--track", help="Simulate the full model in C with the result, and report the difference."),
]
OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="Result file (.npz).")]


def reconfigure(
    scene: SceneArgument,
    start: StartOption,
    end: EndOption,
    tau: TauOption,
    zero_torque: ZeroTorqueOption = False,
    force: ForceOption = None,
    samples: SamplesOption = 201,
    track: TrackOption = False,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
) -> None:
    """Compute rest lengths and torque that move a two-stage tower to another symmetrical configuration.

    Only for towers like the example svd_tower. Tendons remain taut and the height constant.

    Example: tensegrity-codegen reconfigure svd_tower.toml --from 55,40,1.11066 --to 65,35 --tau 5
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.studies.papers.scs.printed import track as follow
        from tensegrity_codegen.studies.papers.scs.reconfiguration import plan_reconfiguration
        from tensegrity_codegen.studies.papers.scs.symmetry import SymmetricPose, SymmetricTower

        start_angles = read_numbers(start, "--from", "al,de,Z")
        end_angles = read_numbers(end, "--to", "al" if zero_torque else "al,de")
        check_whole(samples, "--samples", 2, MOST_SAMPLES)
        check_result(out, ".npz", inputs=[scene], overwrite=overwrite)
        tower = SymmetricTower(output.load(scene)[0])
        target: float | SymmetricPose = math.radians(end_angles[0])
        if not zero_torque:
            target = SymmetricPose.from_degrees(end_angles[0], end_angles[1], start_angles[2])
        with output.progress("planning"):
            plan = plan_reconfiguration(
                tower,
                SymmetricPose.from_degrees(*start_angles),
                target,
                duration=tau,
                force=force,
                zero_torque=zero_torque,
            )
        data: dict[str, Any] = {"status": "ok"} | plan.summary()
        if track:
            with output.progress("tracking"):
                data["tracking"] = follow(plan).summary()
        if out is not None:
            plan.sample(samples).write(out, overwrite=overwrite)
        data["out"] = None if out is None else str(out)
        output.result(data, *describe(data))


def read_numbers(text: str, where: str, form: str) -> list[float]:
    """Return the finite numbers of a text such as "55,40,1.1"; form: what stands in it."""
    try:
        numbers = [float(field) for field in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != form.count(",") + 1 or not all(math.isfinite(number) for number in numbers):
        problem = "not a configuration"
        raise InvalidValueError(problem, where=where, given=text, allowed=f"finite numbers {form}")
    return numbers


def describe(data: dict[str, Any]) -> list[str]:
    """Return the summary as readable lines."""
    alpha, delta, height = data["end_deg"]
    lines = [
        f"alpha {data['start_deg'][0]:g} to {alpha:g} deg, delta {data['start_deg'][1]:g} to {delta:.6g} deg",
        f"  at Z = {height:g} m in {data['duration']:g} s, under F_3 = {data['force']:g} N",
    ]
    for name, tension in data["least_tension"].items():
        ends = f"{data['tension_start'][name]:.6g} to {data['tension_end'][name]:.6g} N"
        lines.append(f"  {name:10s} {ends}, least {tension['value']:.6g} N at {tension['time']:.4g} s")
    lines.append(f"  largest torque {data['largest_torque']:.3g} N m")
    lines.append(f"  residual of the full equations: {data['largest_residual']:.2g} N, N m")
    if "tracking" in data:
        error = data["tracking"]
        lines.append(
            f"  the full model follows within {error['angle_error_deg']:.2g} deg, the top within "
            f"{error['other_error']:.2g} m, rad"
        )
    return lines


VERB = Verb(reconfigure, order=330)
