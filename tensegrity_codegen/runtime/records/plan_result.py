"""The result of a plan: a path with all its limits, or why there is none."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import (
    ByName,
    Fact,
    Summarised,
    count_names,
    describe_number,
    describe_range,
)

# Limits in words.
LIMIT_WORDS = {
    "least_tension": "least tension",
    "most_tension": "largest tension",
    "yield": "yield stress",
    "buckling": "buckling",
    "clearance": "clearance",
    "range": "range of rest lengths",
    "least_stiffness": "smallest eigenvalue of the stiffness",
}


@dataclass(frozen=True)
class Contradiction:
    """A target and the limits of one member, or pair of bars, that exclude each other.

    Attributes
    ----------
    target : str
        The target.
    name : str
        Member or pair of bars.
    limit : str
        Which limit.
    given, allowed : float
        What the target makes necessary, and the limit itself.
    unit : str
        Their unit.
    message : str
        A sentence.
    """

    target: str
    name: str
    limit: str
    given: float
    allowed: float
    unit: str
    message: str


@dataclass(frozen=True)
class Cover:
    """Cells of the inputs that cover all that a plan can reach: none has the values of the targets.

    Attributes
    ----------
    half : float
        Half of the width of each cell, of each input [m].
    change : ndarray, shape (n_cells, n_actuators) [m]
        Inputs at the centres of the cells; the first is that of the start.
    node_position : ndarray, shape (n_cells, n_nodes, 3) [m]
        Equilibria at the centres.
    end : tuple of str
        The limit that is broken in the whole cell; "" for a cell that a plan can enter.
    message : str
        A sentence.
    """

    half: float
    change: FloatArray
    node_position: FloatArray
    end: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Binding:
    """One limit that binds.

    Attributes
    ----------
    limit : str
        ``"least_tension"``, ``"most_tension"``, ``"yield"``, ``"buckling"``, ``"clearance"``, ``"range"`` or
        ``"least_stiffness"``.
    name : str
        Member, pair of bars, or actuator; "" for the stiffness.
    bound : float
        The limit itself; of a range, the rest length.
    margin : float
        Distance from the limit.
    unit : str
        Its unit.
    multiplier : float
        Progress (from 0 to 1) that is gained where the limit is eased by one unit; of steps that a limit
        does not shorten, its multiplier in the program of the step, which only says that it binds.
    """

    limit: str
    name: str
    bound: float
    margin: float
    unit: str
    multiplier: float

    def as_dict(self) -> dict[str, Any]:
        """Return the record, JSON-ready."""
        return dict(vars(self))


@dataclass(frozen=True)
class Block:
    """Where a path ends before its target.

    Attributes
    ----------
    progress : float
        Progress reached, from 0 to 1.
    target : ndarray, shape (n_targets,)
        Values of the targets there.
    least_progress : float
        Most progress that a further step of the size of the trust region could make, with all limits
        linearised; nan if that is not known.
    binding : tuple of Binding
        Limits that bind there, first those that gain most where they are eased by one per cent.
    reason : str
        A sentence.
    fewest : tuple of (str, str)
        Limit and name, as in `Binding`, of a set of limits that alone leaves no more progress than all limits
        together, none of which can be spared.
    is_fewest : bool
        Whether it is proved that no smaller set does.
    """

    progress: float
    target: FloatArray
    least_progress: float
    binding: tuple[Binding, ...]
    reason: str
    fewest: tuple[tuple[str, str], ...] = ()
    is_fewest: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the record, JSON-ready."""
        return {
            "progress": self.progress,
            "target": self.target.tolist(),
            "least_progress": self.least_progress,
            "binding": [binding.as_dict() for binding in self.binding],
            "reason": self.reason,
            "fewest": [{"limit": limit, "name": name} for limit, name in self.fewest],
            "is_fewest": self.is_fewest,
        }


@dataclass(frozen=True)
class Branch:
    """One path that was tried, and how it ended.

    Attributes
    ----------
    kind : str
        ``"smallest changes"``, ``"other first changes"``, or ``"random walk"``: straight to the target from
        the shape that a random walk led to.
    n_steps : int
        Steps of the straight path.
    progress : float
        Progress of the straight path, from 0 to 1.
    target : ndarray, shape (n_targets,)
        Values of the targets at its end.
    reason : str
        Why it ended.
    """

    kind: str
    n_steps: int
    progress: float
    target: FloatArray
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """Return the record, JSON-ready."""
        return {**vars(self), "target": self.target.tolist()}


