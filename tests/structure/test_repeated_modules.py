"""Repeated modules: each end of each member stands where its module says, and no member in two modules."""

import numpy as np
import pytest

from tensegrity_codegen.structure.assembly import order_nodes, plan_assembly, spread
from tests.codegen.table.modules import grid, shuffled, spine, tower, twisted

STRUCTURES = {
    "tower": tower(40),
    "spine": spine(30),
    "grid": grid(30, 5),
    "twisted": twisted(80),
    "shuffled": shuffled(grid(40, 6)),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_ends_are_entries_of_columns(name: str) -> None:
    structure = STRUCTURES[name]
    modules = plan_assembly(structure, {}).modules
    held = np.concatenate([module.member.ravel() for module in modules])
    assert len(np.unique(held)) == len(held) > 0.3 * structure.n_members
    for module in modules:
        for strand, member in enumerate(module.member):
            ends = [
                module.column[column][offset : offset + len(member)]
                for column, offset in module.place[strand]
            ]
            expected = np.sort(structure.connectivity[member], axis=1)
            np.testing.assert_array_equal(np.sort(np.stack(ends, axis=1), axis=1), expected)


@pytest.mark.parametrize("name", STRUCTURES)
def test_every_end_adds_once(name: str) -> None:
    plan = plan_assembly(STRUCTURES[name], {})
    expected = [[e, end] for e in range(STRUCTURES[name].n_members) for end in (0, 1)]
    assert sorted(plan.ends.tolist()) == expected


def test_members_that_do_not_repeat_are_in_no_module() -> None:
    structure = tower(40)
    rng = np.random.default_rng(0)
    tangle = structure.with_changes(connectivity=rng.permuted(structure.connectivity, axis=0))
    assert plan_assembly(tangle, {}).modules == ()


def test_an_order_along_the_structure_brings_members_back_together() -> None:
    structure = shuffled(spine(50))
    kind = np.zeros(structure.n_members, dtype=np.int64)
    order = order_nodes(structure.connectivity, kind, structure.n_nodes)
    assert sorted(order.tolist()) == list(range(structure.n_nodes))
    assert spread(structure.connectivity, order) < 6
    assert spread(structure.connectivity, np.arange(structure.n_nodes)) > 60
