"""The structures that the studies of node distances run on."""

from typing import Any

import numpy as np

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.tables.request import ModelRequest

# The three-link prism of S&K Fig. 1, free in space; the paper gives no data. Bars are 20 times as stiff as
# cables.
PRISM: dict[str, Any] = {
    "name": "free_prism",
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 4000.0},
        "cable": {"kind": "cable", "spring_constant": 200.0},
    },
    "shape": {
        "kind": "prism",
        "bars": 3,
        "bottom_radius": 0.15,
        "top_radius": 0.15,
        "height": 0.3,
        "node_mass": 0.5,
        "prestress": 10.0,
    },
}


def sample_prism(speed: float = 0.1, spread: float = 0.0, seed: int = 0) -> Structure:
    """Return a free three-bar prism near its equilibrium.

    Its nodes start with random velocities of about `speed` [m/s], and about `spread` [m] off equilibrium.
    """
    structure, _ = assemble(parse_scene(PRISM, "the prism of the study"), "the prism of the study")
    rng, shape = np.random.default_rng(seed), (structure.n_nodes, 3)
    velocity, shift = rng.normal(scale=speed, size=shape), rng.normal(scale=spread, size=shape)
    return structure.with_changes(
        node_velocity=velocity - velocity.mean(axis=0), node_position=structure.node_position + shift
    )


def sample_structure(n_nodes: int, kind: str = "sparse", seed: int = 0) -> Structure:
    """Return a free random structure of an even number of nodes; every cable has a rest-length input.

    kind "sparse": 2 n members as the prism has them, n/2 bars and 3 n/2 cables (a tree among them, so that
    all hangs together; n_nodes >= 6); kind "complete": all pairs, bars first.
    """
    rng = np.random.default_rng(seed)
    bars = [(k, k + 1) for k in range(0, n_nodes, 2)]
    links = [(int(rng.integers(k)), k) for k in range(2, n_nodes, 2)]
    pairs = [(i, j) for i in range(n_nodes) for j in range(i + 1, n_nodes)]
    others = [pair for pair in pairs if pair not in {*bars, *links}]
    count = 2 * n_nodes - len(bars) - len(links) if kind == "sparse" else len(others)
    chosen = [others[k] for k in np.sort(rng.permutation(len(others))[:count])]
    connectivity = np.array([*bars, *links, *chosen], dtype=np.int64)
    n_members = len(connectivity)
    is_bar = np.arange(n_members) < len(bars)
    position = rng.uniform(-1.0, 1.0, (n_nodes, 3))
    length = np.linalg.norm(position[connectivity[:, 0]] - position[connectivity[:, 1]], axis=1)
    strain = np.where(is_bar, -0.001, rng.uniform(0.01, 0.1, n_members))
    cables = np.flatnonzero(~is_bar)
    return Structure(
        name=f"random{n_nodes}",
        axes=(0, 1, 2),
        node_name=tuple(f"n{k}" for k in range(n_nodes)),
        node_position=position,
        node_velocity=np.zeros((n_nodes, 3)),
        node_mass=rng.uniform(0.2, 2.0, n_nodes),
        node_anchored=np.zeros((n_nodes, 3), dtype=bool),
        node_load=np.zeros((n_nodes, 3)),
        gravity=np.zeros(3),
        member_name=tuple(f"e{k}" for k in range(n_members)),
        member_class=tuple("bar" if bar else "cable" for bar in is_bar),
        connectivity=connectivity,
        is_bar=is_bar,
        tension_only=~is_bar,
        rest_length=length / (1.0 + strain),
        spring_constant=np.where(is_bar, 4000.0, 200.0),
        axial_stiffness=np.zeros(n_members),
        damping=np.zeros(n_members),
        member_mass=np.zeros(n_members),
        radius=np.zeros(n_members),
        inputs=tuple(ActuatedInput(f"u{k}", "rest_length", (int(e),)) for k, e in enumerate(cables)),
    )


def compile_in(structure: Structure, formulation: str, *quantities: str, **options: str) -> CompiledModel:
    """Return the compiled model in a formulation, fit for simulation, with some more quantities."""
    request = ModelRequest(
        (*simulation_quantities(formulation), *quantities),
        integrators=("rk4", "rk54"),
        formulation=formulation,
        options=options,
    )
    return build_library(structure, request).load()