@dataclass(frozen=True, repr=False)
class PlanResult(ByName, Summarised):
    """A plan, or why there is none.

    Attributes
    ----------
    status : str
        ``"found"``; ``"infeasible"``: proved that there is no plan, see `certificate`; ``"blocked"``: no or
        little progress from the last point of the path, see `block`. A blocked path proves nothing about
        others.
    message : str
        A sentence.
    progress : ndarray, shape (n_steps,)
        From 0 at the start to 1 at the target. All arrays have a row for the start, also of an infeasible
        plan; `residual` says whether that is in balance. With a `Cover`, they are those of the furthest path.
    target_name, target_unit : tuple of str
        Names and units of the targets' components.
    target : ndarray, shape (n_steps, n_targets)
        Their values.
    goal : ndarray, shape (n_targets,)
        The values to reach.
    actuator_name : tuple of str
        Names of the actuators.
    change : ndarray, shape (n_steps, n_actuators) [m]
        Values of the actuators' inputs, as `simulate` takes them.
    rest_length : ndarray, shape (n_steps, n_actuators) [m]
        Total rest length of the (first) member of each actuator, whatever moves it.
    node_name, member_name, bar_pair_name : tuple of str
        Names of nodes, members, pairs of bars.
    is_cable : ndarray of bool, shape (n_members,)
        Which members are cables.
    node_position : ndarray, shape (n_steps, n_nodes, 3) [m]
        Positions of the nodes.
    member_tension : ndarray, shape (n_steps, n_members) [N]
        Tensions.
    bar_distance : ndarray, shape (n_steps, n_bar_pairs) [m]
        Distances between bars.
    smallest_eigenvalue : ndarray, shape (n_steps,) [N/m]
        Of the stiffness without neutral rigid motions.
    residual : ndarray, shape (n_steps,) [N]
        Largest node residual.
    coordinate : ndarray, shape (n_steps, n_coordinates)
        Coordinates of the model.
    binding : tuple of tuple of Binding
        Limits that bound the step to each point.
    time : ndarray, shape (n_steps,) [s], or None
        Times at which the points are reached, where rates or a duration are given.
    block : Block or None
        Where a blocked path ends; also of a plan that a `Cover` proves infeasible.
    certificate : Certificate, Contradiction, Cover or None
        The proof of ``"infeasible"``.
    proof_position, proof_displacement : ndarray, shape (n_nodes, 3) [m, 1], or None
        The shape that has no such tensions, and the displacements of its nodes that prove it.
    warnings : tuple of str
        What to check.
    structure : Structure, BodySystem or None
        The structure, for pictures; None with a library that was loaded alone.
    branches : tuple of Branch
        The paths that were tried, in order; none if the plan is proved infeasible.
    """

    status: str
    message: str
    progress: FloatArray
    target_name: tuple[str, ...]
    target_unit: tuple[str, ...]
    target: FloatArray
    goal: FloatArray
    actuator_name: tuple[str, ...]
    change: FloatArray
    rest_length: FloatArray
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    bar_pair_name: tuple[str, ...]
    is_cable: NDArray[np.bool_]
    node_position: FloatArray
    member_tension: FloatArray
    bar_distance: FloatArray
    smallest_eigenvalue: FloatArray
    residual: FloatArray
    coordinate: FloatArray
    binding: tuple[tuple[Binding, ...], ...]
    time: FloatArray | None = None
    block: Block | None = None
    certificate: Certificate | Contradiction | Cover | None = None
    proof_position: FloatArray | None = None
    proof_displacement: FloatArray | None = None
    warnings: tuple[str, ...] = field(default=())
    structure: Structure | BodySystem | None = None
    branches: tuple[Branch, ...] = ()

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}, {self.message}" if self.message else self.status

    def facts(self) -> list[Fact]:
        """Return targets, actuators, tensions and stiffness, for `repr` and notebooks."""
        reached = self.target[-1] if len(self.target) else np.full(len(self.target_name), np.nan)
        targets = [
            f"{name} {value:.6g} of {goal:.6g} {unit}".rstrip()
            for name, value, goal, unit in zip(
                self.target_name, reached, self.goal, self.target_unit, strict=True
            )
        ]
        return [
            ("targets", "; ".join(targets)),
            ("actuators", f"{count_names(self.actuator_name)}, change {describe_range(self.change, 'm')}"),
            ("tension", describe_range(self.member_tension, "N")),
            ("steps", f"{self.n_steps}"),
            ("smallest eigenvalue", describe_range(self.smallest_eigenvalue, "N/m")),
            ("duration", describe_number(None if self.time is None else float(self.time[-1]), "s")),
        ]

    @property
    def is_found(self) -> bool:
        """Whether the path reaches the target."""
        return self.status == "found"

    @property
    def n_steps(self) -> int:
        """Number of steps, without the start."""
        return max(len(self.progress) - 1, 0)
