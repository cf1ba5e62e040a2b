"""The elastic catenary against closed forms, its own equations and differences (Irvine, Cable Structures)."""

import math

import numpy as np
import pytest

from tensegrity_codegen.structure.catenary import Catenary, find_catenary
from tensegrity_codegen.system.errors import InvalidValueError


def test_a_cable_that_does_not_stretch() -> None:
    found = find_catenary(10.0, 0.0, 10.5, 1.0)
    assert found.horizontal_force == pytest.approx(9.19639630037, rel=1e-11)
    assert found.sag == pytest.approx(1.39304206592, rel=1e-11)
    assert found.end_tension == pytest.approx([10.5894383663] * 2, rel=1e-11)
    # 2 a sinh(span / 2 a) = length, a (cosh(span / 2 a) - 1) = sag, with a = H / w.
    a = found.horizontal_force
    assert 2 * a * math.sinh(5.0 / a) == pytest.approx(10.5, rel=1e-12)
    assert a * (math.cosh(5.0 / a) - 1) == pytest.approx(found.sag, rel=1e-11)


def test_an_elastic_cable() -> None:
    found = find_catenary(10.0, 0.0, 10.5, 1.0, 1000.0)
    assert found.horizontal_force == pytest.approx(8.38006825738, rel=1e-11)
    assert found.sag == pytest.approx(1.52249673979, rel=1e-11)
    assert found.vertical_force == pytest.approx(5.25, rel=1e-12)
    shape = found.points(4)
    assert shape.shape == (5, 2)
    assert shape[[0, 2, 4]] == pytest.approx(np.array([[0, 0], [5, -found.sag], [10, 0]]), abs=1e-12)


def test_the_forces_balance_along_the_whole_cable() -> None:
    """T' = (0, w) along a cable whose tension is EA times its strain: its own equations, by differences."""
    found = find_catenary(7.0, 3.0, 7.2, 2.0, 50.0)
    s = np.linspace(0.0, 7.2, 20001)
    step = np.diff(found.position(s), axis=0)
    tension = found.tension((s[:-1] + s[1:]) / 2)
    stretch = np.linalg.norm(step, axis=1) / np.diff(s)
    assert stretch == pytest.approx(1.0 + tension / 50.0, rel=1e-7)
    force = tension[:, None] * step / np.linalg.norm(step, axis=1)[:, None]
    assert np.ptp(force[:, 0]) < 1e-6 * force[0, 0]
    assert np.diff(force[:, 1]) == pytest.approx(np.full(19999, 2.0 * s[1]), abs=1e-8)
    assert found.end_tension == pytest.approx(np.linalg.norm(force[[0, -1]], axis=1), rel=1e-3)


@pytest.mark.parametrize(
    ("rise", "length", "first", "second"),
    [
        # taut: T = EA (d / l0 - 1) + or - w l0 / 2, the upper end pulled more
        (-3.0, 2.9, 1000 / 2.9 * 0.1 + 1.45, 1000 / 2.9 * 0.1 - 1.45),
        (3.0, 2.9, 1000 / 2.9 * 0.1 - 1.45, 1000 / 2.9 * 0.1 + 1.45),
        # a loop: (V - w l0 / 2) l0 / EA + (2 V - w l0) / w = 3
        (-3.0, 10.0, 5 + 3 / (10 / 1000 + 2), 5 - 3 / (10 / 1000 + 2)),
        (0.0, 10.0, 5.0, 5.0),
    ],
)
def test_a_vertical_cable_has_no_horizontal_force(
    rise: float, length: float, first: float, second: float
) -> None:
    found = find_catenary(0.0, rise, length, 1.0, 1000.0)
    assert found.horizontal_force == 0.0
    assert found.sag == 0.0
    assert found.end_tension == pytest.approx([first, second], rel=1e-12)
    assert found.position(np.array([length]))[0] == pytest.approx([0.0, rise], abs=1e-12)
    near = find_catenary(1e-6, rise, length, 1.0, 1000.0)
    assert near.end_tension == pytest.approx(found.end_tension, rel=1e-5)
    assert found.tangent[1, 1] == pytest.approx(near.tangent[1, 1], rel=1e-4)
    if length < abs(rise):
        assert found.tangent[0, 0] == pytest.approx(near.tangent[0, 0], rel=1e-4)
    else:  # the stiffness of a loop sideways falls as 1 / log(1 / span), to nothing
        assert found.tangent[0, 0] == 0.0
        assert near.tangent[0, 0] < 0.5 * find_catenary(1e-2, rise, length, 1.0, 1000.0).tangent[0, 0]


