import json

import pytest
from pydantic import ValidationError

from tensegrity_codegen.scene.schema.model_schema import EMITTERS, INTEGRATORS, Parameters
from tensegrity_codegen.scene.schema.schema import Scene, scene_json_schema
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.quantities import PARAMETERS, QUANTITIES
from tests.scene.samples import ARCH


def _walk(node):
    if isinstance(node, dict):
        yield node
        for value in node.values():
            yield from _walk(value)
    elif isinstance(node, list):
        for value in node:
            yield from _walk(value)


def test_parameters_are_those_of_the_table():
    assert tuple(Parameters.model_fields) == PARAMETERS


def test_every_key_has_a_sentence():
    top = scene_json_schema()
    tables = [node for node in _walk(top) if isinstance(node.get("properties"), dict)]
    assert len(tables) > 8
    for table in tables:
        for key, value in table["properties"].items():
            target = top["$defs"].get(value.get("$ref", "").rpartition("/")[2], {})
            sentence = value.get("description", target.get("description", ""))
            assert len(sentence) > 8, (table.get("title"), key)


def test_numbers_with_dimension_state_their_unit():
    values = scene_json_schema()["$defs"]["MemberClass"]["properties"]
    for key, unit in {
        "spring_constant": "[N/m]",
        "axial_stiffness": "[N]",
        "rest_length": "[m]",
        "prestress": "[N]",
        "damping": "[N s/m]",
        "mass": "[kg]",
        "density": "[kg/m3]",
        "radius": "[m]",
    }.items():
        assert unit in values[key]["description"]


def test_schema_offers_the_known_words():
    model = scene_json_schema()["$defs"]["ModelOptions"]["properties"]
    assert model["quantities"]["items"]["enum"] == list(QUANTITIES)
    assert model["formulation"]["enum"] == list(FORMULATIONS)
    assert model["emitter"]["enum"] == list(EMITTERS)
    assert model["integrators"]["items"]["enum"] == list(INTEGRATORS)


def test_schema_has_no_null_since_toml_has_none():
    assert all(node.get("type") != "null" for node in _walk(scene_json_schema()))
    assert "null" not in json.dumps(scene_json_schema())


def test_schema_forbids_unknown_keys_and_names_the_needed_ones():
    top = scene_json_schema()
    assert top["additionalProperties"] is False
    assert top["required"] == ["name"]
    assert top["$defs"]["Node"]["required"] == ["position"]
    assert {"class", "kind", "nodes"} <= top["$defs"]["Member"]["properties"].keys()


def test_scene_is_frozen():
    scene = Scene.model_validate(ARCH)
    with pytest.raises(ValidationError):
        scene.name = "other"


def test_whole_numbers_serve_as_numbers():
    scene = Scene.model_validate(ARCH)
    assert scene.nodes["b"].position == (2.0, 0.0, 0.0)
    assert all(isinstance(value, float) for value in scene.nodes["b"].position)
