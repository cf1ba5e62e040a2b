"""The answer of `simulate` for one scene: a motion, or many from the starts of a file."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensegrity_codegen.analyses.cases.record import Result

if TYPE_CHECKING:
    from rich.table import Table

    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.integrate.event_log import EventLog
    from tensegrity_codegen.runtime.trajectory.trajectory import BatchTrajectory, Trajectory
    from tensegrity_codegen.structure.member_limits import MemberFlaws

MAX_EVENTS = 10  # in the text
AT_REST = 1e-3  # 1/s: speed over the size of the structure, up to which it is at rest
# The word for an event of a kind and direction.
EVENTS = {
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


@dataclass(frozen=True, eq=False)
class MotionAnswer(Result):
    """A motion of a scene.

    facts: of the run besides the summary of the motion, JSON-ready.
    stiffer: the motion on a stiffer ground, for comparison; change: the distances between their nodes.
    """

    case: "SceneCase"
    motion: "Trajectory"
    facts: Mapping[str, Any]
    stiffer: "Trajectory | None" = None
    change: Mapping[str, Any] | None = None

    @property
    def failure(self) -> str:
        """Why the motion, or the one on a stiffer ground, is not good."""
        if self.motion.status != "ok":
            return f"{self.motion.status}: {self.motion.message}"
        if self.stiffer is None or self.change is None or self.stiffer.status == "ok":
            return ""
        factor = f"{self.change['stiffness_factor']:g}"
        return f"with {factor} times the ground's stiffness: {self.stiffer.status}: {self.stiffer.message}"

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle."""
        return self.motion.find_flaws().is_beyond

    def write(self, name: str, path: Path, *, overwrite: bool) -> bool:
        """Write the motion, or the scene as a motion that is good ends."""
        if name == "out":
            self.motion.write(path, overwrite=overwrite)
        elif self.is_good:
            self._write_end(path, overwrite=overwrite)
        return name == "out" or self.is_good

    def as_dict(self) -> dict[str, Any]:
        """Return the summary of the motion, the library, times and inputs, and the comparison."""
        compared = {} if self.change is None else {"ground_check": dict(self.change)}
        return {**self.motion.summary(), **self.facts, **compared}

    def describe(self) -> list[Any]:
        """Return extremes, facts, events and feet of the motion."""
        from tensegrity_codegen.report.tables import touched_table
        from tensegrity_codegen.runtime.contacts.rest_memory import describe_plastic

        motion, summary = self.motion, self.as_dict()
        lines = [
            f"{_say_excess(self)}{motion.status}: {_describe_extremes(summary, motion.find_flaws())}",
            _build_table(summary, self.case.name_options),
            *_describe_events(motion.log, self.case.whole),
            *describe_plastic(motion.plastic_elongation),
        ]
        if self.change is not None:
            lines.append(
                f"ground check: with {self.change['stiffness_factor']:g} times the stiffness node "
                f"{self.change['node']} is {self.change['largest_change']:.4g} m elsewhere at "
                f"{self.change['time']:.4g} s; at the end nodes are up to "
                f"{self.change['change_at_end']:.4g} m elsewhere"
            )
        if motion.feet:
            lines.append(touched_table(self.case.subject.name, motion.feet))
        return lines

    def _write_end(self, path: Path, *, overwrite: bool) -> None:
        """Write the scene as its motion ends: places, velocities, and rest lengths with the inputs there."""
        import numpy as np

        from tensegrity_codegen.scene.describe import describe_subject
        from tensegrity_codegen.scene.write import write_scene
        from tensegrity_codegen.structure.applied_inputs import add_inputs_to_rest_length
        from tensegrity_codegen.structure.bodies import BodySystem
        from tensegrity_codegen.system.errors import name_list

        motion, subject = self.motion, self.case.subject
        inputs = {} if motion.input is None else dict(zip(motion.input_name, motion.input[-1], strict=True))
        is_bodies = isinstance(subject, BodySystem)
        names = ("coordinate", "velocity") if is_bodies else ("node_position", "node_velocity")
        subject = subject.with_changes(
            rest_length=add_inputs_to_rest_length(subject, inputs),
            **{name: getattr(motion, name)[-1] for name in names},
        )
        write_scene(describe_subject(subject, self.case.request), path, overwrite=overwrite)
        speed = float(np.linalg.norm(motion.node_velocity[-1], axis=-1).max(initial=0.0))
        if speed > AT_REST * float(np.ptp(motion.node_position[-1], axis=0).max(initial=0.0)):
            hint = "a longer `t_end`, or the verb equilibrium, finds a state at rest"
            self.case.warn(f"{path} begins in motion, with up to {speed:.3g} m/s of a node: {hint}")
        # Feet stick again at their positions, work counts from 0; others have no place in a scene.
        lost = [name for name in motion.internal_name if "_stick" not in name and not name.endswith("_work")]
        if lost:
            self.case.warn(f"{path} begins without internal states: {name_list(lost, most=10)}")


