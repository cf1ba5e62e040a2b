"""The analysis `load-path`: equilibria under a growing load, and the events along it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from tensegrity_codegen.analyses.cases.record import Option, Result, ResultFile, SceneAnalysis
from tensegrity_codegen.system.errors import InvalidValueError, check_choice

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from tensegrity_codegen.analyses.cases.scene_case import SceneCase
    from tensegrity_codegen.runtime.paths.load_path import LoadPath, Watch
    from tensegrity_codegen.runtime.paths.model_path import ModelPath
    from tensegrity_codegen.scene.subject import Subject
    from tensegrity_codegen.structure.member_limits import MemberFlaws

RampKind = Literal["load", "loads", "gravity", "all"]
# What the load factor multiplies with each of them.
GROWING = {
    "load": "the loads of --load; those of the scene and weights act in full",
    "loads": "all loads; weights act in full",
    "gravity": "weights; loads act in full",
    "all": "all loads and weights, as in the check of `equilibrium` for jumps",
}
# Words of --events and the kinds of events that they stand for.
EVENTS = {
    "slack": ("slack", "taut"),
    "switch": ("switch",),
    "yield": ("yield",),
    "contact": ("contact", "separation"),
    "limit": ("limit", "stability"),
    "bifurcation": ("bifurcation",),
    "members": ("exceeded", "met"),
    "feet": ("lift", "touch", "slip", "stick", "slides", "tips", "lifts_off"),
}
ALL_EVENTS = ",".join(EVENTS)
DIGITS_ON_GROUND = 6  # of load factors, which are located to 1e-7 of the largest there


@dataclass(frozen=True)
class LoadRamp:
    """Loads base + load factor x pattern, by the names of the run-time arguments."""

    base: "dict[str, NDArray[np.float64]]"
    pattern: "dict[str, NDArray[np.float64]]"
    parameters: dict[str, tuple[int, ...]]
    kind: RampKind

    def check_moves(self, path: "ModelPath", load_texts: Sequence[str]) -> tuple[str, ...]:
        """Return the nodes whose growing load supports take; raises InvalidValueError if they take all."""
        held = path.find_held() if load_texts else ()
        is_all = len(held) == self.pattern["node_load"].any(axis=1).sum() and "gravity" not in self.pattern
        if held and is_all:
            raise InvalidValueError(
                "supports take the whole load at once: nothing moves, and only reactions change",
                where=f"--load {held[0]}",
                given=", ".join(held),
                allowed="a node that can move in the direction of the load",
                hint="load another node; `reactions` shows what supports carry",
            )
        return held


def build_ramp(
    subject: "Subject", kind: RampKind | None, load: "NDArray[np.float64]", load_texts: Sequence[str]
) -> LoadRamp:
    """Return the growing and the constant loads. Raises InvalidValueError for no load.

    load (n_nodes, 3) [N]: added to the loads of the scene; load_texts: the values of --load that state it.
    kind: "load": the added loads; "loads": these and the scene's own; "gravity": gravity alone, while all
    loads stay; "all": all of them; None: the added loads, without these the scene's own, or its gravity.
    """
    import numpy as np

    axes = list(subject.axes)
    scene_load, added = subject.node_load[:, axes], load[:, axes]
    weight = np.array(subject.gravity, dtype=float)[axes]
    if kind is None:
        kind = "load" if load_texts else "loads" if scene_load.any() else "gravity" if weight.any() else "all"
    grows = {
        "load": added,
        "loads": scene_load + added,
        "gravity": 0 * scene_load,
        "all": scene_load + added,
    }[kind]
    base, pattern = {"node_load": scene_load + added - grows}, {"node_load": grows}
    parameters: dict[str, tuple[int, ...]] = {"node_load": tuple(range(subject.n_nodes))}
    if kind in ("gravity", "all") and weight.any():
        base["gravity"], pattern["gravity"], parameters["gravity"] = 0 * weight, weight, ()
    if not any(values.any() for values in pattern.values()):
        raise _no_load(kind, load_texts)
    return LoadRamp(base, pattern, parameters, kind)


def _no_load(kind: RampKind, load_texts: Sequence[str]) -> InvalidValueError:
    if kind == "gravity":
        return InvalidValueError(
            "the scene has no gravity", where="--ramp", given=kind, allowed="a scene with the key gravity"
        )
    if kind == "load" and not load_texts:
        return InvalidValueError(
            "no load is given",
            where="--load",
            given=None,
            allowed="NODE=fx,fy,fz",
            hint="add --load, or omit --ramp load: then the scene's own loads increase",
        )
    if not load_texts:
        also = " and no gravity" if kind == "all" else ""
        return InvalidValueError(
            f"the scene has no loads{also}",
            where="--ramp",
            given=kind,
            allowed="a scene with loads that can be increased",
            hint="add --load NODE=fx,fy,fz",
        )
    return InvalidValueError(
        "the load is zero", where="--load", given=", ".join(load_texts), allowed="a force that is not zero"
    )


@dataclass(frozen=True)
class FollowLoadPath(SceneAnalysis):
    """Follow the equilibrium under increasing loads, through limit points, and locate events.

    Loads of --load act at load factor 1. A path that turns back continues through zero load to the far
    branch.

    Events: cables that go slack or taut, switches of member laws, the first contact of bars (which ends the
    path), limit points (where the load factor turns back), bifurcations, members that buckle or exceed a
    limit of the scene. On the ground: feet that lift, touch, slip or stick, and where the structure no longer
    stands, which ends the path; no other events. Exit code 3 if neither the load factor nor an end of the
    path was reached.

    Example: tensegrity-codegen load-path prism.toml --load t1=0,0,-1 --most 20 --json
    """

    name: ClassVar[str] = "load-path"
    verb_order: ClassVar[int] = 130
    takes: ClassVar[tuple[str, ...]] = ("load", "input")
    files: ClassVar[tuple[ResultFile, ...]] = (
        ResultFile("out", (".csv", ".json"), "Write the path as a table (.csv or .json)."),
        ResultFile("page", (".html",), "Write a page with the curve, events and shapes (.html).", draws=True),
    )

    most: Annotated[float, Option("load factor to reach.")] = 1.0
    ramp: Annotated[
        RampKind | None,
        Option(
            "what increases: load (--load only), loads (and the scene's own), gravity, all. Default: load, "
            "without --load the scene's loads, or its gravity where it has none."
        ),
    ] = None
    floor: Annotated[
        float | None,
        Option("load factor at which a path that turned back ends; 0: at its start; default -10 x --most."),
    ] = None
    events: Annotated[str, Option(f"events, by commas; default all: {', '.join(EVENTS)}.")] = ALL_EVENTS
    past_contact: Annotated[bool, Option("continue after contact; bars then pass through each other.")] = (
        False
    )
    step: Annotated[float, Option("largest step; a straight path is about 1.4 long.")] = 0.1

    def check_files(self, paths: "Mapping[str, Any]") -> None:
        """Raise the error of an event, a step or a load factor that cannot be, before the work begins."""
        _parse_events(self.events)
        _check_options(self.most, self.floor, self.step)

    def solve(self, case: "SceneCase") -> "LoadPathResult":
        """Return the path of a scene from its equilibrium without the growing load."""
        from tensegrity_codegen.system.progress import work_pass

        _check_ground(case.subject, self.floor, self.past_contact)
        ramp = build_ramp(case.subject, self.ramp, case.added_load, case.load_texts)
        model = self._build(case, ramp)
        watches = _find_watches(model, case.subject, self.past_contact)
        floor = -10 * self.most if self.floor is None else self.floor
        with work_pass("load path") as show:
            path = _follow(model, watches, self.most, floor, self.step, show, case.warn)
        return LoadPathResult(case, model, path, _parse_events(self.events), ramp.kind)

    def _build(self, case: "SceneCase", ramp: LoadRamp) -> "ModelPath":
        """Return the problem of a scene under its loads and inputs, with all that a path needs."""
        from tensegrity_codegen.pipeline.analyses import find_needs
        from tensegrity_codegen.pipeline.settle import with_statics
        from tensegrity_codegen.runtime.model.arguments import merge_inputs
        from tensegrity_codegen.runtime.paths.model_path import build_path
        from tensegrity_codegen.runtime.paths.watches import MEMBER_WATCH_QUANTITIES
        from tensegrity_codegen.structure.bodies import BodySystem

        subject = case.subject
        statics = with_statics(subject, case.request)
        needs = find_needs("load_path", subject, statics).alone(statics)
        extra = ("node_position",) if "page" in case.files and isinstance(subject, BodySystem) else ()
        quantities = (*needs.quantities, *MEMBER_WATCH_QUANTITIES, *extra)
        needs = needs.wanting(*quantities, parameters=ramp.parameters)
        model = case.build(subject, needs)
        path = build_path(model, ramp.pattern, {**ramp.base, **merge_inputs(model.manifest, case.inputs)})
        held = ramp.check_moves(path, case.load_texts)
        if isinstance(subject, BodySystem):  # of others it is told as their loads are read
            case.warn_held_load(held)
        return path


@dataclass(frozen=True, eq=False)
class LoadPathResult(Result):
    """A load path, and which kinds of events are reported."""

    case: "SceneCase"
    model: "ModelPath"
    path: "LoadPath"
    kinds: tuple[str, ...]
    ramp: RampKind

    @property
    def is_good(self) -> bool:
        """Whether the load factor or an end of the path was reached."""
        return self.path.is_followed

    @cached_property
    def columns(self) -> "dict[str, NDArray[np.float64]]":
        """The path as a table: load factor, places, lengths, tensions."""
        from tensegrity_codegen.report.result_tables import tabulate_path

        return tabulate_path(self.path, self.model)

    @property
    def events(self) -> tuple[Any, ...]:
        """The events of the kinds that are reported."""
        return tuple(event for event in self.path.events if event.kind in self.kinds)

    @cached_property
    def flaws(self) -> "MemberFlaws":
        """The limits that members exceed at points of the path."""
        import numpy as np

        from tensegrity_codegen.structure.member_limits import check_members

        subject, columns = self.case.subject, self.columns
        length, tension = (
            np.stack([columns[f"{prefix}_{name}"] for name in subject.member_name], axis=-1)
            for prefix in ("length", "tension")
        )
        return check_members(subject, tension, length)

    def write(self, name: str, path: "Path", *, overwrite: bool) -> bool:
        """Write the table or the page if the path has points."""
        from tensegrity_codegen.report.result_tables import write_path

        if len(self.path.load_factor):
            if name == "page":
                self._write_page(path, overwrite)
            else:
                write_path(self.columns, self.path, path, overwrite=overwrite)
        return bool(len(self.path.load_factor))

    def _write_page(self, path: "Path", overwrite: bool) -> None:
        import numpy as np

        from tensegrity_codegen.report.pages.page import write_page
        from tensegrity_codegen.report.path_page import build_path_page
        from tensegrity_codegen.runtime.model.placement import place_nodes
        from tensegrity_codegen.structure.outline import outline_bodies
        from tensegrity_codegen.system.progress import work_pass

        model, flaws, drawn = self.model, self.flaws.describe(), outline_bodies(self.case.subject)
        with work_pass("drawing"):
            rows = [place_nodes(model.model, q, arguments=model.arguments) for q in self.path.coordinate]
            page = build_path_page(
                self.path, self.events, drawn, np.array(rows), self.columns, flaws, self.case.command
            )
            write_page(page, path, overwrite=overwrite)

    def as_dict(self) -> dict[str, Any]:
        """Return load factors, stability, events and members against their limits."""
        path = self.path
        return path.as_evidence() | {
            "events": [event.as_dict() for event in self.events],
            "load_factor": path.load_factor,
            "smallest_eigenvalue": path.smallest_eigenvalue,
            "inputs": dict(self.case.inputs),
            "ramp": self.ramp,
            "hint": _advise(path),
            "stable_up_to": path.stable_up_to,
            "near_bifurcation": path.near_bifurcation,
            "limits": self.flaws.as_evidence(),
        }

    def describe(self) -> list[Any]:
        """Return how the path ended, its points and its events."""
        from tensegrity_codegen.report.result_tables import describe_excess, events_table

        path = self.path
        digits = DIGITS_ON_GROUND if self.model.model.manifest.contact_name else 10
        flaws = [*describe_excess(path.events, digits), *path.describe_stability(digits)]
        flaws += self.flaws.describe()
        finding = "; but ".join([f"{path.status}: {path.message}", *flaws])
        grows = f"the load factor multiplies {GROWING[self.ramp]}" if self.case.subject.gravity.any() else ""
        lines = (finding, grows, _advise(path), _summary(path, digits))
        sentences = [sentence for sentence in lines if sentence]
        events = self.events
        return [*sentences, events_table(events, self.case.whole, digits) if events else "no event"]


def _parse_events(text: str) -> tuple[str, ...]:
    """Return the kinds of events that a list of words stands for; raises UnknownNameError."""
    names = [name.strip() for name in text.split(",")]
    for name in names:
        check_choice(name, EVENTS, "event", "--events")
    return tuple(kind for name in names for kind in EVENTS[name])


def _check_options(most: float, floor: float | None, step: float) -> None:
    """Raise the error of a load factor or a step that cannot be."""
    if not 1e-4 <= step <= 1:
        raise InvalidValueError(
            "the step is out of range",
            where="--step",
            given=step,
            allowed="0.0001 to 1",
            hint="0.1 is the default",
        )
    if not math.isfinite(most) or most == 0:
        raise InvalidValueError(
            "not a valid load factor" if most else "the path has no length",
            where="--most",
            given=most,
            allowed="a finite number other than 0",
            hint="1 reaches the full load",
        )
    if floor is not None and not floor * most <= 0:
        raise InvalidValueError(
            "the path would end before its start",
            where="--floor",
            given=floor,
            allowed=f"0 or a load factor {'below' if most > 0 else 'above'} it",
            hint="0 ends a path that has turned back at its start",
        )


def _check_ground(subject: "Subject", floor: float | None, past_contact: bool) -> None:
    """Raise FormulationError for options that load paths on the ground do not have."""
    from tensegrity_codegen.structure.ground_support import require_no_ground

    for name, is_given in (("--floor", floor is not None), ("--past-contact", past_contact)):
        if is_given:
            require_no_ground(subject, f"{name} of load-path")


def _find_watches(path: "ModelPath", subject: "Subject", past_contact: bool) -> "list[Watch]":
    """Return the watches of cables, since the stiffness jumps there, and of pairs of bars."""
    from tensegrity_codegen.runtime.paths.watches import (
        watch_contact,
        watch_members,
        watch_slack,
        watch_switch,
        watch_yield,
    )

    cables = [name for name, bar in zip(subject.member_name, subject.is_bar, strict=True) if not bar]
    switches = zip(subject.member_name, subject.has_switch, strict=True)
    switching = [name for name, has_switch in switches if has_switch]
    watches = [watch_slack(path, cables)] if cables else []
    watches += [*watch_switch(path, switching), *watch_yield(path), *watch_members(path, subject)]
    if subject.n_bar_pairs:
        watches.append(watch_contact(path, stops=not past_contact))
    return watches


def _follow(
    path: "ModelPath", watches: "list[Watch]", most: float, floor: float, step: float, show: Any, warn: Any
) -> "LoadPath":
    """Return the path from the equilibrium without the load; raises ConvergenceError if there is none."""
    from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
    from tensegrity_codegen.runtime.paths.ground_path import follow_ground_path
    from tensegrity_codegen.runtime.paths.ramp import find_pushed_start
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    if path.model.manifest.contact_name:
        return follow_ground_path(path, most=most, largest_step=step)
    arguments = {name: value for name, value in path.arguments.items() if name != "velocity"}
    equilibrium = find_equilibrium(path.model, arguments={**arguments, **path.loads(0.0)})
    for warning in equilibrium.warnings:
        warn(f"before loading: {warning}")
    start = equilibrium.coordinate
    control = StepControl(largest=step, most_steps=max(1000, round(100 / step)))

    def follow(begin: "NDArray[np.float64]", least: float) -> "LoadPath":
        return follow_path(
            path,
            begin,
            least=least,
            most=most,
            watches=watches,
            neutral=path.neutral_motions(),
            control=control,
            floor=floor if floor or not least else least,
            progress=lambda points, factor: show(min(max(factor / most, 0.0), 1.0)),
        )

    followed = follow(start, 0.0)
    if followed.status != "no_start" and not (
        followed.status == "stalled" and len(followed.load_factor) == 1
    ):
        return followed
    # Without stiffness at zero load, as of a line that sags, the path begins at a small part of it.
    pushed = find_pushed_start(path, start, most)
    return followed if pushed is None else follow(*pushed)


def _advise(path: "LoadPath") -> str | None:
    """Return a hint if the contact of bars has ended the path, else None."""
    if path.status != "stopped" or not path.find_events("contact"):
        return None
    touching = path.find_events("contact")[-1].names
    if len(path.load_factor) > 1:
        return "use --past-contact to continue the path; these bars then pass through each other"
    return (
        f"the bars of {', '.join(touching)} touch or cross at the start of the path, so it ends there; "
        "use --past-contact to continue, or remove the radius of bars whose contact does not matter"
    )


def _summary(path: "LoadPath", digits: int) -> str:
    if not len(path.load_factor):
        return "no point of the path was found"
    largest, end = (f"{load:.{digits}g}" for load in (path.load_factor.max(), path.load_factor[-1]))
    return (
        f"{len(path.load_factor)} points; largest load factor {largest}, at the end {end}; "
        f"smallest eigenvalue at the end {path.smallest_eigenvalue[-1]:.6g}; "
        f"largest residual {path.residual.max():.3g} N"
    )


ANALYSIS = FollowLoadPath
