"""Equilibria on the ground: the structure is let down until it touches, then its weights and loads grow.

Without friction there is an energy, whose minimum is sought as that of any structure. With friction the
result depends on the way: bristles start at zero if a foot first touches. In steps of the load, each from
the one before, Newton's method solves the balance of forces with friction limited to mu N; the number of
steps is doubled until the result is settled.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.runtime.contacts.contacts import Contacts
from tensegrity_codegen.runtime.contacts.judge_stand import judge_stand
from tensegrity_codegen.runtime.contacts.roll_onto_feet import roll_onto_feet
from tensegrity_codegen.runtime.statics.newton import (
    Outcome,
    find_idle_motions,
    find_minimum,
    find_stability,
)
from tensegrity_codegen.runtime.statics.static_problem import Point, StaticProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.static_methods import FOUND

FIRST_STEPS, MAX_STEPS = 4, 64  # of the load
SETTLED = 1e-9  # of the structure's size: change with twice the steps up to which a result is settled
MIN_PART = 1 / 8  # of a step of the load, to which it is cut where no balance is found
UNBALANCED = 1e-9  # of all loads: what they may add up to along the ground without friction
MAX_NEWTON = 30  # iterations of Newton's method in a step of the load
MAX_UPDATES = 3  # of the limits of friction
MAX_HALVINGS = 12  # of one step of Newton's method
LIFT = 10.0  # times the structure's size: height at which it settles before it touches
FARTHEST = 10.0  # times the structure's size: way in a step of the load, beyond which a structure slides away
OUT_OF_ITERATIONS = ("iteration_limit", "work_limit")
MAX_TILT = float(np.radians(15.0))  # turn about an axis along the plane, beyond which a structure has tipped

Search = Callable[[Point], Outcome]


@dataclass(frozen=True)
class Feet:
    """The contacts of an equilibrium with the ground."""

    node_name: tuple[str, ...]  # nodes that can touch the ground
    state: tuple[str, ...]  # "open", "stick" or "slip" of each; without friction "slide"
    force: FloatArray  # (n_contacts, 3) [N], of the ground on each
    penetration: FloatArray  # (n_contacts,) [m], depth of each below the plane
    internal: FloatArray  # (n_internal,) [m], bristles, for the argument `internal` of `simulate`
    load_steps: int = 0  # in which the loads grew; 0 without friction
    change: float = 0.0  # [m], largest change of a node's position from half of these steps

    @property
    def slipping(self) -> tuple[str, ...]:
        """Nodes at the limit of friction."""
        return tuple(name for name, state in zip(self.node_name, self.state, strict=True) if state == "slip")

    def as_evidence(self) -> dict[str, Any]:
        """Return state, force and penetration by node, and the steps of the load, JSON-ready."""
        values = zip(self.state, self.force.tolist(), self.penetration.tolist(), strict=True)
        keys = ("state", "force", "penetration")
        feet = {
            name: dict(zip(keys, row, strict=True)) for name, row in zip(self.node_name, values, strict=True)
        }
        return {"feet": feet, "load_steps": self.load_steps, "load_step_change": self.change}


def find_on_ground(
    problem: StaticProblem, start: FloatArray, search: Search, *, tolerance: float
) -> tuple[Point, Outcome]:
    """Return where a structure touches the ground, and its equilibrium from there; contacts are kept."""
    contacts = problem.ground_contacts
    held = _is_held(problem, contacts.ground.normal)
    if contacts.friction and contacts.slide is not None and _is_held(problem, contacts.ground.velocity):
        contacts.dragged = contacts.slide
    touching = start if held else _let_down(problem, start, settle=contacts.friction, tolerance=tolerance)
    hopeless = None if held else _find_unheld(problem, contacts, touching)
    if hopeless is not None:
        return hopeless.point, hopeless
    placed = _roll(problem, touching) if contacts.friction else touching
    loading = _Loading(problem, placed, search, held=held, tolerance=tolerance)
    outcome = loading.refine() if contacts.friction else loading.find_frictionless()
    return _find_point(problem, touching), outcome if held else _judge(problem, touching, outcome)


def _judge(problem: StaticProblem, begun: FloatArray, outcome: Outcome) -> Outcome:
    """Return the outcome with the reason for which a free structure does not stand where it began."""
    contacts = problem.ground_contacts
    before, after = problem.node_position(begun), problem.node_position(outcome.point.coordinate)
    structure, mu = contacts.structure, contacts.ground.friction if contacts.friction else 0.0
    tilt = find_tilt(before, after, contacts.ground.normal)
    if tilt > MAX_TILT:
        touching = zip(structure.contact_name, contacts.depth(after), strict=True)
        feet = ", ".join(name for name, depth in touching if depth > 0)
        onto = f" onto {feet}" if outcome.status in FOUND and feet else ""
        message = f"tips over: it turns by {np.degrees(tilt):.3g} degrees{onto} before it rests"
        return replace(outcome, status="tips", message=message)
    if outcome.status in FOUND:
        if contacts.friction and contacts.slide is not None and not outcome.message:
            return replace(outcome, message="at rest on the belt, which carries it along")
        return outcome
    if outcome.status in OUT_OF_ITERATIONS or not _stands_alone(contacts):
        return outcome  # where a search has come to says nothing of where it would end
    pressed = contacts.forces(after)
    for position, force in ((after, pressed if pressed.any() else None), (before, None)):
        verdict = judge_stand(structure, position, contacts.external, force=force, friction=mu)
        if verdict.verdict in ("slides", "tips", "lifts_off", "one_foot", "on_a_line"):
            status = verdict.verdict if verdict.verdict in ("slides", "lifts_off") else "tips"
            slip = ", ".join(verdict.foot)
            feet = f" (feet {slip} slip)" if status == "slides" else ""
            message = verdict.message.removeprefix("slides: ").removeprefix("tips ")
            return replace(outcome, status=status, message=message + feet)
    return outcome


def continue_on_ground(
    problem: StaticProblem, start: FloatArray, search: Search | None, *, tolerance: float
) -> Outcome:
    """Return the next equilibrium, its contacts going on; search: None for Newton's method alone."""
    held = _is_held(problem, problem.ground_contacts.ground.normal)
    outcome = _Loading(problem, start, search, held=held, tolerance=tolerance).take_step()
    return outcome if held else _judge(problem, start, outcome)


