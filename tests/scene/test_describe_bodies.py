"""A body system written as a scene and read back is the same system."""

import tomllib

import numpy as np
import pytest

from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.describe_bodies import describe_bodies
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.tables.request import ModelRequest
from tests.body_scenes import EVERYTHING, assemble_document, example


def read_back(system: BodySystem, request: ModelRequest) -> tuple[BodySystem, ModelRequest]:
    return assemble_bodies(parse_scene(tomllib.loads(format_scene(describe_bodies(system, request)))))


@pytest.mark.parametrize("name", ["everything", "lin_prism", "svd_tower"])
def test_written_and_read_back(name: str) -> None:
    if name == "everything":
        system, request = assemble_document(
            {**EVERYTHING, "parameters": {"rest_length": "all"}, "groups": {"some": ["t1", "t3"]}}
        )
    else:
        system, request = example(name), ModelRequest(("acceleration",), formulation="bodies")
    again, request_again = read_back(system, request)
    assert request_again == request
    for key in ("name", "node_name", "member_name", "coordinate_name", "loads", "friction", "groups"):
        assert getattr(again, key) == getattr(system, key), key
    for key in ("node_local", "node_load", "gravity", "connectivity", "rest_length", "spring_constant",
                "axial_stiffness", "damping", "tension_only"):  # fmt: skip
        np.testing.assert_array_equal(getattr(again, key), getattr(system, key), err_msg=key)
    np.testing.assert_allclose(again.coordinate, system.coordinate, rtol=4e-16, atol=1e-18)
    np.testing.assert_allclose(again.velocity, system.velocity, rtol=4e-16)
    for one, two in zip(again.bodies, system.bodies, strict=True):
        assert type(one) is type(two)
        assert one.name == two.name
    for one, two in zip(again.inputs, system.inputs, strict=True):
        assert (one.name, one.kind, one.targets, one.frame) == (two.name, two.kind, two.targets, two.frame)
        assert one.direction == pytest.approx(two.direction, abs=1e-15)
