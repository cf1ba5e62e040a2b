"""The analysis `stand`: whether the ground can hold a structure, and the cables that tip it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tensegrity_codegen.analyses.cases.record import Option, Result, SceneAnalysis
from tensegrity_codegen.system.errors import check_choice

if TYPE_CHECKING:
    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.analysis.stand import Tip
    from tensegrity_codegen.runtime.contacts.judge_stand import Stand
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
    from tensegrity_codegen.structure.structure import Structure

TIP_ALL = "all"
DISTRIBUTIONS = {
    "equilibrium": "those of the equilibrium",
    "statics": "they follow from the balance alone",
    "least_squares": "not determined by the balance, those with the least sum of squares",
    "feasible": "not determined by the balance, one distribution that friction allows",
}


@dataclass(frozen=True)
class JudgeStand(SceneAnalysis):
    """Say whether a structure stands on the ground: forces of its feet, tipping margin, friction needed.

    The scene has a table [ground]. The structure counts as rigid in its equilibrium. Where no forces of the
    feet can hold it, a rigid motion proves it. --tip shortens cables, one at a time, until the structure
    tips. Exit code 3 if it does not stand.

    Example: tensegrity-codegen stand standing.toml --load t1=1,0,0
    """

    name: ClassVar[str] = "stand"
    verb_order: ClassVar[int] = 115
    takes: ClassVar[tuple[str, ...]] = ("load", "input")

    as_drawn: Annotated[bool, Option("judge the positions in the scene instead of the equilibrium.")] = False
    frictionless: Annotated[bool, Option("on the ground: without friction, whatever the scene says.")] = False
    tip: Annotated[
        tuple[str, ...],
        Option(
            "find how far this cable must be shortened until the structure tips; may be repeated. all: each "
            "cable."
        ),
    ] = ()

    @property
    def settles(self) -> bool:
        """Whether the analysis begins with the search for the equilibrium."""
        return not self.as_drawn

    def solve(self, case: "SceneCase") -> "StandResult":
        """Return whether a scene stands, in its equilibrium or as drawn, and the cables that tip it."""
        import numpy as np

        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.settle import with_statics
        from tensegrity_codegen.runtime.analysis.stand import find_tips, stand
        from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
        from tensegrity_codegen.structure.contact_estimates import require_ground
        from tensegrity_codegen.system.progress import work_pass

        structure = require_ground(case.subject, case.subject.name)
        # The cables that are shortened.
        cable_names = [
            name for name, bar in zip(structure.member_name, structure.is_bar, strict=True) if not bar
        ]
        for name in self.tip:
            check_choice(name, (*cable_names, TIP_ALL), "cable", "--tip")
        cables = tuple(cable_names) if TIP_ALL in self.tip else self.tip
        # A library whose loads, and rest lengths of the cables that are shortened, change at run time.
        statics = with_statics(structure, case.request)
        parameters: dict[str, tuple[int, ...]] = {"node_load": tuple(range(structure.n_nodes))}
        if cables:
            rows = np.flatnonzero(np.isin(structure.member_name, cables))
            parameters["rest_length"] = tuple(rows.tolist())
        quantities = find_needs("equilibrium", structure, statics).quantities
        model = case.build(structure, statics.wanting(*quantities, parameters=parameters))
        arguments = {**case.inputs, "node_load": case.node_load}
        equilibrium, shape = None, None
        if self.settles:
            equilibrium = find_equilibrium(
                model, arguments=arguments, frictionless=self.frictionless, raise_on_failure=False
            )
            case.warn(*equilibrium.warnings)
            shape = equilibrium if equilibrium.is_found else equilibrium.coordinate
        verdict = stand(model, shape, arguments=arguments, frictionless=self.frictionless)
        tips: tuple[Tip, ...] = ()
        if cables and equilibrium is not None and equilibrium.is_found:
            with work_pass("shortening cables") as move:
                tips = find_tips(
                    model,
                    arguments=arguments,
                    frictionless=self.frictionless,
                    progress=lambda number, _: move(number / len(cables)),
                )
        return StandResult(structure, equilibrium, verdict, tips)


@dataclass(frozen=True, eq=False)
class StandResult(Result):
    """Whether a scene stands: its equilibrium (None: judged as drawn), the verdict, cables that tip it."""

    structure: "Structure"
    equilibrium: "Equilibrium | None"
    verdict: "Stand"
    tips: "tuple[Tip, ...]"

    @property
    def is_lost(self) -> bool:
        """Whether an equilibrium was looked for and not found."""
        return self.equilibrium is not None and not self.equilibrium.is_found

    @property
    def is_good(self) -> bool:
        """Whether the structure stands."""
        return self.verdict.is_standing and not self.is_lost

    def as_dict(self) -> dict[str, Any]:
        """Return verdict, equilibrium and tips; the status is "ok" if the structure stands."""
        equilibrium, verdict = self.equilibrium, self.verdict
        status = "ok" if verdict.is_standing else verdict.verdict
        return {
            "status": equilibrium.status if equilibrium is not None and self.is_lost else status,
            **verdict.as_evidence(),
            "equilibrium": None if equilibrium is None else equilibrium.as_evidence(),
            "tips": [tip.as_evidence() for tip in self.tips],
        }

    def describe(self) -> list[Any]:
        """Return the verdict, the feet, and the cables that tip the structure."""
        from tensegrity_codegen.report.tables import feet_table, tips_table

        equilibrium, verdict, name = self.equilibrium, self.verdict, self.structure.name
        lines = [verdict.message]
        if equilibrium is not None and self.is_lost:
            lines = [f"{equilibrium.status}: {equilibrium.message}"]
        tables: list[Any] = []
        if verdict.is_standing:
            lines.append(
                f"friction needed {verdict.friction_needed:.6g} of {verdict.friction:.6g}; "
                f"forces of the feet: {DISTRIBUTIONS[verdict.distribution]}"
            )
            tables.append(feet_table(name, verdict.foot, verdict.force))
        elif verdict.motion is not None:
            lines.append("proof: a rigid motion that the loads drive and no foot can stop, in --json")
        if self.tips:
            tables.append(tips_table(name, self.tips))
        return ["\n".join(lines), *tables]


ANALYSIS = JudgeStand
