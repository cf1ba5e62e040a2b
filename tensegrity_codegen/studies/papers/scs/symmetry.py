"""Symmetrical configurations of the two-stage tower, obtained from its full model (SCS 4).

The family (16): s = (alpha, delta, Z), psi = 300 deg, all declinations delta, azimuths alpha + (0, 240, 120)
in the lower stage and alpha + (120, 0, 240) in the upper one. Tensions are one a class: saddle, vertical,
diagonal. Any scene of the kind will do; whether it is symmetrical is found by putting the family into it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.members import compute_rest_length
from tensegrity_codegen.structure.bodies import Bar, BodyInput, BodySystem, RigidBody
from tensegrity_codegen.structure.kinematics import compute_node_position
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.restriction import Control, RestrictedBodies
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import (
    InfeasibleError,
    InvalidValueError,
    NonFiniteError,
    StructureError,
)

BARS = ("bar11", "bar21", "bar31", "bar12", "bar22", "bar32")
GROUPS = ("saddle", "vertical", "diagonal")
INPUTS = ("M1", "M2", "M3", "F1", "F2", "F3")


def find_top(system: BodySystem) -> RigidBody:
    """Return the only rigid body; StructureError if there are none or several."""
    rigid = [body for body in system.bodies if isinstance(body, RigidBody)]
    if len(rigid) != 1:
        raise StructureError(
            "a two-stage tower has one rigid top", where=system.name, given=[body.name for body in rigid]
        )
    return rigid[0]


def check_kind(system: BodySystem) -> None:
    """Raise StructureError unless bodies and classes of tendons are those of a two-stage tower."""
    bars = [body for body in system.bodies if isinstance(body, Bar)]
    held = {body.name: body.held for body in bars}
    expected = {name: "A" if name[-1] == "1" else "B" for name in BARS}
    plain = all(body.chart.axis == 2 and body.chart.polar == "declination" for body in bars)
    if held != expected or not plain or any(body.chart.offset for body in bars):
        raise StructureError(
            "not the bars of a two-stage tower",
            where=f"{system.name}: bodies",
            given=held,
            allowed=f"{', '.join(BARS)}; the first three held at A, the others at B, angles as in SCS (13)",
        )
    if sorted(set(system.member_class)) != sorted(GROUPS):
        raise StructureError(
            "not the tendons of a two-stage tower",
            where=f"{system.name}: tendons",
            given=sorted(set(system.member_class)),
            allowed=f"the classes {', '.join(GROUPS)}",
        )


def make_inputs(top: RigidBody, system: BodySystem) -> tuple[BodyInput, ...]:
    """Return M_1 to F_3 of SCS (15), along the axes of the top."""
    body, centre = system.bodies.index(top), f"{top.name}_centre"
    if centre not in system.node_name:
        raise StructureError(
            "the top needs a point at its centre, where F_3 acts",
            where=f"{system.name}: bodies.{top.name}",
            hint=f'name "{top.name}.centre" in a load or an input',
        )
    node = system.find_node(centre)
    unit = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    torques = [BodyInput(INPUTS[k], "torque", (body,), unit[k], "body") for k in range(3)]
    forces = [BodyInput(INPUTS[3 + k], "force", (node,), unit[k], "body") for k in range(3)]
    return (*torques, *forces)


AZIMUTH_OFFSET = (0, 240, 120, 120, 0, 240)  # [deg], of the bars in this order
PSI = 300  # [deg]
CROSSING = 30.0  # [deg], the azimuth at which bars intersect
BOUND_TOLERANCE = 1e-9  # [deg] or [m], closer than this counts as on a bound
SYMMETRY = 1e-9  # [m, N, N m], of lengths in a class and of left-out residuals


@dataclass(frozen=True)
class SymmetricPose:
    """A symmetrical configuration: alpha, delta [rad], height Z [m]."""

    alpha: float
    delta: float
    height: float

    @classmethod
    def from_degrees(cls, alpha: float, delta: float, height: float) -> "SymmetricPose":
        """Return the pose of angles in degrees; NonFiniteError for numbers that are not finite."""
        if not np.isfinite([alpha, delta, height]).all():
            raise NonFiniteError("not a pose", where="alpha, delta, Z", given=(alpha, delta, height))
        return cls(math.radians(alpha), math.radians(delta), height)

    @property
    def parameter(self) -> FloatArray:
        """s = (alpha, delta, Z)."""
        return np.array([self.alpha, self.delta, self.height])

    @property
    def in_degrees(self) -> tuple[float, float, float]:
        """alpha, delta [deg], Z [m]."""
        return math.degrees(self.alpha), math.degrees(self.delta), self.height


class SymmetricTower:
    """A two-stage tower in its symmetrical configurations.

    system: a scene with the bars bar11 to bar32 (lower stage held at A, upper at B), one rigid body with
    a point at its centre, and tendons of the classes saddle, vertical and diagonal. Loads are left out: the
    force F_3 is given to each question, its value in the scene is `scene_force` [N]. Raises StructureError
    for a scene of another kind, and for one in which symmetrical motions do not stay symmetrical.
    """

    def __init__(self, system: BodySystem | Structure) -> None:
        if not isinstance(system, BodySystem):
            raise StructureError(
                "not a scene of bodies",
                where=system.name,
                allowed='formulation = "bodies", as in the example svd_tower',
            )
        self._top = find_top(system)
        check_kind(system)
        self.scene_force = float(system.node_load[:, 2].sum())
        self.system = system.with_changes(
            node_load=np.zeros((system.n_nodes, 3)),
            loads=(),
            inputs=make_inputs(self._top, system),
            actuators=(),
        )
        group = {name: [k for k, c in enumerate(system.member_class) if c == name] for name in GROUPS}
        self.restricted = RestrictedBodies(self.system, ("alpha", "delta", "Z"), self._family, group)
        self._check_symmetry()

    # Numbers of the scene

    @cached_property
    def bar(self) -> Bar:
        """The bar that all bars are equal to."""
        return next(body for body in self.system.bodies if isinstance(body, Bar))

    @cached_property
    def side(self) -> float:
        """b [m], the side of the base."""
        anchors = [self._bar(name).anchor for name in BARS[:2]]
        lower, second = compute_node_position(self.system)[anchors]
        return float(np.linalg.norm(lower - second))

    @property
    def friction(self) -> float:
        """d [N m s], the common coefficient of joint friction, zero without friction."""
        return self.system.friction[0].coefficient if self.system.friction else 0.0

    @property
    def bar_inertia(self) -> float:
        """J + m l^2 / 4 [kg m2], of a bar about its joint (SCS 26)."""
        return self.bar.inertia + 0.25 * self.bar.mass * self.bar.length**2

    @property
    def bar_moment(self) -> float:
        """3 m l / 2 [kg m] (SCS 26)."""
        return 1.5 * self.bar.mass * self.bar.length

    # Configurations

    def check_pose(self, pose: SymmetricPose, where: str = "configuration") -> None:
        """Raise InvalidValueError for a pose outside the bounds of SCS 4.

        alpha = 30 deg: bars intersect; 0 < delta < 90 deg; Z > l cos(delta): else bars reach base and top.
        """
        alpha, delta, height = pose.in_degrees
        lowest = self.bar.length * math.cos(pose.delta)
        if _is_crossing(alpha):
            problem, stated, allowed = (
                "bars intersect at this azimuth",
                f"alpha = {alpha:g} deg",
                "not 30 deg",
            )
        elif not BOUND_TOLERANCE < delta < 90.0 - BOUND_TOLERANCE:
            problem, stated = "the declination is outside its bounds", f"delta = {delta:g} deg"
            allowed = "0 < delta < 90 deg"
        elif not height > lowest + BOUND_TOLERANCE:
            problem, stated = "the bars of one stage reach the other end of the tower", f"Z = {height:g} m"
            allowed = f"Z > l cos(delta) = {lowest:.6g} m"
        else:
            return
        raise InvalidValueError(problem, where=where, given=stated, allowed=allowed)

    def is_inside(self, parameters: FloatArray) -> NDArray[np.bool_]:
        """Return which s of (n, 3) are within the bounds of SCS 4, (n,)."""
        alpha, delta, height = parameters.T
        tilted = (np.degrees(delta) > BOUND_TOLERANCE) & (np.degrees(delta) < 90.0 - BOUND_TOLERANCE)
        room = height > self.bar.length * np.cos(delta) + BOUND_TOLERANCE
        inside: NDArray[np.bool_] = tilted & room & ~_is_crossing(np.degrees(alpha))
        return inside

    def lengths(self, pose: SymmetricPose) -> FloatArray:
        """Return S, V, D, (3,) [m] (SCS 17 to 19)."""
        return self.restricted.group_length(pose.parameter)

    def matrix(self, parameters: FloatArray) -> FloatArray:
        """Return A_r at many s, (n, 3) -> (n, 3, 3); rows dl/d(delta), dl/d(alpha), 6 dl/dZ (SCS A)."""
        by_parameter = self.restricted.group_matrix(parameters)  # rows alpha, delta, Z
        matrix: FloatArray = by_parameter[:, [1, 0, 2], :] / np.array([6.0, 6.0, 1.0])[:, None]
        return matrix

    def determinant(self, parameters: FloatArray) -> FloatArray:
        """Return det(A_r) at many s, (n, 3) -> (n,), zero where SCS (42) is."""
        result: FloatArray = np.linalg.det(self.matrix(parameters))
        return result

    def compute_control(
        self, s: FloatArray, rate: FloatArray, change: FloatArray, force: float, where: str = "configuration"
    ) -> Control:
        """Return tensions (saddle, vertical, diagonal) and inputs (M1 to F3) at s, s', s'', each (3,).

        force: F_3 [N]. All inputs but F_3 are found, so that a motion that is not symmetrical by itself shows
        in M_1, M_2, F_1, F_2 (SCS 20) or in the residual.
        """
        inputs = np.array([0.0, 0.0, 0.0, 0.0, 0.0, force])
        control = self.restricted.find_control(s, rate, change, inputs, range(5))
        if control.rank < 8:
            raise InfeasibleError(
                "the tensions are not determined: A_r is singular here",
                evidence={"alpha_deg": math.degrees(s[0]), "delta_deg": math.degrees(s[1]), "Z": float(s[2])},
                where=where,
                hint="choose a configuration away from the zero contour of the determinant (SCS 42)",
            )
        return control

    def equilibrium(self, pose: SymmetricPose, force: float, where: str = "configuration") -> FloatArray:
        """Return the tensions A_r^-1 (0, 0, F_3), (3,) [N], whatever their signs (SCS 31)."""
        self.check_pose(pose, where)
        zero = np.zeros(3)
        return self.compute_control(pose.parameter, zero, zero, force, where).tension

    def check_taut(self, tension: FloatArray, where: str) -> None:
        """Raise InfeasibleError naming the tendons that would have to push (SCS 27)."""
        slack = [name for name, value in zip(GROUPS, tension, strict=True) if not value > 0]
        if slack:
            raise InfeasibleError(
                f"no equilibrium with taut tendons: {', '.join(slack)} would have to push",
                evidence={name: f"{value:.6g} N" for name, value in zip(GROUPS, tension, strict=True)},
                where=where,
                hint="choose another configuration or force; see the map of feasible configurations",
            )

    def rest_lengths(self, length: FloatArray, tension: FloatArray) -> FloatArray:
        """Return the rest lengths (3,) [m] that give the tensions at these lengths (SCS 35)."""
        leaders = [members[0] for members in self.restricted.group.values()]
        spring, axial = (
            getattr(self.system, name)[leaders] for name in ("spring_constant", "axial_stiffness")
        )
        return compute_rest_length(length, tension, spring, axial)

    def spread(self, by_group: FloatArray) -> FloatArray:
        """Return one value a tendon, (18,), of one a class, (3,)."""
        result = np.empty(self.system.n_members)
        for value, members in zip(by_group, self.restricted.group.values(), strict=True):
            result[list(members)] = value
        return result

    # Whether the scene is what it must be

    def _family(self, s: Sequence[Any]) -> list[Any]:
        """Return q_s(s) of (16), in the order of the scene's coordinates."""
        alpha, delta, height = s
        values = {f"{name}_declination": delta for name in BARS}
        for name, offset in zip(BARS, AZIMUTH_OFFSET, strict=True):
            values[f"{name}_azimuth"] = alpha + math.radians(offset)
        top = {"psi": math.radians(PSI), "phi": 0.0, "theta": 0.0, "x": 0.0, "y": 0.0, "z": height}
        values |= {f"{self._top.name}_{label}": value for label, value in top.items()}
        return [values[name] for name in self.system.coordinate_name]

    def _bar(self, name: str) -> Bar:
        return next(body for body in self.system.bodies if isinstance(body, Bar) and body.name == name)

    def _check_symmetry(self) -> None:
        """Raise StructureError unless lengths are equal in each class and symmetrical motions stay so."""
        s, rate, change = np.array([1.0, 0.6, 1.2]), np.array([0.3, -0.2, 0.0]), np.array([0.5, 0.7, 0.0])
        unequal = {
            name: np.ptp(self._stiffness[list(m)], axis=0) for name, m in self.restricted.group.items()
        }
        evidence = {
            "difference of lengths in a class [m]": self.restricted.length_spread(s),
            "difference of stiffnesses in a class [N, N/m]": max(float(x.max()) for x in unequal.values()),
        }
        control = self.restricted.find_control(s, rate, change, np.zeros(6), range(5))
        torques = np.abs(control.input[[0, 1, 3, 4]])
        evidence["left-out residual [N, N m]"] = float(max(np.abs(control.residual).max(), torques.max()))
        wrong = {name: value for name, value in evidence.items() if not value <= SYMMETRY}
        if wrong:
            raise StructureError(
                "this tower does not move symmetrically",
                where=self.system.name,
                given=wrong,
                allowed="equal bars, triangles, joints and tendons of a class; no gravity (SCS 4)",
            )

    @property
    def _stiffness(self) -> FloatArray:
        return np.column_stack([self.system.spring_constant, self.system.axial_stiffness])


def _is_crossing(alpha_deg: Any) -> Any:
    """Return whether bars intersect at azimuths [deg], numbers or arrays."""
    return abs((alpha_deg - CROSSING + 180.0) % 360.0 - 180.0) <= BOUND_TOLERANCE
