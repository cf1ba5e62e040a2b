"""The result of searching equilibria of many cases: one row a case."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import ByName, Fact, Summarised, count_names, describe_range
from tensegrity_codegen.tables.static_methods import FOUND

WORDS = ("status", "message", "method", "displaced_node", "changed_node")
# Single numbers of each case, with what stands where there is none.
NUMBERS: dict[str, Any] = {
    "residual": np.nan,
    "largest_force": np.nan,
    "iterations": 0,
    "smallest_eigenvalue": np.nan,
    "neutral_motions": 0,
    "energy": np.nan,
    "energy_change": np.nan,
    "displacement": np.nan,
    "change": np.nan,
    "extent": np.nan,
    "is_start_unstable": False,
    "saddles_left": 0,
}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Equilibria(ByName, Summarised):
    """Results of the search for equilibria of many cases, each as of `Equilibrium`.

    Attributes
    ----------
    status, message, method : tuple of str
        Of each case: words as of an Equilibrium, and ``"non_finite_input"``.
    coordinate : ndarray, shape (n_batch, n_coordinates) [m]
        Free coordinates.
    node_position : ndarray, shape (n_batch, n_nodes, 3) [m]
        Positions of all nodes.
    member_length, member_tension : ndarray, shape (n_batch, n_members) [m, N]
        Lengths and tensions of members.
    residual, largest_force : ndarray, shape (n_batch,) [N]
        Largest node residual and largest member force.
    iterations : ndarray of int, shape (n_batch,)
        Number of iterations.
    smallest_eigenvalue : ndarray, shape (n_batch,) [N/m]
        Of the stiffness without neutral rigid motions.
    neutral_motions : ndarray of int, shape (n_batch,)
        Number of neutral rigid motions.
    energy, energy_change : ndarray, shape (n_batch,) [J]
        Potential energy, and its change from the start.
    displacement, change : ndarray, shape (n_batch,) [m]
        Largest distance of a node from its start; the same without neutral motions.
    displaced_node, changed_node : tuple of str
        Names of these nodes.
    extent : ndarray, shape (n_batch,) [m]
        Longest side of a box around the start.
    is_start_unstable : ndarray of bool, shape (n_batch,)
        Whether the start was an unstable equilibrium.
    saddles_left : ndarray of int, shape (n_batch,)
        Number of unstable equilibria that the search passed.
    internal : ndarray or None, shape (n_batch, n_internal) [m]
        Internal states of members and feet, settled; None without any.
    node_name, member_name : tuple of str
        Names.
    structure : Structure, BodySystem or None
        The structure; None with a library that was loaded alone.
    """

    status: tuple[str, ...]
    message: tuple[str, ...]
    method: tuple[str, ...]
    coordinate: FloatArray
    node_position: FloatArray
    member_length: FloatArray
    member_tension: FloatArray
    residual: FloatArray
    largest_force: FloatArray
    iterations: NDArray[np.int64]
    smallest_eigenvalue: FloatArray
    neutral_motions: NDArray[np.int64]
    energy: FloatArray
    energy_change: FloatArray
    displacement: FloatArray
    displaced_node: tuple[str, ...]
    change: FloatArray
    changed_node: tuple[str, ...]
    extent: FloatArray
    is_start_unstable: NDArray[np.bool_]
    saddles_left: NDArray[np.int64]
    node_name: tuple[str, ...]
    member_name: tuple[str, ...]
    structure: Structure | BodySystem | None = None
    internal: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.status)

    @property
    def is_found(self) -> NDArray[np.bool_]:
        """Whether a minimum of the energy was found in each case, (n_batch,)."""
        return np.array([status in FOUND for status in self.status])

    def headline(self) -> str:
        """Return how many cases there are, and how they ended."""
        counts = ", ".join(f"{count} {status}" for status, count in Counter(self.status).most_common())
        return f"{len(self)} cases: {counts}"

    def facts(self) -> list[Fact]:
        """Return ranges over all cases, for `repr` and notebooks."""
        return [
            ("tension", describe_range(self.member_tension, "N")),
            ("smallest eigenvalue", describe_range(self.smallest_eigenvalue, "N/m")),
            ("change", describe_range(self.change, "m")),
            ("residual", describe_range(self.residual, "N")),
            ("members", count_names(self.member_name)),
        ]


class EquilibriaTable:
    """Rows of results, filled one by one or many at a time; others keep their start `coordinate`."""

    def __init__(self, model: Model, coordinate: FloatArray) -> None:
        self.model, manifest, count = model, model.manifest, len(coordinate)
        nodes, members = len(manifest.node_name), len(manifest.member_name)
        shapes = {"node_position": (nodes, 3), "member_length": (members,), "member_tension": (members,)}
        self.arrays: dict[str, Any] = {
            name: np.full((count, *shape), np.nan) for name, shape in shapes.items()
        }
        self.arrays["coordinate"] = np.array(coordinate, dtype=np.float64)
        if manifest.internal_name:
            self.arrays["internal"] = np.full((count, len(manifest.internal_name)), np.nan)
        for name, empty in NUMBERS.items():
            kind = np.int64 if type(empty) is int else type(empty)
            self.arrays[name] = np.full(count, empty, dtype=kind)
        self.words: dict[str, Any] = {name: [""] * count for name in WORDS}

    def put(self, k: int, row: Equilibrium | tuple[str, str]) -> None:
        """Fill one row from its record, or from status and message where there is none."""
        if not isinstance(row, Equilibrium):
            self.words["status"][k], self.words["message"][k] = row
            return
        for name, array in self.arrays.items():
            array[k] = row.internal_argument.get(name, np.nan) if name == "internal" else getattr(row, name)
        for name, column in self.words.items():
            column[k] = getattr(row, name)

    def put_many(
        self, rows: NDArray[np.int64], arrays: Mapping[str, Any], columns: Mapping[str, Any]
    ) -> None:
        """Fill rows from arrays and lists of words by name."""
        for name, array in arrays.items():
            self.arrays[name][rows] = array
        for name, column in columns.items():
            for k, entry in zip(rows.tolist(), column, strict=True):
                self.words[name][k] = entry

    def build(self) -> Equilibria:
        """Return the results."""
        manifest = self.model.manifest
        texts: dict[str, Any] = {name: tuple(column) for name, column in self.words.items()}
        return Equilibria(
            **self.arrays,
            **texts,
            node_name=manifest.node_name,
            member_name=manifest.member_name,
            structure=getattr(self.model, "structure", None),
        )
