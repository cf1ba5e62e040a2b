"""Slip at rings with friction: the equations of the capstan hold for any tensions and numbers of rings."""

import re
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.scene.assemble.assemble import assemble
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.structure.sliding import SlidingCable
from tensegrity_codegen.symbolic.members.rings import RingSlip

GIVING = 0.01  # of the damping, on what a strand gives away


def make_cable(n: int) -> tuple[RingSlip, list[Any]]:
    """Return a cable with n rings, and symbols of tensions without slip and of E."""
    pull, ratio = ca.SX.sym("a", n + 1), ca.SX.sym("E", n)
    damping = [ca.SX(2.0 + k) for k in range(n + 1)]
    strands: list[Any] = [
        SimpleNamespace(
            law=SimpleNamespace(damping=damping[k], mu=100.0, rest_length=1.0),
            stuck_tension=pull[k],
            giving=GIVING * damping[k],
        )
        for k in range(n + 1)
    ]
    names, rows = tuple(f"c_{k}" for k in range(n + 1)), tuple(range(n + 1))
    slip = RingSlip(SlidingCable("c", names, rows, (0.1,) * n, (90.0,) * n), strands)
    vars(slip)["ratios"] = [ratio[k] for k in range(n)]
    vars(slip)["limits"] = [(0.9 * (ratio[k] - 1.0) ** 2, 1.0) for k in range(n)]
    return slip, [pull, ratio]


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_flows_solve_the_equations_of_the_capstan(n: int) -> None:
    """T = a - c rho' and a hundredth of c on what a strand gives; ratios within E, or at it with flow."""
    slip, symbols = make_cable(n)
    flows, margins = slip.solution
    solve = ca.Function("f", symbols, [ca.vertcat(*flows), ca.vertcat(*margins)])
    rng = np.random.default_rng(n)
    seen = set()
    for _ in range(400):
        pull = np.maximum(1.0 + rng.choice([1.0, 0.05]) * rng.normal(size=n + 1), 0.0)
        ratio = 1.0 + rng.choice([0.02, 2.0]) * rng.random(n)
        found, margin = (np.array(item).ravel() for item in solve(pull, ratio))
        flow = np.concatenate([[0.0], found, [0.0]])
        slide = flow[:-1] - flow[1:]
        tension = pull - (2.0 + np.arange(n + 1)) * np.where(slide > 0, slide, GIVING * slide)
        before, behind = tension[:-1], tension[1:]
        assert (tension >= -1e-12).all()
        assert (behind <= ratio * before + 1e-10).all()
        assert (before <= ratio * behind + 1e-10).all()
        forth, back = found > 0, found < 0
        assert behind[forth] == pytest.approx((ratio * before)[forth], abs=1e-10)
        assert before[back] == pytest.approx((ratio * behind)[back], abs=1e-10)
        assert ((found == 0) == (margin >= 0))[tension[1:] > 0].all()
        seen |= set(np.sign(found).tolist())
    assert seen == {-1.0, 0.0, 1.0}


@pytest.mark.parametrize(
    ("n", "total", "most"), [(1, 12.0, 1e-11), (2, 24.0, 1e-11), (4, 24.0, 1e-13), (12, 40.0, 1e-13)]
)
def test_large_ratios_of_several_rings_do_not_spoil_the_flows(n: int, total: float, most: float) -> None:
    """The equations hold to rounding, which one ring enlarges by its E, not by the product over all rings."""
    slip, symbols = make_cable(n)
    solve = ca.Function("f", symbols, [ca.vertcat(*slip.solution[0])])
    ratio, rng = np.full(n, np.exp(total / n)), np.random.default_rng(n)
    n_slips = 0
    for spread in (0.05, 1.0, 5.0) * 30:
        pull = 8.0 * np.exp(spread * rng.normal(size=n + 1)) * (rng.random(n + 1) > 0.15)
        flow = np.array(solve(pull, ratio)).ravel()
        slide = -np.diff(np.concatenate([[0.0], flow, [0.0]]))
        tension = pull - (2.0 + np.arange(n + 1)) * np.where(slide > 0, slide, GIVING * slide)
        above, below = tension[1:] - ratio * tension[:-1], tension[:-1] - ratio * tension[1:]
        wrong = np.where(flow > 0, np.abs(above), np.where(flow < 0, np.abs(below), np.maximum(above, below)))
        assert max(wrong.max(), -tension.min()) <= most * pull.max()
        n_slips += np.count_nonzero(flow)
    assert n_slips > 20


