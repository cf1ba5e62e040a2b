"""The analysis `simulate`: the motion of a scene, of many starts, or of the cases of a sweep."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import Output, ResultFile
from tensegrity_codegen.analyses.motions.motion_options import MotionAnalysis
from tensegrity_codegen.system.errors import InvalidValueError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.quantities import CaseArguments, Outcomes
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.analyses.motions.motion_answer import BatchAnswer, MotionAnswer
    from tensegrity_codegen.pipeline.analyses import Needs
    from tensegrity_codegen.runtime.model.model import CompiledModel
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.tables.manifest import Manifest
    from tensegrity_codegen.tables.request import ModelRequest


@dataclass(frozen=True)
class Simulate(MotionAnalysis):
    """Simulate the motion of a scene and write it to a file.

    Files .npz and .mat hold all arrays by name; .csv and .parquet a row for each sample, with columns such as
    "time [s]", "t1.x [m]", "bar1.tension [N]".

    With --until contact the run ends at the first contact of two bars; "events" of the result, and
    event_time, event_kind, event_name of the file describe it. With a condition the run ends where a
    comparison becomes true, or another expression changes its sign.

    With --batch every row of coordinate, velocity, node_position, node_velocity, or of a run-time argument in
    that file is a separate motion. Explicit methods in C integrate eight at a time in one core, with
    ever tighter steps until the error at the samples is within the tolerance; --control steps does it once
    and does not estimate that error. With --keep or --profile, on the ground, and where steps would have to
    end at events, motions run one after the other.

    With --input an input or actuator has a constant value from the start on; with --settle also in the
    equilibrium, and so do the first values of a profile.

    With --profile inputs change with time: a CSV file with the header time,motor (names of inputs) and rows
    from 0 to --t-end or later. Two rows with the same time are a jump.

    With --ground-check a scene with [ground] is simulated a second time with four times the stiffness of its
    contacts: where nodes then come to be elsewhere, the motion depends on a number that is seldom known.

    With --scene-out the scene is written as it ends: a structure that came to rest on its ground, say.

    Example: tensegrity-codegen simulate prism.toml --t-end 2 --samples 201 --out prism.npz
    """

    name: ClassVar[str] = "simulate"
    success_phrase: ClassVar[str] = "ran to their end"
    verb_order: ClassVar[int] = 210
    takes: ClassVar[tuple[str, ...]] = ("input", "flags", "strict")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile(
            "out", (".npz", ".csv", ".parquet", ".mat"), "Result file (.npz, .csv, .parquet or .mat)."
        ),
        ResultFile(
            "scene_out",
            (".toml",),
            "Write the scene as the motion ends (.toml); with inputs, without loads.",
            key="",
        ),
    )

    def check_files(self, paths: Mapping[str, Any]) -> None:
        """Raise InvalidValueError for options that one motion, or many, do not have, or out of range."""
        from tensegrity_codegen.runtime.integrate.options import check_options
        from tensegrity_codegen.runtime.simulate.condition import find_quantities
        from tensegrity_codegen.runtime.trajectory.motion_tables import check_motion_file

        check_options(self.run_options, self.t_end, self.samples)
        if self.event[1] is not None:
            find_quantities(self.event[1])
        if "out" in paths:
            check_motion_file(paths["out"])
        if self.batch is None:
            return
        alone = {name: getattr(self, name) for name in ("until", "settle", "ground_check")}
        for name, value in {**alone, "scene_out": paths.get("scene_out")}.items():
            if value:
                raise InvalidValueError(
                    "not together with --batch",
                    where=f"--{name.replace('_', '-')}",
                    given=value if value is not True else "",
                )

    def solve(self, case: "SceneCase") -> "MotionAnswer | BatchAnswer":
        """Return the motion of a scene, or those of a file of starts."""
        from tensegrity_codegen.analyses.motions.solve_motion import solve_motion, solve_starts

        return solve_motion(self, case) if self.batch is None else solve_starts(self, case, self.batch)

    def needs(self, structure: "Subject", request: "ModelRequest") -> "Needs":
        """Return the functions of a batch of motions, and the quantities that `keep` requests."""
        from tensegrity_codegen.analyses.cases.kept import find_kept_quantities
        from tensegrity_codegen.analyses.motions.case_motions import VELOCITY, list_texts, select_sampled
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.runtime.integrate.options import check_options

        check_options(self.run_options, self.t_end, self.samples)
        needs = find_needs("simulate_batch", structure, request, method=self.method, rtol=self.rtol)
        kept_quantities = find_kept_quantities(select_sampled(list_texts(self.keep)), request)
        placed = () if needs.quantities.count(VELOCITY) else (VELOCITY,)  # placed by coordinates
        added = tuple(name for name in kept_quantities if name not in (*needs.quantities, *placed))
        return replace(needs, quantities=(*needs.quantities, *added))

    def outputs(self, manifest: "Manifest") -> tuple[Output, ...]:
        """Return descriptions of the stored arrays."""
        from tensegrity_codegen.analyses.motions.case_motions import list_outputs

        return list_outputs(self, manifest)

    def compute(
        self, model: "CompiledModel", case_arguments: "CaseArguments", outcomes: "Outcomes", threads: int
    ) -> "Mapping[str, NDArray[Any]]":
        """Integrate the motions of a chunk of cases."""
        from tensegrity_codegen.analyses.motions.case_motions import compute_motions

        return compute_motions(self, model, case_arguments, outcomes, threads)


ANALYSIS = Simulate
