"""The record of the least mass of a structure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import ByName, Fact, Summarised, describe_range


@dataclass(frozen=True, repr=False)
class Sizing(ByName, Summarised):
    """Sections of members with which a structure carries its loads at the least mass.

    Attributes
    ----------
    status : str
        ``"optimal"``: no forces that balance the loads need less mass, up to `gap`; ``"local"``: the best
        that was found, and `lower_bound` is what is proved.
    message : str
        A sentence.
    case_name : tuple of str
        Names of the load cases.
    member_tension, force_density : ndarray, shape (n_cases, n_members) [N, N/m]
        Tensions, below 0 in bars that push, and tensions over lengths.
    area, radius, inner_radius, member_mass : ndarray, shape (n_members,) [m2, m, m, kg]
        Sections and masses; 0 where no case needs the member.
    limit : tuple of str
        What decides each section: ``"yield"``, ``"buckling"``, ``"none"`` where the member has no force.
    governing_case : tuple of str
        The load case that decides each section, empty without force.
    total_mass, lower_bound : float [kg]
        Mass of all members, and the mass below which none can be: proved by the multipliers of linear
        programs, whatever the tolerances of their solver are.
    gap : float
        (total_mass - lower_bound) / total_mass.
    mass_gradient : ndarray, shape (n_nodes, 3) [kg/m]
        Derivatives of the least mass by positions of nodes, loads constant; nan where there are none: moving
        the node needs a force in a member without mass, or cannot be balanced, or along axes that are not
        modelled.
    n_unstable : int
        Motions that strain no member with a force and lower the energy, of the load case that has most: above
        0 the structure leaves the balance, whatever its stiffnesses are. Members without force do not count.
    residual : float [N]
        Largest force out of balance.
    n_splits, n_programs : int
        Intervals split by the branch and bound, and linear programs solved.
    structure : Structure
        The structure with these sections, stiffnesses, masses of bars, and rest lengths for the tensions of
        the first load case. Members without mass are as in the scene, without tension.
    document : mapping
        The same as a scene.
    """

    status: str
    message: str
    case_name: tuple[str, ...]
    member_tension: FloatArray
    force_density: FloatArray
    area: FloatArray
    radius: FloatArray
    inner_radius: FloatArray
    member_mass: FloatArray
    limit: tuple[str, ...]
    governing_case: tuple[str, ...]
    total_mass: float
    lower_bound: float
    gap: float
    mass_gradient: FloatArray
    n_unstable: int
    residual: float
    n_splits: int
    n_programs: int
    structure: Structure
    document: Mapping[str, Any]

    @property
    def node_name(self) -> tuple[str, ...]:
        """Names of the nodes."""
        return self.structure.node_name

    @property
    def node_position(self) -> FloatArray:
        """Positions of the nodes, (n_nodes, 3) [m]."""
        return self.structure.node_position

    @property
    def member_name(self) -> tuple[str, ...]:
        """Names of the members."""
        return self.structure.member_name

    def as_evidence(self) -> dict[str, Any]:
        """Return all results by name, JSON-ready."""
        members = {}
        for e, name in enumerate(self.member_name):
            members[name] = {
                "tension": dict(zip(self.case_name, self.member_tension[:, e].tolist(), strict=True)),
                "force_density": dict(zip(self.case_name, self.force_density[:, e].tolist(), strict=True)),
                "area": float(self.area[e]),
                "radius": float(self.radius[e]),
                "inner_radius": float(self.inner_radius[e]),
                "mass": float(self.member_mass[e]),
                "limit": self.limit[e],
                "governing_case": self.governing_case[e],
            }
        gradient = [[None if x != x else x for x in row] for row in self.mass_gradient.tolist()]
        numbers = ("total_mass", "lower_bound", "gap", "n_unstable", "residual", "n_splits", "n_programs")
        return {
            "status": self.status,
            "message": self.message,
            **{name: getattr(self, name) for name in numbers},
            "members": members,
            "mass_gradient": dict(zip(self.node_name, gradient, strict=True)),
        }

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}: {self.message}"

    def facts(self) -> list[Fact]:
        """Return masses and sections."""
        return [
            ("proved at least", f"{self.lower_bound:.9g} kg"),
            ("mass of members", describe_range(self.member_mass, "kg")),
            ("radius", describe_range(self.radius[self.radius > 0], "m")),
            ("tension", describe_range(self.member_tension, "N")),
        ]
