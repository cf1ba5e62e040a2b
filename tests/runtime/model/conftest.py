"""The library that most tests of models call."""

import pytest

from tensegrity_codegen.runtime.model.model import CompiledModel
from tests.runtime.model.libraries import loaded_prism


@pytest.fixture(scope="session")
def model() -> CompiledModel:
    return loaded_prism()
