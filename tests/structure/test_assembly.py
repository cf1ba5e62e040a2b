"""The order of members and of their contributions: by class, free nodes apart from held ones."""

import numpy as np
from hypothesis import given

from tensegrity_codegen.structure.assembly import ABSENT, ARGUMENT, CONSTANT, plan_assembly
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tests.cases import draws
from tests.random_structures import structures
from tests.runtime.build import bar, cable, make_structure, spring

SLOW = draws(12)
SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
MEMBERS = [bar(0, 2, 1.4), cable(0, 1, 0.9), spring(1, 2, 0.9), cable(2, 3, 0.9), bar(1, 3, 1.4)]


def orders(structure: Structure, **parameters: tuple[int, ...]) -> list[list[int]]:
    return [group.member.tolist() for group in plan_assembly(structure, parameters).groups]


def test_members_of_one_law_come_together_in_the_order_of_the_scene() -> None:
    assert orders(make_structure(SQUARE, MEMBERS)) == [[0, 2, 4], [1, 3]]


def test_members_at_an_anchor_come_apart() -> None:
    held = make_structure(SQUARE, MEMBERS, anchored={3: "y"})
    assert orders(held) == [[0, 2], [1], [3], [4]]
    assert [group.is_interior for group in plan_assembly(held, {}).groups] == [True, True, False, False]


def test_an_anchor_on_an_axis_that_is_not_modelled_holds_nothing() -> None:
    flat = make_structure(SQUARE, MEMBERS, axes="xy", anchored={3: "z"})
    assert all(group.is_interior for group in plan_assembly(flat, {}).groups)


def test_values_that_change_at_run_time_make_a_class_of_their_own() -> None:
    structure = make_structure(SQUARE, MEMBERS)
    assert orders(structure, rest_length=(1,), damping=(4,)) == [[0, 2], [1], [3], [4]]
    groups = plan_assembly(structure, {"rest_length": (1,), "damping": (4,)}).groups
    assert [group.member_class.rest_length for group in groups] == [CONSTANT, ARGUMENT, CONSTANT, CONSTANT]
    assert [group.member_class.damping for group in groups] == [ABSENT, ABSENT, ABSENT, ARGUMENT]


def test_mu_is_a_constant_where_nothing_in_it_changes() -> None:
    members = [cable(0, 1, 0.9), cable(1, 2, 0.9, 0.0, axial=50.0), cable(2, 3, 0.9, 0.0, axial=50.0)]
    inputs = (ActuatedInput("pull", "rest_length", (0, 2)), ActuatedInput("more", "rest_length", (2,)))
    groups = plan_assembly(make_structure(SQUARE, members, inputs=inputs), {}).groups
    assert [group.member_class.n_inputs for group in groups] == [1, 0, 2]
    assert [group.member_class.is_stiffness_constant for group in groups] == [True, True, False]


@given(structures())
@SLOW
def test_every_end_adds_once(structure: Structure) -> None:
    plan = plan_assembly(structure, {})
    assert sorted(plan.member) == list(range(structure.n_members))
    expected = [[e, end] for e in range(structure.n_members) for end in (0, 1)]
    assert sorted(plan.ends.tolist()) == expected


def test_a_structure_without_members_has_an_empty_plan() -> None:
    plan = plan_assembly(make_structure([[0, 0, 0]], []), {})
    assert plan.groups == ()
    assert plan.ends.shape == (0, 2)
    assert np.issubdtype(plan.ends.dtype, np.integer)
