"""Branches of a plan: other paths where limits block the first, how each ended, and the fewest limits."""

import tomllib
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.control.pages.plans import describe_plan
from tensegrity_codegen.control.planning import path as paths
from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.control.planning.plan_point import Slopes
from tensegrity_codegen.control.planning.step_problem import Margins, Program, find_fewest_limits
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.control.planning.structures import (
    actuate,
    assemble,
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
    monkeypatch.setattr(paths, "N_FIRST_CHANGES", 0)
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
    assert "and of 2 over shapes drawn at random (seed 0) none reaches the target" in more.message
    assert "other changes" not in none.message
    np.testing.assert_array_equal(default.change, more.change)
    told = describe_plan(more)["branches"]
    assert [item["kind"] for item in told][3:] == ["random walk", "random walk"]
    assert all(item["reason"] and 0.0 <= item["progress"] < 1.0 for item in told)


@pytest.mark.thorough
def test_a_mast_leans_further_by_its_saddle_cables_alone() -> None:
    """Straight paths end at 12.7 deg, by least tensions; walks lead to a branch that leans further."""
    file = Path(__file__).parents[3] / "docs" / "gallery" / "deployable_mast.toml"
    mast = assemble(tomllib.loads(file.read_text(encoding="utf-8")))
    structure = limit(actuate(mast.with_changes(inputs=()), "saddle"))
    model = compile_plan(structure)
    blocked = plan(model, "tilt=15")
    assert blocked.status == "blocked"
    assert max(item.target[0] for item in blocked.branches) < 13.0
    found = plan(model, "tilt=15", attempts=12)
    check(found, structure, steps=120, least=1.0 - 1e-6, clearance=0.002 * (1 - 1e-6))
    assert found.branches[-1].kind == "random walk"


@pytest.mark.parametrize("options", [{"attempts": -1}, {"attempts": 1.5}, {"seed": -1}, {"seed": True}])
def test_wrong_attempts_and_seeds_are_refused(options: dict[str, int]) -> None:
    with pytest.raises(InvalidValueError, match=next(iter(options))):
        plan(compile_plan(limit(actuate(build_prism(155.0)))), "twist=160", **options)


# The fewest limits that block.


def build_program(slope: list[list[float]], value: list[float]) -> Program:
    """Return a program over two inputs whose progress is the first, with limits slope u + value >= 0."""
    count = len(value)
    margins = Margins(
        ("least_tension",) * count,
        np.arange(count),
        np.array(value),
        np.ones(count),
        np.zeros(count),
        np.array(slope),
    )
    none, unmoved = np.zeros((0, 2)), np.zeros((1, 2))
    target = np.array([[1.0, 0.0]])
    slopes = Slopes(unmoved, unmoved, unmoved, unmoved, none, target, none)
    return Program(margins, slopes, np.zeros(1), np.ones(1), 10.0, 1.0, aimed_margin=0.0)


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 2, 0], [2, 0, 1]])
def test_one_limit_that_blocks_alone_is_found_among_others(order: list[int]) -> None:
    """u1 <= 1 alone, or u1 + u2 <= 1 with u1 - u2 <= 1."""
    slope = np.array([[-1.0, 0.0], [-1.0, -1.0], [-1.0, 1.0]])[order].tolist()
    program = build_program(slope, [1.0, 1.0, 1.0])
    bound = program.find_bound()
    assert bound is not None
    assert bound.progress == pytest.approx(1.0)
    rows, is_fewest = find_fewest_limits(program, bound)
    assert rows.tolist() == [order.index(0)]
    assert is_fewest


@pytest.mark.parametrize("seed", range(20))
def test_no_smaller_set_blocks(seed: int) -> None:
    """Against all smaller sets, of random limits, and of their doubles."""
    draw = np.random.default_rng(seed)
    slope = np.round(draw.uniform(-2.0, 2.0, (5, 2)), 0)
    slope = np.vstack([slope, slope[:2]])
    value = np.append(np.round(draw.uniform(0.0, 2.0, 5), 0), [0.0, 0.0])
    program = build_program(slope.tolist(), value.tolist())

    def find_most(rows: tuple[int, ...]) -> float:
        part = build_program([slope[k].tolist() for k in rows], [float(value[k]) for k in rows])
        step = part.find_bound() if rows else None
        return 10.0 if step is None else step.progress

    bound = program.find_bound()
    assert bound is not None
    rows, is_fewest = find_fewest_limits(program, bound)
    assert find_most(tuple(rows.tolist())) <= bound.progress * (1 + 2e-3) + 2e-6
    assert is_fewest
    if len(rows):
        smaller = combinations(range(len(value)), len(rows) - 1)
        assert all(find_most(chosen) > bound.progress + 1e-6 for chosen in smaller)


def test_the_fewest_limits_are_in_the_record_of_a_block() -> None:
    found = plan(compile_plan(limit(actuate(build_prism(155.0), "vertical"))), "twist=165", attempts=0)
    assert found.block is not None
    assert sorted(found.block.fewest) == [("least_tension", f"opposite{k}") for k in (1, 2, 3)]
    assert describe_plan(found)["block"]["is_fewest"]
