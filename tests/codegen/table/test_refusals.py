"""What loops over tables do not serve is refused by name, with what to do."""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.runtime.build import bar, make_structure, prism, spring
from tests.test_golden import EXAMPLES


def refuse(structure: Structure, request: ModelRequest) -> FormulationError:
    with pytest.raises(FormulationError) as caught:
        emit(structure, replace(request, emitter="table"))
    return caught.value


def test_a_quantity_without_loops_is_refused_with_emitter_and_name() -> None:
    structure = prism()
    thick = structure.with_changes(radius=np.where(structure.is_bar, 0.01, 0.0))
    error = refuse(thick, ModelRequest(("bar_distance",)))
    assert "'table'" in str(error)
    assert error.given == "bar_distance"
    assert 'emitter = "unrolled"' in error.hint
    assert "node_force" in error.allowed


def test_another_formulation_is_refused() -> None:
    error = refuse(prism(), ModelRequest(("acceleration",), formulation="node_distance"))
    assert error.given == "formulation 'node_distance'"
    assert error.where.endswith("model.emitter")


def test_bodies_are_refused() -> None:
    structure, request = load_scene(next(path for path in EXAMPLES if path.stem == "svd_tower"))
    assert not isinstance(structure, Structure)
    with pytest.raises(FormulationError) as caught:
        emit(structure, replace(request, emitter="table"))
    assert caught.value.given == "formulation 'bodies'"


def test_rigid_bars_and_bare_nodes_are_refused_as_everywhere() -> None:
    rigid = make_structure([[0, 0, 0], [1, 0, 0]], [bar(0, 1, 1.0, mu=0.0)])
    assert "rigid bars" in refuse(rigid, ModelRequest(("member_tension",))).problem
    bare = make_structure(
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]], [spring(0, 1, 0.9), spring(1, 2, 0.9)], mass=[1.0, 0.0, 1.0]
    )
    assert refuse(bare, ModelRequest(("acceleration",))).given == "no mass at n1"


def test_what_nothing_enters_is_refused() -> None:
    error = refuse(prism(), ModelRequest(("support_reaction",)))
    assert "empty" in error.problem


def coupled() -> Structure:
    members = [bar(0, 1, 1.0, mass=0.3), bar(1, 2, 1.0, mass=0.2), spring(0, 2, 1.9)]
    return make_structure([[0, 0, 0], [1, 0, 0], [2, 0, 0.1]], members, mass=[1.0, 0.5, 1.0])


def test_masses_of_coupled_nodes_stay_constants() -> None:
    error = refuse(coupled(), ModelRequest(("acceleration",), parameters={"node_mass": (1,)}))
    assert (error.where, error.given) == ("small: parameters.node_mass", "n1")
    error = refuse(coupled(), ModelRequest(("state_jacobian",), parameters={"node_mass": (1,)}))
    assert (error.where, error.given) == ("small: parameters.node_mass", "n1")
