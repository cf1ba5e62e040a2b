"""Gaits of structures that roll: rolls for each kind of edge, chosen by the facet that is down."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.sweeps.fitting.keyed_scene import require_nodes
from tensegrity_codegen.sweeps.gaits.rolls import (
    KNOTS,
    SAMPLES,
    Facet,
    Facets,
    RollLoss,
    SceneLike,
    Step,
    Winches,
    find_roll,
)
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_whole
from tensegrity_codegen.system.errors import ConvergenceError, FormulationError, InvalidValueError
from tensegrity_codegen.system.summaries import Summarised

MORE = 0.15  # by which a roll that did not come about is larger the next time
MOST_TRIES = 5  # of one roll
AHEAD = 1.5  # steps along the line at which the next facet is chosen
ALLOWED = "two numbers that are not both 0"  # as a direction
LENGTH_PART = 0.5  # of its rest length by which a winch without a range changes it, at most


@dataclass(frozen=True, repr=False)
class Walk(Summarised):
    """Rolls from facet to facet, one after the other.

    Attributes
    ----------
    status, message : str
        ``"ok"``; ``"lost"``: one roll did not come about five times, or a motion failed.
    cost_of_transport, net_cost_of_transport : float
        Work of winches that pull, over the weight and the length of the way; less what those take that are
        pulled.
    way : ndarray, shape (2,) [m]
        From the start to the end of the centre of mass, seen from above.
    facet : tuple of tuple of str
        Nodes of the facets that the structure stood on, with the first one.
    motions : tuple of Trajectory
        A rest of 1 s, then one for each roll or rest where other nodes were lowest, with times from 0 on.
    schedule : Profile
        Inputs over time, of all of them one after the other.
    """

    status: str
    message: str
    cost_of_transport: float
    net_cost_of_transport: float
    way: FloatArray
    facet: tuple[tuple[str, ...], ...]
    motions: tuple[Trajectory, ...]
    schedule: Profile


@dataclass(frozen=True, repr=False)
class Gait(Summarised):
    """Rolls over every kind of edge of a structure.

    Attributes
    ----------
    model : CompiledModel
        The model without errors.
    rolls : mapping of (facet, facet) to ndarray, shape (n_winches, n_knots) [m]
        Changes of rest lengths over time; by the nodes of the facets from and to which they roll.
    failed : tuple of (facet, facet)
        Steps for which no roll was found.
    winches, facets
        What is wound, and what the structure stands on.
    """

    model: CompiledModel
    rolls: Mapping[Step, FloatArray]
    failed: tuple[Step, ...]
    winches: Winches
    facets: Facets

    def find(self, step: Step) -> FloatArray | None:
        """Return the changes of rest lengths (n_winches, n_knots) [m] of a step, by symmetry; None: none."""
        for known_step, values in self.rolls.items():
            row = self.facets.find_symmetry(known_step, step)
            if row is not None:
                member_map = self.facets.map_members(row)
                order = [self.winches.member.index(member_map[member]) for member in self.winches.member]
                return values[np.argsort(order)]
        return None

    def walk(
        self,
        n_facets: int,
        direction: ArrayLike = (1.0, 0.0),
        *,
        arguments: Mapping[str, Any] | None = None,
        coordinate: ArrayLike | None = None,
    ) -> Walk:
        """Roll over facets along a line, and choose each roll by the facet that is down.

        Parameters
        ----------
        n_facets : int
            Number of facets to reach.
        direction : array_like, shape (2,)
            Direction of the line through the start, along x and y.
        arguments : mapping, optional
            Run-time parameters where they differ from the scene: friction and stiffnesses that the rolls were
            not made for.
        coordinate : array_like, shape (n_coordinates,), optional
            Another start [m].

        Returns
        -------
        Walk
            The rolls, with their cost of transport.

        Raises
        ------
        InvalidValueError
            A direction without length, fewer than one facet, or as `simulate`.

        Notes
        -----
        Of the facets beyond the edges, but not the one before, the one is chosen that brings the centre of
        mass nearest to a point of the line one and a half steps ahead. A roll that ends where it began is
        repeated with changes of lengths that are larger by 15 % each time, within the ranges of winches.
        """
        check_whole(n_facets, "n_facets", 1)
        heading = np.array(to_doubles(direction, "direction", ALLOWED))
        if heading.shape != (2,) or not np.isfinite(heading).all() or not heading.any():
            raise InvalidValueError("not a direction", where="direction", given=direction, allowed=ALLOWED)
        run = _Run(self, arguments or {}, coordinate)
        while len(run.facet) <= n_facets and run.tries < MOST_TRIES and run.motions[-1].status == "ok":
            run.roll(heading / np.linalg.norm(heading))
        return run.finish(n_facets)


class _Run:
    """A walk on its way: rests for a second, then moves as it is told."""

    def __init__(self, gait: Gait, arguments: Mapping[str, Any], coordinate: ArrayLike | None) -> None:
        self.gait, self.arguments = gait, dict(arguments)
        self.motions: list[Trajectory] = []
        self.schedules: list[Profile] = []
        self.facet: list[Facet] = []
        self.work, self.tries = np.zeros(2), 0
        at_rest = {
            "coordinate": coordinate,
            "velocity": None if coordinate is None else np.zeros(np.shape(coordinate)),
        }
        self.move(None, at_rest)
        self.start = gait.winches.find_centre(self.motions[0])[-1]

    def move(self, values: FloatArray | None, start: Mapping[str, Any] | None = None) -> None:
        """Change rest lengths over time by values (n_winches, n_knots) [m], None for a rest, and look."""
        winches = self.gait.winches
        rows = np.zeros((len(winches.name), 2)) if values is None else values
        bound = np.clip(rows, winches.low[:, None], winches.high[:, None])
        times = np.array([0.0, 1.0]) if values is None else KNOTS
        schedule = Profile(times, dict(zip(winches.name, bound, strict=True)))
        if start is None:
            previous = self.motions[-1]
            start = {"coordinate": previous.coordinate[-1], "velocity": previous.velocity[-1]}
            if previous.internal is not None:
                self.arguments["internal"] = previous.internal[-1]
        options = {"arguments": self.arguments, "schedule": schedule, **start}
        motion = simulate(self.gait.model, times[-1], samples=SAMPLES, **options)
        work = winches.find_work(motion, schedule)
        self.work += work[work > 0.0].sum(), work.sum()
        self.motions.append(motion)
        self.schedules.append(schedule)
        facet = self.gait.facets.find_standing(motion.node_position[-1])
        if facet is not None and facet not in self.facet[-1:]:
            self.facet.append(facet)
            self.tries = 0
        else:
            self.tries += 1

    def roll(self, heading: FloatArray) -> None:
        """Roll over the edge that leads along a line (2,) through the start; rest where no facet is down."""
        gait, position = self.gait, self.motions[-1].node_position[-1]
        facet = gait.facets.find_standing(position)
        steps = [] if facet is None else [(facet, target) for target in gait.facets.list_next(facet)]
        rolls = [(step, values) for step in steps if (values := gait.find(step)) is not None]
        if not rolls:
            self.move(None)
            return
        rolls = [pair for pair in rolls if pair[0][1] not in self.facet[-2:-1]] or rolls  # back at last
        mass_fraction = gait.winches.share
        centre = (mass_fraction @ position)[:2]
        ends = np.array([(mass_fraction @ gait.facets.turn_over(position, step))[:2] for step, _ in rolls])
        length = float(np.linalg.norm(ends - centre, axis=1).mean())
        goal = self.start + ((centre - self.start) @ heading + AHEAD * length) * heading
        nearest = int(np.linalg.norm(ends - goal, axis=1).argmin())
        self.move(rolls[nearest][1] * (1.0 + MORE * self.tries))

    def finish(self, n_facets: int) -> Walk:
        """Return the walk."""
        winches, latest = self.gait.winches, self.motions[-1]
        way, names = winches.find_centre(latest)[-1] - self.start, self.gait.model.manifest.node_name
        done = len(self.facet) - 1
        summary = f"{done} of {n_facets} facets in {len(self.motions) - 1} rolls"
        time, values = self.schedules[0].time, dict(self.schedules[0].values)
        for schedule in self.schedules[1:]:  # each begins with the values with which the last one ends
            time = np.append(time, time[-1] + schedule.time[1:])
            values = {name: np.append(row, schedule.values[name][1:]) for name, row in values.items()}
        cost = self.work / (winches.weight * max(float(np.linalg.norm(way)), 1e-300))
        return Walk(
            status="ok" if done >= n_facets else "lost",
            message=summary if latest.status == "ok" else f"{summary}; {latest.message}",
            cost_of_transport=float(cost[0]),
            net_cost_of_transport=float(cost[1]),
            way=way,
            facet=tuple(tuple(names[k] for k in facet) for facet in self.facet),
            motions=tuple(self.motions),
            schedule=Profile(time, values),
        )


def design_gait(scene: SceneLike, *, max_iterations: int = 100) -> Gait:
    """Find rolls over every kind of edge of a structure that stands on a facet, by gradients of its motions.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`: a structure at rest on a horizontal ground. Inputs of rest lengths with one
        member each are winches; ranges of actuators bound them.
    max_iterations : int
        Largest number of iterations for a roll, with and without its cost.

    Returns
    -------
    Gait
        The rolls, of which symmetry makes those over all edges.

    Raises
    ------
    FormulationError
        Bodies, a structure without a horizontal ground or without winches.
    InvalidValueError
        The structure does not stand on three nodes that are a facet of its convex hull, or a winch starts
        outside of its range.
    ConvergenceError
        No roll was found.

    Notes
    -----
    A roll lasts 2 s: all winches have lengths of their own at 0.25, 0.5, 0.75 and 1 s, and are back at 1.4 s.
    The loss is the distance of the centre of mass from where a rigid roll would end, and the work of winches
    that pull, over weight and way; its gradient goes back through contacts, slips and slack cables.

    Examples
    --------
    >>> from tensegrity_codegen import design_gait
    >>> gait = design_gait("icosahedron_gait.toml")  # doctest: +SKIP
    >>> gait.walk(10, arguments={"ground": [0.35]}).status  # doctest: +SKIP
    'ok'
    """
    structure = require_nodes(load_scene(scene)[0], "scene")
    winches = _find_winches(structure)
    model = compile_scene(scene, for_="simulate")
    gait = Gait(model, {}, (), winches, Facets(structure, winches.member))
    waiting = [_Run(gait, {}, None)]
    if not waiting[0].facet:
        raise InvalidValueError(
            "the structure does not stand on a facet",
            where=structure.name,
            given="after 1 s other nodes are lowest than three of a facet of its convex hull",
            allowed="a structure that stands on a triangle",
            hint="put a facet down: on_facet of [shape]; or write how it comes to rest: tensegrity-codegen "
            "simulate SCENE --t-end 5 --scene-out NEW.toml",
        )
    # Rolls that are found lead to facets that have not been met, until every kind of edge has been
    rolls: dict[Step, FloatArray] = {}
    failed: list[Step] = []
    while waiting:
        run = waiting.pop(0)
        motion = run.motions[-1]
        for step in ((run.facet[-1], target) for target in gait.facets.list_next(run.facet[-1])):
            if any(gait.facets.find_symmetry(old, step) is not None for old in (*rolls, *failed)):
                continue
            goal = (winches.share @ gait.facets.turn_over(motion.node_position[-1], step))[:2]
            start = {"coordinate": motion.coordinate[-1], "velocity": np.zeros_like(motion.velocity[-1])}
            loss = RollLoss(scene, winches, goal, start)
            values = find_roll(loss, max_iterations)
            ahead = _Run(gait, {}, motion.coordinate[-1])
            ahead.move(values)
            ahead.move(None)
            if ahead.facet[-1:] == [step[1]]:
                rolls[step] = values
                waiting.append(ahead)
            else:
                failed.append(step)
    if not rolls:
        hint = "give winches more range, or allow more iterations"
        raise ConvergenceError("no roll over an edge was found", where=structure.name, hint=hint)
    return replace(gait, rolls=rolls, failed=tuple(failed))


def _find_winches(structure: Structure) -> Winches:
    """Return the winches of a structure on a horizontal ground; raises what design_gait raises."""
    ground, inputs = structure.ground, [source for source in structure.inputs if source.kind == "rest_length"]
    inputs = [source for source in inputs if len(source.targets) == 1 and source.gain in ((), (1.0,))]
    inputs = list({source.targets[0]: source for source in inputs}.values())  # one a member
    is_free = len(structure.axes) == 3 and not structure.node_anchored.any()
    if ground is None or ground.normal[2] != 1.0 or not is_free or not inputs:
        has = "no ground" if ground is None else f"a ground with the normal {ground.normal.tolist()}"
        problem = "only structures that winches move freely on a horizontal ground roll"
        value = f"{len(inputs)} winches, {has}, {'no ' if is_free else 'a planar scene or '}anchors"
        allowed = "[ground] with the normal z, no anchors, and inputs of rest lengths with one member each"
        hint = "write an [[actuators]] for each cable"
        raise FormulationError(problem, where=structure.name, given=value, allowed=allowed, hint=hint)
    member = [source.targets[0] for source in inputs]
    rest_length = structure.rest_length[member]
    low, high = -LENGTH_PART * rest_length, LENGTH_PART * rest_length
    ranges = {source.name: source.range for source in structure.actuators}
    for k, source in enumerate(inputs):
        lower, upper = ranges.get(source.name, (0.0, np.inf))
        low[k], high[k] = max(low[k], lower - rest_length[k]), min(high[k], upper - rest_length[k])
        if not low[k] <= 0.0 <= high[k]:
            problem = "a winch starts outside of its range"
            location = f"{structure.name}: actuators.{source.name}.range"
            value = f"the rest length of {structure.member_name[member[k]]}, {rest_length[k]:.6g} m"
            allowed = f"{lower:.6g} to {upper:.6g} m, the range of the winch"
            hint = "a range with the rest length, or another rest length"
            raise InvalidValueError(problem, where=location, given=value, allowed=allowed, hint=hint)
    mass = structure.lumped_mass
    weight = float(mass.sum() * np.linalg.norm(structure.gravity))
    return Winches(tuple(source.name for source in inputs), member, low, high, mass / mass.sum(), weight)
