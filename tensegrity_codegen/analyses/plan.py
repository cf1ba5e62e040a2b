"""The analysis `plan`: rest lengths that move a structure to a target through stable equilibria."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import Option, Result, ResultFile, SceneAnalysis

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.runtime.records.plan_result import PlanResult
    from tensegrity_codegen.runtime.records.timed_motion import Motion
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Plan(SceneAnalysis):
    """Plan rest lengths that move a structure to a target, through stable equilibria within its limits.

    The plan is found, proved infeasible, or blocked by limits that are named; a blocked path proves nothing
    about others. Exit code 3 unless it is found.

    Example: tensegrity-codegen plan prism12.toml --to twist=165 --out plan.csv
    """

    name: ClassVar[str] = "plan"
    verb_order: ClassVar[int] = 310
    takes: ClassVar[tuple[str, ...]] = ("input",)
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile(
            "out",
            (".npz", ".csv"),
            "Result file: .npz, or .csv for `simulate --profile`; may be repeated.",
            is_list=True,
        ),
        ResultFile(
            "page",
            (".html",),
            "Write a page with shapes, tensions, clearances and what binds (.html).",
            draws=True,
        ),
        ResultFile(
            "motion",
            (".npz", ".csv"),
            "Put the plan in time by a quintic, with inverse dynamics, and write it: .npz, or .csv for "
            "`simulate --profile FILE --profile-kind cubic`.",
            key="",
        ),
    )

    to: Annotated[
        tuple[str, ...],
        Option(
            "TARGET=VALUE: twist=165, tilt=10, height=250mm, 'member_length[\"c1\"]=0.2' and others "
            "(docs/planning.md); may be repeated.",
            verb_default=...,
        ),
    ] = ()
    actuate: Annotated[
        tuple[str, ...],
        Option(
            "what moves: cables, all, or a name of actuators, members, groups or classes; may be repeated; "
            "default: the actuators of the scene."
        ),
    ] = ()
    steps: Annotated[int, Option("number of steps where nothing limits them.", minimum=1)] = 20
    max_steps: Annotated[int, Option("largest number of steps and attempts.", minimum=1)] = 200
    least_progress: Annotated[
        float,
        Option(
            "the path ends where limits leave less than this part of a step 8 times in a row; 0: where they "
            "leave none."
        ),
    ] = 0.4
    attempts: Annotated[
        int,
        Option(
            "largest number of other paths where limits block the first: two begin with other changes, more "
            "go over shapes that random walks lead to.",
            minimum=0,
        ),
    ] = 2
    seed: Annotated[int, Option("of the random changes and walks.", minimum=0)] = 0
    duration: Annotated[
        float | None, Option("time of the plan [s]; default: the shortest that the rates permit.")
    ] = None

    def prepare_structure(self, structure: "Subject") -> "Subject":
        """Return the structure with the actuators of `actuate`."""
        from tensegrity_codegen.analyses.plans.planned import add_actuators

        return add_actuators(structure, self.actuate)

    def solve(self, case: "SceneCase") -> "PlanAnswer":
        """Return the plan, and its motion over time if the file `motion` is requested."""
        from tensegrity_codegen.analyses.plans.planned import plan_to_targets, request_actuated
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.build_library import MANY_CALLS
        from tensegrity_codegen.system.threads import limit_threads

        analysis = "time_motion" if "motion" in case.files else "plan"

        def choose_request(structure: "Subject", request: "ModelRequest") -> "ModelRequest":
            return find_needs(analysis, structure, request).alone(request)

        request = request_actuated(case, self.to, choose_request)
        model = case.build_library(case.subject, request, MANY_CALLS).load()
        limit_threads()  # the matrices are too small for several: waiting for each other takes longer
        options = ("steps", "max_steps", "least_progress", "attempts", "seed", "duration")
        plan = plan_to_targets(
            case, model, self.to, self.actuate, **{name: getattr(self, name) for name in options}
        )
        motion = None
        if "motion" in case.files and plan.is_found and plan.n_steps > 0:
            motion = _put_in_time(case, model, plan, self.duration)
        self._warn_of_profiles(case, plan, motion)
        return PlanAnswer(case, plan, motion)

    def _warn_of_profiles(self, case: "SceneCase", plan: "PlanResult", motion: "Motion | None") -> None:
        """Warn of .csv files that `simulate --profile` cannot follow as they are."""
        tables = [file for file in case.files.get("out", ()) if file.suffix.lower() == ".csv"]
        if self.actuate and (
            tables or (motion is not None and case.files["motion"].suffix.lower() == ".csv")
        ):
            case.warn(
                "the scene needs [[actuators]] of these names for `simulate --profile` to follow the plan"
            )
        if plan.time is None and tables:
            case.warn(
                "no actuator has a rate, so the .csv has the progress in place of times: with --duration "
                "SECONDS `simulate --profile` can follow it"
            )


@dataclass(frozen=True, eq=False)
class PlanAnswer(Result):
    """A plan, whether it is found or not, and its motion over time if that is requested."""

    case: "SceneCase"
    plan: "PlanResult"
    motion: "Motion | None"

    @property
    def is_good(self) -> bool:
        """Whether the plan is found."""
        return self.plan.is_found

    def write(self, name: str, path: Path, *, overwrite: bool) -> bool:
        """Write the plan, its page, or its motion if there is one."""
        from tensegrity_codegen.control.planning.record_plan import write_plan

        if name == "out":
            write_plan(self.plan, path, overwrite=overwrite)
        elif name == "page":
            self._write_page(path, overwrite=overwrite)
        elif self.motion is not None:
            self.motion.write(path, overwrite=overwrite)
        return name != "motion" or self.motion is not None

    def _write_page(self, path: Path, *, overwrite: bool) -> None:
        from tensegrity_codegen.control.pages.plan_page import build_plan_page
        from tensegrity_codegen.report.pages.page import write_page
        from tensegrity_codegen.structure.outline import outline_bodies
        from tensegrity_codegen.system.progress import work_pass

        case = self.case
        with work_pass("drawing"):
            named = replace(self.plan, message=case.name_options(self.plan.message))
            page = build_plan_page(named, outline_bodies(case.subject), case.subject.limits, case.command)
            write_page(page, path, overwrite=overwrite)

    def as_dict(self) -> dict[str, Any]:
        """Return the plan and the facts of its motion."""
        from tensegrity_codegen.control.pages.plans import describe_plan

        motion = None
        if self.motion is not None:
            rates = zip(self.motion.actuators, self.motion.peak_rate.tolist(), strict=True)
            motion = {
                "out": str(self.case.files["motion"]),
                "duration": self.motion.duration,
                "shortest_duration": self.motion.shortest_duration,
                "peak_rate": dict(rates),
                "largest_residual": float(self.motion.residual.max(initial=0.0)),
            }
        return {**describe_plan(self.plan), "motion": motion}

    def describe(self) -> list[Any]:
        """Return targets, rest lengths, the limits that bind, and times."""
        from tensegrity_codegen.control.pages.plans import (
            actuators_table,
            binding_table,
            certificate_table,
            describe_extremes,
            targets_table,
        )

        plan = self.plan
        builders = (targets_table, actuators_table, binding_table, certificate_table)
        tables = [build(plan, self.case.subject.name) for build in builders]
        lines = describe_extremes(plan)
        if plan.time is not None:
            lines.append(f"takes {plan.time[-1]:.6g} s")
        if self.motion is not None:
            lines.append(
                f"motion of {self.motion.duration:.6g} s, shortest {self.motion.shortest_duration:.6g} s"
            )
        shown = [table for table in tables if table is not None]
        return [f"{plan.status}: {plan.message}", *shown, *lines]


def _put_in_time(
    case: "SceneCase", model: "CompiledModel", plan: "PlanResult", duration: float | None
) -> "Motion":
    """Return the motion of a plan that was found, after its warnings."""
    from tensegrity_codegen.control.feedback.time_motion import time_motion
    from tensegrity_codegen.system.progress import work_pass

    has_masses = model.has("acceleration")
    if not has_masses:
        case.warn("without masses the inputs of the motion are those of its equilibria")
    kind = "dynamic" if has_masses else "static"
    with work_pass("putting the plan in time"):
        motion = time_motion(model, plan, duration, feedforward=kind, arguments=case.inputs)
    case.warn(*motion.warnings)
    return motion


ANALYSIS = Plan