@pytest.mark.parametrize(
    "cable",
    [(10.0, 0.0, 10.5, 1.0), (10.0, 3.0, 10.6, 1.0, 1e3), (4.0, -9.0, 9.0, 2.0, 100.0), (1, 2, 30, 1, 1e5)],
)
def test_the_tangent_is_the_derivative_of_the_forces(cable: tuple[float, ...]) -> None:
    def pull(span: float, rise: float) -> np.ndarray:
        found = find_catenary(span, rise, *cable[2:])
        return np.array([found.horizontal_force, -found.vertical_force])

    found, step = find_catenary(*cable), 1e-5
    span, rise = cable[:2]
    slopes = np.array(
        [
            (pull(span + step, rise) - pull(span - step, rise)) / (2 * step),
            (pull(span, rise + step) - pull(span, rise - step)) / (2 * step),
        ]
    ).T
    assert found.tangent == pytest.approx(slopes, rel=1e-5, abs=1e-6 * np.abs(slopes).max())
    assert found.tangent == pytest.approx(found.tangent.T, rel=1e-9)
    whole = found.tangent_stiffness
    assert whole[:2, :2] == pytest.approx(found.tangent)
    assert whole @ np.tile([1.0, 2.0], 2) == pytest.approx(np.zeros(4), abs=1e-9 * np.abs(whole).max())


def test_thousands_of_cables_of_all_sizes_reach_their_ends() -> None:
    random = np.random.default_rng(1)
    for _ in range(2000):
        span, rise = 10.0 ** random.uniform(-8, 3, 2) * (1, random.choice([-1, 1]))
        chord, weight = math.hypot(span, rise), 10.0 ** random.uniform(-9, 5)
        is_rigid = random.random() < 0.3
        stiffness = math.inf if is_rigid else weight * chord * 10.0 ** random.uniform(-2, 8)
        longer = is_rigid or random.random() < 0.5
        length = chord * (1 + 10.0 ** random.uniform(-6, 2) if longer else random.uniform(0.2, 1))
        found = find_catenary(span, rise, length, weight, stiffness)
        size = max(chord, length * (1 + weight * length / stiffness))
        assert found.position(np.array([length]))[0] == pytest.approx([span, rise], abs=1e-9 * size)
        assert np.linalg.eigvalsh(found.tangent)[0] >= -1e-9 * np.abs(found.tangent).max()


@pytest.mark.parametrize(
    ("cable", "where"),
    [
        ((-1.0, 0.0, 2.0, 1.0), "span"),
        ((1.0, math.nan, 2.0, 1.0), "rise"),
        ((1.0, 0.0, 0.0, 1.0), "length"),
        ((1.0, 0.0, 2.0, 0.0), "weight"),
        ((1.0, 0.0, 2.0, 1.0, 0.0), "axial_stiffness"),
        ((1.0, 0.0, 2.0, "heavy"), "weight"),
        ((3.0, 4.0, 5.0, 1.0), "length"),
    ],
)
def test_what_is_no_cable_is_refused(cable: tuple[float, ...], where: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        find_catenary(*cable)
    assert caught.value.where == where


def test_a_record_is_what_it_was_made_of() -> None:
    assert find_catenary(0.0, -1.0, 3.0, 2.0) == Catenary(0.0, -1.0, 3.0, 2.0, math.inf, 0.0, 4.0)
