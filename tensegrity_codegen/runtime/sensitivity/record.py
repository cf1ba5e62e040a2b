"""The record of a sensitivity: derivatives by rest lengths, their gauge, and what limits them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError, check_choice
from tensegrity_codegen.system.summaries import Summarised


@dataclass(frozen=True, repr=False)
class Sensitivity(Summarised):
    """Derivatives of an equilibrium by rest lengths.

    A column stands for one member, or for the members of an input or actuator, whose rest lengths change
    together.
    The column of a rigid bar is the derivative by the length that it keeps.

    Attributes
    ----------
    coordinate : ndarray, shape (n_coordinates, n_columns) [m/m]
        dq/drho; radians per metre where a coordinate is an angle.
    tension : ndarray, shape (n_members, n_columns) [N/m]
        dt/drho, with the motion of the nodes.
    node : ndarray, shape (n_nodes, 3, n_columns) [m/m]
        dr/drho of all nodes.
    coordinate_name, node_name, member_name, column_name : tuple of str
        Names of rows and columns.
    gauge : tuple of str
        Rigid motions that cost no force, and are set to zero: ``"slide along x"``, ``"turn about z"``.
    gauge_motion : ndarray, shape (n_coordinates, n_gauge)
        These motions. The motion of the nodes in each column is orthogonal to that in each of them: the
        mean of the nodes does not slide, and they do not turn on the whole.
    slack : tuple of str
        Slack cables: the structure does not follow changes of their rest lengths.
    one_sided : tuple of str
        Cables at their rest lengths, which go slack or taut with the smallest change: the derivatives hold on
        one side only.
    smallest_eigenvalue : float
        Eigenvalue of the stiffness nearest zero, without the gauge and within rigid bars [N/m]; negative
        where the equilibrium is unstable.
    rounding : float
        What one iterative refinement changed, as part of the largest dq/drho.
    residual, largest_force : float
        Largest node residual and member force of the equilibrium [N].
    """

    coordinate: FloatArray
    tension: FloatArray
    node: FloatArray
    coordinate_name: tuple[str, ...]
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    column_name: tuple[str, ...]
    gauge: tuple[str, ...]
    gauge_motion: FloatArray
    slack: tuple[str, ...]
    one_sided: tuple[str, ...]
    smallest_eigenvalue: float
    rounding: float
    residual: float
    largest_force: float

    def rank_for_node(self, node: str, axis: str = "z", most: int = 5) -> list[tuple[str, float]]:
        """Return the columns that move a node most along an axis.

        Parameters
        ----------
        node : str
            Name of the node.
        axis : str
            ``"x"``, ``"y"`` or ``"z"``.
        most : int
            Number of columns, at most.

        Returns
        -------
        list of (str, float)
            Name and derivative [m/m], the largest modulus first; zeros are left out.

        Raises
        ------
        UnknownNameError
            No such node or axis.
        InvalidValueError
            A number of columns below 1.
        """
        check_choice(node, self.node_name, "node", "node")
        check_choice(axis, "xyz", "axis", "axis")
        return self._rank(self.node[self.node_name.index(node), "xyz".index(axis)], most)

    def rank_for_tension(self, member: str, most: int = 5) -> list[tuple[str, float]]:
        """Return the columns that change the tension of a member most.

        Parameters
        ----------
        member : str
            Name of the member.
        most : int
            Number of columns, at most.

        Returns
        -------
        list of (str, float)
            Name and derivative [N/m], the largest modulus first; zeros are left out.

        Raises
        ------
        UnknownNameError
            No such member.
        InvalidValueError
            A number of columns below 1.
        """
        check_choice(member, self.member_name, "member", "member")
        return self._rank(self.tension[self.member_name.index(member)], most)

    def _rank(self, row: FloatArray, most: int) -> list[tuple[str, float]]:
        if most < 1:
            raise InvalidValueError("no columns are asked for", where="most", given=most, allowed="1 or more")
        order = np.argsort(-np.abs(row), kind="stable")[:most]
        return [(self.column_name[k], float(row[k])) for k in order if row[k] != 0.0]

    def as_evidence(self) -> dict[str, Any]:
        """Return the scalar results by name, JSON-ready."""
        names = (
            "gauge",
            "slack",
            "one_sided",
            "smallest_eigenvalue",
            "rounding",
            "residual",
            "largest_force",
        )
        return {name: getattr(self, name) for name in names}
