"""`tensegrity-codegen control`: a motion held by feedback, designed and simulated under disturbances."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensegrity_codegen.cli.control_options import (
    CodeOptions,
    DesignOptions,
    MotionOptions,
    StudyOptions,
    check_build,
    check_estimator,
    check_motion_gusts,
    read_controlled,
    read_errors,
    write_controller,
)
from tensegrity_codegen.cli.options import CompilerOption, OverwriteOption, PrintOptions, SceneArgument
from tensegrity_codegen.cli.output import Output, check_result
from tensegrity_codegen.cli.verb import Verb, quote_command

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
    held: MotionOptions,
    design: DesignOptions,
    study: StudyOptions,
    out: OutOption = None,
    page: PageOption = None,
    *,
    code: CodeOptions,
    overwrite: OverwriteOption = False,
    compiler: CompilerOption = None,
    printing: PrintOptions,
) -> None:
    """Hold a motion by feedback: design it, and simulate it in the full model under disturbances.

    Plans the motion, puts it in time, designs a linear-quadratic regulator and, where the scene has sensors,
    an estimator; then simulates without feedback, with the true state and with the estimator. Exit code 3
    where a loop with feedback is unstable, a tenth of its commands are not solved, or it ends further from
    the motion than the open loop by more than a tenth of --tolerance. --build writes the controller in C.

    Example: tensegrity-codegen control pinned_prism.toml --to 'twist("bar*_B", "base_*")=165' --page c.html
    """
    output = Output(printing.json, printing.all)
    with output.guard(scene):
        from tensegrity_codegen.analyses.plans.held_motion import FeedbackDesign
        from tensegrity_codegen.control.feedback.study.stated_errors import check_errors
        from tensegrity_codegen.pipeline.build_library import MANY_CALLS
        from tensegrity_codegen.runtime.model.arrays import write_arrays

        inputs = [scene, *(file for file in (held.plan, design.weights) if file is not None)]
        check_result(out, ".npz", inputs=inputs, overwrite=overwrite)
        check_result(page, ".html", inputs=inputs, overwrite=overwrite, draws=True)
        check_build(code, scene, overwrite)
        stated, options = held.to_motion(), design.to_feedback()
        stated.check(options.sample, study.t_end, study.last)
        options.check()
        # The motion, feedback about it, and its study.
        case = read_controlled(output, scene, stated, held.input, compiler)
        subject, arguments = case.subject, case.inputs
        check_estimator(code, options, subject)
        errors = read_errors(study, subject.axes)
        check_motion_gusts(errors.gusts, study.t_end)
        model = case.build_library(subject, stated.request_model(case), MANY_CALLS).load()
        check_errors(model, errors)
        motion = stated.find(case, model, study.t_end)
        in_c = study.in_c or design.mpc
        controller = FeedbackDesign(
            model, motion, options, arguments, in_c or code.build is not None, output.warn
        )
        if controller.lacks_sensors:
            output.warn("the scene has no [[sensors]]: feedback is simulated with the true state only")
        with output.progress("designing feedback"):
            design_parts = controller.build()
        del design_parts["stored_gains"]
        result = _study(
            output,
            replace(study, in_c=in_c),
            model,
            motion,
            errors=errors,
            arguments=arguments,
            compiler=compiler,
            **design_parts,
        )
        # Its arrays, its page, the controller in C.
        if out is not None:
            write_arrays(out, result.arrays(), overwrite=overwrite)
        if page is not None:
            _write_page(output, result, model, subject, page, overwrite)
        written: dict[str, Any] = {"out": None if out is None else str(out)}
        written["page"] = None if page is None else str(page)
        written["build"] = write_controller(
            output, result, model, code, scene=scene, compiler=compiler, overwrite=overwrite
        )
        _report(output, subject, result, written)
        if not result.holds:
            raise typer.Exit(3)


def _study(
    output: Output, options: StudyOptions, model: Any, motion: Any, *, compiler: str | None, **parts: Any
) -> "ControlStudy":
    """Simulate all loops: many draws at once in C, by this compiler, or one after the other in Python."""
    from tensegrity_codegen.control.embedded.closed_loop import simulate_control_batch
    from tensegrity_codegen.control.embedded.parts import ControllerCode
    from tensegrity_codegen.control.feedback.study.stated_errors import Draws
    from tensegrity_codegen.control.feedback.study.study import study_control

    batch = partial(simulate_control_batch, code=ControllerCode(compiler=compiler)) if options.in_c else None
    draws = Draws(options.draws, options.seed, options.last, batch, output.warn)
    with output.progress("simulating") as progress:
        study = study_control(model, motion, t_end=options.t_end, draws=draws, progress=progress, **parts)
    output.warn(*study.warnings)
    return study


def _write_page(
    output: Output, study: "ControlStudy", model: Any, subject: "Subject", page: Path, overwrite: bool
) -> None:
    from tensegrity_codegen.control.pages.control_page import build_control_page
    from tensegrity_codegen.report.pages.page import write_page
    from tensegrity_codegen.structure.outline import outline_bodies

    with output.progress("drawing"):
        shown = build_control_page(study, model, outline_bodies(subject), quote_command())
        write_page(shown, page, overwrite=overwrite)


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
