"""The formulation in node positions against an independent NumPy model (S&K 2, 5)."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tensegrity_codegen.codegen.prune import prune
from tensegrity_codegen.errors import FormulationError
from tensegrity_codegen.request import ModelRequest
from tensegrity_codegen.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tests.compare import dense, run_in_casadi
from tests.random_structures import structures
from tests.reference import ReferenceModel

SLOW = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


def offered(structure: Structure, request: ModelRequest) -> list:
    """Return every quantity that has an entry in this structure, pruned."""
    model = build_model(structure, request)
    functions = []
    for name in model.quantities:
        try:
            functions += prune(model, (name,))
        except FormulationError:
            continue
    return functions


def all_parameters(structure: Structure) -> dict[str, tuple[int, ...]]:
    everything = {
        "rest_length": range(structure.n_members),
        "spring_constant": np.flatnonzero(structure.spring_constant),
        "axial_stiffness": np.flatnonzero(structure.axial_stiffness),
        "damping": range(structure.n_members),
        "node_mass": np.flatnonzero(structure.node_mass),
        "node_load": range(structure.n_nodes),
        "gravity": (),
    }
    return {
        name: tuple(int(k) for k in items)
        for name, items in everything.items()
        if len(items) or name == "gravity"
    }


def check_against_reference(structure: Structure, request: ModelRequest, seed: int) -> None:
    reference = ReferenceModel(structure, request.parameters)
    inputs = np.random.default_rng(seed).uniform(-0.05, 0.05, len(structure.inputs))
    for function in offered(structure, request):
        arguments = {name: reference.nominal(name) for name in function.arguments if name != "input"}
        arguments |= {"input": inputs} if structure.inputs else {}
        expected = dense(reference.compute(function.quantity.name, **arguments))
        found = dense(run_in_casadi(function, arguments))
        scale = max(np.abs(expected).max(), 1e-300)
        error = np.abs(found.reshape(expected.shape) - expected).max() / scale
        assert error < 1e-12, (function.quantity.name, error)


@given(structures(), st.integers(0, 2**32 - 1))
@SLOW
def test_every_quantity_equals_the_numpy_model_with_constants_baked_in(
    structure: Structure, seed: int
) -> None:
    check_against_reference(structure, ModelRequest(()), seed)


@given(structures(most_nodes=15), st.integers(0, 2**32 - 1))
@settings(SLOW, max_examples=15)
def test_every_quantity_equals_the_numpy_model_with_all_parameters_at_run_time(
    structure: Structure, seed: int
) -> None:
    check_against_reference(structure, ModelRequest((), parameters=all_parameters(structure)), seed)
