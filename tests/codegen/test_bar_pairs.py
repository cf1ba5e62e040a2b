"""Pairs of bars from structure to library: against the NumPy model, and bit by bit against CasADi."""

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.manifest import Manifest, name_bar_pairs
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import dense, run_in_casadi
from tests.models import load
from tests.reference import ReferenceModel
from tests.runtime.build import prism

QUANTITIES = (
    "bar_distance",
    "bar_distance_case",
    "bar_distance_parameters",
    "bar_nearest_point",
    "bar_distance_jacobian",
    "member_extension",
)


def round_prism(sides: int = 3, **more: object) -> Structure:
    plain = prism(sides=sides, **more)
    return plain.with_changes(radius=np.where(plain.is_bar, 0.02 + 0.01 * np.arange(plain.n_members), 0.0))


def configurations(structure: Structure, count: int = 20) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    start = structure.node_position[~structure.node_anchored]
    return [start + rng.uniform(-spread, spread, start.size) for spread in np.linspace(0, 2, count)]


@pytest.mark.thorough
@pytest.mark.parametrize("sides", [3, 4])
def test_bar_quantities_equal_the_numpy_model_and_the_library_equals_casadi(sides: int) -> None:
    structure = round_prism(sides, anchored={0: "xyz", 1: "z"})
    request = ModelRequest(QUANTITIES)
    functions = prune(build_model(structure, request), QUANTITIES)
    reference = ReferenceModel(structure)
    model = build_library(structure, request).load()
    cases = set()
    for coordinate in configurations(structure):
        for function in functions:
            name = function.quantity.name
            assert function.arguments == ("coordinate",)
            expected = dense(reference.compute(name, coordinate=coordinate))
            in_casadi = run_in_casadi(function, {"coordinate": coordinate})
            np.testing.assert_allclose(in_casadi.reshape(expected.shape), expected, atol=1e-11, rtol=0)
            compiled = dense(model.compute(name, coordinate=coordinate))
            np.testing.assert_array_equal(compiled, in_casadi.reshape(expected.shape))
        cases |= set(model.compute("bar_distance_case", coordinate=coordinate).tolist())
    assert len(cases) >= 4  # the configurations reach several cases of the geometry


def test_pairs_are_named_in_manifest_and_header_where_they_are_wanted() -> None:
    structure = round_prism(3)
    wanted = emit(structure, ModelRequest(("bar_distance",)))
    assert wanted.manifest.bar_pair_name == ("e0_e4", "e0_e8", "e4_e8")
    assert wanted.manifest.bar_pair[1] == ("e0", "e8")
    assert "SMALL_BAR_PAIR_e0_e8 = 1" in wanted.files["small.h"]
    assert "SMALL_N_BAR_PAIRS = 3" in wanted.files["small.h"]
    assert Manifest.from_json(wanted.manifest.to_json()) == wanted.manifest
    other = emit(structure, ModelRequest(("member_tension",)))
    assert other.manifest.bar_pair == ()
    assert "BAR_PAIR" not in other.files["small.h"]


def test_bars_that_share_a_node_and_bars_without_radius_are_no_pairs() -> None:
    structure = round_prism(3)
    connected = structure.connectivity.copy()
    connected[4] = (0, 4)  # bar e4 now starts where e0 does
    assert structure.with_changes(connectivity=connected).bar_pairs.tolist() == [[0, 8], [4, 8]]
    thin = structure.radius.copy()
    thin[0] = 0
    assert structure.with_changes(radius=thin).bar_pairs.tolist() == [[4, 8]]


def test_chosen_pairs_are_the_only_ones() -> None:
    structure = round_prism(3).with_changes(interference=((8, 0),))
    model = load(structure, "bar_distance")
    every = load(round_prism(3), "bar_distance")
    assert model.compute("bar_distance").tolist() == [every.compute("bar_distance")[1]]


def test_a_scene_without_round_bars_has_no_distances() -> None:
    model = build_model(prism(), ModelRequest(()))
    with pytest.raises(FormulationError, match="no two bars that could touch") as caught:
        prune(model, ("bar_distance",))
    assert "a radius [m]; contacts are of bars" in caught.value.hint


def test_pairs_of_bars_have_names_that_differ() -> None:
    assert name_bar_pairs((("a", "b_c"), ("a_b", "c"), ("x", "y"))) == ("a_b_c", "a_b_c_2", "x_y")
