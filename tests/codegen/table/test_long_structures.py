"""Loops over long structures have the bits of the virtual machine, whatever the order of their nodes."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters
from tests.codegen.table.long_structures import grid, shuffled, spine, tower, twisted
from tests.codegen.test_generated_c import arguments_near, assert_same_bits, raw_call
from tests.comparison import run_in_casadi
from tests.models import load

FORCES = ("node_residual", "acceleration", "cable_force")
REQUEST = ModelRequest(FORCES, emitter="table")
MATRICES = REQUEST.wanting("tangent_stiffness", "geometric_stiffness", "state_jacobian")
SUBJECTS = {
    "tower": tower(21),
    "damped": tower(19, damping=0.3),
    "spine": spine(18),
    "grid": grid(19, 4),
    "flat": grid(18, 3, axes="xy"),
    "equal": tower(20, spread=0.0),
    "two": twisted(34),
    "shuffled": shuffled(tower(22)),
}


def assert_equal_to_casadi(structure: Structure, request: ModelRequest, **build: str) -> None:
    functions = prune(build_model(structure, request), request.quantities)
    model = build_library(structure, request, **build).load()
    for seed in range(2):
        arguments = arguments_near(model, seed)
        for function in functions:
            name = function.quantity.name
            assert_same_bits(model.compute(name, **arguments), run_in_casadi(function, arguments), name)


@pytest.mark.thorough
@pytest.mark.parametrize("name", SUBJECTS)
def test_forces_have_the_virtual_machine_s_bits(name: str) -> None:
    assert_equal_to_casadi(SUBJECTS[name], REQUEST)


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("flags", ["reference", "native"])
@pytest.mark.parametrize("family", EACH_FAMILY)
def test_every_compiler_and_both_flag_sets_agree(family: str, flags: str) -> None:
    require_compiler(family)
    request = ModelRequest(("acceleration", "tangent_stiffness", "damping_matrix"), emitter="table")
    assert_equal_to_casadi(SUBJECTS["damped"], request, compiler=family, flags=flags)


@pytest.mark.parametrize("name", ["flat", *thorough("spine", "damped", "grid", "shuffled")])
def test_matrices_have_the_virtual_machine_s_bits(name: str) -> None:
    assert_equal_to_casadi(SUBJECTS[name], MATRICES)


@pytest.mark.thorough
def test_values_that_are_arguments_or_changed_by_inputs_are_brought_in() -> None:
    structure = SUBJECTS["damped"]
    every = tuple(range(structure.n_members))
    pulled = structure.with_changes(inputs=(ActuatedInput("pull", "rest_length", every[1::2]),))
    assert_equal_to_casadi(structure, replace(REQUEST, parameters=all_parameters(structure)))
    assert_equal_to_casadi(pulled, REQUEST)


def test_coincident_nodes_are_reported() -> None:
    structure = SUBJECTS["tower"]
    model = load(structure, "node_residual", emitter="table")
    position = model.nominal("coordinate").reshape(-1, 3)
    i, j = structure.connectivity[9 * 7] - 3  # three anchored nodes come first
    position[j] = position[i]
    status, result = raw_call(model, "node_residual", coordinate=position.ravel())
    assert (status, np.isnan(result).all()) == ("non_finite_result", True)
