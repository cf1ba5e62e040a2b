"""A family of configurations q = q_s(s) put into the full equations of motion of bodies.

q' = J s', q'' = J s'' + J' s', with J = dq_s/ds, go into M q'' + c + C q' + A G t + H u - f = 0 (SCS 10),
where t holds one tension for each group of tendons (G repeats it over the group) and f what acts beside
tendons and inputs. J^T times this are the equations of the family; the family is a class of motions where
the other components vanish as well.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.symbolic.formulations.bodies import build_bodies
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest

Family = Callable[[Sequence[Any]], Sequence[Any]]


@dataclass(frozen=True)
class Balance:
    """The full equations at one (s, s', s''): own_force + tendon_matrix t + input_matrix u = 0.

    own_force (n_coordinates,): M q'' + c + C q' - f; tendon_matrix (n_coordinates, n_groups): A G;
    input_matrix (n_coordinates, n_inputs): H; family_jacobian (n_coordinates, n_parameters): J.
    """

    own_force: FloatArray
    tendon_matrix: FloatArray
    input_matrix: FloatArray
    family_jacobian: FloatArray

    def reduced(self) -> "Balance":
        """Return the equations of the family, J^T times the full ones."""
        transposed = self.family_jacobian.T
        return Balance(
            transposed @ self.own_force,
            transposed @ self.tendon_matrix,
            transposed @ self.input_matrix,
            np.eye(len(transposed)),
        )

    def residual(self, tension: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the residual of the equations, (n_coordinates,), zero in a motion."""
        pulled = self.tendon_matrix @ np.asarray(tension, dtype=np.float64)
        driven = self.input_matrix @ np.asarray(inputs, dtype=np.float64)
        return np.asarray(self.own_force + pulled + driven, dtype=np.float64)


@dataclass(frozen=True)
class Control:
    """Tensions and inputs that drive the family through one (s, s', s'').

    tension (n_groups,) [N]; input (n_inputs,) [N, N m]; residual (n_coordinates,): what these leave over of
    the full equations, zero but for rounding where the family is a class of motions; rank: of the equations
    for the unknowns, full where they are unique.
    """

    tension: FloatArray
    input: FloatArray
    residual: FloatArray
    rank: int


class RestrictedBodies:
    """The model of `system`, restricted to `family`: s (list of symbols) -> q (n_coordinates entries).

    parameter: names of s; group: name -> indices of tendons with one common tension. Tensions are unknowns
    here: stiffness, rest length and damping of tendons do not enter. Raises InvalidValueError if the
    family gives another number of coordinates.
    """

    def __init__(
        self, system: BodySystem, parameter: Sequence[str], family: Family, group: Mapping[str, Sequence[int]]
    ) -> None:
        self.system, self.parameter = system, tuple(parameter)
        self.group = {name: tuple(members) for name, members in group.items()}
        self._model = build_bodies(_without_stiffness(system), ModelRequest((), formulation="bodies"))
        s, rate, change = (ca.SX.sym(name, len(self.parameter)) for name in ("s", "rate", "change"))
        q = ca.vertcat(*family([s[k] for k in range(len(self.parameter))]))
        if q.numel() != system.n_coordinates:
            raise InvalidValueError(
                "the family gives another number of coordinates",
                where=system.name,
                given=q.numel(),
                allowed=f"{system.n_coordinates} coordinates",
            )
        self._build(s, rate, change, q)

    def coordinate(self, s: ArrayLike) -> FloatArray:
        """Return q_s(s), (n_coordinates,) [m, rad]."""
        return np.array(self._place(self._numbers(s))).ravel()

    def velocity(self, s: ArrayLike, rate: ArrayLike) -> FloatArray:
        """Return J s', (n_coordinates,) [m/s, rad/s]."""
        return np.array(self._speed(self._numbers(s), self._numbers(rate))).ravel()

    def member_length(self, s: ArrayLike) -> FloatArray:
        """Return the lengths of all tendons, (n_members,) [m]."""
        return np.array(self._length(self._numbers(s))).ravel()

    def group_length(self, s: ArrayLike) -> FloatArray:
        """Return the mean length in each group, (n_groups,) [m]."""
        length = self.member_length(s)
        return np.array([length[list(members)].mean() for members in self.group.values()])

    def length_spread(self, s: ArrayLike) -> float:
        """Return the largest difference of lengths within a group [m], zero in a symmetrical family."""
        length = self.member_length(s)
        return max(float(np.ptp(length[list(members)])) for members in self.group.values())

    def balance(self, s: ArrayLike, rate: ArrayLike, change: ArrayLike) -> Balance:
        """Return the full equations at s, s', s'', each (n_parameters,). Raises NonFiniteError."""
        values = [self._numbers(value) for value in (s, rate, change)]
        inertial, tendon, inputs, jacobian = (np.array(term) for term in self._balance(*values))
        return Balance(inertial.ravel(), tendon, inputs, jacobian)

    def group_matrix(self, s: ArrayLike) -> FloatArray:
        """Return J^T A G at many configurations, s (n, n_parameters) -> (n, n_parameters, n_groups)."""
        table = np.atleast_2d(np.asarray(s, dtype=np.float64))
        stacked = np.array(self._group(table.T))
        return stacked.reshape(len(self.parameter), len(table), len(self.group)).transpose(1, 0, 2)

    def find_control(
        self, s: ArrayLike, rate: ArrayLike, change: ArrayLike, fixed: ArrayLike, free: Sequence[int]
    ) -> Control:
        """Return group tensions and the `free` inputs that balance all equations, in least squares.

        fixed (n_inputs,): the values of the other inputs; those of free ones are ignored.
        """
        balance, inputs, chosen = self.balance(s, rate, change), np.array(fixed, dtype=float), list(free)
        inputs[chosen] = 0.0
        right = balance.own_force + balance.input_matrix @ inputs
        matrix = np.hstack([balance.tendon_matrix, balance.input_matrix[:, chosen]])
        solution, _, rank, _ = np.linalg.lstsq(matrix, -right, rcond=None)
        tension, inputs[chosen] = solution[: len(self.group)], solution[len(self.group) :]
        return Control(tension, inputs, balance.residual(tension, inputs), int(rank))

    def _build(self, s: ca.SX, rate: ca.SX, change: ca.SX, q: ca.SX) -> None:
        """Make the functions: each quantity of the full model is called with q_s(s), J s', J s'' + J' s'."""
        jacobian = ca.jacobian(q, s)
        speed = ca.mtimes(jacobian, rate)
        acceleration = ca.mtimes(jacobian, change) + ca.jtimes(speed, s, rate)
        at = {name: self._substitute(name, q, speed) for name in _NEEDED}
        inertial = ca.mtimes(at["mass_matrix"], acceleration) + at["coriolis_force"]
        inertial = inertial + ca.mtimes(at["damping_matrix"], speed) - at["coordinate_force"]
        tendon = ca.mtimes(at["equilibrium_matrix"], self._repetition())
        self._place = ca.Function("place", [s], [ca.densify(q)])
        self._speed = ca.Function("speed", [s, rate], [ca.densify(speed)])
        self._length = ca.Function("length", [s], [ca.densify(at["member_length"])])
        self._group = ca.Function("group", [s], [ca.densify(ca.mtimes(jacobian.T, tendon))])
        terms = [ca.densify(term) for term in (inertial, tendon, at["load_matrix"], jacobian)]
        self._balance = ca.Function("balance", [s, rate, change], terms)

    def _substitute(self, quantity: str, q: ca.SX, speed: ca.SX) -> ca.SX:
        symbols = [argument.symbol for argument in self._model.arguments.values()]
        values = {"coordinate": q, "velocity": speed}
        arguments = [values.get(name, ca.SX(*a.symbol.shape)) for name, a in self._model.arguments.items()]
        return ca.Function(quantity, symbols, [self._model.expression(quantity)])(*arguments)

    def _repetition(self) -> ca.SX:
        """Return G, (n_members, n_groups): one if the tendon is in the group."""
        matrix = np.zeros((self.system.n_members, len(self.group)))
        for column, members in enumerate(self.group.values()):
            matrix[list(members), column] = 1.0
        return ca.sparsify(ca.SX(matrix))

    def _numbers(self, value: ArrayLike) -> FloatArray:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != (len(self.parameter),):
            raise InvalidValueError(
                "wrong shape", where=", ".join(self.parameter), given=array.shape,
                allowed=f"shape ({len(self.parameter)},)",
            )  # fmt: skip
        if not np.isfinite(array).all():
            raise NonFiniteError("not finite", where=", ".join(self.parameter), given=array.tolist())
        return array


_NEEDED = (
    "mass_matrix", "coriolis_force", "damping_matrix", "coordinate_force",
    "equilibrium_matrix", "load_matrix", "member_length",
)  # fmt: skip


def _without_stiffness(system: BodySystem) -> BodySystem:
    """Return the system with tendons that pull by their unknown tensions alone."""
    none = np.zeros(system.n_members)
    return system.with_changes(spring_constant=none, axial_stiffness=none, damping=none)