def step_on_ground(
    problem: StaticProblem,
    coordinate: FloatArray,
    position: FloatArray,
    feet: Feet,
    *,
    tolerance: float,
    max_iterations: int,
) -> Outcome:
    """Return the next equilibrium after that of `feet`; max_iterations: of searches for a minimum, or 0."""
    contacts = problem.ground_contacts
    contacts.begin(position, feet.internal if contacts.friction else None)
    start = problem.to_search_coordinate(coordinate)
    problem.watch_stiff_members(start)

    def search(point: Point) -> Outcome:
        return find_minimum(problem, point, tolerance=tolerance, max_iterations=max_iterations)

    return continue_on_ground(problem, start, search if max_iterations else None, tolerance=tolerance)


def describe_feet(problem: StaticProblem, coordinate: FloatArray) -> Feet:
    """Return the contacts at an equilibrium; contacts and bristles are those of `problem.contacts`."""
    contacts = problem.ground_contacts
    position = problem.node_position(coordinate)
    depth = contacts.depth(position)
    slips = np.zeros(len(depth), dtype=bool)
    if contacts.friction and contacts.start is not None:
        slips = contacts.bristles(position)[1]
    states_when_closed = np.where(slips, "slip", "stick" if contacts.friction else "slide")
    state = contacts.state(position).get("internal", np.zeros(0))
    return Feet(
        node_name=contacts.structure.contact_name,
        state=tuple(np.where(depth > 0, states_when_closed, "open").tolist()),
        force=contacts.forces(position),
        penetration=depth,
        internal=state,
        load_steps=contacts.load_steps,
        change=contacts.change,
    )


def find_tilt(before: FloatArray, after: FloatArray, normal: FloatArray) -> float:
    """Return the angle by which the nodes (n, 3) have turned out of the plane [rad], by their best fit."""
    covariance = (before - before.mean(axis=0)).T @ (after - after.mean(axis=0))
    u, _, vt = np.linalg.svd(covariance)
    turn = vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    return float(np.arccos(np.clip(normal @ turn @ normal, -1.0, 1.0)))


