"""Options of the analysis `simulate`, of one motion or of many."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tensegrity_codegen.analyses.cases.record import CaseAnalysis, Option, SceneAnalysis
from tensegrity_codegen.runtime.integrate.methods import BATCH_METHOD, METHODS
from tensegrity_codegen.system.errors import UnknownNameError, suggest
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.integrate.options import RunOptions

UNTIL = ("contact",)


@dataclass(frozen=True)
class MotionAnalysis(SceneAnalysis, CaseAnalysis):
    """An analysis of motions from time 0 on."""

    t_end: Annotated[float, Option("simulated time [s].", verb_default=...)] = 1.0
    samples: Annotated[int, Option("number of equally spaced samples.")] = 101
    method: Annotated[
        str,
        Option(
            f"one of {', '.join(METHODS)}; auto says what it chooses, {STIFF_INTEGRATOR} is for stiff bars.",
            verb_default="auto",
        ),
    ] = BATCH_METHOD
    step: Annotated[float | None, Option("step of fixed-step methods [s].")] = None
    rtol: Annotated[float, Option("relative tolerance of methods with error control.")] = 1e-6
    atol: Annotated[
        float | None,
        Option("absolute tolerance, m and m/s; if not given 1e-9 of the structure's length and speed."),
    ] = None
    max_steps: Annotated[
        int | None, Option("most steps of one run of a method in C; default a million, more with --keep.")
    ] = None
    control: Annotated[
        str | None,
        Option(
            "what the tolerance limits: samples (total error; default), or steps (default with --keep): of "
            "many motions several times as fast, where the error at the samples is not estimated.",
        ),
    ] = None
    conserve: Annotated[
        str,
        Option(
            "what stays constant: energy, for long undamped motions.",
            argument_name="keep",
            parameter="keep",
            in_sweep=False,
        ),
    ] = ""
    settle: Annotated[bool, Option("start from the equilibrium.", in_sweep=False)] = False
    ground_check: Annotated[
        bool,
        Option(
            "repeat with 4 times the ground's stiffness; say how far nodes are elsewhere.", in_sweep=False
        ),
    ] = False
    until: Annotated[
        str | None,
        Option("end early: contact of two bars, or a condition: 'top.z < 0.1'.", in_sweep=False),
    ] = None
    profile: Annotated[
        Path | None,
        Option("inputs over time (.csv): the column time, and one for each input.", in_sweep=False),
    ] = None
    profile_kind: Annotated[
        str, Option("between the rows of --profile: linear or cubic.", in_sweep=False)
    ] = "linear"
    batch: Annotated[
        Path | None, Option("file of many starts (.npz), simulated side by side.", in_sweep=False)
    ] = None
    threads: Annotated[int, Option("number of threads for a batch.", in_sweep=False)] = 1

    @property
    def settles(self) -> bool:
        """Whether the analysis begins with the search for the equilibrium."""
        return self.settle

    @property
    def run_options(self) -> "RunOptions":
        """How motions are integrated, one alone with the control of its samples by default."""
        from tensegrity_codegen.runtime.integrate.options import complete_run_options

        return complete_run_options(
            self.method, self.rtol, self.atol, self.step, self.max_steps, self.conserve, self.control
        )

    @property
    def event(self) -> tuple[bool, str | None]:
        """Whether a contact ends the motion, and the condition that does; raises UnknownNameError."""
        from tensegrity_codegen.tables.quantities import QUANTITIES

        if self.until is None or self.until in UNTIL:
            return self.until is not None, None
        if self.until.isidentifier() and self.until not in QUANTITIES and self.until != "time":
            raise UnknownNameError(
                "unknown event",
                where="--until",
                given=self.until,
                allowed=f"{', '.join(UNTIL)}, or a condition such as 'top.z < 0.1'",
                hint=suggest(self.until, UNTIL),
            )
        return False, self.until