def test_a_strand_cannot_hold_more_than_the_capstan_says() -> None:
    """10 N and mu 0.3 over 1.5 turns hold up to 169.020241717 N."""
    slip, (pull, _) = make_cable(1)
    slip = RingSlip(SlidingCable("c", ("c_1", "c_2"), (0, 1), (0.3,), (540.0,)), slip.strands)
    assert float(slip.ratios[0]) == pytest.approx(16.9020241717, rel=1e-10)
    flow = ca.Function("f", [pull], [slip.solution[0][0]])
    assert [float(flow([10.0, end])) > 0 for end in (169.020241716, 169.020241718)] == [False, True]
    assert [float(flow([end, 10.0])) < 0 for end in (169.020241716, 169.020241718)] == [False, True]


def make_strands(*vectors: list[float]) -> list[Any]:
    """Return strands of these vectors [m], which are all that limits depend on."""
    return [SimpleNamespace(vector=list(map(ca.SX, d)), length=ca.SX(np.linalg.norm(d))) for d in vectors]


@pytest.mark.parametrize("friction", [0.01, 0.1, 0.5, 3.0])
@pytest.mark.parametrize("n_axes", [2, 3])
def test_quick_limits_are_below_those_of_the_capstan(n_axes: int, friction: float) -> None:
    """Below (E - 1)^2 at all angles; with moderate friction and turns by more than half of it."""
    for angle in (0.0, 1e-9, 1e-3, 0.1, 0.5, 1.0, 2.0, 3.0, np.pi):
        turned = [0.7 * np.cos(angle), 0.7 * np.sin(angle), 0.0]
        strands = make_strands([2.0, 0.0, 0.0][:n_axes], turned[:n_axes])
        slip = RingSlip(SlidingCable("c", ("c_1", "c_2"), (0, 1), (friction,), (0.0,)), strands)
        assert float(slip.ratios[0]) == pytest.approx(np.exp(friction * angle), rel=1e-14)
        ((top, bottom),) = slip.limits
        limit, exact = float(top / bottom), np.expm1(friction * angle) ** 2
        assert limit < exact or angle == 0.0 >= limit
        if friction <= 0.5 and 0.01 < angle <= 1.0:
            assert limit > 0.6 * exact
    ((top, bottom),) = RingSlip(SlidingCable("c", ("c_1", "c_2"), (0, 1), (0.3,), (540.0,)), strands).limits
    assert float(top / bottom) == pytest.approx((16.9020241717 - 1.0) ** 2, rel=2e-6)


@pytest.mark.parametrize("n", [1, 3])
def test_a_cable_that_sticks_for_sure_gives_the_same_results(n: int) -> None:
    """Flows and margins without the quick answer are zero there too, and positive, the same to rounding."""
    (slip, symbols), (exact, same) = make_cable(n), make_cable(n)
    vars(exact)["moves"] = ca.SX(1.0)
    results = [
        ca.Function("f", given, [ca.vertcat(*item.solution[0]), ca.vertcat(*item.solution[1]), item.moves])
        for item, given in ((slip, symbols), (exact, same))
    ]
    rng, counts = np.random.default_rng(n), [0, 0]
    for _ in range(600):
        pull = 1.0 + rng.choice([0.1, 0.01, 0.0]) * rng.normal(size=n + 1)
        ratio = 1.0 + 0.2 * rng.random(n)
        (flow, margin, moves), (flow_of_all, margin_of_all, _) = (
            [np.array(part).ravel() for part in solve(pull, ratio)] for solve in results
        )
        counts[int(moves.item())] += 1
        assert flow.tolist() == flow_of_all.tolist()
        assert margin == pytest.approx(margin_of_all, rel=1e-9, abs=1e-15)
    assert min(counts) > 100


def test_generated_code_solves_for_flows_only_where_a_ring_may_slip() -> None:
    """One block in the accelerations; exponentials and angles stand in it alone, and nothing else jumps."""
    nodes = {
        "a": {"position": [0.0, 0.0, 0.0], "anchored": True},
        "ring": {"position": [1.0, 0.0, -0.5], "mass": 1.0},
        "b": {"position": [2.0, 0.0, 0.0], "mass": 1.0},
    }
    cable = {"kind": "cable", "nodes": ["a", "ring", "b"], "axial_stiffness": 100.0, "damping": 1.0}
    scene = {"name": "one", "nodes": nodes, "members": {"c": {**cable, "friction": 0.2}}}
    structure, request = assemble(parse_scene(scene, "scene"), "scene")
    (text,) = [text for name, text in emit(structure, request).files.items() if name == "one.c"]
    kernel = text[text.index("static void acceleration_kernel") :].partition("\n}\n")[0]
    found = re.fullmatch(r"(.*?)\n  if \([^{]*\) {\n(.*?)\n  }\n(.*)", kernel, re.DOTALL)
    assert found is not None
    before, block, behind = found.groups()
    for word in ("exp(", "atan2(", "fmax("):
        assert word in block
        assert word not in before + behind
    assert "if (" not in behind
