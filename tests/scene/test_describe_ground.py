"""The ground survives being written as a scene and read back, bit by bit."""

import math
import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.codegen.compilation.fingerprint import hash_scene
from tensegrity_codegen.scene.assemble.assemble_bodies import assemble_bodies
from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.describe_bodies import describe_bodies
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError
from tests.body_scenes import EVERYTHING, assemble_document
from tests.cases import draws
from tests.scene.samples import build, changed

ROUND = changed("classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01})
ROUND["nodes"]["b"]["mass"] = 0.2
SIZES = st.floats(1e-6, 1e6)
PARTS = st.floats(-1, 1).filter(lambda x: abs(x) > 1e-3)
TABLES = st.fixed_dictionaries(
    {"stiffness": SIZES, "normal": st.tuples(PARTS, PARTS, PARTS).map(list), "offset": st.floats(-9, -4)},
    optional={
        "contacts": st.sampled_from(["all", ["c"], ["b", "c"]]),
        "radius": st.floats(0, 1) | st.just("bar"),
        "exponent": st.sampled_from([1, 1.5]),
        "restitution": st.fixed_dictionaries({"value": st.floats(0.01, 0.99), "speed": SIZES}),
        "friction": st.floats(0.1, 2),
        "static_friction": st.floats(2, 3),
        "stick_stiffness": SIZES,
        "stick_damping": SIZES,
    },
)


def read_again(document: dict[str, Any]) -> Ground | None:
    return build(tomllib.loads(format_scene(document)))[0].ground


@draws(50)
@given(TABLES)
def test_written_and_read_back(table: dict[str, Any]) -> None:
    if "friction" not in table:
        table.pop("static_friction", None)
    if not table.get("stick_stiffness"):
        table["stick_stiffness"] = 1.0  # a normal may point down, where no weight gives one
    structure, request = build(changed("ground", to=table, base=ROUND))
    assert structure.ground is not None
    again = read_again(describe_structure(structure, request))
    assert again == structure.ground


def test_a_slope_a_belt_and_a_penetration_become_numbers() -> None:
    table = {
        "slope_deg": 20, "penetration": 1e-4, "offset": -3, "contacts": ["c"], "friction": 0.5,
        "velocity": [0.93969262, 0.3, -0.34202014], "restitution": {"value": 0.6, "speed": 3},
    }  # fmt: skip
    structure, request = build(changed("ground", to=table, base=ROUND))
    written = describe_structure(structure, request)["ground"]
    assert written["normal"] == [math.sin(math.radians(20)), 0.0, math.cos(math.radians(20))]
    assert written["contacts"] == "all"  # b cannot move along the normal
    assert not {"slope_deg", "penetration", "restitution"} & set(written)
    assert read_again(describe_structure(structure, request)) == structure.ground


def test_all_contacts_and_radii_of_bars_are_written_as_words() -> None:
    table = {"normal": [0, 1, 1], "stiffness": 1, "offset": -1, "radius": "bar"}
    structure, _ = build(changed("ground", to=table, base=ROUND))
    written = describe_structure(structure)["ground"]
    assert (written["contacts"], written["radius"]) == ("all", "bar")


def test_other_radii_cannot_be_written() -> None:
    structure, _ = build(
        changed("ground", to={"normal": [0, 1, 1], "stiffness": 1, "offset": -1}, base=ROUND)
    )
    assert structure.ground is not None
    values = {name: getattr(structure.ground, name) for name in structure.ground.__dataclass_fields__}
    odd = structure.with_changes(ground=Ground(**(values | {"radius": np.array([0.1, 0.2])})))
    with pytest.raises(InvalidValueError, match="a scene cannot state"):
        describe_structure(odd)


def test_bodies_written_and_read_back() -> None:
    ground = {
        "stiffness": 1e4,
        "offset": -3,
        "contacts": ["stick.A", "mast.B"],
        "friction": 0.4,
        "radius": "bar",
    }
    system, request = assemble_document({**EVERYTHING, "ground": ground})
    written = describe_bodies(system, request)
    assert written["ground"]["contacts"] == ["mast.B", "stick.A"]
    assert written["ground"]["radius"] == "bar"
    again, _ = assemble_bodies(parse_scene(tomllib.loads(format_scene(written))))
    assert again.ground == system.ground


def test_the_scene_itself_keeps_its_table() -> None:
    table = {"slope_deg": 20, "stiffness": 1e4, "restitution": {"value": 0.6, "speed": 3}}
    scene = parse_scene({**ROUND, "ground": table})
    assert tomllib.loads(scene.to_toml())["ground"] == table


def test_the_hash_of_a_scene_changes_with_its_ground() -> None:
    plain, request = build(ROUND)
    one, two = (build(changed("ground", to={"stiffness": k}, base=ROUND))[0] for k in (1e4, 2e4))
    assert len({hash_scene(item, request) for item in (plain, one, two)}) == 3
