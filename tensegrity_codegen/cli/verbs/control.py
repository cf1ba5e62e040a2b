"""`tensegrity-codegen control`: a motion held by feedback, designed and simulated under disturbances."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.control_options import (
    BuildOption,
    BuiltPrecisionOption,
    DisturbanceOption,
    DrawsOption,
    DurationOption,
    EffortOption,
    EstimatorOption,
    GustOption,
    InCOption,
    IntegralOption,
    LastOption,
    LeastTensionOption,
    OnlyObservableOption,
    PlanOption,
    ResponseOption,
    SampleOption,
    SeedOption,
    StartErrorOption,
    StiffnessErrorOption,
    TEndOption,
    ToleranceOption,
    ToOption,
    WeightsOption,
    read_errors,
    read_least_tension,
)
from tensegrity_codegen.cli.controlled_motion import (
    ControlDesign,
    check_build,
    check_motion_gusts,
    check_motion_times,
    compile_control,
    find_motion,
    write_controller,
)
from tensegrity_codegen.cli.inputs import InputOption, read_inputs
from tensegrity_codegen.cli.options import CompilerOption, JsonOption, OverwriteOption, SceneArgument
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.scene_files import check_result, write_page
from tensegrity_codegen.cli.verb import Verb, quote_command
from tensegrity_codegen.cli.verbs.plan import ActuateOption

if TYPE_CHECKING:
    from tensegrity_codegen.control.feedback.study.control_study import ControlStudy
    from tensegrity_codegen.scene.subject import Subject


OutOption = Annotated[Path | None, typer.Option("--out", "-o", help="Result file with all arrays (.npz).")]
PageOption = Annotated[
    Path | None,
    typer.Option("--page", help="Write a page with errors, commands, tensions, pictures and limits (.html)."),
]


def control(
    scene: SceneArgument,
    to: ToOption = None,
    plan: PlanOption = None,
    actuate: ActuateOption = None,
    input: InputOption = None,
    duration: DurationOption = None,
    sample: SampleOption = 0.005,
    tolerance: ToleranceOption = None,
    effort: EffortOption = None,
    response_time: ResponseOption = None,
    integral_action: IntegralOption = None,
    weights: WeightsOption = None,
    least_tension: LeastTensionOption = None,
    estimator: EstimatorOption = True,
    disturbance: DisturbanceOption = None,
    only_observable: OnlyObservableOption = False,
    start_error: StartErrorOption = None,
    stiffness_error: StiffnessErrorOption = 0.05,
    gust: GustOption = None,
    draws: DrawsOption = 5,
    seed: SeedOption = 0,
    t_end: TEndOption = None,
    in_c: InCOption = False,
    last: LastOption = None,
    out: OutOption = None,
    page: PageOption = None,
    build: BuildOption = None,
    precision: BuiltPrecisionOption = "double",
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    json: JsonOption = False,
) -> None:
    """Hold a motion by feedback: design it, and simulate it in the full model under disturbances.

    Plans the motion, puts it in time, designs a linear-quadratic regulator and, where the scene has sensors,
    an estimator; then simulates without feedback, with the true state and with the estimator. Exit code 3
    where a loop with feedback is unstable, or ends further from the motion than the open loop by more than a
    tenth of --tolerance. --build writes the controller in C.

    Example: tensegrity-codegen control pinned_prism.toml --to 'twist("bar*_B", "base_*")=165' --page c.html
    """
    output = Output(json)
    with output.guard(scene):
        from tensegrity_codegen.control.feedback.study.study import study_control
        from tensegrity_codegen.runtime.model.array_file import write_arrays

        inputs = [scene, *(file for file in (plan, weights) if file is not None)]
        check_result(out, ".npz", inputs=inputs, overwrite=overwrite)
        check_result(page, ".html", inputs=inputs, overwrite=overwrite, draws=True)
        check_build(build, precision, scene, overwrite)
        read_least_tension(least_tension)
        is_held = not to and plan is None
        check_motion_times(sample, duration, t_end, last, is_held=is_held)
        subject, model, chosen = compile_control(output, scene, to, plan, actuate, compiler)
        arguments = read_inputs(input, subject, output)
        errors = read_errors(start_error, stiffness_error, gust, subject.axes)
        check_motion_gusts(errors.gusts, t_end)
        motion = find_motion(
            output, model, to, plan, chosen, duration=duration, arguments=arguments, t_end=t_end
        )
        design = ControlDesign(
            model, motion, sample, tolerance, effort, response_time, integral_action, weights, estimator,
            disturbance, only_observable, least_tension, arguments,
            in_c or build is not None, output.warn,
        )  # fmt: skip
        if design.lacks_sensors:
            output.warn("the scene has no [[sensors]]: feedback is simulated with the true state only")
        with output.progress("designing feedback"):
            parts = design.build()
        # Many draws at once in C, or one after the other in Python.
        batch = None
        if in_c:
            from tensegrity_codegen.control.embedded.simulate_batch import simulate_control_batch

            batch = partial(simulate_control_batch, compiler=compiler)
        with output.progress("simulating") as progress:
            study = study_control(
                model, motion, errors=errors, t_end=t_end, last=last, draws=draws, seed=seed,
                arguments=arguments, progress=progress, batch=batch, **parts,
            )  # fmt: skip
        output.warn(*study.warnings)
        if out is not None:
            write_arrays(out, study.arrays(), overwrite=overwrite)
        if page is not None:
            from tensegrity_codegen.control.pages.control_page import build_control_page
            from tensegrity_codegen.structure.outline import outline_bodies

            with output.progress("drawing"):
                drawn = outline_bodies(subject)
                shown = build_control_page(study, model, drawn, quote_command())
                write_page(shown, page, overwrite=overwrite)
        written: dict[str, Any] = {"out": None if out is None else str(out)}
        written["page"] = None if page is None else str(page)
        written["build"] = write_controller(
            output, study, model, build, scene=scene, precision=precision, compiler=compiler,
            overwrite=overwrite,
        )  # fmt: skip
        _report(output, subject, study, written)
        if not study.holds:
            raise typer.Exit(3)


def _report(output: Output, subject: "Subject", study: "ControlStudy", more: Mapping[str, Any]) -> None:
    """Print the study: errors of the loops, actuators, assumptions."""
    from tensegrity_codegen.control.pages.control_studies import (
        actuators_table,
        describe_facts,
        describe_study,
        errors_table,
    )

    name = subject.name
    output.result(
        {**describe_study(study), **more},
        f"{study.status}: {study.message}",
        errors_table(study, name),
        actuators_table(study, name),
        *describe_facts(study),
        *([] if more["build"] is None else [f"wrote a controller in C to {more['build']['folder']}"]),
    )


VERB = Verb(control, order=320)
