"""Jacobians of accelerations where bars with own mass couple nodes, by loops over tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.codegen.table.members import block_pattern as mass_groups
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests import random_structures
from tests.cases import draws, thorough
from tests.codegen.table.long_structures import spine, tower, twisted
from tests.codegen.table.subjects import assert_equal_to_casadi
from tests.codegen.test_generated_c import arguments_near
from tests.comparison import dense
from tests.models import load
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure

JACOBIANS = ("state_jacobian", "rest_length_jacobian", "input_jacobian")
SLOW = draws(3)


def heavy(structure: Structure, which: NDArray[np.bool_] | None = None) -> Structure:
    """The same structure with bars of different masses, all or some of them."""
    mass = np.random.default_rng(5).uniform(0.1, 1.0, structure.n_members)
    chosen = structure.is_bar if which is None else structure.is_bar & which
    return structure.with_changes(member_mass=np.where(chosen, mass, 0.0))


def prisms(count: int) -> Structure:
    """Prisms on each other whose bars share no node, so that each bar couples two nodes: 18 members each."""
    position: list[list[float]] = []
    members = []
    for k in range(count):
        angle, low = 2 * np.pi * np.arange(3) / 3 + 0.3 * k, 6 * k
        for turn, height in ((0.0, 1.5 * k), (2.6, 1.5 * k + 1.2)):
            position += np.column_stack(
                [np.cos(angle + turn), np.sin(angle + turn), np.full(3, height)]
            ).tolist()
        for i in range(3):
            j = (i + 1) % 3
            members += [bar(low + i, low + 3 + i, 2.2, mass=0.4), cable(low + i, low + 3 + j, 1.1)]
            members += [cable(low + i, low + j, 1.6), cable(low + 3 + i, low + 3 + j, 1.6)]
            if k:
                members += [cable(low - 3 + i, low + i, 0.4), cable(low - 3 + i, low + j, 1.0)]
    return make_structure(position, members, anchored=dict.fromkeys(range(3), "xyz"))


def build(structure: Structure, **more: object) -> CompiledModel:
    """Return the library of those of JACOBIANS that something enters, and of the state derivative."""
    request = ModelRequest((), emitter="table")
    model = TABLE.build(structure, request)
    wanted = [name for name in JACOBIANS if TABLE.is_offered(model, name)]
    return build_library(structure, request.wanting(*wanted, "state_derivative")).load()


def assert_bits_of_unrolled(structure: Structure, seed: int) -> None:
    """The bits and the pattern of the symbolic model."""
    model = build(structure)
    names = tuple(function.quantity for function in model.manifest.functions)
    functions = {f.quantity.name: f for f in prune(build_model(structure, ModelRequest(())), names)}
    assert_equal_to_casadi(model, functions, arguments_near(model, seed))
    for name in set(names) - {"state_derivative"}:
        pattern = model.function(name).spec.pattern
        assert pattern == functions[name].pattern


@pytest.mark.thorough
@given(st.integers(4, 12), st.sampled_from(random_structures.AXES), st.booleans(), st.integers(0, 2**32 - 1))
@SLOW
def test_random_structures_have_the_bits_of_unrolled_code(
    n_nodes: int, axes: tuple[int, ...], anchors: bool, seed: int
) -> None:
    wants = dict.fromkeys(("gravity", "damping", "loads", "velocity", "bar_mass", "inputs", "slack"), True)
    rng = np.random.default_rng(seed)
    structure = random_structures.make_structure(rng, n_nodes, axes, wants | {"anchors": anchors})
    assert_bits_of_unrolled(heavy(structure), seed)


@pytest.mark.thorough
@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("make", [lambda: tower(5, damping=0.5), lambda: spine(4), lambda: twisted(16)])
def test_repeated_modules_have_the_bits_of_unrolled_code(make: object, every: int) -> None:
    structure = make()  # type: ignore[operator]
    assert_bits_of_unrolled(heavy(structure, np.arange(structure.n_members) % every == 0), 1)


def test_the_second_writing_of_the_equations_agrees() -> None:
    structure = prisms(2)
    push = ActuatedInput("push", "force", (4, 7), (0.0, 0.6, 0.8))
    structure = structure.with_changes(inputs=(ActuatedInput("reel", "rest_length", (1, 5)), push))
    model, reference = build(structure), ReferenceModel(structure, {})
    arguments = arguments_near(model, 2)
    for name in JACOBIANS:
        expected = dense(reference.compute(name, **arguments))
        found = model.compute(name, **arguments).toarray()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.thorough
def test_the_remainder_of_the_linear_model_falls_with_the_square_of_the_step() -> None:
    model = build(prisms(23).with_changes(damping=np.full(408, 0.2)))
    rng, n = np.random.default_rng(0), len(model.manifest.coordinate_name)
    q, v = model.nominal("coordinate"), rng.normal(size=n)
    step = rng.normal(size=2 * n)
    at = {"coordinate": q, "velocity": v}
    slope = model.compute("state_jacobian", **at) @ step
    start = model.compute("state_derivative", **at)
    remainders = []
    for size in (1e-3, 1e-4, 1e-5):
        moved = {"coordinate": q + size * step[:n], "velocity": v + size * step[n:]}
        remainders.append(np.abs(model.compute("state_derivative", **moved) - start - size * slope).max())
    orders = np.log10(np.array(remainders[:-1]) / remainders[1:])
    assert np.all(orders > 1.9)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [27, *thorough(60)])
def test_structures_of_480_and_1074_members_with_heavy_bars_have_a_linear_model(count: int) -> None:
    structure = prisms(count)
    assert structure.n_members == 18 * count - 6
    quantities = linearize_quantities("node_position", with_inputs=False)
    model = load(structure, *quantities, emitter="auto")
    assert model.manifest.emitter == "table"
    found = linearize(model)
    assert np.all(found.natural_frequency > 0.0)
    assert found.A.nnz == 14_544 if count == 27 else found.A.nnz > 14_544


@pytest.mark.thorough
def test_a_matrix_that_large_groups_fill_is_refused_with_a_way_out() -> None:
    structure = heavy(tower(230))
    with pytest.raises(FormulationError) as caught:
        emit(structure, ModelRequest(("state_jacobian",), emitter="table"))
    assert caught.value.where == "tower: model.quantities"
    assert int(str(caught.value.given).split()[0]) > mass_groups.MAX_ENTRIES
    half = np.zeros(structure.n_nodes)
    np.add.at(half, structure.connectivity.ravel(), np.repeat(structure.member_mass / 2, 2))
    lumped = structure.with_changes(node_mass=structure.node_mass + half, member_mass=np.zeros(2070))
    assert emit(lumped, ModelRequest(("state_jacobian",), emitter="table")).manifest.functions
