"""The record of a shape in balance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import ByName, Fact, Summarised, describe_range


@dataclass(frozen=True, repr=False)
class Form(ByName, Summarised):
    """A shape in balance.

    Attributes
    ----------
    status : str
        ``"stable"``; ``"unstable"``: forces balance, and the structure with its stiffnesses leaves the shape.
    message : str
        A sentence.
    node_position : ndarray, shape (n_nodes, 3) [m]
        Positions.
    member_length, member_tension, force_density, rest_length : ndarray, shape (n_members,)
        Lengths [m], tensions [N], tensions over lengths [N/m], and rest lengths that hold them [m].
    residual, largest_force : float
        Largest force that is not balanced at a node, and largest tension [N].
    proof : str
        Why it is stable, or is not.
    structure : Structure
        The structure in this shape, at rest, with these rest lengths.
    document : mapping
        The same as a scene.
    """

    status: str
    message: str
    node_position: FloatArray
    member_length: FloatArray
    member_tension: FloatArray
    force_density: FloatArray
    rest_length: FloatArray
    residual: float
    largest_force: float
    proof: str
    structure: Structure
    document: Mapping[str, Any]

    @property
    def node_name(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return self.structure.node_name

    @property
    def member_name(self) -> tuple[str, ...]:
        """Names of the members."""
        return self.structure.member_name

    @property
    def load_path(self) -> float:
        """Sum of ``|tension| length`` over all members [N m]."""
        return float(np.abs(self.member_tension) @ self.member_length)

    def as_evidence(self) -> dict[str, Any]:
        """Return all results by name, JSON-ready."""
        rows = zip(
            self.member_name,
            self.member_length,
            self.member_tension,
            self.force_density,
            self.rest_length,
            strict=True,
        )
        heads = ("length", "tension", "force_density", "rest_length")
        return {
            "status": self.status,
            "message": self.message,
            "proof": self.proof,
            "residual": self.residual,
            "largest_force": self.largest_force,
            "load_path": self.load_path,
            "node_position": dict(zip(self.node_name, self.node_position.tolist(), strict=True)),
            "members": {name: dict(zip(heads, map(float, values), strict=True)) for name, *values in rows},
        }

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}: {self.message}"

    def facts(self) -> list[Fact]:
        """Return tensions, rest lengths and what is left of balance."""
        return [
            ("tension", describe_range(self.member_tension, "N")),
            ("rest length", describe_range(self.rest_length, "m")),
            ("residual", f"{self.residual:.3g} N of {self.largest_force:.6g} N"),
        ]
