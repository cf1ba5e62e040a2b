"""Loops over members, block by block: one form for every compiler, with the bits of unrolled code."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.table.members.member_loops import BLOCK
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.codegen.build_c import STRICT, run, write_files
from tests.codegen.compilers import EACH_FAMILY, require_compiler
from tests.codegen.subjects import all_parameters, offered
from tests.codegen.test_generated_c import arguments_near, assert_same_bits, raw_call
from tests.comparison import dense, run_in_casadi
from tests.models import load
from tests.random_structures import make_structure
from tests.runtime import build

FORCES = ("node_residual", "acceleration", "node_force")
STIFFNESS = ("tangent_stiffness", "material_stiffness", "geometric_stiffness")
OF_MEMBERS = ("elastic_energy", "member_tension", "equilibrium_matrix", "rest_length_jacobian")
AT_ONCE, IN_BLOCKS = "const int p = 3 * e;", f"start += {BLOCK}"


def in_space(seed: int, n_nodes: int, *wishes: str, axes: tuple[int, ...] = (0, 1, 2)) -> Structure:
    every = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")
    wants = {wish: wish in wishes for wish in every}
    return make_structure(np.random.default_rng(seed), n_nodes, axes, wants)


def fan(count: int) -> Structure:
    """One class of members that all begin at one free node: every sum of theirs is as long as can be."""
    position = np.random.default_rng(count).uniform(-1, 1, (count + 1, 3))
    members = [build.cable(0, k, 0.1, 100.0 + k) for k in range(1, count + 1)]
    return build.make_structure(position, members, mass=np.ones(count + 1))


def source_of(structure: Structure, request: ModelRequest) -> str:
    source = emit(structure, request)
    return source.files[f"{source.manifest.name}.c"]


@pytest.mark.thorough
@pytest.mark.optimised
@pytest.mark.parametrize("flags", ["reference", "native"])
@pytest.mark.parametrize("family", EACH_FAMILY)
@pytest.mark.parametrize("changeable", [*thorough(False), True])
def test_every_compiler_and_both_flag_sets_give_the_virtual_machine_s_bits(
    family: str, flags: str, changeable: bool
) -> None:
    require_compiler(family)
    structure = in_space(1, 25, "damping", "anchors", "inputs", "slack", "velocity", "gravity")
    parameters = all_parameters(structure) if changeable else {}
    wanted = (*FORCES, *STIFFNESS, *OF_MEMBERS, "state_jacobian")
    request = ModelRequest(wanted, parameters=parameters, emitter="table")
    functions = offered(structure, replace(request, emitter="unrolled"))
    model = build_library(structure, request, compiler=family, flags=flags).load()
    for seed in range(3):
        arguments = arguments_near(model, seed)
        for name in wanted:
            expected = run_in_casadi(functions[name], arguments)
            assert_same_bits(model.compute(name, **arguments), expected, name)


@pytest.mark.parametrize("flags", ["reference", *thorough("native")])
@pytest.mark.parametrize("count", [BLOCK, BLOCK + 1, *thorough(1, BLOCK - 1, 2 * BLOCK, 2 * BLOCK + 3)])
def test_blocks_that_are_full_or_not_give_the_virtual_machine_s_bits(count: int, flags: str) -> None:
    structure, wanted = fan(count), (*FORCES, "tangent_stiffness", "elastic_energy", "member_tension")
    request = ModelRequest(wanted, emitter="table")
    assert (IN_BLOCKS in source_of(structure, request)) == (count > BLOCK)
    functions = offered(structure, replace(request, emitter="unrolled"))
    model = build_library(structure, request, flags=flags).load()
    arguments = arguments_near(model, count)
    for name in wanted:
        assert_same_bits(model.compute(name, **arguments), run_in_casadi(functions[name], arguments), name)


def test_coincident_nodes_and_bad_numbers_are_reported() -> None:
    structure = in_space(2, 20)
    model = load(structure, "node_residual", emitter="table")
    i, j = structure.connectivity[0]
    position = model.nominal("coordinate").reshape(-1, 3)
    position[j] = position[i]
    status, result = raw_call(model, "node_residual", coordinate=position.ravel())
    assert (status, np.isnan(result).all()) == ("non_finite_result", True)
    for value in (np.nan, np.inf):
        for entry in (0, position.size - 1):
            changed = model.nominal("coordinate")
            changed[entry] = value
            assert raw_call(model, "node_residual", coordinate=changed)[0] == "non_finite_input"


def test_there_is_one_form_for_all_compilers_and_precisions() -> None:
    space = fan(BLOCK + 1)
    request = ModelRequest(("node_residual", "tangent_stiffness"), emitter="table")
    for item in (space, in_space(3, 20), in_space(3, 20, axes=(0, 2))):
        for precision in ("double", "single"):
            text = source_of(item, replace(request, precision=precision))
            assert not any(word in text for word in ("LANES", "immintrin", "lanes_", "__SSE2__", "__AVX2__"))
            assert text.count("_of_member") >= 4  # two kernels, each called in one loop
    assert IN_BLOCKS in source_of(space, request)
    assert AT_ONCE in source_of(fan(BLOCK), request)


@pytest.mark.parametrize("axes", ["z", *thorough("xz", "xyz")])
def test_no_variable_is_declared_that_nothing_reads(axes: str, tmp_path: Path) -> None:
    structure = in_space(8, 9, "damping", axes=tuple("xyz".index(axis) for axis in axes))
    wanted = ("tension_rest_length_derivative", "state_jacobian", "tangent_stiffness", "acceleration")
    source, compiler = emit(structure, ModelRequest(wanted, emitter="table")), require_compiler("gcc")
    folder = write_files(tmp_path, source.files)
    run([*compiler.command, "-std=c99", "-O1", *STRICT, "-c", f"{source.manifest.name}.c"], folder, compiler)


@pytest.mark.thorough
def test_blocks_off_the_diagonal_are_set_once_unless_members_share_both_nodes() -> None:
    structure = in_space(4, 20, "anchors")
    request = ModelRequest(STIFFNESS, emitter="table")
    assert "tangent_stiffness[b1 + k] = -r0[p + k]" in source_of(structure, request)
    ends = structure.connectivity.copy()
    ends[1::2] = ends[: 2 * (len(ends) // 2) : 2, ::-1]
    twice = structure.with_changes(connectivity=ends)
    assert "tangent_stiffness[b1 + k] -= r0[p + k]" in source_of(twice, request)
    for item in (structure, twice):
        functions = offered(item, replace(request, emitter="unrolled"))
        model = build_library(item, request).load()
        arguments = arguments_near(model, 5)
        for name in STIFFNESS:
            # What was there before does not matter, wherever it is.
            assert raw_call(model, name, **arguments)[0] == "ok"
            assert_same_bits(
                model.compute(name, **arguments), run_in_casadi(functions[name], arguments), name
            )


@pytest.mark.parametrize("precision", ["double", *thorough("single")])
def test_a_stiffness_too_large_to_add_up_is_looked_at_entry_by_entry(precision: str) -> None:
    structure, largest = in_space(7, 20), {"double": 1.7e308, "single": 3.3e38}[precision]
    request = ModelRequest(("material_stiffness",), emitter="table", precision=precision)
    none = np.zeros(structure.n_members)
    for share, is_finite in ((1e-7, True), (1.0, False)):
        stiffness = np.full(structure.n_members, share * largest)
        stiff = structure.with_changes(spring_constant=stiffness, axial_stiffness=none)
        model = build_library(stiff, request).load()
        if is_finite:
            assert dense(model.compute("material_stiffness")).max() > 1e-8 * largest
            continue
        with pytest.raises(NonFiniteError):
            model.compute("material_stiffness")
