"""A held and loaded prism, whose loads and two rest lengths are arguments of single calls and of batches."""

from typing import Any

from tensegrity_codegen.runtime.model.model import CompiledModel
from tests.models import load
from tests.runtime.build import prism

QUANTITIES = ("member_tension", "node_force", "total_energy", "tangent_stiffness", "acceleration")


def loaded_prism(*quantities: str, batch_width: int = 8, **request: Any) -> CompiledModel:
    structure = prism(150.0, anchored={0: "xyz"}, load={3: (0.0, 0.0, -1.0), 4: (0.5, 0.0, 0.0)})
    parameters = {"node_load": (3, 4), "rest_length": (1, 2)}
    return load(
        structure, *(quantities or QUANTITIES), parameters=parameters, batch_width=batch_width, **request
    )
