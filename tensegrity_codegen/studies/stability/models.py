"""The compiled models of a structure's cases: springs, rigid bars, and a second opinion on stiff bars."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.accuracy.choice import integrators_for
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.changes import as_springs, with_rigid_bars, with_springs
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.formulations import choose_formulation, find_formulation
from tensegrity_codegen.tables.request import ModelRequest

AUTO = "auto"
EXPLICIT = ("rk853", "rk54")
FOR_STIFF_BARS = "radau"
FIXED = "rk4"
OF_MEMBERS = ("rest_length", "spring_constant", "damping")


class CaseModels:
    """The models of one structure, each compiled when first needed; they may raise TensegrityError."""

    def __init__(self, structure: Structure, *, compiler: str | None, flags: str) -> None:
        self.structure, self.compiler, self.flags = structure, compiler, flags
        self._made: dict[tuple[bool, tuple[str, ...]], CompiledModel] = {}

    def of(self, case: Case, method: str = "") -> CompiledModel:
        """Return the model that a case is for, all its members springs or the bars rigid.

        That of the method auto holds the integrators that the verb simulate would compile for the case alone,
        all others every integrator.
        """
        formulation = choose_formulation(rigid_bars=case.is_rigid).name
        structure = as_springs(self.structure) if case.is_rigid else with_springs(self.structure)
        if case.is_rigid and not structure.is_rigid.any():
            structure = with_rigid_bars(structure)
        integrators = (*list_integrators(structure), FIXED)
        if method == AUTO:
            integrators = integrators_for(AUTO, case.structure, formulation, case.rtol)
        key = (case.is_rigid, integrators)
        if key not in self._made:
            self._made[key] = self._compile(structure, formulation, integrators)
        return self._made[key]

    def corrected(self, case: Case) -> CompiledModel:
        """Return a model of just this case, its bars rigid but for the first order of their stretch."""
        extra = ("consistent_coordinate", "consistent_velocity")
        request = ModelRequest(
            (*simulation_quantities("rigid_bar"), *extra),
            formulation="rigid_bar",
            integrators=("rk853",),
            options={"bars": "all", "correction": "first_order"},
        )
        return self._build(case.structure, request)

    def _compile(self, structure: Structure, formulation: str, integrators: tuple[str, ...]) -> CompiledModel:
        """Return the model that keeps changeable whatever differs between cases."""
        flexible = tuple(int(e) for e in np.flatnonzero(~structure.is_rigid))
        anchored = structure.node_anchored.any(axis=1)
        massive = structure.node_mass > 0
        massive[structure.coordinate_node_axis[0, 0]] |= not massive.any()
        kept = {
            "rest_length": tuple(range(structure.n_members)),
            "spring_constant": flexible,
            "damping": flexible,
            "node_mass": tuple(int(n) for n in np.flatnonzero(massive)),
            "anchor_position": tuple(int(n) for n in np.flatnonzero(anchored)),
        }
        rigid = find_formulation(formulation).has_rigid_bars
        extra = ("consistent_coordinate", "consistent_velocity") if rigid else ()
        request = ModelRequest(
            (*simulation_quantities(formulation), *extra),
            formulation=formulation,
            parameters={name: items for name, items in kept.items() if items},
            integrators=integrators,
        )
        return self._build(structure, request)

    def _build(self, structure: Structure, request: ModelRequest) -> CompiledModel:
        request = replace(request, emitter="auto")
        return build_library(structure, request, compiler=self.compiler, flags=self.flags).load()


def list_methods(structure: Structure) -> tuple[str, ...]:
    """Return our methods with error control that a structure can have, `auto` first."""
    return (AUTO, *list_integrators(structure))


def list_integrators(structure: Structure) -> tuple[str, ...]:
    """Return the integrators with error control that a structure can have."""
    free = ~np.all(structure.node_anchored[:, list(structure.axes)], axis=1)
    moves = np.any(free[structure.connectivity], axis=1)
    is_stiff = bool((structure.is_mixed & moves).any())
    return (*EXPLICIT, FOR_STIFF_BARS) if is_stiff else EXPLICIT


def values_of(model: CompiledModel, structure: Structure) -> Mapping[str, FloatArray]:
    """Return what the model needs to be this structure: state and run-time parameters."""
    places, axes = structure.coordinate_node_axis, list(structure.axes)
    found = {
        "coordinate": structure.node_position[places[:, 0], places[:, 1]],
        "velocity": structure.node_velocity[places[:, 0], places[:, 1]],
    }
    node = {name: index for index, name in enumerate(structure.node_name)}
    member = {name: index for index, name in enumerate(structure.member_name)}
    for argument in model.manifest.arguments:
        if argument.name == "anchor_position":
            found["anchor_position"] = structure.node_position[[node[n] for n in argument.over]][:, axes]
        elif argument.name == "node_mass":
            found["node_mass"] = structure.node_mass[[node[n] for n in argument.over]]
        elif argument.name in OF_MEMBERS:
            found[argument.name] = getattr(structure, argument.name)[[member[e] for e in argument.over]]
    return found
