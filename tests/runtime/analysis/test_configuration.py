"""Configurations of nodes and of bodies: their matrices are those of the energy."""

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.runtime.analysis.configuration import read_configuration
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import example
from tests.reference import ReferenceModel
from tests.runtime.build import prism


def compile_bodies(name: str) -> CompiledModel:
    system = example(name)
    request = ModelRequest((), formulation="bodies")
    return build_library(system, find_needs("analyse", system, request).alone(request)).load()


@pytest.fixture(scope="module")
def lin_prism() -> CompiledModel:
    return compile_bodies("lin_prism")


def check_stiffness(model) -> None:
    """The tangent stiffness is A diag(mu) A^T, and what tensions and loads add by turning."""
    at = read_configuration(model, None, None)
    mu = np.where((at.tension != 0) | ~at.tension_only, model.structure.mu, 0.0)
    unit = np.eye(len(at.coordinate))
    parts = (
        at.equilibrium_matrix * mu @ at.equilibrium_matrix.T
        + at.geometric_stiffness(at.tension, unit)
        + at.load_stiffness(unit)
    )
    whole = at.problem.stiffness(at.coordinate).toarray()
    np.testing.assert_allclose(parts, whole, atol=1e-7 * np.abs(whole).max())
    direction = np.random.default_rng(4).normal(size=len(at.coordinate))
    bend = at.geometric_stiffness(at.tension, direction[:, None])[0, 0]
    assert at.tension @ at.curvature(direction) == pytest.approx(bend, rel=1e-7)


def test_of_nodes() -> None:
    model = ReferenceModel(prism(gravity=(0.0, 0.0, -10.0), anchored={0: "xyz", 1: "z"}))
    check_stiffness(model)
    at = read_configuration(model, None, None)
    weight = np.zeros((6, 3))
    weight[:, 2] = -10.0
    np.testing.assert_allclose(at.load, weight[~model.structure.node_anchored], atol=1e-12)
    assert not read_configuration(ReferenceModel(prism()), None, None).load.any()


def test_of_bodies(lin_prism) -> None:
    check_stiffness(lin_prism)
    found = analyse(lin_prism)
    assert found.status == "stable"
    assert (found.rank.rank, found.rigid_motion.shape[2]) == (6, 0)
    assert found.load_prestress is not None  # the weight of the bars is carried by the tensions that act
    np.testing.assert_allclose(found.load_prestress.tension, found.member_tension, rtol=1e-6)
    assert found.modes is not None
    assert found.modes.shape.shape == (9, 3, 6)


@pytest.mark.thorough
def test_of_the_two_stage_tower() -> None:
    """18 tendons, 18 coordinates: no self-stress; the force on the top gives the printed tensions."""
    found = analyse(compile_bodies("svd_tower"))
    assert found.status == "stable"
    assert (found.rank.rank, len(found.rank.selfstress)) == (18, 0)
    np.testing.assert_allclose(found.load_prestress.tension[[0, 6, 12]], [26.11, 1.85, 18.38], atol=0.01)
    assert found.prestress.least_tension == 0.0


def test_a_library_that_was_loaded_alone_is_refused(lin_prism) -> None:
    alone = CompiledModel(lin_prism.path)
    with pytest.raises(FormulationError, match="does not know its structure"):
        analyse(alone)
