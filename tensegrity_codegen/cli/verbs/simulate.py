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
from tensegrity_codegen.cli.output import Output, check_result
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
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest

STIFFER = 4.0  # stiffness of the ground that a motion is compared with, over its own
LARGE_CHANGE = 0.01  # part of the structure's size above which the comparison is a warning

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
EndOption = Annotated[
    Path | None,
    typer.Option(
        "--scene-out", help="Write the scene as the motion ends (.toml); with inputs, without loads."
    ),
]
SettleOption = Annotated[bool, typer.Option("--settle", help="Start from the equilibrium.")]
GroundCheckOption = Annotated[
    bool,
    typer.Option(
        "--ground-check",
        help=f"Repeat with {STIFFER:g} times the ground's stiffness; say how far nodes are elsewhere.",
    ),
]
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
class AroundOptions:
    """What is done before and after a motion."""

    settle: SettleOption = False
    ground_check: GroundCheckOption = False
    scene_out: EndOption = None


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
    around: AroundOptions,
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

    With --ground-check a scene with [ground] is simulated a second time with four times the stiffness of its
    contacts: where nodes then come to be elsewhere, the motion depends on a number that is seldom known.

    With --scene-out the scene is written as it ends: a structure that came to rest on its ground, say.

    Example: tensegrity-codegen simulate prism.toml --t-end 2 --samples 201 --out prism.npz
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.runtime.integrate.options import check_options, complete_run_options
        from tensegrity_codegen.runtime.trajectory.write_motion import check_motion_file

        options = complete_run_options(**vars(integration))
        asked = _Asked(
            options, *read_until(until), around.settle, given, 1.0 if around.ground_check else None
        )
        check_options(options, t_end, samples)
        check_result(around.scene_out, ".toml", inputs=[scene], overwrite=overwrite)
        if out is not None:
            check_motion_file(out)
            inputs = [path for path in (scene, many.batch, given.profile) if path is not None]
            check_output(out, inputs=inputs, overwrite=overwrite)
        if many.batch is not None:
            from tensegrity_codegen.runtime.integrate.batch_integration import choose_batch_control

            check_no_other(until=until, **vars(around))
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
        built, start = _build(scene, asked, t_end, compilation, output)
        given_run = {"t_end": t_end, "samples": samples}
        repeat = None
        if around.ground_check:
            stiff, begun = _build(scene, replace(asked, stiffer=STIFFER), t_end, compilation, output)
            repeat = (stiff, given_run | begun)
        motion = _run(output, built, asked, out, overwrite, repeat, **given_run, **start)
        if around.scene_out is not None:
            from tensegrity_codegen.cli.motion_end import write_end

            write_end(output, scene, motion, around.scene_out, overwrite=overwrite)


@dataclass(frozen=True)
class _Asked:
    """What is asked of one motion: options, what ends it early, whether it starts settled, inputs, ground."""

    options: "RunOptions"
    until_contact: bool
    condition: str | None
    settle: bool
    inputs: InputOptions
    stiffer: float | None  # factor of the stiffness of the ground, None where nothing is compared


def _run(
    output: Output,
    built: "BuiltLibrary",
    asked: _Asked,
    out: Path | None,
    overwrite: bool,
    repeat: "tuple[BuiltLibrary, dict[str, Any]] | None",
    **given: Any,
) -> "Trajectory":
    """Simulate the motion, say how it went, and return it; exit code 3 where it is not good.

    repeat: the library with a stiffer ground, and its arguments, to compare with.
    """
    from tensegrity_codegen.runtime.contacts.rest_memory import describe_plastic
    from tensegrity_codegen.runtime.integrate.raw_results import STOPPED_AT
    from tensegrity_codegen.scene.checks.plausible_ground import warn_of_sampled_contacts

    model = built.load()
    if built.structure is not None:
        interval = given["t_end"] / max(given["samples"] - 1, 1)
        output.warn(*warn_of_sampled_contacts(built.structure, interval))
    trajectory = _move(output, model, asked, given)
    if out is not None:
        trajectory.write(out, overwrite=overwrite)
    data = trajectory.summary() | {"library": str(built.path), "out": None if out is None else str(out)}
    data |= {"t_asked": given["t_end"], "t_stopped": trajectory.evidence.get(STOPPED_AT)}
    data["inputs"] = {name: value for name, value in given["arguments"].items() if name != "internal"}
    finding = f"{trajectory.status}: {describe_extremes(data, trajectory.find_flaws())}"
    readable: list[Any] = [finding, lambda: build_run_table(data), *_list_events(trajectory.log)]
    readable += describe_plastic(trajectory.plastic_elongation)
    second = None if repeat is None else _move(output, repeat[0].load(), asked, repeat[1])
    if second is not None:
        data["ground_check"] = compared = _compare(trajectory, second)
        readable.append(_describe_change(compared))
        if compared["change_over_size"] > LARGE_CHANGE:
            output.warn("the motion depends on the stiffness of the ground, see ground check")
    if trajectory.feet and not output.as_json:
        from tensegrity_codegen.report.tables import touched_table

        readable.append(touched_table(model.manifest.name, trajectory.feet))
    output.result(data, *readable)
    for motion in (trajectory, second):
        if motion is not None and motion.status != "ok":
            where = "" if motion is trajectory else f"with {STIFFER:g} times the ground's stiffness: "
            output.warn(f"{where}{motion.status}: {motion.message}")
            raise typer.Exit(3)
    return trajectory


