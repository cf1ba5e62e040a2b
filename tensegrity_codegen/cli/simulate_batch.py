"""`tensegrity-codegen simulate --batch`: many motions of one scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tensegrity_codegen.cli.option_names import name_options
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.errors import InvalidValueError

if TYPE_CHECKING:
    from tensegrity_codegen.pipeline import BuiltLibrary
    from tensegrity_codegen.runtime.integrate.options import RunOptions
    from tensegrity_codegen.runtime.profiles.profile import Profile
    from tensegrity_codegen.scene.subject import Subject

__all__ = ["build_for_batch", "check_no_other", "read_schedule", "simulate_starts"]


def simulate_starts(
    output: Output,
    built: BuiltLibrary,
    starts: Path,
    out: Path | None,
    options: RunOptions,
    **asked: Any,
) -> None:
    """Simulate every start of a file and say how many motions came to their end; exit code 3 unless all did.

    asked: t_end, samples and threads of `simulate_batch`.
    """
    from tensegrity_codegen.report.tables import run_table
    from tensegrity_codegen.runtime.simulate.read_starts import read_starts
    from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch

    model = built.load()
    given = read_starts(starts, model.manifest)
    with output.progress("simulating") as progress:
        batch = simulate_batch(
            model,
            progress=progress,
            **options.as_given(),
            **asked,
            **given,
        )
    if out is not None:
        batch.write(out)
    data = batch.summary() | {
        "control": options.control,
        "library": str(built.path),
        "out": None if out is None else str(out),
    }
    output.result(data, run_table(name_options(data)))
    if not batch.is_ok.all():
        bad = int(batch.is_ok.argmin())
        count = len(batch) - data["n_ok"]
        output.warn(
            f"{count} of {len(batch)} motions; number {bad}: {batch.status[bad]}: {batch.message[bad]}"
        )
        raise typer.Exit(3)


def check_no_other(**options: Any) -> None:
    """Raise InvalidValueError for options that batches do not have."""
    for name, value in options.items():
        if value:
            raise InvalidValueError(
                "not together with --batch",
                where=f"--{name.replace('_', '-')}",
                given=value if value is not True else "",
            )


def read_schedule(path: Path | None, kind: str, structure: Subject) -> Profile | None:
    """Return the inputs over time of --profile, None without it; raises what read_profile raises."""
    from tensegrity_codegen.errors import check_choice
    from tensegrity_codegen.runtime.profiles.profile import KINDS
    from tensegrity_codegen.runtime.profiles.read_profile import read_profile

    check_choice(kind, KINDS, "kind of profile", "--profile-kind")
    return None if path is None else read_profile(path, [item.name for item in structure.inputs], kind)


def build_for_batch(
    output: Output,
    scene: Path,
    options: RunOptions,
    compiler: str | None,
    flags: str | None,
    profile: Path | None,
    profile_kind: str,
) -> tuple[BuiltLibrary, Profile | None]:
    """Return the library of a scene with what a batch of its motions needs, and the inputs over time."""
    from tensegrity_codegen.pipeline import build_library, find_needs

    structure, request = output.load(scene)
    schedule = read_schedule(profile, profile_kind, structure)
    needs = find_needs("simulate_batch", structure, request, method=options.method, rtol=options.rtol)
    wanted = needs.alone(request)
    wanted = replace(wanted, keep=(options.keep,)) if options.keep else wanted
    return build_library(structure, wanted, compiler=compiler, flags=flags), schedule
