"""Two structures for the tests of generated code: one with everything there is, one with nothing extra."""

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest
from tests.runtime.build import bar, cable, make_structure, spring


def all_parameters(structure: Structure) -> dict[str, tuple[int, ...]]:
    """Return every parameter over all members or nodes that have it."""
    nodes, members = tuple(range(structure.n_nodes)), tuple(range(structure.n_members))
    anchored = structure.node_anchored.any(axis=1)
    found = {
        "rest_length": members,
        "spring_constant": tuple(int(e) for e in np.flatnonzero(structure.spring_constant)),
        "axial_stiffness": tuple(int(e) for e in np.flatnonzero(structure.axial_stiffness)),
        "damping": members,
        "node_mass": tuple(int(n) for n in np.flatnonzero(structure.node_mass)),
        "node_load": nodes,
        "anchor_position": tuple(int(n) for n in np.flatnonzero(anchored)),
    }
    return {name: items for name, items in found.items() if items} | {"gravity": ()}


def offered(structure: Structure, request: ModelRequest) -> dict[str, PrunedFunction]:
    """Return every quantity that has an entry in this structure, pruned."""
    model = build_model(structure, request)
    functions = {}
    for name in model.quantities:
        try:
            (functions[name],) = prune(model, (name,))
        except FormulationError:
            continue
    return functions


@functools.cache
def everything() -> tuple[Structure, ModelRequest]:
    """A braced tetrahedron with every feature, every parameter, every quantity and the integrator."""
    position = [[0, 0, 0], [1, 0, 0.1], [0.2, 1, 0], [0.4, 0.3, 1.1]]
    members = [
        bar(0, 3, 1.19, 900.0, mass=0.3, damping=0.5),
        bar(2, 3, 1.31, 0.0, axial=700.0, mass=0.2),
        cable(0, 1, 0.93, damping=0.4),
        cable(1, 2, 1.22, 0.0, axial=90.0),
        cable(3, 1, 1.02),
        cable(0, 2, 1.2, damping=0.3),  # slack
    ]
    inputs = (
        ActuatedInput("wind", "rest_length", (3, 4)),
        ActuatedInput("thrust", "force", (3,), (0.0, 0.6, 0.8)),
    )
    structure = make_structure(
        position,
        members,
        anchored={0: "xyz", 1: "z"},
        gravity=(0.1, 0.0, -9.81),
        load={3: (0.5, 0.0, -1.0)},
        mass=[0.0, 0.7, 0.4, 0.9],
        inputs=inputs,
    )
    velocity = np.where(structure.node_anchored, 0.0, np.linspace(-0.5, 0.7, 12).reshape(4, 3))
    structure = structure.with_changes(name="braced", node_velocity=velocity)
    request = ModelRequest(
        (),
        parameters=all_parameters(structure),
        integrators=("rk4", "rk54", "rk853", "radau"),
        events=AUTO_EVENTS,
    )
    return structure, request.wanting(*offered(structure, request), integrators=request.integrators)


def in_single_precision(
    subject: Callable[[], tuple[Structure, ModelRequest]],
) -> tuple[Structure, ModelRequest]:
    """The subject in single precision, without what needs double precision."""
    structure, request = subject()
    integrators = tuple(name for name in request.integrators if name != "radau")
    return structure, replace(request, precision="single", integrators=integrators)


def bare() -> tuple[Structure, ModelRequest]:
    """A planar triangle of two-sided springs, nothing anchored, nothing changeable."""
    members = [spring(0, 1, 0.9), spring(1, 2, 1.1), spring(2, 0, 1.0)]
    structure = make_structure([[0, 0, 0], [1, 0, 0], [0.5, 0, 0.8]], members, axes="xz")
    return structure.with_changes(name="triangle"), ModelRequest(("member_tension", "acceleration"))
