"""`tensegrity-codegen simulate`: motion over time, by the generated C."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.inputs import InputOption, read_inputs, warn_of_profile
from tensegrity_codegen.cli.options import (
    CompilerOption,
    FlagsOption,
    JsonOption,
    OverwriteOption,
    SceneArgument,
)
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.simulate_batch import (
    build_for_batch,
    build_run_table,
    check_no_other,
    describe_extremes,
    read_schedule,
    simulate_starts,
)
from tensegrity_codegen.cli.verb import Verb
from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.system.errors import UnknownNameError, suggest
from tensegrity_codegen.system.files import check_output
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

if TYPE_CHECKING:
    from tensegrity_codegen.pipeline.build_library import BuiltLibrary
    from tensegrity_codegen.runtime.integrate.event_log import EventLog
    from tensegrity_codegen.runtime.integrate.options import RunOptions
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

TEndOption = Annotated[float, typer.Option("--t-end", help="Simulated time [s].", show_default=False)]
SamplesOption = Annotated[int, typer.Option("--samples", help="Number of equally spaced samples.")]
RtolOption = Annotated[
    float, typer.Option("--rtol", help="Relative tolerance of methods with error control.")
]
AtolOption = Annotated[
    float | None,
    typer.Option(
        "--atol",
        help="Absolute tolerance, m and m/s; if not given 1e-9 of the structure's length and speed.",
        show_default=False,
    ),
]
MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        help=f"One of {', '.join(METHODS)}; auto says what it chooses, {STIFF_INTEGRATOR} is for stiff bars.",
    ),
]
StepOption = Annotated[float | None, typer.Option("--step", help="Step of fixed-step methods [s].")]
MaxStepsOption = Annotated[
    int | None,
    typer.Option(
        "--max-steps", help="Most steps of one run of a method in C; default a million, more with --keep."
    ),
]
KeepOption = Annotated[
    str, typer.Option("--keep", help="energy: keep it constant, for long undamped motions.")
]
ControlOption = Annotated[
    str | None,
    typer.Option(
        "--control",
        help="What the tolerance limits: samples (total error; default) or steps (default with --keep).",
    ),
]
ProfileOption = Annotated[
    Path | None,
    typer.Option("--profile", help="Inputs over time (.csv): the column time, and one for each input."),
]
ProfileKindOption = Annotated[
    str, typer.Option("--profile-kind", help="Between the rows of --profile: linear or cubic.")
]
SettleOption = Annotated[bool, typer.Option("--settle", help="Start from the equilibrium.")]
UntilOption = Annotated[
    str | None,
    typer.Option("--until", help="End early: contact of two bars, or a condition: 'top.z < 0.1'."),
]
BatchOption = Annotated[
    Path | None, typer.Option("--batch", help="File of many starts (.npz), simulated side by side.")
]
ThreadsOption = Annotated[int, typer.Option("--threads", help="Number of threads for a batch.")]


UNTIL = ("contact",)


def read_until(text: str | None) -> tuple[bool, str | None]:
    """Return whether a contact is meant, and the condition if one is.

    Raises UnknownNameError for a word that is neither, InvalidValueError for what is no expression.
    """
    from tensegrity_codegen.runtime.simulate.condition import find_quantities
    from tensegrity_codegen.tables.quantities import QUANTITIES

    if text is None or text in UNTIL:
        return text is not None, None
    if text.isidentifier() and text not in QUANTITIES and text != "time":
        raise UnknownNameError(
            "unknown event",
            where="--until",
            given=text,
            allowed=f"{', '.join(UNTIL)}, or a condition such as 'top.z < 0.1'",
            hint=suggest(text, UNTIL),
        )
    find_quantities(text)
    return False, text


def watching(structure: "Subject", request: "ModelRequest", kind: str, condition: str = "") -> "ModelRequest":
    """Return the request with integrators that watch a kind of event, and the quantities of a condition."""
    from tensegrity_codegen.codegen.integrators.events import choose_events
    from tensegrity_codegen.runtime.simulate.condition import find_quantities

    events = request.events
    if events is None:
        events = choose_events(request, structure)
    quantities = find_quantities(condition) if condition else ()
    kinds = tuple(dict.fromkeys((*events, kind)))
    return replace(request, quantities=(*request.quantities, *quantities), events=kinds)


OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="Result file (.npz, .csv, .parquet or .mat).")
]

MOST_EVENTS = 10  # in the text


@dataclass(frozen=True)
class MethodOptions:
    """How a motion is integrated."""

    rtol: RtolOption = 1e-6
    atol: AtolOption = None
    method: MethodOption = "auto"
    step: StepOption = None
    max_steps: MaxStepsOption = None
    keep: KeepOption = ""
    control: ControlOption = None


@dataclass(frozen=True)
class InputOptions:
    """Inputs of a motion, constant and over time."""

    input: InputOption = None
    profile: ProfileOption = None
    profile_kind: ProfileKindOption = "linear"


@dataclass(frozen=True)
class BatchOptions:
    """Many motions at once."""

    batch: BatchOption = None
    threads: ThreadsOption = 1


@dataclass(frozen=True)
class CompileOptions:
    """How the library is compiled."""

    compiler: CompilerOption = None
    flags: FlagsOption = None


def simulate(
    scene: SceneArgument,
    t_end: TEndOption,
    samples: SamplesOption = 101,
    *,
    integration: MethodOptions,
    settle: SettleOption = False,
    until: UntilOption = None,
    given: InputOptions,
    many: BatchOptions,
    out: OutOption = None,
    overwrite: OverwriteOption = False,
    compilation: CompileOptions,
    json: JsonOption = False,
) -> None:
    """Simulate the motion of a scene and write it to a file.

    Files .npz and .mat hold all arrays by name; .csv and .parquet a row for each sample, with columns such as
    "time [s]", "t1.x [m]", "bar1.tension [N]".

    With --until contact the run ends at the first contact of two bars; "events" of the result, and
    event_time, event_kind, event_name of the file describe it. With a condition the run ends where a
    comparison becomes true, or another expression changes its sign.

    With --batch every row of coordinate, velocity, node_position, node_velocity, or of a run-time argument in
    that file is a separate motion. Explicit methods in C integrate eight at a time in one core, where they
    control the error of each step; with --control samples, --keep or --profile, motions run one after the
    other.

    With --input an input or actuator has a constant value from the start on; with --settle also in the
    equilibrium, and so do the first values of a profile.

    With --profile inputs change with time: a CSV file with the header time,motor (names of inputs) and rows
    from 0 to --t-end or later. Two rows with the same time are a jump.

    Example: tensegrity-codegen simulate prism.toml --t-end 2 --samples 201 --out prism.npz
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.runtime.integrate.options import check_options, complete_run_options
        from tensegrity_codegen.runtime.trajectory.write_motion import check_motion_file

        options = complete_run_options(**vars(integration))
        asked = _Asked(options, *read_until(until), settle, given)
        check_options(options, t_end, samples)
        if out is not None:
            check_motion_file(out)
            inputs = [path for path in (scene, many.batch, given.profile) if path is not None]
            check_output(out, inputs=inputs, overwrite=overwrite)
        if many.batch is not None:
            from tensegrity_codegen.runtime.integrate.batch_integration import choose_batch_control

            check_no_other(settle=settle, until=until)
            options = choose_batch_control(options, integration.control)
            built, values, schedule = build_for_batch(
                output, scene, options, compilation.compiler, compilation.flags, given.input, given.profile,
                given.profile_kind, t_end,
            )  # fmt: skip
            simulate_starts(
                output, built, many.batch, out, overwrite, options, values, t_end=t_end, samples=samples,
                threads=many.threads, schedule=schedule,
            )  # fmt: skip
            return
        built, start = _build(scene, asked, t_end, compilation.compiler, compilation.flags, output)
        _run(output, built, asked, out, overwrite, t_end=t_end, samples=samples, **start)


