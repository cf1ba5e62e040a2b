"""Damping of members in a search for an equilibrium: what covers the energy, how it grows and goes."""

import numpy as np
import pytest

from tensegrity_codegen import compile_scene
from tensegrity_codegen.runtime.statics.damping import Damping, MemberDamping, find_turn, locate_members
from tensegrity_codegen.runtime.statics.equilibrium import build_problem
from tensegrity_codegen.runtime.statics.static_problem import StaticProblem
from tensegrity_codegen.tables.strands import list_strands
from tests.models import EXAMPLES


@pytest.fixture(scope="module")
def problem() -> StaticProblem:
    """The shipped prism of three bars."""
    return build_problem(compile_scene(EXAMPLES / "prism.toml", for_="equilibrium"))


@pytest.mark.parametrize("size", [1e-4, 1e-2, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("seed", range(4))
def test_needed_damping_covers_the_energy_of_a_step(problem: StaticProblem, size: float, seed: int) -> None:
    """U(q + s) - U <= -f.s + s.K s / 2 + sum need d^2 / 2, also where cables go slack or taut on the way."""
    rng = np.random.default_rng(seed)
    coordinate = problem.model.nominal("coordinate").ravel()
    point = problem.find_point(coordinate + 0.05 * rng.standard_normal(problem.size))
    step = size * rng.standard_normal(problem.size)
    trial = problem.find_point(point.coordinate + step)
    damping = MemberDamping(problem)
    difference = problem.find_differences(point.coordinate)
    moved = (difference @ step).reshape(-1, 3)
    here, there = damping.locate(point), damping.locate(trial)
    need = damping.find_need(moved, here, there, problem.kept_members)
    assert (need >= 0.0).all()
    stiffness = problem.stiffness(point.coordinate)
    model = -point.residual @ step + step @ (stiffness @ step) / 2
    covered = model + need @ (moved**2).sum(axis=1) / 2
    assert trial.energy - point.energy <= covered + 1e-9 * (abs(model) + point.energy_scale)


def test_needed_damping_of_a_turning_bar_is_that_of_its_stretch() -> None:
    """Ends that part across a bar by d stretch it by l' - l: k (l' - l)^2 = need d^2 without tension."""
    stiffness, length, apart = 1e4, 2.0, 0.5

    class Point:
        largest_force = node_force = longest = np.array(length)
        tension = np.zeros(1)

    strands = list_strands(np.array([[0, 1]]), ())
    before, after = np.zeros((2, 2, 3))
    before[0, 0] = after[0, 0] = length
    after[0, 1] = apart
    stretch = np.hypot(length, apart) - length
    damping = Damping.start(1)
    damping.spring_constant[:] = stiffness
    here = locate_members(before, strands, Point)
    # A tension too small to matter: members at exactly zero count as slack.
    here.tension[:], there = 1e-9, locate_members(after, strands, Point)
    there = type(there)(
        there.vector, there.length, np.array([stiffness * stretch]), there.force, there.longest
    )
    moved = np.array([[0.0, apart, 0.0]])
    need = damping.find_need(moved, here, there, np.zeros(0, dtype=np.int64))
    np.testing.assert_allclose(need, stiffness * stretch**2 / apart**2, rtol=1e-6)
    np.testing.assert_allclose(find_turn(moved, here, there), [apart / length])
    assert damping.find_need(moved, here, there, np.array([0])).tolist() == [0.0]


def test_damping_grows_where_steps_fail_and_goes_where_they_succeed(problem: StaticProblem) -> None:
    damping = MemberDamping(problem)
    here = damping.locate(problem.find_point(problem.model.nominal("coordinate").ravel()))
    turn = np.zeros(len(problem.strands.member))
    turn[2] = 3.0
    damping.hold(turn, here)
    assert np.flatnonzero(damping.sigma).tolist() == [2]
    held = damping.sigma[2]
    damping.refuse(np.where(turn > 0, 50 * held, 0.0), here, 0)
    assert 2 * held < damping.sigma[2] < 50 * held
    damping.refuse(np.zeros_like(turn), here, 8)  # late attempts damp all members
    assert (damping.sigma > 0.0).all()
    assert (damping.shift > 0.0).all()
    for _ in range(20):
        damping.relax(np.zeros_like(turn), np.zeros_like(turn), 1.0, True)
        damping.forget_small(here)
    assert not damping.sigma.any()


def test_damping_of_compression_comes_before_a_shift(problem: StaticProblem) -> None:
    """Members in compression, then a shift, until the matrix is positive definite."""
    damping = MemberDamping(problem)
    here = damping.locate(problem.find_point(problem.model.nominal("coordinate").ravel()))
    for part in (0.125, 0.25, 0.5, 1.0):
        damping.harden(here, np.zeros(1))
        assert damping.compression_part.tolist() == [part]
    assert not damping.shift.any()
    damping.harden(here, np.zeros(1))
    assert (damping.shift > 0.0).all()
