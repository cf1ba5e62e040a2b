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