@dataclass(frozen=True, eq=False)
class BatchAnswer(Result):
    """Motions from many starts; facts: of the run besides their summary, JSON-ready."""

    case: "SceneCase"
    batch: "BatchTrajectory"
    facts: Mapping[str, Any]

    @property
    def failure(self) -> str:
        """The number of motions that failed, and the message of the first of them."""
        is_ok = self.batch.is_ok
        if is_ok.all():
            return ""
        k = int(is_ok.argmin())
        count = len(self.batch) - int(is_ok.sum())
        return (
            f"{count} of {len(self.batch)} motions; number {k}: {self.batch.status[k]}: "
            f"{self.batch.message[k]}"
        )

    @property
    def is_beyond(self) -> bool:
        """Whether members exceed limits or buckle."""
        return self.batch.find_flaws().is_beyond

    def write(self, name: str, path: Path, *, overwrite: bool) -> bool:
        """Write all motions."""
        self.batch.write(path, overwrite=overwrite)
        return True

    def as_dict(self) -> dict[str, Any]:
        """Return the summary of the motions, their control, inputs and library."""
        return {**self.batch.summary(), **self.facts}

    def describe(self) -> list[Any]:
        """Return the number of good motions, and the extremes of all."""
        summary = self.as_dict()
        extremes = _describe_extremes(summary, self.batch.find_flaws())
        return [
            f"{summary['n_ok']} of {len(self.batch)} motions ok{self.batch.say_unestimated()}: "
            f"{_say_excess(self)}{extremes}",
            _build_table(summary, self.case.name_options),
        ]


def _say_excess(result: Result) -> str:
    """Return the opening of the text if members exceed limits or buckle."""
    return "exceeds limits; " if result.is_beyond else ""


def _describe_extremes(summary: Mapping[str, Any], flaws: "MemberFlaws") -> str:
    """Return the largest displacement of a motion, or of many, its tensions, and exceeded limits."""
    from tensegrity_codegen.structure.member_limits import describe_tensions

    sentence = "no node moves"
    if summary["largest_displacement"]:
        sentence = (
            f"node {summary['displaced_node']} moves farthest, {summary['largest_displacement']:.4g} m at "
            f"{summary['displaced_time']:.4g} s"
        )
    tensions = [describe_tensions(summary)] if "cable_tension" in summary else []
    return "; but ".join(["; ".join([sentence, *tensions]), *flaws.describe()])


def _build_table(summary: Mapping[str, Any], name_options: Callable[[Any], Any]) -> "Table":
    """Return the facts of one or many motions, but for those of the first sentence, as a table."""
    from tensegrity_codegen.report.tables import run_table

    shown = {
        key: value for key, value in summary.items() if not key.startswith(("displaced", "largest_disp"))
    }
    return run_table(name_options(shown))


def _describe_events(log: "EventLog", whole: bool) -> list[str]:
    """Return the first events of a motion, or all, as a line: time, name, and which way."""
    count = log.count if whole else min(log.count, MAX_EVENTS)
    shown = [
        f"{time:.6g} s {name} {EVENTS.get((kind, sign), kind)}"
        for time, kind, name, sign in zip(log.time, log.kind, log.name, log.direction.tolist(), strict=True)
    ][:count]
    remainder = f", and {log.count - len(shown)} more (log_time, log_name of the result file)"
    return [f"events: {', '.join(shown)}{remainder if log.count > len(shown) else ''}"] if shown else []