def _move(output: Output, model: "CompiledModel", asked: _Asked, given: dict[str, Any]) -> "Trajectory":
    """Return the motion."""
    from tensegrity_codegen.runtime.simulate.simulate import simulate as run
    from tensegrity_codegen.runtime.simulate.until import Until

    until = Until(asked.condition, asked.until_contact)
    with output.progress("simulating") as progress:
        return run(model, until=until, progress=progress, **given, **asked.options.as_given())


def _compare(motion: "Trajectory", other: "Trajectory") -> dict[str, Any]:
    """Return how far nodes are elsewhere in another motion, at the samples that both have."""
    import numpy as np

    count = min(len(motion.time), len(other.time))
    apart = np.linalg.norm(motion.node_position[:count] - other.node_position[:count], axis=2)
    sample, node = np.unravel_index(int(apart.argmax()), apart.shape)
    return {
        "stiffness_factor": STIFFER,
        "status": other.status,
        "largest_change": float(apart[sample, node]),
        "change_over_size": float(apart[sample, node] / np.ptp(motion.node_position[0], axis=0).max()),
        "node": motion.node_name[node],
        "time": float(motion.time[sample]),
        "change_at_end": float(apart[-1].max()),
    }


def _describe_change(found: dict[str, Any]) -> str:
    return (
        f"ground check: with {found['stiffness_factor']:g} times the stiffness node {found['node']} is "
        f"{found['largest_change']:.4g} m elsewhere at {found['time']:.4g} s; "
        f"at the end nodes are up to {found['change_at_end']:.4g} m elsewhere"
    )


def _list_events(log: "EventLog") -> list[str]:
    """Return the first events of a motion as a line: time, what, and which way."""
    words = {
        ("cable", 1): "taut",
        ("cable", -1): "slack",
        ("ground", 1): "touches",
        ("ground", -1): "lifts",
        ("stick", 1): "sticks",
        ("stick", -1): "slips",
        ("motor", 1): "is below its rate",
        ("motor", -1): "is at its rate",
        ("ring", 1): "sticks at its end",
        ("ring", -1): "slips at its end",
        ("yield", 1): "stops yielding",
        ("yield", -1): "yields",
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
    scene: Path, asked: _Asked, t_end: float, compilation: CompileOptions, output: Output
) -> "tuple[BuiltLibrary, dict[str, Any]]":
    """Return the library that the run needs; its start (None: of the scene), inputs and schedule, by name."""
    from tensegrity_codegen.pipeline.analyses import balance_energy
    from tensegrity_codegen.pipeline.build_library import MANY_CALLS, build_library
    from tensegrity_codegen.pipeline.settle import has_statics, settle_structure
    from tensegrity_codegen.structure.structure import Structure

    structure, request = output.load(scene, settles=asked.settle)
    if asked.stiffer is not None:
        from tensegrity_codegen.runtime.analysis.stand import require_ground

        ground = require_ground(structure, "--ground-check").ground
        assert ground is not None
        structure = replace(structure, ground=ground.stiffen(asked.stiffer))
    structure = balance_energy(structure, request)
    compiler, flags = compilation.compiler, compilation.flags
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
