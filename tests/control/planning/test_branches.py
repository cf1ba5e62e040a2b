"""Branches of a plan: other paths where limits block the first, how each ended."""

import numpy as np
import pytest

from tensegrity_codegen.control.pages.plans import describe_plan
from tensegrity_codegen.control.planning import branches
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.control.planning.structures import (
    actuate,
    build_passing_bars,
    build_prism,
    compile_plan,
    limit,
)
from tests.control.planning.test_plan import check

ROUND = {"moving1.x": 0.2, "moving2.x": 0.2}


@pytest.mark.parametrize("seed", [0, *thorough(1, 2)])
def test_a_random_walk_leads_round_a_bar(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the paths that begin with other changes, only walks leave the plane of symmetry."""
    monkeypatch.setattr(branches, "N_FIRST_CHANGES", 0)
    structure = build_passing_bars()
    model = compile_plan(structure)
    blocked = plan(model, ROUND, steps=3, attempts=0)
    assert blocked.status == "blocked"
    found = plan(model, ROUND, steps=3, attempts=12, seed=seed)
    check(found, structure, steps=80, least=1.0 - 1e-6, clearance=0.01 * (1 - 1e-6))
    kinds = [item.kind for item in found.branches]
    assert kinds[0] == "smallest changes"
    assert set(kinds[1:]) == {"random walk"}
    assert [item.reason == "reaches the target" for item in found.branches] == [False] * (len(kinds) - 1) + [
        True
    ]
    again = plan(model, ROUND, steps=3, attempts=12, seed=seed)
    np.testing.assert_array_equal(again.change, found.change)


def test_a_blocked_plan_says_how_all_branches_ended() -> None:
    model = compile_plan(limit(actuate(build_prism(155.0), "vertical")))
    default, more, none = (plan(model, "twist=165", attempts=count, steps=5) for count in (2, 4, 0))
    assert [len(found.branches) for found in (default, more, none)] == [3, 5, 1]
    assert "2 paths that begin with other changes end no further;" in default.message
    assert "and 2 ways over shapes drawn at random (seed 0) end too" in more.message
    assert "other changes" not in none.message
    np.testing.assert_array_equal(default.change, more.change)
    told = describe_plan(more)["branches"]
    assert [item["kind"] for item in told][3:] == ["random walk", "random walk"]
    assert all(item["reason"] and 0.0 <= item["progress"] < 1.0 for item in told)


@pytest.mark.parametrize("options", [{"attempts": -1}, {"attempts": 1.5}, {"seed": -1}, {"seed": True}])
def test_wrong_attempts_and_seeds_are_refused(options: dict[str, int]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(options))):
        plan(compile_plan(limit(actuate(build_prism(155.0)))), "twist=160", **options)
