"""Distance between bars: every case, against exact rationals and against sampling (LIN 3.2)."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegrity_codegen.symbolic.interference import (
    BAR_DISTANCE_CASE,
    MAX_PAIRS,
    BarPairs,
    build_bar_contact,
    build_bar_quantities,
)
from tensegrity_codegen.system.errors import FormulationError
from tests.cases import draws
from tests.segments import exact_distance, searched_distance

Array = NDArray[np.float64]
EPSILON = float(np.finfo(float).eps)
MANY = draws(25)


def make_contact(n_axes: int = 3) -> ca.Function:
    points = [ca.SX.sym(name, n_axes) for name in "abcd"]
    contact = build_bar_contact(*[[p[k] for k in range(n_axes)] for p in points])
    p, q = contact.points
    return ca.Function(
        "contact",
        points,
        [
            contact.distance,
            contact.case,
            ca.vertcat(*contact.parameters),
            ca.horzcat(ca.vertcat(*p), ca.vertcat(*q)),
            ca.vertcat(*contact.normal),
            ca.horzcat(*[ca.vertcat(*vector) for vector in contact.gradient]),
        ],
    )


CONTACT = make_contact()


def contact(*points: Any) -> tuple[float, str, Array, Array, Array, Array]:
    distance, case, parameters, nearest, normal, gradient = (
        np.array(item) for item in CONTACT(*[ca.DM(np.asarray(p, dtype=float)) for p in points])
    )
    name = BAR_DISTANCE_CASE[int(case[0, 0])]
    return float(distance[0, 0]), name, parameters[:, 0], nearest.T, normal[:, 0], gradient.T


def check_contact(points: list[Array]) -> None:
    """The distance is exact to rounding, and parameters and points belong to it."""
    a, b, c, d = points
    size = max(np.abs(p).max() for p in points)
    distance, _, (s, t), nearest, normal, gradient = contact(*points)
    assert abs(distance - exact_distance(*points)) <= 32 * EPSILON * size
    assert 0 <= s <= 1
    assert 0 <= t <= 1
    np.testing.assert_allclose(nearest[0], a + s * (b - a), atol=4 * EPSILON * size, rtol=0)
    np.testing.assert_allclose(nearest[1], c + t * (d - c), atol=4 * EPSILON * size, rtol=0)
    assert np.isfinite(gradient).all()
    assert np.linalg.norm(normal) < 1 + 1e-14
    np.testing.assert_allclose(gradient.sum(axis=0), 0, atol=1e-14)


def numbers(least: float, most: float) -> st.SearchStrategy[float]:
    """Numbers of nine digits: squares of distances below 1e-154 m lose their own digits."""
    return st.floats(least, most, allow_subnormal=False).map(lambda x: round(x, 9))


coordinates = numbers(-1, 1)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)


@MANY
@given(points, points, points, points)
def test_any_two_bars(a: Array, b: Array, c: Array, d: Array) -> None:
    check_contact([a, b, c, d])


@MANY
@given(
    points,
    points,
    points,
    numbers(-2, 2),
    st.sampled_from([0, 1e-17, 1e-16, 1e-15, 1e-13, 1e-11, 1e-9, 1e-6, 1e-3]),
    points,
)
def test_bars_that_are_parallel_or_nearly_so(
    a: Array, u: Array, w: Array, length: float, tilt: float, aside: Array
) -> None:
    check_contact([a, a + u, a + w, a + w + length * u + tilt * aside])


@MANY
@given(points, points, st.lists(numbers(-2, 2), min_size=2, max_size=2), st.booleans())
def test_bars_on_one_line(a: Array, u: Array, at: list[float], turned: bool) -> None:
    first = [a, a + u]
    second = [a + at[0] * u, a + at[1] * u]
    check_contact([*second, *first] if turned else [*first, *second])


@MANY
@given(points, points, points, numbers(0, 1), numbers(0, 1))
def test_bars_whose_axes_meet(a: Array, u: Array, v: Array, s: float, t: float) -> None:
    meeting = a + s * u
    check_contact([a, a + u, meeting - t * v, meeting + (1 - t) * v])


@MANY
@given(points, points, points, st.sampled_from(["first", "second", "both", "same"]))
def test_bars_without_length(a: Array, b: Array, c: Array, which: str) -> None:
    four = {"first": [a, a, b, c], "second": [b, c, a, a], "both": [a, a, b, b], "same": [a, a, a, a]}[which]
    check_contact(four)
    assert contact(*four)[1] == "no_length" or not np.array_equal(four[0], four[1])


@draws(25)
@given(points, points, points, points)
def test_sampling_finds_no_shorter_way(a: Array, b: Array, c: Array, d: Array) -> None:
    distance = contact(a, b, c, d)[0]
    assert distance <= searched_distance(a, b, c, d) + 1e-15


@draws(25)
@given(points, points, points, points)
def test_sampling_finds_the_distance(a: Array, b: Array, c: Array, d: Array) -> None:
    sine = np.linalg.norm(np.cross(b - a, d - c))
    assume(sine > 0.05)
    # The search finds the square of the distance to rounding, hence the distance to its root.
    assert searched_distance(a, b, c, d) == pytest.approx(contact(a, b, c, d)[0], abs=5e-8)


@MANY
@given(points, points, points, points)
def test_the_gradient_is_the_derivative_of_the_distance(a: Array, b: Array, c: Array, d: Array) -> None:
    four = [a, b, c, d]
    distance, name, _, _, normal, gradient = contact(*four)
    # Away from where two nearest pairs compete, or the axes meet, the distance is differentiable.
    assume(distance > 0.05 and np.linalg.norm(np.cross(b - a, d - c)) > 0.05)
    assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-14)
    step = 1e-6
    for row, point in enumerate(four):
        for axis in range(3):
            more, less = [p.copy() for p in four], [p.copy() for p in four]
            more[row][axis] += step
            less[row][axis] -= step
            slope = (contact(*more)[0] - contact(*less)[0]) / (2 * step)
            assert gradient[row, axis] == pytest.approx(slope, abs=1e-4), (name, point)


# Each figure of LIN 3.2, drawn with bar 1 on the x axis from -1 to 1.
FIRST = ([-1, 0, 0], [1, 0, 0])
CASES = {
    "both_inside": ([0, -1, 0.5], [0, 1, 0.5], 0.5),
    "first_outside_end_to_inner": ([1.3, -1, 0.4], [1.3, 1, 0.4], 0.5),
    "first_outside_end_to_end": ([2, -0.1, 1], [4, 4, 1], np.sqrt(1 + 0.01 + 1)),
    "second_outside_inner_to_end": ([0, 0.3, 0.4], [0, 2, 0.4], 0.5),
    "second_outside_end_to_end": ([1.3, 0.4, 1.2], [2.3, 1.4, 1.2], 1.3),
    "both_outside_inner_to_end": ([0.5, 0.3, 0.4], [3, 0.55, 0.4], 0.5),
    "both_outside_end_to_end": ([1.3, 0.4, 1.2], [-0.7, 3.4, 1.2], 1.3),
    "parallel_side_by_side": ([0, 0.3, 0.4], [3, 0.3, 0.4], 0.5),
    "parallel_apart": ([1.3, 0.4, 1.2], [3, 0.4, 1.2], 1.3),
    "no_length": ([0.2, 0.3, 0.4], [0.2, 0.3, 0.4], 0.5),
}


@pytest.mark.parametrize("name", CASES)
def test_a_figure_of_the_paper(name: str) -> None:
    c, d, expected = CASES[name]
    distance, found, *_ = contact(*FIRST, c, d)
    assert (found, distance) == (name, pytest.approx(expected, abs=1e-15))


def test_the_mirrored_case_of_figure_2f() -> None:
    c, d, expected = CASES["both_outside_inner_to_end"]
    distance, found, *_ = contact(c, d, *FIRST)
    assert (found, distance) == ("both_outside_end_to_inner", pytest.approx(expected, abs=1e-15))


def test_every_case_has_its_figure() -> None:
    assert set(CASES) | {"both_outside_end_to_inner"} == set(BAR_DISTANCE_CASE.values())


def test_nearest_points_of_parallel_bars_are_in_the_middle_of_where_they_face() -> None:
    _, _, (s, t), nearest, *_ = contact(*FIRST, [0, 0.3, 0.4], [3, 0.3, 0.4])
    np.testing.assert_allclose(nearest, [[0.5, 0, 0], [0.5, 0.3, 0.4]], atol=1e-15)
    assert (s, t) == (0.75, pytest.approx(1 / 6))


def test_where_axes_meet_the_gradient_is_the_common_normal() -> None:
    distance, name, _, _, normal, _ = contact(*FIRST, [0, -1, 0], [0, 1, 0])
    assert (distance, name) == (0, "both_inside")
    np.testing.assert_allclose(normal, [0, 0, 1], atol=0)


def test_on_one_line_and_overlapping_the_gradient_is_zero() -> None:
    distance, name, _, _, normal, _ = contact(*FIRST, [0, 0, 0], [3, 0, 0])
    assert (distance, name) == (0, "parallel_side_by_side")
    np.testing.assert_array_equal(normal, 0)


@pytest.mark.parametrize("n_axes", [1, 2])
def test_in_fewer_axes_the_distance_is_that_in_space(n_axes: int) -> None:
    rng = np.random.default_rng(3)
    planar = make_contact(n_axes)
    for _ in range(100):
        four = rng.uniform(-1, 1, (4, n_axes))
        padded = np.hstack([four, np.zeros((4, 3 - n_axes))])
        assert float(planar(*[ca.DM(p) for p in four])[0]) == contact(*padded)[0]


def pairs_of(count: int) -> BarPairs:
    symbols = ca.SX.sym("q", 6 * count)
    ends = [
        ([symbols[6 * k + i] for i in range(3)], [symbols[6 * k + 3 + i] for i in range(3)])
        for k in range(count)
    ]
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)]
    bars = BarPairs(ends, [0.1 * (k + 1) for k in range(count)], pairs)
    bars.symbols = symbols  # type: ignore[attr-defined]
    return bars


def test_pairs_of_bars_of_different_radii() -> None:
    bars = pairs_of(3)
    q = np.random.default_rng(1).uniform(-1, 1, (3, 2, 3))
    symbols = bars.symbols  # type: ignore[attr-defined]
    builders = build_bar_quantities(lambda: bars, symbols)
    evaluate = ca.Function("f", [symbols], [builder() for builder in builders.values()])
    distance, case, parameters, nearest, jacobian = evaluate(q.ravel())
    assert jacobian.shape == (3, 18)
    assert jacobian.nnz() == 36  # a pair depends on its own two bars only
    for row, (i, j) in enumerate(bars.pairs):
        expected, name, st_, points_, _, gradient = contact(*q[i], *q[j])
        assert float(distance[row]) == pytest.approx(expected - 0.1 * (i + j + 2), abs=1e-15)
        assert BAR_DISTANCE_CASE[int(case[row])] == name
        np.testing.assert_array_equal(np.array(parameters)[:, row], st_)
        np.testing.assert_array_equal(np.array(nearest).T[2 * row : 2 * row + 2], points_)
        found = np.array(ca.densify(jacobian))[row].reshape(3, 2, 3)
        np.testing.assert_array_equal(np.vstack([found[i], found[j]]), gradient)


def test_no_pairs_and_too_many_pairs_are_refused() -> None:
    with pytest.raises(FormulationError, match="no two bars"):
        BarPairs([], [], [])
    end = [ca.SX(0)] * 3
    with pytest.raises(FormulationError, match="too many pairs") as caught:
        BarPairs([(end, end)], [1.0], [(0, 0)] * (MAX_PAIRS + 1))
    assert "[interference]" in caught.value.hint