@dataclass(frozen=True)
class _Asked:
    """What is asked of one motion: options, what ends it early, whether it starts settled, its inputs."""

    options: "RunOptions"
    until_contact: bool
    condition: str | None
    settle: bool
    inputs: InputOptions


def _run(
    output: Output, built: "BuiltLibrary", asked: _Asked, out: Path | None, overwrite: bool, **given: Any
) -> None:
    """Simulate the motion and say how it went; exit code 3 where it is not good."""
    from tensegrity_codegen.runtime.simulate.simulate import simulate as run
    from tensegrity_codegen.runtime.simulate.until import Until
    from tensegrity_codegen.scene.checks.plausible_ground import warn_of_sampled_contacts

    model = built.load()
    if built.structure is not None:
        interval = given["t_end"] / max(given["samples"] - 1, 1)
        output.warn(*warn_of_sampled_contacts(built.structure, interval))
    with output.progress("simulating") as progress:
        trajectory = run(
            model,
            until=Until(asked.condition, asked.until_contact),
            progress=progress,
            **given,
            **asked.options.as_given(),
        )
    if out is not None:
        trajectory.write(out, overwrite=overwrite)
    data = trajectory.summary() | {"library": str(built.path), "out": None if out is None else str(out)}
    data["inputs"] = {name: value for name, value in given["arguments"].items() if name != "internal"}
    finding = f"{trajectory.status}: {describe_extremes(data, trajectory.find_flaws())}"
    readable: list[Any] = [finding, lambda: build_run_table(data), *_list_events(trajectory.log)]
    if trajectory.feet and not output.as_json:
        from tensegrity_codegen.report.tables import touched_table

        readable.append(touched_table(model.manifest.name, trajectory.feet))
    output.result(data, *readable)
    if trajectory.status != "ok":
        output.warn(f"{trajectory.status}: {trajectory.message}")
        raise typer.Exit(3)


