"""Values of nodes and members by their names."""

from collections.abc import Sequence
from typing import Protocol

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import UnknownNameError, suggest


class _Named(Protocol):
    """What has nodes with positions and members with tensions; `...` stands for samples and motions."""

    @property
    def node_name(self) -> tuple[str, ...]: ...
    @property
    def node_position(self) -> FloatArray: ...  # (..., n_nodes, 3) [m]
    @property
    def member_name(self) -> tuple[str, ...]: ...
    @property
    def member_tension(self) -> FloatArray: ...  # (..., n_members) [N]


class ByName:
    """Positions and tensions by name, for results with the arrays of all nodes and members."""

    def position(self: _Named, node: str) -> FloatArray:
        """Return the position of a node.

        Parameters
        ----------
        node : str
            Name of the node.

        Returns
        -------
        ndarray, shape (..., 3) [m]
            Its position, at every sample where the result has samples.

        Raises
        ------
        UnknownNameError
            No node has that name; the message has similar ones.
        """
        return self.node_position[..., find_row(node, self.node_name, "node"), :]

    def tension(self: _Named, member: str) -> FloatArray:
        """Return the tension of a member.

        Parameters
        ----------
        member : str
            Name of the member.

        Returns
        -------
        float or ndarray, shape (...) [N]
            Its tension, at every sample where the result has samples.

        Raises
        ------
        UnknownNameError
            No member has that name; the message has similar ones.
        """
        return self.member_tension[..., find_row(member, self.member_name, "member")]


def find_row(name: str, names: Sequence[str], what: str) -> int:
    """Return the index of a name; raises UnknownNameError, which has similar names, where it is unknown."""
    if name in names:
        return names.index(name)
    raise UnknownNameError(
        f"no {what} has this name",
        where=what,
        given=name,
        allowed=f"the names of the {len(names)} {what}s" if names else f"there are no {what}s",
        hint=suggest(name, names),
    )
