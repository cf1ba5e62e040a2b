"""Structures for tests of the table emitter, and their libraries beside the symbolic model."""

from collections.abc import Mapping

import numpy as np

from tensegrity_codegen.codegen.emitter import PrunedFunction, prune
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import dense, run_in_casadi


def served(structure: Structure, request: ModelRequest) -> tuple[str, ...]:
    """Return the quantities that loops serve and something enters."""
    model = TABLE.build(structure, request)
    return tuple(name for name in model.quantities if TABLE.is_offered(model, name))


def some_of(
    structure: Structure, parameters: Mapping[str, tuple[int, ...]], seed: int
) -> dict[str, tuple[int, ...]]:
    """Return a random half of every parameter's nodes or members, in random order."""
    rng = np.random.default_rng(seed)
    found = {}
    for name, items in parameters.items():
        kept = tuple(int(k) for k in rng.permutation(items)[: max(1, len(items) // 2)])
        found[name] = kept if items else ()
    return found


def build_table(
    structure: Structure, parameters: Mapping[str, tuple[int, ...]], compiler: str | None = None
) -> tuple[CompiledModel, dict[str, PrunedFunction]]:
    """Return the library of everything that is served, and the same functions in CasADi."""
    request = ModelRequest((), parameters=parameters, emitter="table")
    quantities = served(structure, request)
    built = build_library(structure, request.wanting(*quantities), compiler=compiler)
    functions = prune(build_model(structure, request), quantities)
    return built.load(), {function.quantity.name: function for function in functions}


def assert_equal_to_casadi(
    model: CompiledModel, functions: Mapping[str, PrunedFunction], arguments: Mapping[str, np.ndarray]
) -> None:
    """Check every function: the same arguments, the same shape, the same bits."""
    for name, function in functions.items():
        assert model.function(name).arguments == function.arguments, name
        expected = run_in_casadi(function, dict(arguments))
        found = dense(model.compute(name, **arguments)).reshape(expected.shape)
        np.testing.assert_array_equal(found, expected, err_msg=name)