def _find_unheld(problem: StaticProblem, contacts: Contacts, touching: FloatArray) -> Outcome | None:
    """Return the outcome of loads that lift a structure, or that nothing balances along the ground."""
    total, normal = contacts.external.sum(axis=0), contacts.ground.normal
    along = total - (total @ normal) * normal
    size = float(np.linalg.norm(along))
    if total @ normal >= 0.0:
        reason = "lifts_off", "no weight or load presses it onto the ground"
    elif not contacts.friction and size > UNBALANCED * np.linalg.norm(total) and not _is_held(problem, along):
        reason = "slides", f"without friction nothing balances {size:.6g} N along the ground"
    else:
        return None
    return Outcome(reason[0], _find_point(problem, touching), 0, reason[1])


def _is_held(problem: StaticProblem, direction: FloatArray) -> bool:
    """Return whether an anchor holds a node along a direction (3,)."""
    axes = np.flatnonzero(np.abs(direction) > 1e-12 * np.linalg.norm(direction))
    manifest = problem.model.manifest
    count = len(manifest.node_name) - len(manifest.body_points)
    return bool(min(np.sum(problem.axis == axis) for axis in axes) < count)


def _stands_alone(contacts: Contacts) -> bool:
    """Return whether no anchor holds a node along any axis."""
    structure = contacts.structure
    return not structure.node_anchored[:, list(structure.axes)].any()


def _find_point(problem: StaticProblem, coordinate: FloatArray) -> Point:
    point = problem.find_point(coordinate)
    assert point is not None
    return point


def _let_down(problem: StaticProblem, start: FloatArray, *, settle: bool, tolerance: float) -> FloatArray:
    """Return coordinates at which the structure just touches, in the shape that its prestress gives it."""
    contacts = problem.ground_contacts
    up = contacts.ground.normal[problem.axis]
    position = problem.node_position(start)
    if settle:
        height = LIFT * float(np.ptp(position, axis=0).max()) + float(contacts.depth(position).max())
        lifted = start + up * height
        contacts.load_factor = 0.0
        problem.forget()
        outcome = find_minimum(problem, _find_point(problem, lifted), tolerance=tolerance, max_iterations=500)
        if outcome.status in FOUND:
            start = outcome.point.coordinate
        contacts.load_factor = 1.0
        problem.forget()
    deepest = float(contacts.depth(problem.node_position(start)).max())
    return np.asarray(start + up * deepest)


def _roll(problem: StaticProblem, touching: FloatArray) -> FloatArray:
    """Return coordinates turned as a rigid whole onto its feet; as they were if it is held, or turns far."""
    contacts = problem.ground_contacts
    if not _stands_alone(contacts):
        return touching
    before = problem.node_position(touching)
    after = roll_onto_feet(contacts.ground, before, contacts.external)
    if find_tilt(before, after, contacts.ground.normal) > MAX_TILT:
        return touching
    return np.asarray(touching + (after - before)[problem.node, problem.axis])


def _press_in(problem: StaticProblem, touching: FloatArray, held: bool) -> FloatArray:
    """Return coordinates with the depth at which one foot of those that touch carries a third of it all."""
    contacts = problem.ground_contacts
    if held:
        return touching
    press = -contacts.load_factor * float(contacts.external.sum(axis=0) @ contacts.ground.normal)
    depth = (press / 3 / contacts.ground.stiffness) ** (1 / contacts.ground.exponent)
    return np.asarray(touching - depth * contacts.ground.normal[problem.axis])


