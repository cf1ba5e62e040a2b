"""Structures at their equilibrium, in a formulation that supports the search for it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import FEW_CALLS, build_library
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.applied_inputs import find_input_force
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.sliding import slip_rest_lengths
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.formulations import choose_formulation, find_formulation
from tensegrity_codegen.tables.request import ModelRequest

if TYPE_CHECKING:
    from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium

POINT_ANALYSES = {"equilibrium", "equilibria", "sensitivity", "linearize", "load_path", "analyse", "plan"}


def has_statics(request: ModelRequest) -> bool:
    """Return whether models of this request support find_equilibrium; node distances do not."""
    return find_formulation(request.formulation).has_statics and not is_corrected(request)


def with_statics(structure: Subject, request: ModelRequest) -> ModelRequest:
    """Return the request in a formulation that supports find_equilibrium, itself if it does."""
    # Bars with first-order correction are springs in the statics.
    if has_statics(request):
        return request
    rigid = isinstance(structure, Structure) and bool(structure.is_rigid.any())
    formulation = choose_formulation(rigid_bars=rigid).name
    return replace(request, formulation=formulation, integrators=(), options={})


def choose_request(structure: Subject, request: ModelRequest, analyses: Iterable[str]) -> ModelRequest:
    """Return the request in a formulation that serves these analyses, unless one of them is of motions."""
    chosen = set(analyses)
    served = has_statics(request) if chosen - {"linearize"} else not is_corrected(request)
    if served or not chosen or not chosen <= POINT_ANALYSES:
        return request
    return replace(with_statics(structure, request), quantities=())  # those are of its own formulation


def settle_structure(
    structure: Structure,
    request: ModelRequest,
    *,
    compiler: str | None = None,
    flags: str | None = None,
    warn: Callable[[str], None] | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> Structure:
    """Return the structure with its nodes in equilibrium."""
    from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium

    statics = with_statics(structure, request)
    moved, offset = move_near_origin(structure, request)
    needs = find_needs("equilibrium", moved, statics).alone(statics)
    model = build_library(moved, needs, compiler=compiler, flags=flags, calls=FEW_CALLS).load()
    equilibrium = find_equilibrium(model, arguments=arguments)
    if warn is not None:
        for warning in equilibrium.warnings:
            warn(warning)
    return structure.with_changes(node_position=equilibrium.node_position + offset)


def find_settled(
    subject: Subject,
    request: ModelRequest,
    *,
    warn: Callable[[str], None] | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> "tuple[Subject, Equilibrium]":
    """Return the structure or bodies at rest at the equilibrium, and the equilibrium at its place."""
    from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium

    statics = with_statics(subject, request)
    moved, offset = move_near_origin(subject, request)
    needs = find_needs("equilibrium", moved, statics).alone(statics)
    model = build_library(moved, needs, calls=FEW_CALLS).load()
    equilibrium = find_equilibrium(model, arguments=arguments)
    if warn is not None:
        for warning in equilibrium.warnings:
            warn(warning)
    equilibrium = move_back(equilibrium, subject, offset)
    settled: Subject
    if isinstance(subject, Structure):
        still = np.zeros_like(subject.node_position)
        rest_length = slip_rest_lengths(subject.sliding, subject.rest_length, equilibrium.slid)
        settled = subject.with_changes(
            node_position=equilibrium.node_position, node_velocity=still, rest_length=rest_length
        )
    else:
        coordinate = equilibrium.coordinate
        settled = subject.with_changes(coordinate=coordinate, velocity=np.zeros_like(coordinate))
    return settled, equilibrium


def move_near_origin(structure: Subject, request: ModelRequest) -> tuple[Any, NDArray[np.float64]]:
    """Return the structure for its statics, near the origin, and the motion back (3,) [m]."""
    # Coordinates of node distances keep their digits far from the origin; node positions, in which the
    # equilibrium is found, do not. An axis is moved where all positions are farther from zero than twice
    # the extent of the structure.
    on_ground = getattr(structure, "ground", None) is not None
    if not isinstance(structure, Structure) or on_ground or find_formulation(request.formulation).has_statics:
        return structure, np.zeros(3)
    position = structure.node_position
    is_far = np.abs(position).min(axis=0) > 2.0 * np.ptp(position, axis=0)
    offset = np.where(is_far, position[0], 0.0)
    return structure.with_changes(node_position=position - offset), offset


def move_back(
    found: "Equilibrium",
    structure: Subject,
    offset: NDArray[np.float64],
    added: NDArray[np.float64] | float = 0.0,
    inputs: Mapping[str, float] | None = None,
) -> "Equilibrium":
    """Return the equilibrium of a structure that was moved near the origin, at its place."""
    # Energies count from the origin, with loads added (n_nodes, 3) [N] to those of the structure.
    if isinstance(structure, BodySystem) or not offset.any():
        return found
    force = (structure.node_load + added).sum(axis=0) + structure.total_mass * structure.gravity
    force += find_input_force(structure, inputs or {}).sum(axis=0)
    return replace(found, node_position=found.node_position + offset, energy=found.energy - force @ offset)


def is_corrected(request: ModelRequest) -> bool:
    """Return whether the lengths of rigid bars follow their tensions (first-order correction)."""
    return request.options.get("correction") == "first_order"
