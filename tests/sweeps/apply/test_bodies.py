"""Sweeps over numbers of rigid bodies: what is assembled anew, and what is refused."""

import copy
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import compile_scene
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.sweeps.sweep import sweep
from tensegrity_codegen.system.errors import InvalidValueError
from tests.codegen.quickly import without_optimisation
from tests.hung_disk import SCENE


@pytest.mark.parametrize(
    "key", ["bodies.disk.mass", "loads[0].force[0]", "members.c1.rest_length", "bodies.disk.points.p1[0]"]
)
def test_cases_are_those_of_the_scene_with_the_number(key: str, tmp_path: Path) -> None:
    values = {"bodies.disk.mass": 0.8, "loads[0].force[0]": 0.3, "members.c1.rest_length": 0.45}
    value = values.get(key, -0.07)
    with without_optimisation():
        found = sweep(
            SCENE, over={key: [value]}, do="equilibrium", out=tmp_path / "s", keep=("node_position",)
        )
        changed = copy.deepcopy(SCENE)
        if key.startswith("bodies.disk.mass"):
            changed["bodies"]["disk"]["mass"] = value
        elif key.startswith("loads"):
            changed["loads"][0]["force"][0] = value
        elif key.startswith("members"):
            changed["members"]["c1"]["rest_length"] = value
        else:
            changed["bodies"]["disk"]["points"]["p1"][0] = value
        model = compile_scene(changed, for_="equilibrium")
        wanted = find_equilibrium(model).node_position
    np.testing.assert_allclose(np.asarray(found["node_position"])[0], wanted, atol=1e-9)


@pytest.mark.parametrize(
    "key", ["node_mass.disk_corner1", "node_position.disk_p1[2]", "node_velocity.disk_p1[0]"]
)
def test_nodes_of_bodies_have_no_numbers_of_their_own(key: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="a node of a body moves with it"):
        sweep(SCENE, over={key: [0.1]}, do="equilibrium", out=tmp_path / "s")


def test_too_many_libraries_of_bodies_are_refused_with_what_changes() -> None:
    values = np.linspace(-0.1, -0.05, 51).tolist()
    with pytest.raises(InvalidValueError, match="since bodies cannot change at run time"):
        sweep(SCENE, over={"bodies.disk.points.p1[0]": values}, do="equilibrium")
