"""Materials and load cases by name, and what a scene states of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.pipeline.forming.targets import find_members
from tensegrity_codegen.pipeline.sizing.member_mass import Material
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.checks import check_mapping, is_number
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    NonFiniteError,
    check_choice,
)
from tensegrity_codegen.system.summaries import count_names

ALL = "all"
WORDS = {"youngs_modulus": "Young's modulus", "density": "density", "yield_stress": "yield stress"}
HINTS = {
    "youngs_modulus": "`youngs_modulus=2e11` [Pa], or radius and axial_stiffness of bars in the scene",
    "density": "`density=7850` [kg/m3], or radius and density of bars in the scene",
    "yield_stress": "`yield_stress=235e6` [Pa], or radius and limits.yield_stress in the scene",
}


def read_material(
    structure: Structure,
    youngs_modulus: float | Mapping[str, float] | None,
    density: float | Mapping[str, float] | None,
    yield_stress: float | Mapping[str, float] | None,
    johnson: bool,
) -> Material:
    """Return the material of each member; raises UnknownNameError and InvalidValueError."""
    outer = structure.radius
    inner = np.zeros_like(outer) if structure.inner_radius is None else structure.inner_radius
    section = np.pi * (outer**2 - inner**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        modulus = (structure.axial_stiffness + structure.spring_constant * structure.rest_length) / section
        own_density = structure.member_mass / (section * structure.member_length())
        ratio = np.where(outer > 0, inner / outer, 0.0)
    yields = structure.limits.yield_stress
    everyone = np.ones(structure.n_members, dtype=bool)
    buckles = structure.is_bar & (structure.limits.buckling >= 0)
    return Material(
        youngs_modulus=_read(structure, "youngs_modulus", youngs_modulus, modulus, buckles),
        density=_read(structure, "density", density, own_density, everyone),
        yield_stress=_read(structure, "yield_stress", yield_stress, yields, everyone),
        safety_factor=np.maximum(structure.limits.buckling, 1.0),
        radius_ratio=ratio,
        buckles=buckles,
        johnson=johnson,
    )


@dataclass(frozen=True)
class LoadCase:
    """One load case: load (n_nodes, 3) [N]; weight: factor of the weights of members; tension (n_members,)
    [N] that members have in it, nan where it is any."""

    load: FloatArray
    weight: float
    tension: FloatArray


def read_load_cases(
    structure: Structure, given: Mapping[str, Mapping[str, float | Sequence[float]]] | None
) -> dict[str, LoadCase]:
    """Return the load cases by name; raises UnknownNameError and InvalidValueError."""
    load_cases = {}
    cases = check_mapping(given, "load_cases", "forces by node by case") or {"scene": {}}
    for case, loads in cases.items():
        load = structure.node_load + structure.node_mass[:, None] * structure.gravity
        stated = check_mapping(loads, f"load_cases.{case}", "forces by node")
        numbers = {n: v for n, v in stated.items() if is_number(v) and n not in structure.node_name}
        load, weight = numbers.pop("loads", 1.0) * load, numbers.pop("weight", 0.0)
        tension = np.full(structure.n_members, np.nan)
        members = {name: find_members(structure, name, f"load_cases.{case}") for name in numbers}
        for name in sorted(numbers, key=lambda name: -members[name][1]):
            tension[members[name][0]] = numbers[name]
        for name, force in stated.items():
            if is_number(force) and name not in structure.node_name:
                continue
            location = f"{structure.name}: load_cases.{case}.{name}"
            check_choice(name, structure.node_name, "node", location)
            value = to_doubles(force, location, "three numbers [N]")
            if value.shape != (3,):
                raise InvalidValueError(
                    "not a force", where=location, given=force, allowed="three numbers [N]"
                )
            if not np.isfinite(value).all():
                problem = "not finite"
                raise NonFiniteError(problem, where=location, given=force, allowed="three finite numbers [N]")
            load[structure.node_name.index(name)] += value
        load_cases[case] = LoadCase(load, weight, tension)
    return load_cases


def _read(
    structure: Structure,
    word: str,
    given: float | Mapping[str, float] | None,
    own: FloatArray,
    needed: BoolArray,
) -> FloatArray:
    """Return the value of each member: what is given, else what the scene states; nan where not known."""
    value = np.where(np.isfinite(own) & (own > 0), own, np.nan)
    rank = np.full(structure.n_members, 9)  # behind all that can be stated
    stated = given if isinstance(given, Mapping) else {} if given is None else {ALL: given}
    for name, number in stated.items():
        if not is_number(number) or number <= 0:
            problem, location = f"not a {WORDS[word]}", f"{structure.name}: {word}"
            allowed = "a finite number above 0"
            raise InvalidValueError(problem, where=location, given=f"{name} = {number!r}", allowed=allowed)
        members, order = find_members(structure, name, word) if name != ALL else (range(len(rank)), 8)
        for e in members:
            if order == rank[e]:
                raise DuplicateNameError(
                    "two statements of one member",
                    where=f"{structure.name}: {word}",
                    given=f"{name}, and another one of {structure.member_name[e]}",
                    allowed="one, or another one of fewer members",
                )
            if order < rank[e]:
                value[e], rank[e] = number, order
    missing = np.flatnonzero(needed & np.isnan(value))
    if missing.size:
        raise InvalidValueError(
            f"no {WORDS[word]} of some members",
            where=f"{structure.name}: {word}",
            given=count_names([structure.member_name[e] for e in missing]),
            allowed="one of each of them",
            hint=HINTS[word],
        )
    return value
