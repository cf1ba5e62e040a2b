"""Least mass of a structure that carries its loads: sections by force, proved by branch and bound."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.pipeline.forming.form import require_nodes
from tensegrity_codegen.pipeline.sizing.branch_and_bound import LeastForces, find_least_forces
from tensegrity_codegen.pipeline.sizing.force_program import ForceProgram
from tensegrity_codegen.pipeline.sizing.mass_gradient import find_mass_gradient, move_balance
from tensegrity_codegen.pipeline.sizing.member_mass import MassLaw, Material, find_mass_law
from tensegrity_codegen.pipeline.sizing.read_material import LoadCase, read_load_cases, read_material
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.scene.shapes.selfstress import equilibrium_matrix
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, check_switch, check_whole
from tensegrity_codegen.system.errors import (
    ConvergenceError,
    InfeasibleError,
    InvalidValueError,
    check_choice,
    name_list,
)
from tensegrity_codegen.system.summaries import (
    ByName,
    Fact,
    Summarised,
    count_names,
    describe_count,
    describe_range,
)
from tensegrity_codegen.tables.request import ModelRequest


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
        The structure with these sections, stiffnesses, masses, and rest lengths for the tensions of the
        first load case. Members without force are as in the scene, without tension.
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


MOST_PROVED = 40  # members, up to which the search goes on until the mass is proved
MOST_SPLITS, FEW_SPLITS = 20_000, 100  # by default, up to that many members and beyond
MAX_ROUNDS, SAME_MASS = 50, 1e-9  # with weights of members, until no node's changes by this part of all
ALTERNATES = 1e-6  # of the mass, by which it grows at most where designs that are as light take turns
MOST_FORCE = 100.0  # of the loads of a case in all: larger ones are those of a shape that hardly carries them
LEVER = "the shape hardly carries these; settle it under them, or move nodes"
LEAST_FORCE = 1e-9  # of the largest: smaller ones at nodes are rounding


def size_members(
    scene: str | Path | Mapping[str, Any] | Scene,
    *,
    youngs_modulus: float | Mapping[str, float] | None = None,
    density: float | Mapping[str, float] | None = None,
    yield_stress: float | Mapping[str, float] | None = None,
    load_cases: Mapping[str, Mapping[str, float | Sequence[float]]] | None = None,
    sections: Sequence[float] = (),
    column: Literal["euler", "johnson"] = "euler",
    bars_pull: bool = False,
    gap: float = 1e-6,
    max_splits: int | None = None,
) -> Sizing:
    """Find the sections with which a structure carries its loads at the least mass.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`: nodes, anchors, loads, members. Of the limits, `least_tension` and
        `most_tension` bound forces, `buckling` is the safety factor of bars (1 where not stated; false:
        they yield and do not buckle).
    youngs_modulus, density, yield_stress : float or mapping of str to float, optional
        Material [Pa, kg/m3, Pa]: of all members, or by member, group, class, ``"cables"``, ``"bars"`` or
        ``"all"``; what is stated of fewer members comes first. By default that of the scene: the modulus from
        stiffness and section, the density from mass and section, the limit `yield_stress`.
    load_cases : mapping, optional
        Forces [N] by node by case, added to the loads and weights of nodes in the scene; each section is the
        largest that a case needs. By default the loads of the scene are the only case. Numbers beside them:
        ``"loads"`` is the factor of the loads and weights of the scene (1), ``"weight"`` that of the weights
        of members (0), and one of a member, group, class or kind is the tension [N] that it has in the case:
        ``{"prestress": {"loads": 0, "top1": 500.0}, "snow": {"weight": 1.35, "n1": [0, 0, -1500.0]}}``.
    sections : sequence of float
        Areas [m2] of a catalogue, of which each member gets the smallest that holds; by default any.
    column : {"euler", "johnson"}
        Whether stocky bars yield at once, or buckle by Johnson's parabola above half of the yield stress.
    bars_pull : bool
        Whether bars may pull too.
    gap : float
        Relative difference between mass and bound at which the mass counts as proved.
    max_splits : int, optional
        Most intervals that the branch and bound splits; by default 20,000 up to 40 members, 100 beyond.

    Returns
    -------
    Sizing
        Forces, sections and masses, the bound, and derivatives by positions of nodes.

    Raises
    ------
    UnknownNameError, InvalidValueError
        A name that is none; a material that is missing or not above 0; no load and no least tension.
    InfeasibleError
        No forces of these signs balance the loads; the evidence has the nodes and a motion that proves it.
    ConvergenceError
        Neither forces in balance nor such a proof were found; weights of members that do not come to an end.
    FormulationError
        A structure of bodies, or on the ground.

    Notes
    -----
    With force f and length l a member that yields has the mass density ``l |f| / yield_stress``, a solid bar
    that buckles 2 density l^2 sqrt(f / (pi E)); a bar has the larger of both (R. E. Skelton and M. C. de
    Oliveira, "Tensegrity systems", 2009). Forces are those of the stated shape: A(x) t = load. A bar with an
    inner radius in the scene is a tube of the same ratio of radii. Weights of members, half at each end, are
    those of the sections found, repeated until they agree: the bound is for loads with these weights, and for
    any sections. Joints are not looked at. The least mass is often one in which the loads
    balance and no others would; `n_unstable` says where the structure would leave that balance.

    Examples
    --------
    >>> from tensegrity_codegen import size_members
    >>> steel = {"youngs_modulus": 2e11, "density": 7850.0, "yield_stress": 3e8}
    >>> found = size_members("two_nodes.toml", load_cases={"pull": {"n2": [0.0, 0.0, -100.0]}}, **steel)
    >>> found.status, found.limit
    ('optimal', ('yield',))
    """
    check_choice(column, ("euler", "johnson"), "formula of columns", "column")
    check_switch(bars_pull, "bars_pull")
    check_positive(gap, "gap")
    if max_splits is not None:
        check_whole(max_splits, "max_splits", 0)
    subject, request = load_scene(scene)
    structure = require_nodes(subject, "least mass")
    material = read_material(structure, youngs_modulus, density, yield_stress, column == "johnson")
    cases = read_load_cases(structure, load_cases)
    areas = _read_sections(structure, sections)
    law = find_mass_law(material, structure.member_length())
    splits = max_splits
    if splits is None:
        splits = MOST_SPLITS if structure.n_members <= MOST_PROVED else FEW_SPLITS
    member_mass = np.zeros(structure.n_members)
    for _ in range(MAX_ROUNDS):
        program, force, mass = _state_program(structure, law, cases, member_mass, bars_pull)
        optimum = find_least_forces(program, gap, splits)
        if optimum is None:
            raise _prove_infeasible(structure, program, tuple(cases), force)
        sized = _record(
            structure, request, material, law, program, optimum, tuple(cases), force, mass, gap, areas
        )
        change = np.abs(_carry(structure, sized.member_mass - member_mass)).max()
        if change <= SAME_MASS * sized.total_mass or not any(case.weight for case in cases.values()):
            return sized
        growth, member_mass = sized.total_mass - float(member_mass.sum()), sized.member_mass
    problem, hint = "heavier members need heavier ones", "a stronger or lighter material, or shorter members"
    if growth <= ALTERNATES * sized.total_mass:
        problem = "each design is the least under the weights of another, that is as light"
        hint = f"state the weights as loads of nodes, such as those of {sized.total_mass:.6g} kg in all"
    raise ConvergenceError(
        f"the weights of members do not come to an end: {problem}",
        evidence={"rounds": MAX_ROUNDS, "total_mass": sized.total_mass},
        where=structure.name,
        hint=hint,
    )


def _carry(structure: Structure, member_mass: FloatArray) -> FloatArray:
    """Return the mass of members that each free node carries, half of each member's [kg]."""
    carried = np.zeros(structure.n_nodes)
    for end in structure.connectivity.T:
        np.add.at(carried, end, 0.5 * member_mass)
    return np.asarray(carried[structure.coordinate_node_axis[:, 0]])


def _read_sections(structure: Structure, sections: Sequence[float]) -> FloatArray:
    """Return the areas of a catalogue in their order; raises InvalidValueError."""
    location = f"{structure.name}: sections"
    areas = np.unique(to_doubles(sections, location, "areas [m2]"))
    if not (np.isfinite(areas) & (areas > 0)).all():
        raise InvalidValueError(
            "not a section", where=location, given=list(sections), allowed="areas above 0 m2"
        )
    return areas


def _state_program(
    structure: Structure,
    law: MassLaw,
    cases: Mapping[str, LoadCase],
    member_mass: FloatArray,
    bars_pull: bool,
) -> tuple[ForceProgram, float, float]:
    """Return the program in multiples of a force [N] and a mass [kg], and these."""
    node, axis = structure.coordinate_node_axis.T
    matrix = equilibrium_matrix(structure.node_position, structure.connectivity)[3 * node + axis]
    limits = structure.limits
    lower = np.maximum(np.where(structure.is_bar, -np.inf, 0.0), limits.least_tension)
    upper = np.minimum(np.where(structure.is_bar & (not bars_pull), 0.0, np.inf), limits.most_tension)
    weight = _carry(structure, member_mass) * structure.gravity[axis]
    loads = np.stack([case.load[node, axis] + case.weight * weight for case in cases.values()])
    stated = np.stack([case.tension for case in cases.values()])
    lower, upper = (np.where(np.isnan(stated), limit, stated) for limit in (lower, upper))
    force = float(max(np.abs(loads).max(initial=0.0), np.abs(lower[np.isfinite(lower)]).max(initial=0.0)))
    if not force > 0:
        problem = "no load and no least tension, so that the least mass is nothing"
        value = "0 N at every free node"
        allowed = "a load on a node that is free, or a least tension of cables"
        hint = "state loads, or [limits] least_tension = 100"
        raise InvalidValueError(problem, where=structure.name, given=value, allowed=allowed, hint=hint)
    mass = float(law.direct.mean() * force)
    program = ForceProgram(matrix, loads / force, law.scale(force, mass), lower / force, upper / force)
    return program, force, mass


def _prove_infeasible(
    structure: Structure, program: ForceProgram, case_name: tuple[str, ...], force: float
) -> ConvergenceError:
    """Return the error with the nodes that cannot be in balance, and a motion where it proves it."""
    unbalanced = program.find_unbalanced(program.lower, program.upper)
    case = int(np.abs(unbalanced.residual).sum(axis=1).argmax())
    node, axis = structure.coordinate_node_axis.T
    residual, motion = np.zeros((2, structure.n_nodes, 3))
    residual[node, axis], motion[node, axis] = unbalanced.residual[case] * force, unbalanced.motion[case]
    size = np.linalg.norm(residual, axis=1)
    nodes = [structure.node_name[k] for k in np.flatnonzero(size > LEAST_FORCE * force)]
    where, speed = f"{structure.name}: load case {case_name[case]}", np.linalg.norm(motion, axis=1)
    if not unbalanced.is_proved:
        return ConvergenceError(
            "no forces of these members that balance the loads were found, nor a proof that there are none",
            where=where,
            evidence={"nodes": count_names(nodes), "unbalanced_force": float(size.sum())},
            hint="settle the structure under these loads with `equilibrium`, or move nodes a little: "
            "motions of it strain its members hardly",
        )
    weights = " with `gravity = [0, 0, 0]` (weights of members are no loads here unless a case states them)"
    weightless = weights if structure.member_mass.any() and any(structure.gravity) else ""
    moves = [k for k in np.argsort(-speed, kind="stable") if speed[k] > LEAST_FORCE]
    return InfeasibleError(
        "no forces of these members balance the loads",
        where=where,
        evidence={
            "nodes": count_names(nodes),
            "unbalanced_force": unbalanced.excess * force,
            "motion": {
                structure.node_name[k]: [round(x, 6) + 0.0 for x in motion[k].tolist()] for k in moves
            },
        },
        hint=f"settle the structure under these loads with `equilibrium`{weightless} and size that shape, "
        "add members or anchors, state fewer tensions, or let bars pull: `bars_pull=True`",
    )


def _record(
    structure: Structure,
    request: ModelRequest,
    material: Material,
    law: MassLaw,
    program: ForceProgram,
    found: LeastForces,
    case_name: tuple[str, ...],
    force: float,
    mass: float,
    gap: float,
    areas: FloatArray,
) -> Sizing:
    """Return the result in SI units, and the structure with its sections."""
    tension = found.tension * force
    needed = law.find_mass(tension)
    member_mass, governing = needed.max(axis=0), needed.argmax(axis=0)
    members = np.arange(structure.n_members)
    governs = tension[governing, members]
    is_yield = law.direct * np.abs(governs) >= law.find_buckling_mass(-governs) * (1 - LEAST_FORCE)
    # area = mass / (density length), radius = sqrt(area / (pi (1 - h^2))) with the ratio h of radii
    length = structure.member_length()
    area = member_mass / (material.density * length)
    used = member_mass > 0
    if len(areas):
        _check_largest(structure, area, areas)
        area = np.where(used, areas[np.searchsorted(areas, area * (1 - LEAST_FORCE))], 0.0)
        member_mass = area * material.density * length
    radius = np.sqrt(area / (np.pi * (1 - material.radius_ratio**2)))
    total = float(member_mass.sum())
    bound = min(found.bound * mass, total)
    status = "optimal" if total - bound <= gap * total else "local"
    unstable = max(_count_unstable(structure, program.matrix[:, tense != 0], tense) for tense in tension)
    limits = (program.lower * force, program.upper * force)
    gradient = find_mass_gradient(structure, law, tension, program.matrix, limits)
    held = _build(structure, material, area, radius, member_mass, tension[0], used)
    any_area = " with sections of any area" if len(areas) else ""
    proof = f"proved to {gap:.0e}" if status == "optimal" else f"proved {bound:.6g} kg{any_area}"
    spared = [structure.member_name[e] for e in np.flatnonzero(~used)]
    idle = f"; {describe_count(len(spared), 'member')} without force: {name_list(spared)}" if spared else ""
    size, loads = np.abs(found.tension).max(initial=0.0), np.abs(program.load).sum(axis=1).max(initial=1.0)
    excess = (
        f"; but forces are {size / loads:.4g} times all loads: {LEVER}" if size > MOST_FORCE * loads else ""
    )
    leaves = f"; not stable: {describe_count(unstable, 'motion')} without strain" if unstable else ""
    return Sizing(
        status=status,
        message=f"{total:.9g} kg, {proof} after {found.splits} splits{idle}{leaves}{excess}",
        case_name=case_name,
        member_tension=tension,
        force_density=tension / length,
        area=area,
        radius=radius,
        inner_radius=radius * material.radius_ratio,
        member_mass=member_mass,
        limit=tuple(np.where(used, np.where(is_yield, "yield", "buckling"), "none").tolist()),
        governing_case=tuple(case_name[k] if mine else "" for k, mine in zip(governing, used, strict=True)),
        total_mass=total,
        lower_bound=bound,
        gap=(total - bound) / total,
        mass_gradient=gradient,
        n_unstable=unstable,
        residual=float(np.abs(found.tension @ program.matrix.T - program.load).max(initial=0.0) * force),
        n_splits=found.splits,
        n_programs=program.count,
        structure=held,
        document=describe_structure(held, request),
    )


def _check_largest(structure: Structure, area: FloatArray, areas: FloatArray) -> None:
    """Raise InvalidValueError where members need more than the largest area of the catalogue."""
    beyond = np.flatnonzero(area > areas[-1] * (1 + LEAST_FORCE))
    if beyond.size:
        raise InvalidValueError(
            "no section of the catalogue holds some members",
            where=f"{structure.name}: {count_names([structure.member_name[e] for e in beyond])}",
            given=f"{areas[-1]:.6g} m2 at most",
            allowed=f"at least {area.max():.6g} m2",
            hint="add larger sections",
        )


def _count_unstable(structure: Structure, matrix: FloatArray, tension: FloatArray) -> int:
    """Return how many motions that strain no member with a force lower the energy [tension times length]."""
    node, axis = structure.coordinate_node_axis.T
    geometric = move_balance(structure, tension)[:, 3 * node + axis]
    motions = scipy.linalg.null_space(matrix.T)
    energy = np.linalg.eigvalsh(motions.T @ geometric @ motions)
    return int((energy < -LEAST_FORCE * np.abs(geometric).max(initial=0.0)).sum())


def _build(
    structure: Structure,
    material: Material,
    area: FloatArray,
    radius: FloatArray,
    member_mass: FloatArray,
    tension: FloatArray,
    used: Any,
) -> Structure:
    """Return the structure with these sections where members have mass, at rest with these tensions."""
    length = structure.member_length()
    outer = np.where(used, radius, structure.radius)
    stiff = used & np.isfinite(material.youngs_modulus) & ~structure.is_rigid
    sized = structure.with_changes(
        radius=outer,
        inner_radius=outer * material.radius_ratio,
        member_mass=np.where(used, member_mass, structure.member_mass),
        axial_stiffness=np.where(stiff, material.youngs_modulus * area, structure.axial_stiffness),
        spring_constant=np.where(stiff, 0.0, structure.spring_constant),
        node_velocity=np.zeros_like(structure.node_velocity),
        rest_length=length,
    )
    hint = "a larger modulus"
    return sized.with_changes(rest_length=sized.require_rest_length(length, tension, hint))
