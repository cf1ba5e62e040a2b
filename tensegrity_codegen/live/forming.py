"""A net inside a page whose force densities are moved by sliders, and whose shape is found there."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.live.channels import pack
from tensegrity_codegen.live.live_scene import LiveScene
from tensegrity_codegen.pipeline.forming.force_density import static_load
from tensegrity_codegen.pipeline.forming.formed import Form
from tensegrity_codegen.pipeline.forming.statements import find_members
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import count_names

FACT = (
    "The shape follows from the force densities, tension over length, by linear equations that this page "
    "solves (Schek 1974). Rest lengths are those that give each member its tension."
)


def add_forming(scene: LiveScene, found: Form, density: Mapping[str, float]) -> LiveScene:
    """Return a live scene of a shape whose force densities, loads and heights of supports have sliders.

    scene: the page of the shape; found: the shape at the stated force densities; density: the force densities
    [N/m], as in `form`; each has a slider over its members.
    Raises InvalidValueError: a member without a stated force density, whose shapes follow from other
    equations.
    """
    structure = found.structure
    group, rank = np.full(structure.n_members, -1), np.full(structure.n_members, 9)
    for k, name in enumerate(density):
        members, order = find_members(structure, name, "density")
        chosen = [e for e in members if order < rank[e]]
        group[chosen], rank[chosen] = k, order
    if (group < 0).any():
        raise InvalidValueError(
            "a page of shapes needs the force density of every member",
            where=structure.name,
            given=f"none of {count_names([structure.member_name[e] for e in np.flatnonzero(group < 0)])}",
            allowed="a force density of each member",
            hint="--density cables=100; shapes of stated forces and lengths are written as scenes (.toml)",
        )
    forming = {
        "groups": [{"label": name, "density": value} for name, value in density.items()],
        "document": found.document,
    }
    linear = structure.is_linear
    channels = {name: item for name, item in scene.channels.items() if name != "use"} | {
        "form_order": pack(_order_nodes(structure), "int32"),
        "form_group": pack(group, "int32"),
        "form_position": pack(structure.node_position.ravel(), "float64"),
        "form_weight": pack((static_load(structure) - structure.node_load).ravel(), "float64"),
        "axial_stiffness": pack(structure.axial_stiffness, "float64"),
        "spring_constant": pack(np.where(linear, structure.spring_constant, np.nan), "float64"),
    }
    return replace(
        scene, data={**scene.data, "forming": forming}, channels=channels, facts=(FACT, *scene.facts)
    )


def _order_nodes(structure: Structure) -> Any:
    """Return the nodes in an order in which neighbours are near to each other (Cuthill and McKee)."""
    i, j = structure.connectivity.T
    n = structure.n_nodes
    graph = scipy.sparse.csr_array((np.ones(len(i)), (i, j)), shape=(n, n))
    return scipy.sparse.csgraph.reverse_cuthill_mckee(scipy.sparse.csr_array(graph + graph.T), True)
