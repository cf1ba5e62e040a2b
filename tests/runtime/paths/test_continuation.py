"""Load paths against closed forms: limit points, bifurcations, events, kinks, and how a path may end."""

import pickle
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from tensegrity_codegen.runtime.paths.continuation import StepControl, follow_path
from tensegrity_codegen.runtime.paths.load_path import Watch
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tests.cases import thorough
from tests.runtime.path_problems import Chain, Column, Kinked, Line, VonMises

FREE = {"floor": -np.inf}


@pytest.mark.parametrize("height", [0.05, 0.3, 1.0])
def test_the_limit_load_of_the_truss_of_von_mises(height: float) -> None:
    truss = VonMises(height)
    path = follow_path(truss, truss.start, most=3 * truss.limit_load(), **FREE)
    first, second = path.find_events("limit")
    assert first.load_factor == pytest.approx(truss.limit_load(), rel=1e-10)
    assert second.load_factor == pytest.approx(-truss.limit_load(), rel=1e-10)
    assert abs(first.tangent[-1]) < 1e-6 * truss.limit_load()
    assert path.status == "completed"
    assert path.load_factor[-1] == 3 * truss.limit_load()
    assert path.coordinate[-1, 1] < -height
    stable = path.smallest_eigenvalue > 0
    falling = path.load_rate < 0
    assert (stable[~falling] | (np.abs(path.load_rate[~falling]) < 1e-6 * truss.limit_load())).all()


def test_every_point_of_a_path_is_an_equilibrium() -> None:
    truss = VonMises(0.3)
    path = follow_path(truss, truss.start, most=3.0, **FREE)
    force = [truss.residual(q, load) for q, load in zip(path.coordinate, path.load_factor, strict=True)]
    assert np.abs(force).max() < 1e-12
    assert path.residual.max() < 1e-12


def test_a_path_that_comes_back_ends_where_it_began() -> None:
    truss = VonMises(0.3)
    path = follow_path(truss, truss.start, most=10.0)
    assert (path.status, path.is_followed) == ("returned", False)
    assert f"{truss.limit_load():.10g}" in path.message
    assert path.load_factor[-1] == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(path.coordinate[-1], 0, atol=1e-9)


@pytest.mark.parametrize("beyond", [1e-2, 1e-10, *thorough(1e-4, 1e-7)])
@pytest.mark.parametrize("step", [0.25, *thorough(0.07)])
@pytest.mark.parametrize("after", [-0.5, -0.05, None])
def test_a_path_ends_at_its_load_just_before_one_where_it_turns_back(
    beyond: float, step: float, after: float | None
) -> None:
    """The load crosses its end twice within a step: at a kink, and at a smooth limit point (None)."""
    truss = VonMises(0.3)
    limit = truss.limit_load() if after is None else 1.0
    problem, start = (truss, truss.start) if after is None else (Kinked(after), np.zeros(1))
    watches = [Watch("slack", ("a",), lambda q, load: 1 - q, is_kink=True)] if after is not None else []
    most = limit * (1 - beyond)
    path = follow_path(problem, start, most=most, watches=watches, control=StepControl(largest=step), **FREE)
    assert path.status == "completed"
    assert path.load_factor.max() == path.load_factor[-1] == most
    assert path.events == ()


