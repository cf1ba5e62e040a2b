"""Libraries of a triangle that falls on the ground, slides and sticks, shared by these tests."""

import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.model.model import CompiledModel
from tests.codegen.quickly import without_optimisation
from tests.symbolic.test_jacobians import TRIANGLE


@pytest.fixture(scope="package")
def quantities() -> CompiledModel:
    energy = ("total_energy", "total_energy_slopes")
    with without_optimisation():
        return compile_scene(TRIANGLE, for_="derivatives", quantities=energy)


@pytest.fixture(scope="package")
def motions() -> CompiledModel:
    with without_optimisation():
        return compile_scene(TRIANGLE, for_="motion_derivatives")
