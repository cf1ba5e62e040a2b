"""Plans of several structures, in twice the shortest duration, followed by the full model in C."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.control.feedback.time_motion import time_motion
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tests.control.feedback.structures import compile_motion
from tests.control.planning.structures import (
    actuate,
    build_icosahedron,
    build_prism,
    build_tower,
    limit,
)


def dampen(structure: Any, mass: float = 0.05, damping: float = 5.0) -> Any:
    """Return the structure with masses at all nodes, damped members, limits and motors of 0.05 m/s."""
    moving = structure.with_changes(
        node_mass=np.full(structure.n_nodes, mass), damping=np.full(structure.n_members, damping)
    )
    return limit(actuate(moving, rate=0.05))


def build(name: str) -> tuple[Any, str]:
    """Return a structure of the tests of plans, and a target."""
    if name == "icosahedron":
        structure, facet = build_icosahedron()
        return dampen(structure, mass=0.2), f"past_edge({facet[0]}, {facet[1]})=10mm"
    kind, target = name.split()
    if kind == "tower":
        return dampen(build_tower()), target
    return dampen(build_prism(150.0, opposite=False) if kind == "prism9" else build_prism(155.0)), target


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("prism12 twist=165", marks=pytest.mark.thorough),  # as the verb plan's test of motions
        pytest.param("prism9 tilt=10", marks=pytest.mark.thorough),
        pytest.param("prism9 height=0.25", marks=pytest.mark.thorough),
        pytest.param("icosahedron", marks=pytest.mark.thorough),
        pytest.param("tower tilt=20", marks=pytest.mark.thorough),
        pytest.param("tower tilt=60", marks=pytest.mark.thorough),
    ],
)
def test_the_motion_ends_at_the_plan(name: str) -> None:
    structure, target = build(name)
    model = compile_motion(structure)
    found = plan(model, target)
    assert found.status == "found", found.message
    motion = time_motion(model, found, 2 * time_motion(model, found, samples=51).duration)
    run = simulate(
        model, motion.duration, schedule=motion.profile(), coordinate=motion.coordinate[0], samples=201
    )
    assert run.status == "ok", run.message
    end = np.abs(run.node_position[-1] - found.node_position[-1]).max()
    # Prisms of 9 cables and towers have mechanisms, whose motion needs forces that no tensions produce.
    assert bool(motion.warnings) == name.startswith(("prism9", "tower"))
    assert motion.residual.max() < 0.005
    assert end < (1e-3 if name.startswith("tower") else 1e-6)
    assert np.abs(run.coordinate - motion.coordinate).max() < (2e-3 if name.startswith("tower") else 1e-5)