def _list_events(log: "EventLog") -> list[str]:
    """Return the first events of a motion as a line: time, what, and which way."""
    words = {
        ("cable", 1): "taut",
        ("cable", -1): "slack",
        ("ground", 1): "touches",
        ("ground", -1): "lifts",
        ("stick", 1): "sticks",
        ("stick", -1): "slips",
        ("collision", 1): "press",
        ("collision", -1): "part",
    }
    shown = [
        f"{time:.6g} s {name} {words.get((kind, sign), kind)}"
        for time, kind, name, sign in zip(log.time, log.kind, log.name, log.direction.tolist(), strict=True)
    ][:MOST_EVENTS]
    more = f", and {log.count - len(shown)} more (log_time, log_name of the result file)"
    return [f"events: {', '.join(shown)}{more if log.count > len(shown) else ''}"] if shown else []


def _build(
    scene: Path, asked: _Asked, t_end: float, compiler: str | None, flags: str | None, output: Output
) -> "tuple[BuiltLibrary, dict[str, Any]]":
    """Return the library that the run needs; its start (None: of the scene), inputs and schedule, by name."""
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import has_statics, settle_structure
    from tensegrity_codegen.structure.structure import Structure

    structure, request = output.load(scene, settles=asked.settle)
    given: dict[str, Any] = {"arguments": read_inputs(asked.inputs.input or [], structure, output)}
    schedule = read_schedule(
        asked.inputs.profile, asked.inputs.profile_kind, structure, t_end, given["arguments"]
    )
    given["schedule"] = schedule
    warn_of_profile(schedule, structure, output)
    at_start = {name: float(values[0]) for name, values in schedule.values.items()} if schedule else {}
    settled_with = given["arguments"] | at_start
    if asked.settle and isinstance(structure, Structure) and not has_statics(request):
        structure = settle_structure(
            structure,
            request,
            compiler=compiler,
            flags=flags,
            warn=output.warn,
            arguments=settled_with,
        )
        asked = replace(asked, settle=False)
    wanted = _require(structure, request, asked)
    built = build_library(structure, wanted, compiler=compiler, flags=flags, calls=MANY_CALLS)
    if not asked.settle:
        return built, {"coordinate": None, **given}
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    found = find_equilibrium(built.load(), arguments=settled_with)
    output.warn(*found.warnings)
    given["arguments"] = given["arguments"] | found.internal_argument
    return built, {"coordinate": found.coordinate, **given}


def _require(structure: "Subject", request: "ModelRequest", asked: _Asked) -> "ModelRequest":
    """Return the request with all that the run needs of a library."""
    from tensegrity_codegen.pipeline.analyses import find_needs
    from tensegrity_codegen.runtime.simulate.until import CONTACT_QUANTITIES

    options = asked.options
    needs = find_needs("simulate", structure, request, method=options.method, rtol=options.rtol)
    quantities = needs.quantities
    quantities += find_needs("equilibrium", structure, request).quantities if asked.settle else ()
    quantities += CONTACT_QUANTITIES if asked.until_contact else ()
    wanted = request.wanting(*quantities, integrators=needs.integrators)
    if asked.until_contact and needs.integrators:  # SciPy's methods look at distances by themselves
        wanted = watching(structure, wanted, "contact")
    wanted = wanted if asked.condition is None else watching(structure, wanted, "condition", asked.condition)
    return replace(wanted, keep=(options.keep,)) if options.keep else wanted


VERB = Verb(simulate, order=210)