def test_a_tall_truss_bifurcates_before_its_limit_load() -> None:
    truss = VonMises(3.0)
    path = follow_path(truss, truss.start, most=1.2 * truss.limit_load(), **FREE)

    def sideways(length: float) -> float:
        return 1 + (length - truss.rest_length) * (length**2 - 1) / length

    length = optimize.brentq(sideways, 2.5, truss.rest_length, xtol=1e-15)
    events = path.events
    assert [event.kind for event in events[:3]] == ["bifurcation", "limit", "bifurcation"]
    assert events[0].load_factor == pytest.approx(truss.load(length), rel=1e-10)
    assert events[1].load_factor == pytest.approx(truss.limit_load(), rel=1e-10)
    np.testing.assert_allclose(np.abs(events[0].mode.ravel()), [1, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(events[1].mode.ravel()), [0, 1], atol=1e-6)


def test_a_column_of_rigid_links_buckles_at_its_two_loads() -> None:
    column = Column(2.0)
    path = follow_path(column, [0.0, 0.0], most=10.0)
    assert path.status == "completed"
    assert [event.kind for event in path.events] == ["bifurcation", "bifurcation"]
    loads = [event.load_factor for event in path.events]
    np.testing.assert_allclose(loads, 3 + np.array([-1, 1]) * np.sqrt(5), rtol=1e-10)
    golden = (1 + np.sqrt(5)) / 2
    mode = path.events[0].mode.ravel()
    assert mode[1] / mode[0] == pytest.approx(golden, rel=1e-9)
    np.testing.assert_array_equal(path.coordinate, 0)


def test_equal_columns_side_by_side_buckle_together() -> None:
    column = Column(2.0)

    class Pair:
        def residual(self, q, load):
            return np.concatenate([column.residual(q[:2], load), column.residual(q[2:], load)])

        def stiffness(self, q, load):
            zero = np.zeros((2, 2))
            return np.block([[column.stiffness(q[:2], load), zero], [zero, column.stiffness(q[2:], load)]])

        def load_vector(self, q, load):
            return np.sin(q)

    path = follow_path(Pair(), np.zeros(4), most=1.0)
    (event,) = path.find_events("bifurcation")
    assert event.names == ("mode1", "mode2")
    assert event.load_factor == pytest.approx(3 - np.sqrt(5), rel=1e-10)


@pytest.mark.parametrize("size", [5, *thorough(400)])
def test_limit_load_of_a_chain_with_dense_and_with_sparse_factors(size: int) -> None:
    path = follow_path(Chain(size), np.zeros(size), most=1.0)
    (event,) = path.find_events("limit")
    assert event.load_factor == pytest.approx(2 / 3, rel=1e-10)
    assert event.coordinate[0] == pytest.approx(1, abs=1e-6)
    assert path.status == "returned"


def test_watched_values_are_located_and_equal_ones_reported_together() -> None:
    def values(q, load):
        return np.array([0.3 - q[0], q[0] ** 2 - 0.25, 0.3 - load, np.cos(5 * q[0])])

    watch = Watch("fall", ("a", "b", "c", "d"), values, rising="rise")
    path = follow_path(Line(), [0.0], most=1.0, watches=[watch])
    found = [(event.kind, event.names) for event in path.events]
    assert found == [("fall", ("a", "c")), ("fall", ("d",)), ("rise", ("b",)), ("rise", ("d",))]
    expected = [0.3, np.pi / 10, 0.5, 3 * np.pi / 10]
    np.testing.assert_allclose([event.load_factor for event in path.events], expected, rtol=1e-12)
    for event in path.events:
        assert path.load_factor[event.point] == event.load_factor


@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6])
def test_a_value_that_dips_below_zero_within_one_step_is_noticed(depth: float) -> None:
    watch = Watch("in", ("a",), lambda q, load: (q - 0.511) ** 2 - depth, rising="out")
    path = follow_path(Line(), [0.0], most=1.0, watches=[watch], control=StepControl(largest=0.5))
    assert [event.kind for event in path.events] == ["in", "out"]
    expected = 0.511 + np.array([-1, 1]) * np.sqrt(depth)
    np.testing.assert_allclose([event.load_factor for event in path.events], expected, rtol=1e-9)


def test_a_value_that_stays_at_zero_for_a_while_is_crossed_once_each_way() -> None:
    """Tensions of slack cables are exactly zero; such a crossing was found again and again, without end."""

    def values(q, load):
        away = np.interp(q[0], [0.0, 0.2, 0.3, 0.34, 0.4, 1.0], [0.2, 0.0, 0.0, -0.1, 0.1, 0.2])
        return np.array([away, 0.35 - q[0]])

    watch = Watch("fall", ("a", "b"), values, rising="rise")
    path = follow_path(Line(), [0.0], most=1.0, watches=[watch], control=StepControl(largest=0.5))
    assert path.status == "completed"
    assert [(event.kind, event.names) for event in path.events][-2:] == [("fall", ("b",)), ("rise", ("a",))]
    assert [event.names for event in path.events].count(("a",)) % 2 == 0


def test_a_path_stops_where_it_is_told_to() -> None:
    watch = Watch("contact", ("a",), lambda q, load: 0.25 - q, stops=True)
    path = follow_path(Line(), [0.0], most=1.0, watches=[watch])
    assert (path.status, path.is_followed) == ("stopped", True)
    assert path.load_factor[-1] == pytest.approx(0.25, rel=1e-12)
    assert "contact of a" in path.message
    inside = Watch("contact", ("a",), lambda q, load: -0.1 - q, stops=True)
    begun = follow_path(Line(), [0.0], most=1.0, watches=[inside])
    assert (begun.status, len(begun.load_factor)) == ("stopped", 1)
    assert begun.events[0].load_factor == 0
    assert "at the start" in begun.message


@pytest.mark.parametrize(
    ("after", "kinds"), [(0.1, ["slack"]), (20.0, ["slack"]), (-0.5, ["slack", "limit"])]
)
def test_a_path_is_cut_at_a_kink_and_goes_on_behind_it(after: float, kinds: list[str]) -> None:
    watch = Watch("slack", ("a",), lambda q, load: 1 - q, is_kink=True)
    path = follow_path(Kinked(after), [0.0], most=2.0, watches=[watch])
    assert [event.kind for event in path.events] == kinds
    assert path.events[0].load_factor == pytest.approx(1, rel=1e-12)
    if after > 0:
        assert path.status == "completed"
        assert path.coordinate[-1, 0] == pytest.approx(1 + 1 / after, rel=1e-12)
    else:
        assert path.status == "returned"
        assert path.coordinate[-1, 0] == pytest.approx(3, rel=1e-9)


