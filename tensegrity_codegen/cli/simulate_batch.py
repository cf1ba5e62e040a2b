"""`tensegrity-codegen simulate --batch`: many motions of one scene."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tensegrity_codegen.cli.inputs import read_inputs, warn_of_profile
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import name_options
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError

if TYPE_CHECKING:
    from rich.table import Table

    from tensegrity_codegen.pipeline.build_library import BuiltLibrary
    from tensegrity_codegen.runtime.integrate.options import RunOptions
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.structure.member_limits import MemberFlaws


def simulate_starts(
    output: Output,
    built: "BuiltLibrary",
    starts: Path,
    out: Path | None,
    overwrite: bool,
    options: "RunOptions",
    values: Mapping[str, float],
    **asked: Any,
) -> None:
    """Simulate every start of a file and say how many motions came to their end; exit code 3 unless all did.

    values: of inputs that all motions share, by name; asked: t_end, samples, threads and schedule of
    `simulate_batch`.
    """
    from tensegrity_codegen.runtime.simulate.read_starts import read_starts
    from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch

    model = built.load()
    given = read_starts(starts, model.manifest)
    _check_twice(values, given["arguments"], starts)
    given["arguments"] |= values
    with output.progress("simulating") as progress:
        batch = simulate_batch(
            model,
            progress=progress,
            **options.as_given(),
            **asked,
            **given,
        )
    if out is not None:
        batch.write(out, overwrite=overwrite)
    data = batch.summary() | {
        "control": options.control,
        "inputs": dict(values),
        "library": str(built.path),
        "out": None if out is None else str(out),
    }
    finding = describe_extremes(data, batch.find_flaws())
    output.result(
        data, f"{data['n_ok']} of {len(batch)} motions ok: {finding}", lambda: build_run_table(data)
    )
    if not batch.is_ok.all():
        bad = int(batch.is_ok.argmin())
        count = len(batch) - data["n_ok"]
        output.warn(
            f"{count} of {len(batch)} motions; number {bad}: {batch.status[bad]}: {batch.message[bad]}"
        )
        raise typer.Exit(3)


def describe_extremes(data: Mapping[str, Any], flaws: "MemberFlaws") -> str:
    """Return the largest displacement of a motion, or of many, its tensions, and exceeded limits."""
    from tensegrity_codegen.structure.member_limits import describe_tensions

    text = "no node moves"
    if data["largest_displacement"]:
        text = (
            f"node {data['displaced_node']} moves farthest, {data['largest_displacement']:.4g} m at "
            f"{data['displaced_time']:.4g} s"
        )
    tensions = [describe_tensions(data)] if "cable_tension" in data else []
    return "; but ".join(["; ".join([text, *tensions]), *flaws.describe()])


def build_run_table(data: Mapping[str, Any]) -> "Table":
    """Return what is said of one or many motions, as a table."""
    from tensegrity_codegen.report.tables import run_table  # imports Rich

    shown = {key: value for key, value in data.items() if not key.startswith(("displaced", "largest_disp"))}
    return run_table(name_options(shown))


def _check_twice(values: Mapping[str, float], arguments: Mapping[str, Any], starts: Path) -> None:
    """Raise DuplicateNameError for an input that both --input and the file of starts give."""
    twice = sorted(values.keys() & arguments.keys()) or (["input"] if values and "input" in arguments else [])
    if twice:
        raise DuplicateNameError(
            "an input is given twice",
            where="--input",
            given=", ".join(values),
            allowed=f"inputs that {starts} does not hold",
            hint=f"remove the option, or the array {twice[0]!r} from the file",
        )


def check_no_other(**options: Any) -> None:
    """Raise InvalidValueError for options that batches do not have."""
    for name, value in options.items():
        if value:
            raise InvalidValueError(
                "not together with --batch",
                where=f"--{name.replace('_', '-')}",
                given=value if value is not True else "",
            )


def read_schedule(
    path: Path | None, kind: str, structure: "Subject", t_end: float, values: Mapping[str, float]
) -> "Profile | None":
    """Return the inputs over time of --profile, None without it.

    t_end [s]: of the motion; values: constant values of inputs. Raises InvalidValueError for a profile that
    ends before, or of an input with a constant value, and what read_profile raises.
    """
    from tensegrity_codegen.runtime.profiles.driven import check_end, check_not_constant
    from tensegrity_codegen.runtime.profiles.profile import KINDS
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile
    from tensegrity_codegen.system.errors import check_choice

    check_choice(kind, KINDS, "kind of profile", "--profile-kind")
    if path is None:
        return None
    profile = read_profile(path, [item.name for item in structure.inputs], kind)
    check_end(profile, t_end, str(path))
    check_not_constant(profile, values, where=str(path))
    return profile


def build_for_batch(
    output: Output,
    scene: Path,
    options: "RunOptions",
    compiler: str | None,
    flags: str | None,
    inputs: list[str] | None,
    profile: Path | None,
    profile_kind: str,
    t_end: float,
) -> "tuple[BuiltLibrary, dict[str, float], Profile | None]":
    """Return the library that a batch of motions of a scene needs, constant inputs, and inputs over time."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library

    structure, request = output.load(scene)
    values = read_inputs(inputs, structure, output)
    schedule = read_schedule(profile, profile_kind, structure, t_end, values)
    warn_of_profile(schedule, structure, output)
    needs = find_needs("simulate_batch", structure, request, method=options.method, rtol=options.rtol)
    wanted = needs.alone(request)
    wanted = replace(wanted, keep=(options.keep,)) if options.keep else wanted
    return (
        build_library(structure, wanted, compiler=compiler, flags=flags, calls=MANY_CALLS),
        values,
        schedule,
    )
