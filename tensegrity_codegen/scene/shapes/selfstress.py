"""Self-stress of a free pin-jointed structure: tensions that balance on every node without any load."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.system.errors import StructureError

MAX_MEMBERS = 1200  # a dense singular value decomposition stays within seconds
_RANK_TOLERANCE = 1e-10  # of the largest singular value
_TENSION_TOLERANCE = 1e-6  # of the largest tension
_HINT = (
    "leave out shape.prestress, give the cable classes a prestress, and settle the scene with `equilibrium`"
)


def equilibrium_matrix(points: ArrayLike, pairs: ArrayLike) -> NDArray[np.float64]:
    """Return the equilibrium matrix A (3 n_nodes, n_members) of the free structure.

    Column e holds the unit vector of member e at its first node and the opposite at its second one:
    A t = 0 for a self-stress t [N]. points (n_nodes, 3) [m], pairs (n_members, 2) node indices.
    """
    position, ends = np.asarray(points, dtype=float), np.asarray(pairs, dtype=np.int64)
    vector = position[ends[:, 0]] - position[ends[:, 1]]
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    matrix = np.zeros((len(position), 3, len(ends)))
    column = np.arange(len(ends))
    matrix[ends[:, 0], :, column] = unit
    matrix[ends[:, 1], :, column] = -unit
    return matrix.reshape(3 * len(position), len(ends))


def selfstress_modes(
    points: ArrayLike, pairs: ArrayLike, alike: Sequence[int] | None = None
) -> NDArray[np.float64]:
    """Return a basis (n_modes, n_members) of the self-stresses of the free structure, orthonormal.

    alike: (n_members,), of those only in which members of the same number have the same tension; the basis
    is then not orthonormal.
    """
    matrix = equilibrium_matrix(points, pairs)
    group = np.arange(matrix.shape[1]) if alike is None else np.asarray(alike, dtype=np.int64)
    if alike is not None:
        matrix = np.stack([matrix[:, group == k].sum(axis=1) for k in range(group.max() + 1)], axis=1)
    _, singular, right = np.linalg.svd(matrix)
    rank = int(np.sum(singular > _RANK_TOLERANCE * singular[0]))
    modes: NDArray[np.float64] = right[rank:][:, group]
    return modes


def find_selfstress(
    points: Sequence[Sequence[float]],
    pairs: Sequence[tuple[int, int]],
    is_bar: Sequence[bool],
    prestress: float,
    where: str,
    alike: Sequence[int] | None = None,
) -> list[float]:
    """Return the member tensions [N] of the only self-stress, its largest cable tension being `prestress`.

    alike: (n_members,), a number for each member; members with the same number have the same tension in the
    self-stresses that are looked for. With the orbits of a symmetry these are the symmetrical ones, and with
    any self-stress that has all cables in tension there is a symmetrical one: the mean over the symmetry.
    Values are rounded to 13 significant digits, so that they do not depend on the linear algebra library.
    """
    if len(pairs) > MAX_MEMBERS:
        problem, location = "the shape has too many members to find its self-stress", f"{where}.prestress"
        allowed = f"up to {MAX_MEMBERS} members"
        raise StructureError(problem, where=location, given=len(pairs), allowed=allowed, hint=_HINT)
    modes = selfstress_modes(points, pairs, alike)
    if len(modes) != 1:
        kind = "independent" if alike is None else "independent symmetrical"
        problem = f"the free structure has {len(modes)} {kind} self-stresses at this geometry"
        location = f"{where}.prestress"
        allowed = "a geometry with exactly one self-stress (leave out `twist` for the default one)"
        raise StructureError(problem, where=location, given=prestress, allowed=allowed, hint=_HINT)
    cable = ~np.asarray(is_bar, dtype=bool)
    mode = modes[0] * np.sign(modes[0][cable].sum())
    if mode[cable].min() <= _TENSION_TOLERANCE * np.abs(mode).max():
        raise StructureError(
            f"the only self-stress leaves {int(np.sum(mode[cable] <= 0))} cables slack or without tension",
            where=f"{where}.prestress",
            given=prestress,
            allowed="a geometry whose self-stress has every cable in tension",
            hint=_HINT,
        )
    tension = mode * (prestress / mode[cable].max())
    return [float(f"{value:.12e}") for value in tension]