def test_stiffness_that_ends_at_a_kink_ends_the_path() -> None:
    watch = Watch("slack", ("a",), lambda q, load: 1 - q, is_kink=True)

    class Broken(Kinked):
        def load_vector(self, q, load):
            return np.array([1.0 if q[0] < 1 else 0.0])

    path = follow_path(Broken(0.0), [0.0], most=2.0, watches=[watch])
    assert path.status == "stalled"
    assert path.load_factor[-1] == pytest.approx(1)


def test_a_path_downwards_from_a_load_other_than_zero() -> None:
    truss = VonMises(0.3)
    path = follow_path(truss, truss.start, least=0.5, most=-3.0)
    assert path.status == "completed"
    assert path.load_factor[0] == 0.5
    assert path.load_factor[-1] == -3.0
    assert path.events == ()


def test_where_no_equilibrium_is_near_the_start() -> None:
    path = follow_path(Kinked(-0.5), [0.0], least=2.0, most=3.0)
    assert (path.status, len(path.load_factor)) == ("no_start", 0)
    assert path.as_evidence()["load_factor_end"] is None


def test_too_few_steps_are_said() -> None:
    truss = VonMises(0.3)
    path = follow_path(truss, truss.start, most=3.0, control=StepControl(most_steps=3), **FREE)
    assert path.status == "step_limit"
    assert len(path.load_factor) == 4


def test_forces_that_end_being_finite_end_the_path() -> None:
    class Wall(Line):
        def residual(self, q, load):
            if q[0] > 0.5:
                raise NonFiniteError("beyond the wall")
            return load - q

    path = follow_path(Wall(), [0.0], most=1.0)
    assert path.status == "stalled"
    assert path.load_factor[-1] == pytest.approx(0.5, abs=1e-6)


def test_a_load_along_a_motion_that_costs_nothing_is_refused() -> None:
    class Floating:
        def residual(self, q, load):
            return np.array([q[1] - q[0] + load, q[0] - q[1]])

        def stiffness(self, q, load):
            return np.array([[1.0, -1.0], [-1.0, 1.0]])

        def load_vector(self, q, load):
            return np.array([1.0, 0.0])

    both = np.full((2, 1), np.sqrt(0.5))
    path = follow_path(Floating(), [0.0, 0.0], most=1.0, neutral=lambda q, k: both)
    assert path.status == "no_start"
    assert "without stiffness" in path.message


@pytest.mark.parametrize(
    ("start", "most", "error"),
    [([0.0], 0.0, InvalidValueError), ([np.nan], 1.0, NonFiniteError), ([0.0], np.inf, NonFiniteError)],
)
def test_arguments_that_make_no_path_are_refused(start, most, error) -> None:
    with pytest.raises(error):
        follow_path(Line(), start, most=most)


def test_a_start_that_is_no_vector_is_refused() -> None:
    with pytest.raises(InvalidValueError):
        follow_path(Line(), [[0.0]], most=1.0)


class Circle:
    """The circle of radius 1 around q = 0, lambda = 0.5."""

    def residual(self, q: Any, load_factor: float, /) -> Any:
        return np.array([1 - q[0] ** 2 - (load_factor - 0.5) ** 2])

    def stiffness(self, q: Any, load_factor: float, /) -> Any:
        return np.array([[2 * q[0]]])

    def load_vector(self, q: Any, load_factor: float, /) -> Any:
        return np.array([-2 * (load_factor - 0.5)])


def test_a_closed_path_ends_where_it_began() -> None:
    path = follow_path(Circle(), [0.8660254], most=5.0, floor=-np.inf)
    assert (path.status, "closed loop" in path.message) == ("returned", True)
    assert path.load_factor.max() == pytest.approx(1.5, abs=0.02)
    assert path.load_factor.min() == pytest.approx(-0.5, abs=0.02)


def test_a_kind_of_event_may_end_the_path() -> None:
    problem = VonMises(0.5)
    path = follow_path(problem, problem.start, most=2 * problem.limit_load(), stop_at=("limit",))
    assert path.status == "stopped"
    assert path.load_factor[-1] == pytest.approx(problem.limit_load(), rel=1e-9)


def test_a_path_is_pickled_and_described_in_a_few_lines() -> None:
    truss = VonMises(0.3)
    path = follow_path(truss, truss.start, most=10.0)
    again = pickle.loads(pickle.dumps(path))
    np.testing.assert_array_equal(again.coordinate, path.coordinate)
    assert [event.kind for event in again.events] == ["limit"]
    assert len(repr(path).splitlines()) <= 5
    assert "returned" in repr(path)
