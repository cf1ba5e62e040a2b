"""Grounds of structures that a program builds itself."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.structure.ground import Ground
from tensegrity_codegen.system.errors import InvalidValueError, SceneError, StructureError
from tests.scene.samples import build, changed

BASE = build(changed("ground", to={"stiffness": 1e4, "friction": 0.5}))[0]


def change(**changes: Any) -> Any:
    ground = BASE.ground
    assert ground is not None
    values = {name: getattr(ground, name) for name in ground.__dataclass_fields__}
    return BASE.with_changes(ground=Ground(**(values | changes)))


def test_a_sound_ground_passes() -> None:
    check_structure(BASE)
    check_structure(BASE.with_changes(ground=None))


@pytest.mark.parametrize(
    ("changes", "error", "key", "words"),
    [
        ({"node": np.array([3])}, InvalidValueError, "ground.node", "0 to 2"),
        ({"node": np.array([-1])}, InvalidValueError, "ground.node", "0 to 2"),
        ({"node": np.array([0])}, StructureError, "ground.contacts", "cannot be contacts: a"),
        ({"node": np.array([1])}, StructureError, "ground.contacts", "cannot be contacts: b"),
        ({"offset": 0.1}, StructureError, "ground.offset", "a (0.1 m deep), b (0.1 m deep)"),
    ],
)
def test_an_unsound_ground_is_refused(
    changes: dict[str, Any], error: type[SceneError], key: str, words: str
) -> None:
    with pytest.raises(error) as caught:
        check_structure(change(**changes), "mine")
    assert caught.value.where == f"mine: {key}"
    assert words in str(caught.value)


def test_what_is_no_ground_is_refused() -> None:
    with pytest.raises(InvalidValueError) as caught:
        check_structure(BASE.with_changes(ground={"stiffness": 1}), "mine")
    assert caught.value.where == "mine: ground"


def test_contacts_without_mass_are_refused() -> None:
    bare = change(node=np.array([2])).with_changes(
        node_mass=np.zeros(3), member_mass=np.zeros(3), node_load=np.zeros((3, 3))
    )
    with pytest.raises(StructureError, match="contacts without mass: c"):
        check_structure(bare)


def test_the_normal_stays_within_the_axes_of_the_structure() -> None:
    planar = {
        "name": "swing",
        "axes": "xz",
        "nodes": {"a": {"position": [0, 1], "anchored": True}, "b": {"position": [0, 0], "mass": 1.0}},
        "members": {"ab": {"kind": "cable", "nodes": ["a", "b"], "spring_constant": 100.0}},
        "ground": {"stiffness": 1e4},
    }
    structure = build(planar)[0]
    ground = structure.ground
    assert ground is not None
    values = {name: getattr(ground, name) for name in ground.__dataclass_fields__}
    turned = Ground(**(values | {"normal": np.array([0.0, 0.6, 0.8])}))
    with pytest.raises(StructureError, match="normal along y"):
        check_structure(structure.with_changes(ground=turned))