class _Loading:
    """The growth of weights and loads from zero, with friction."""

    def __init__(
        self,
        problem: StaticProblem,
        touching: FloatArray,
        search: Search | None,
        *,
        held: bool,
        tolerance: float,
    ) -> None:
        self.problem, self.contacts, self.search = problem, problem.ground_contacts, search
        self.touching, self.held = touching, held
        self.tolerance = tolerance
        self.size = float(np.ptp(problem.node_position(touching), axis=0).max())
        self.iterations = 0
        self.status, self.message = "no_equilibrium", ""
        self.ran_out: Outcome | None = None  # the last search that ended at a limit of its iterations
        self.slips = np.zeros(self.contacts.ground.n_contacts, dtype=bool)
        self.has_slipped = False  # any foot, on any way

    def refine(self) -> Outcome:
        """Return the equilibrium with so many steps of the load that twice as many do not change it."""
        coarser: Point | None = None
        count = FIRST_STEPS
        while True:
            equilibrium = self._grow(count)
            if equilibrium is None:
                return self._fail()
            self.contacts.load_steps = count
            if coarser is not None:
                moved = equilibrium.coordinate - coarser.coordinate
                self.contacts.change = self.problem.largest_node_norm(moved)
                if self.contacts.change <= SETTLED * self.size or count >= MAX_STEPS:
                    break
            coarser, count = equilibrium, 2 * count
        message = ""
        if self.contacts.change > SETTLED * self.size:
            cause = "feet slip on the way" if self.has_slipped else "no foot slips"
            message = (
                f"{cause}, and the forces of feet depend on the steps of the load: nodes moved by "
                f"{self.contacts.change:.2g} m as these were doubled to {count}"
            )
        return self._conclude(equilibrium, message)

    def find_frictionless(self) -> Outcome:
        """Return the minimum of the energy without friction, its forces balanced to rounding."""
        assert self.search is not None
        outcome = self.search(_find_point(self.problem, _press_in(self.problem, self.touching, self.held)))
        if outcome.status != "converged":
            return outcome
        polished = self._solve(outcome.point.coordinate)
        return outcome if polished is None else replace(outcome, point=polished, stability=None)

    def take_step(self) -> Outcome:
        """Return the equilibrium under the whole load, in one step from where the contacts are."""
        self.last = _find_point(self.problem, self.touching)
        equilibrium = self._balance(self.touching)
        if equilibrium is None:
            self._explain(None, 1.0)
            return self._fail()
        return self._conclude(equilibrium, "")

    def _fail(self) -> Outcome:
        """Return the outcome of a way that ended early: for a reason, or since a search ran out of steps."""
        if self.ran_out and self.status != "tips":
            return Outcome(self.ran_out.status, self.last, self.iterations, self.ran_out.message)
        return Outcome(self.status, self.last, self.iterations, self.message)

    def _conclude(self, equilibrium: Point, message: str) -> Outcome:
        stability = find_stability(self.problem, equilibrium)
        if stability.is_unstable:
            message = "an unstable equilibrium (a saddle of the energy)"
            return Outcome("unstable", equilibrium, self.iterations, message, stability=stability)
        floor = self.problem.rounding_floor(self.problem.stiffness(equilibrium.coordinate), equilibrium)
        if not equilibrium.is_balanced(self.tolerance, floor):
            reason = "rounding error keeps the residual above the tolerance"
            message = "; ".join(filter(None, (reason, message)))
            return Outcome("rounding_limited", equilibrium, self.iterations, message, stability=stability)
        return Outcome("converged", equilibrium, self.iterations, message, stability=stability)

    def _grow(self, count: int) -> Point | None:
        """Return the equilibrium under the whole load after `count` steps, None if the way ends."""
        problem, contacts = self.problem, self.contacts
        contacts.begin(problem.node_position(self.touching))
        self.last = _find_point(problem, self.touching)
        reached, step, here = 0.0, 1.0 / count, self.touching
        while reached < 1.0:
            contacts.load_factor = min(1.0, reached + step)
            problem.forget()
            start = here if reached else _press_in(problem, here, self.held)
            equilibrium = self._balance(start)
            if equilibrium is None and not self.is_hopeless and (step := step / 2) >= MIN_PART / count:
                continue
            if equilibrium is None or not self._is_upright(equilibrium):
                self._explain(equilibrium, reached)
                return None
            self.last, here, reached = equilibrium, equilibrium.coordinate, contacts.load_factor
            position = problem.node_position(here)
            bristle, slips = contacts.bristles(position)
            self.has_slipped |= bool(slips.any())
            if reached < 1.0:
                contacts.begin(position, bristle)
                step = 1.0 / count
        return self.last

    @cached_property
    def is_hopeless(self) -> bool:
        """Whether it cannot stand as a rigid whole where it touches: shorter steps do not help."""
        if not _stands_alone(self.contacts):
            return False
        position = self.problem.node_position(self.touching)
        stand = judge_stand(self.contacts.structure, position, self.contacts.external)
        return stand.verdict in ("tips", "slides")

    def _is_upright(self, point: Point) -> bool:
        if self.held:
            return True
        before, after = (self.problem.node_position(q) for q in (self.touching, point.coordinate))
        return find_tilt(before, after, self.contacts.ground.normal) <= MAX_TILT

    def _explain(self, equilibrium: Point | None, reached: float) -> None:
        """Take the reason for which the way ends: it has tipped, or no balance was found."""
        slips = ", ".join(
            name
            for name, slips in zip(self.contacts.structure.contact_name, self.slips, strict=True)
            if slips
        )
        feet = f": feet {slips} slip" if slips else ""
        self.status = "tips" if equilibrium is not None else "slides" if slips else "no_equilibrium"
        event = "it turns over" if equilibrium is not None else "no balance of forces"
        self.message = f"{event} beyond {reached:.3g} of weights and loads{feet}"
        self.contacts.load_factor = 1.0
        self.problem.forget()

    def _balance(self, start: FloatArray) -> Point | None:
        """Return the equilibrium with limited friction near `start`, from one with friction that holds."""
        equilibrium = self._solve(start)
        if equilibrium is None and self.search is not None:
            self.contacts.limited = self.contacts.dragged is not None
            self.problem.forget()
            stuck = self.search(_find_point(self.problem, start))
            self.iterations += stuck.iterations
            self.ran_out = stuck if stuck.status in OUT_OF_ITERATIONS else self.ran_out
            self.problem.forget()
            if self._is_upright(stuck.point):
                slid = self._slide(stuck.point.coordinate, self.search)
                equilibrium = (
                    self._solve(slid) if np.abs(slid - start).max() <= FARTHEST * self.size else None
                )
            if equilibrium is None:
                self.slips = self.contacts.bristles(self.problem.node_position(stuck.point.coordinate))[1]
        return equilibrium

    def _slide(self, coordinate: FloatArray, search: Search) -> FloatArray:
        """Return where feet slide with constant limits of friction, an energy, updated a few times."""
        contacts = self.contacts
        contacts.limited = True
        for _ in range(MAX_UPDATES if contacts.dragged is None and contacts.friction else 0):
            contacts.limit = None
            contacts.limit = contacts.find_limit(self.problem.node_position(coordinate))
            self.problem.forget()
            slid = search(_find_point(self.problem, coordinate))
            self.iterations += slid.iterations
            if slid.status not in FOUND or not self._is_upright(slid.point):
                break
            coordinate = slid.point.coordinate
        contacts.limit = None
        self.problem.forget()
        return coordinate

    def _solve(self, coordinate: FloatArray) -> Point | None:
        """Return the balance of forces that Newton's method finds, None if it finds none."""
        self.contacts.limited = True
        problem = self.problem
        point = problem.find_point(coordinate)
        for _ in range(MAX_NEWTON):
            if point is None:
                return None
            self.iterations += 1
            self.contacts.exact = True
            stiffness = problem.stiffness(point.coordinate)
            self.contacts.exact = False
            floor = problem.rounding_floor(stiffness, point)
            balanced = point.is_balanced(self.tolerance, floor)
            force = problem.directional_residual(point)
            matrix = scipy.sparse.csc_array(stiffness)
            if not self.contacts.friction:  # motions along the plane are free
                neutral = scipy.sparse.csc_array(find_idle_motions(problem, point, stiffness)[0])
                matrix = matrix + float(abs(matrix).max()) * (neutral @ neutral.T)
            try:
                step = scipy.sparse.linalg.splu(matrix).solve(force)
            except RuntimeError:  # singular
                return point if balanced else None
            better = self._shorten(point, step, force)
            if better is None:  # rounding may leave more than the tolerance
                return point if balanced or point.node_force <= floor else None
            if np.abs(better.coordinate - coordinate).max() > self.size:
                return None
            if balanced and better.node_force > point.node_force / 2:
                return point
            point = better
        return None

    def _shorten(self, point: Point, step: FloatArray, force: FloatArray) -> Point | None:
        """Return the configuration along a step where the forces are closer to balance."""
        before = float(np.linalg.norm(force))
        if not np.isfinite(step).all():
            return None
        for k in range(MAX_HALVINGS):
            trial = self.problem.find_displaced_point(point.coordinate, step / 2**k)
            if trial is None:
                continue
            after = float(np.linalg.norm(self.problem.directional_residual(trial)))
            if after < (1 - 1e-4 / 2**k) * before:
                return trial
        return None
