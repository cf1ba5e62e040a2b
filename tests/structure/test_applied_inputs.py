"""Actuators for members that are named."""

import pytest

from tensegrity_codegen.structure.actuators import Actuator
from tensegrity_codegen.structure.applied_inputs import actuate_members
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import InvalidValueError, StructureError, UnknownNameError
from tests.control.planning.structures import build_prism

PRISM = build_prism(155.0)


def test_cables_all_groups_classes_and_members() -> None:
    cables, names = actuate_members(PRISM, ["cables"])
    assert len(names) == len(cables.actuators) == len(cables.inputs) == 12
    assert cables.actuators[0] == Actuator("bottom1", (3,))
    assert cables.inputs[0] == ActuatedInput("bottom1", "rest_length", (3,))
    assert len(actuate_members(PRISM, ["all"])[1]) == 15
    assert len(actuate_members(PRISM, ["cable"])[1]) == 12  # the class
    assert actuate_members(PRISM, ["vertical_cables"])[1] == ("vertical1", "vertical2", "vertical3")
    assert actuate_members(PRISM, ["top2", "top1"])[1] == ("top2", "top1")


def test_members_keep_their_own_actuator() -> None:
    motor = Actuator("motor", (3,), rate=0.1)
    moved = PRISM.with_changes(actuators=(motor,), inputs=(ActuatedInput("motor", "rest_length", (3,)),))
    structure, names = actuate_members(moved, ["bottom1", "bottom2"])
    assert names == ("motor", "bottom2")
    assert structure.actuators[0] is motor
    assert actuate_members(moved, ["motor"])[1] == ("motor",)


@pytest.mark.parametrize(
    ("names", "error"),
    [
        (["bottom9"], UnknownNameError),
        (["top1", "top1"], InvalidValueError),
        (["top1", "cables"], InvalidValueError),
    ],
)
def test_wrong_names(names: list[str], error: type[Exception]) -> None:
    with pytest.raises(error):
        actuate_members(PRISM, names)


def test_an_input_of_the_name_of_a_member() -> None:
    taken = PRISM.with_changes(inputs=(ActuatedInput("top1", "rest_length", (4,)),))
    with pytest.raises(StructureError, match="already"):
        actuate_members(taken, ["top1"])
