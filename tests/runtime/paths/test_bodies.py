"""Load paths of rigid bodies, whose points are loaded."""

import copy

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.paths.continuation import follow_path
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tests.codegen.quickly import without_optimisation
from tests.hung_disk import SCENE


def test_growing_loads_on_points_lead_to_the_equilibrium_with_them() -> None:
    """A load on a point was refused: "the load acts on anchored axes only"."""
    scene = copy.deepcopy(SCENE)
    del scene["loads"]
    with without_optimisation():
        model = compile_scene(scene, for_=("equilibrium", "load_path"))
    pattern = np.zeros(model.nominal("node_load").shape)
    pattern[model.manifest.argument("node_load").over.index("disk_p1")] = [0.3, -0.2, -1.0]
    path = build_path(model, pattern)
    found = follow_path(path, find_equilibrium(model).coordinate, most=1.0)
    assert found.load_factor[-1] == pytest.approx(1.0)
    wanted = find_equilibrium(model, arguments={"node_load": pattern})
    np.testing.assert_allclose(found.coordinate[-1], wanted.coordinate, atol=1e-9)
