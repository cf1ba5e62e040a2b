"""Compiled models for tests, one call each; where the example scenes are."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "tensegrity_codegen" / "scene" / "examples"

# A stiff bar that hangs from an anchor, its end held by a soft cable.
STIFF_PENDULUM: dict[str, Any] = {
    "name": "pendulum",
    "axes": "xz",
    "gravity": [0, -9.81],
    "nodes": {
        "a": {"position": [0.0, 0.0], "anchored": True},
        "b": {"position": [0.6, -0.8], "mass": 2.0},
        "c": {"position": [1.6, -0.8], "anchored": True},
    },
    "members": {
        "bar": {"kind": "bar", "nodes": ["a", "b"], "spring_constant": 2e6, "rest_length": 1.0},
        "cable": {"kind": "cable", "nodes": ["b", "c"], "spring_constant": 100.0, "rest_length": 0.9},
    },
}


def load(subject: Structure | BodySystem, *quantities: str, **request: Any) -> CompiledModel:
    """Return the library of these quantities; request: further fields, events are "auto" by default."""
    return build_library(subject, ModelRequest(quantities, **{"events": AUTO_EVENTS, **request})).load()


def simulator(
    subject: Structure | BodySystem, *integrators: str, more: tuple[str, ...] = (), **request: Any
) -> CompiledModel:
    """Return the library of what simulations need and of `more` quantities, with these integrators."""
    quantities = simulation_quantities(request.get("formulation", "node_position"))
    return load(subject, *quantities, *more, integrators=integrators, **request)


def start_of(model: CompiledModel) -> NDArray[np.float64]:
    """Return coordinates and velocities of the scene as one state."""
    return np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
