"""Standing of a model in a shape, and how far cables must be shortened until it tips."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.contacts.contacts import compute_external_force
from tensegrity_codegen.runtime.contacts.judge_stand import Stand, find_support_margin, judge_stand
from tensegrity_codegen.runtime.model.arguments import apply_ground, check_arguments, merge_inputs
from tensegrity_codegen.runtime.model.arrays import check_finite, check_shape, to_doubles
from tensegrity_codegen.runtime.model.interface import Model, require_model
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.statics.equilibrium import build_problem, find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.newton import Outcome
from tensegrity_codegen.runtime.statics.on_ground import Feet, describe_feet, step_on_ground
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.structure.contact_estimates import require_ground
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_switch
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.tables.static_methods import FOUND

TIGHT = 1e-12  # tolerance of equilibria near a tipping point
FIRST_STEP, MAX_STEP, MAX_SHORTENING = 0.05, 0.1, 0.99  # of the rest length
NEAR_ROOT = 0.9  # part of the way to a root that a step goes, so that it stays on the side that stands
ROOT = 1e-7  # of the rest length: distance from the root from which the rest of the way is a line
MAX_JUMP = 0.2  # of the structure's size: motion of a node in a step that counts as a jump
MAX_ITERATIONS = 60  # from one equilibrium to the next

Progress = Callable[[int, float], None]


def stand(
    model: Model,
    shape: Equilibrium | ArrayLike | None = None,
    *,
    arguments: Mapping[str, Any] | None = None,
    frictionless: bool = False,
) -> Stand:
    """Find out whether the ground can hold a structure in a shape, as a rigid whole.

    Parameters
    ----------
    model : CompiledModel
        Of a structure on the ground without anchors; any quantities.
    shape : Equilibrium or array_like, shape (n_coordinates,), optional
        An equilibrium, whose contacts that press are the feet; or coordinates [m], by default those of the
        scene, whose contacts up to 1e-6 of its size above the lowest one are the feet.
    arguments : mapping, optional
        Inputs and parameters by name, where they differ from the scene.
    frictionless : bool
        Without friction, whatever its coefficient.

    Returns
    -------
    Stand
        Verdict, forces of the feet, tipping margin, friction needed, and a proof.

    Raises
    ------
    FormulationError
        The scene has no ground, or anchors.
    InvalidValueError, NonFiniteError
        A wrong argument.

    Notes
    -----
    Friction cones are approximated by planes until the gap is below 1e-9 of the loads (docs/ground.md).

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, find_equilibrium, stand
    >>> place = {"left": [0, 0], "right": [1, 0], "top": [0.5, 1]}
    >>> pairs = {"base": ["left", "right"], "west": ["left", "top"], "east": ["right", "top"]}
    >>> frame = {
    ...     "name": "frame",
    ...     "axes": "xz",
    ...     "gravity": [0, -9.81],
    ...     "classes": {"strut": {"kind": "bar", "spring_constant": 1e4}},
    ...     "nodes": {name: {"position": at, "mass": 1.0} for name, at in place.items()},
    ...     "members": {name: {"class": "strut", "nodes": pair} for name, pair in pairs.items()},
    ...     "ground": {"stiffness": 1e5, "friction": 0.5},
    ... }
    >>> model = compile_scene(frame, for_="equilibrium")
    >>> found = stand(model, find_equilibrium(model))
    >>> found.verdict, round(found.tipping_margin, 3)
    ('stands', 0.5)
    """
    require_model(model)
    structure = require_ground(getattr(model, "structure", None), model.manifest.name)
    values = merge_inputs(model.manifest, arguments)
    check_arguments(model.manifest, values)
    structure = structure.with_changes(ground=apply_ground(model, values))
    nominal = model.nominal("coordinate").ravel()
    friction = 0.0 if check_switch(frictionless, "frictionless") else None
    external = compute_external_force(structure, model, values)
    if isinstance(shape, Equilibrium):
        force = None if shape.feet is None else shape.feet.force
        return judge_stand(structure, shape.node_position, external, force=force, friction=friction)
    at = nominal if shape is None else to_doubles(shape, "shape", f"shape {nominal.shape}")
    check_shape(at, nominal.shape, "shape")
    check_finite(at, "shape")
    position = place_nodes(model, at, values.get("anchor_position"))
    return judge_stand(structure, position, external, friction=friction)


@dataclass(frozen=True)
class Tip:
    """How far a cable must be shortened until the structure tips."""

    cable: str  # its name
    status: str  # "tips", "snaps" where nodes jump, "stands" down to 1 % of the length, or that of a search
    rest_length: float  # [m], at which that happens
    shortening: float  # [m], its change from the scene's
    edge: tuple[str, ...]  # the feet of the edge about which it tips
    foot: tuple[str, ...]  # nodes that press, just before
    force: FloatArray  # (n_feet, 3) [N], of the ground on them then
    message: str  # of the search for an equilibrium beyond

    def as_evidence(self) -> dict[str, Any]:
        """Return all by name, JSON-ready."""
        names = ("cable", "status", "rest_length", "shortening", "message")
        feet = dict(zip(self.foot, self.force.tolist(), strict=True))
        return {**{name: getattr(self, name) for name in names}, "edge": list(self.edge), "feet": feet}


def find_tips(
    model: Model,
    cables: Sequence[str] = (),
    *,
    arguments: Mapping[str, Any] | None = None,
    frictionless: bool = False,
    progress: Progress | None = None,
) -> tuple[Tip, ...]:
    """Find how far each cable must be shortened, alone, until the structure tips; the least first.

    cables: by default all whose rest length is a parameter. progress: called with the number of the cable,
    and its shortening [m]. Raises ConvergenceError if the structure does not stand to begin with.

    The tipping margin is followed down to zero: steps of the rest length, each equilibrium from the one
    before, with bristles that go on from there; the root is approached by secants from the side that stands.
    """
    require_model(model)
    require_ground(getattr(model, "structure", None), model.manifest.name)
    spec = model.manifest.find_argument("rest_length")
    valid_names = () if spec is None else spec.over
    for name in cables:
        check_choice(name, valid_names, "cable", "cables")
    values = merge_inputs(model.manifest, arguments)
    begun = find_equilibrium(model, arguments=values, frictionless=frictionless, tolerance=TIGHT)
    assert begun.feet is not None
    friction = "slide" not in begun.feet.state
    tips = []
    for number, name in enumerate(cables or valid_names):
        course = _Shortening(model, values, valid_names.index(name), begun, friction)
        tips.append(course.follow(name, None if progress is None else partial(progress, number)))
    order = {"tips": 0, "slides": 1}
    return tuple(sorted(tips, key=lambda tip: (order.get(tip.status, 2), tip.shortening)))


@dataclass(frozen=True)
class _State:
    """An equilibrium with a cable shortened by `shortening` [m], and its tipping margin [m]."""

    shortening: float
    coordinate: FloatArray
    position: FloatArray
    feet: Feet
    margin: float
    edge: tuple[str, ...]


class _Shortening:
    """One cable that is shortened step by step."""

    def __init__(
        self, model: Model, given: Mapping[str, Any], column: int, begun: Equilibrium, friction: bool
    ) -> None:
        self.model, self.given, self.column, self.friction = model, given, column, friction
        nominal = model.nominal("rest_length") if given.get("rest_length") is None else given["rest_length"]
        self.length = np.array(nominal, dtype=float).ravel()
        self.size = begun.extent
        assert begun.feet is not None
        self.begun = self._judge(0.0, build_problem(model, given), begun.coordinate, begun.feet)

    def follow(self, name: str, progress: Callable[[float], None] | None) -> Tip:
        """Return where the margin vanishes, by a line through the last two equilibria."""
        rest_length = float(self.length[self.column])
        here = self.begun
        step, status, message = FIRST_STEP * rest_length, "stands", ""
        while here.shortening < MAX_SHORTENING * rest_length:
            target = min(here.shortening + step, MAX_SHORTENING * rest_length)
            if progress is not None:
                progress(target)
            outcome = self._settle(target, here)
            jump = (
                0.0 if isinstance(outcome, Outcome) else float(np.abs(outcome.position - here.position).max())
            )
            if isinstance(outcome, Outcome) or jump > MAX_JUMP * self.size:
                status, message = "snaps", f"a node jumps by {jump:.3g} m"
                if isinstance(outcome, Outcome):
                    status, message = outcome.status, outcome.message
                step /= 4
                if step < ROOT * rest_length:
                    break
                continue
            before, here, status = here, outcome, "stands"
            # How much further, until the margin vanishes; inf if it grows.
            slope = (here.margin - before.margin) / (here.shortening - before.shortening)
            remaining = -here.margin / slope if slope < 0.0 else np.inf
            if remaining <= ROOT * rest_length:
                return self._record(name, "tips", here, before, remaining, "")
            step = min(2 * step, MAX_STEP * rest_length, NEAR_ROOT * remaining)
        return self._record(name, status, here, here, 0.0, message)

    def _settle(self, shortening: float, state: _State) -> "_State | Outcome":
        """Return the equilibrium with the cable shortened, or the outcome of a search that finds none."""
        length = self.length.copy()
        length[self.column] -= shortening
        problem = build_problem(self.model, {**self.given, "rest_length": length})
        problem.ground_contacts.friction = self.friction
        reached = state.coordinate, state.position, state.feet
        outcome = step_on_ground(problem, *reached, tolerance=TIGHT, max_iterations=MAX_ITERATIONS)
        if outcome.status not in FOUND:
            return outcome
        at = outcome.point.coordinate
        return self._judge(shortening, problem, at, describe_feet(problem, at))

    def _judge(self, shortening: float, problem: StaticProblem, at: FloatArray, feet: Feet) -> _State:
        contacts, position = problem.ground_contacts, problem.node_position(at)
        margin, edge = find_support_margin(contacts.structure, position, contacts.external, feet.force)
        return _State(shortening, at, position, feet, margin, edge)

    def _record(
        self, name: str, status: str, here: _State, before: _State, remaining: float, message: str
    ) -> Tip:
        """Return the event at a remaining shortening beyond the last equilibrium, to first order."""
        feet = here.feet
        presses = np.array([state != "open" for state in feet.state])
        foot = tuple(state for state, pressed in zip(feet.node_name, presses, strict=True) if pressed)
        step = here.shortening - before.shortening
        force = feet.force + (feet.force - before.feet.force) * (remaining / step if step else 0.0)
        shortening = here.shortening + remaining
        rest_length = float(self.length[self.column]) - shortening
        return Tip(name, status, rest_length, shortening, here.edge, foot, force[presses], message)
