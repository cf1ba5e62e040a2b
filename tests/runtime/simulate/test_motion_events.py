"""Contacts in a simulation: times in closed form, dips between samples, symmetry, refusals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import CONTACT_QUANTITIES, Until, simulate
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.body_scenes import example
from tests.cases import thorough
from tests.models import simulator
from tests.runtime.build import bar, make_structure, spring

RADIUS = 0.05
METHODS = ("auto", "rk4", "scipy_dop853", *thorough("rk54", "scipy_radau"))
EVENTS = ("contact", "condition")
Vector = tuple[float, float, float]


def build(structure: Any, *more: str, formulation: str = "node_position", **request: Any) -> CompiledModel:
    more = (*CONTACT_QUANTITIES, *more)
    return simulator(structure, "rk4", "rk54", more=more, formulation=formulation, events=EVENTS, **request)


def place_bars(shift: Vector, speed: Vector, force: float = 0.0, *, crossed: bool = True) -> Structure:
    """A bar at rest along y, and one along x or y at `shift` from it that flies with `speed`, pulled along z.

    The nodes have 1 kg, the force acts on both.
    """
    half = np.array([0.5, 0.0, 0.0] if crossed else [0.0, 0.5, 0.0])
    position = [[0.0, -0.5, 0.0], [0.0, 0.5, 0.0], np.subtract(shift, half), np.add(shift, half)]
    load = dict.fromkeys((2, 3), (0.0, 0.0, force))
    structure = make_structure(position, [bar(0, 1, 1.0), bar(2, 3, 1.0)], load=load)
    velocity = np.array([[0.0] * 3, [0.0] * 3, speed, speed])
    return structure.with_changes(radius=np.full(2, RADIUS), node_velocity=velocity)


@pytest.fixture(scope="module")
def bars() -> CompiledModel:
    """Two bars, wherever they start and however the second is pulled."""
    return build(place_bars((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), parameters={"node_load": (2, 3)})


def start_of(*words: Any, **more: Any) -> dict[str, Any]:
    """Return what `simulate` starts these bars with."""
    structure = place_bars(*words, **more)
    return {
        "coordinate": structure.node_position.flatten(),
        "velocity": structure.node_velocity.ravel(),
        "arguments": {"node_load": structure.node_load[2:]},
    }


@pytest.mark.parametrize(
    ("condition", "kind", "time"), [("n2.z < 0.85", "condition", 0.075), ("n2.z < 0.05", "contact", 0.45)]
)
def test_what_comes_first_ends_the_motion(
    bars: CompiledModel, condition: str, kind: str, time: float
) -> None:
    """A bar comes down from z = 1 m at 2 m/s, and touches the other one after 0.9 m."""
    start = start_of((0.1, 0.2, 1.0), (0.0, 0.0, -2.0))
    found = simulate(bars, 0.6, **start, until=Until(condition=condition, contact=True))
    (event,) = found.events
    assert event.kind == kind
    assert event.time == pytest.approx(time, rel=1e-9)
    assert "no contact" not in found.message


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [21, *thorough(2)])
def test_bars_that_fly_at_each_other_touch_when_they_must(
    bars: CompiledModel, method: str, samples: int
) -> None:
    gap, speed, acceleration = 1.0 - 2 * RADIUS, 2.0, 3.0
    expected = (np.sqrt(speed**2 + 2 * acceleration * gap) - speed) / acceleration
    start = start_of((0.1, 0.2, 1.0), (0.0, 0.0, -speed), -acceleration)
    step = 1e-3 if method == "rk4" else None
    found = simulate(
        bars, 0.5, samples=samples, method=method, stepping=Stepping(step=step), **start, until="contact"
    )
    assert found.status == "ok"
    (event,) = found.events
    assert (event.kind, event.names) == ("contact", ("e0_e1",))
    assert event.time == pytest.approx(expected, rel=1e-9)
    assert abs(event.margin) < 1e-12
    assert found.time[-1] == event.time
    assert found.time[:-1].tolist() == [t for t in np.linspace(0, 0.5, samples) if t < expected]
    np.testing.assert_array_equal(found.coordinate[-1], event.coordinate)
    np.testing.assert_array_equal(found.velocity[-1], event.velocity)
    assert found.node_position[-1, 2, 2] == pytest.approx(2 * RADIUS, rel=1e-9)
    assert "contact of e0_e1" in found.message


def test_node_distances_find_the_same_contact() -> None:
    words: Any = ((0.1, 0.2, 1.0), (0.0, 0.0, -2.0), -3.0)
    times = [
        simulate(build(place_bars(*words), formulation=name), 0.5, until="contact").events[0].time
        for name in ("node_position", "node_distance")
    ]
    assert times[0] == pytest.approx(times[1], rel=1e-9)


def test_bars_that_fly_through_each_other_between_two_samples_touch(bars: CompiledModel) -> None:
    start = start_of((0.0, 0.0, 1.0), (0.0, 0.0, -20.0))
    found = simulate(bars, 0.1, samples=2, **start, until="contact")
    assert found.events[0].time == pytest.approx((1.0 - 2 * RADIUS) / 20.0, rel=1e-9)


@pytest.mark.parametrize("depth", [1e-4, *thorough(1e-2, 1e-8)])
def test_a_grazing_contact_between_two_samples_is_found(bars: CompiledModel, depth: float) -> None:
    height = 2 * RADIUS - depth
    start = start_of((1.0, 0.1, height), (-4.0, 0.0, 0.0), crossed=False)
    found = simulate(bars, 0.5, samples=2, **start, until="contact")
    expected = (1.0 - np.sqrt((2 * RADIUS) ** 2 - height**2)) / 4.0
    # A graze makes rounding of the distance large in time: dt = d / speed of approach.
    assert found.events[0].time == pytest.approx(expected, rel=max(1e-9, 1e-14 / depth))


@pytest.mark.parametrize("method", METHODS)
def test_bars_that_just_miss_do_not_touch(bars: CompiledModel, method: str) -> None:
    start = start_of((1.0, 0.1, 2 * RADIUS + 1e-8), (-4.0, 0.0, 0.0), crossed=False)
    step = 1e-2 if method == "rk4" else None
    found = simulate(
        bars, 0.5, samples=2, method=method, stepping=Stepping(step=step), **start, until="contact"
    )
    assert (found.status, found.events, found.time.tolist()) == ("ok", (), [0.0, 0.5])
    assert "no contact" in found.message
    assert found.summary()["events"] == []


def test_bars_that_overlap_from_the_start_say_so_at_zero(bars: CompiledModel) -> None:
    start = start_of((0.0, 0.0, RADIUS), (0.0, 0.0, 1.0))
    found = simulate(bars, 1.0, **start, until="contact")
    (event,) = found.events
    assert (event.time, event.margin) == (0.0, pytest.approx(-RADIUS))
    assert found.time.tolist() == [0.0]
    assert found.status == "ok"


def test_what_goes_wrong_after_the_contact_does_not_matter(bars: CompiledModel) -> None:
    start = start_of((0.0, 0.0, 1.0), (0.0, 0.0, -20.0))
    start["coordinate"][1] += 1e-12  # which a step far too large lets grow tenfold, step by step
    run: dict[str, Any] = {"samples": 51, "method": "rk4", "stepping": Stepping(step=1e-2)}
    alone = simulate(bars, 5.0, **run, **start)
    found = simulate(bars, 5.0, **run, **start, until="contact")
    assert (alone.status, found.status) == ("unstable", "ok")
    assert found.events[0].time == pytest.approx(0.045, rel=1e-9)


def bouncing_bar() -> CompiledModel:
    """A bar on two springs 0.5 m above one at rest, let go 0.3 m above its place: z = 0.5 + 0.3 cos(10 t)."""
    ends = [[-0.5, 0.0], [0.5, 0.0]]
    position = [[*end, 3.0] for end in ends] + [[*end, 0.8] for end in ends]
    position += [[0.0, -0.5, 0.25], [0.0, 0.5, 0.25]]
    members = [spring(0, 2, 2.5), spring(1, 3, 2.5), bar(2, 3, 1.0), bar(4, 5, 1.0)]
    structure = make_structure(position, members, anchored={0: "xyz", 1: "xyz", 2: "xy", 3: "xy", 4: "xyz"})
    return build(structure.with_changes(radius=np.array([0, 0, RADIUS, RADIUS])))


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["auto", "rk54", "rk4", "scipy_dop853"])
def test_the_first_of_many_contacts_between_two_samples_is_found(method: str) -> None:
    model = bouncing_bar()
    step = 1e-3 if method == "rk4" else None
    run: dict[str, Any] = {
        "samples": 4,
        "method": method,
        "stepping": Stepping(step=step, atol=1e-12),
        "rtol": 1e-10,
    }
    found = simulate(model, 6 * np.pi, until="contact", **run)
    assert found.events[0].time == pytest.approx(np.arccos(-0.5) / 10, rel=1e-9)
    whole = simulate(model, 6 * np.pi, **run)
    assert whole.events == ()


@pytest.mark.thorough
def test_the_prism_of_three_bars_touches_at_three_places_at_once() -> None:
    system = example("lin_prism")
    model = build(system, "state_derivative", formulation="bodies")
    velocity = np.tile([0.0, -20.0], 3)  # all azimuths turn inwards
    given: Any = {"velocity": velocity, "rtol": 1e-10, "stepping": Stepping(atol=1e-12)}
    found = simulate(model, 0.5, until="contact", **given)
    (event,) = found.events
    assert event.names == ("bar1_bar2", "bar1_bar3", "bar2_bar3")
    assert found.status == "ok"

    def distance(time: float, state: np.ndarray) -> float:
        return float(model.compute("bar_distance", coordinate=state[:6]).min())

    def derivative(time: float, state: np.ndarray) -> np.ndarray:
        return model.compute("state_derivative", coordinate=state[:6], velocity=state[6:])

    distance.terminal = True  # type: ignore[attr-defined]
    start = np.concatenate([model.nominal("coordinate"), velocity])
    check = solve_ivp(derivative, (0, 0.5), start, "DOP853", events=distance, rtol=1e-12, atol=1e-13)
    assert event.time == pytest.approx(check.t[-1], rel=1e-8)
    assert np.abs(model.compute("bar_distance", coordinate=event.coordinate)).max() < 1e-12


def test_contacts_of_a_motion_that_goes_on_are_in_its_log() -> None:
    position = [[0, -1, 0], [0, 1, 0], [-1, 0, 1], [1, 0, 1], [-1, 0.06, -2], [1, 0.06, -2]]
    structure = make_structure(position, [bar(0, 1, 2.0), bar(2, 3, 2.0), bar(4, 5, 2.0)])
    velocity = np.array([[0.0, 0.0, 0.0]] * 2 + [[0.0, 0.0, -1.0]] * 2 + [[0.0, 0.0, 1.0]] * 2)
    model = build(structure.with_changes(radius=np.full(3, RADIUS), node_velocity=velocity))
    times = []
    for pair in ("e0_e1", "e1_e2", "e0_e2"):
        found = simulate(model, 4.0, samples=5, until=Until(condition=f'bar_distance["{pair}"]', stops=False))
        assert (found.status, found.events, found.time[-1]) == ("ok", (), 4.0)
        times.append(found.log.time[found.log.direction < 0][0])
    # e1 and e2 pass each other side by side, 0.06 apart: they touch where the heights differ by 0.08.
    assert times == pytest.approx([0.9, 1.46, 1.9], rel=1e-9)


def test_a_contact_with_a_schedule_is_found_by_scipy(bars: CompiledModel) -> None:
    start = start_of((0.1, 0.2, 1.0), (0.0, 0.0, -2.0))
    found = simulate(bars, 0.6, samples=4, schedule=lambda time: {}, **start, until="contact")
    assert found.method.startswith("auto (scipy")
    assert found.events[0].time == pytest.approx(0.45, rel=1e-9)
    assert found.time.tolist() == pytest.approx([0.0, 0.2, 0.4, found.events[0].time])
    assert found.log.kind == ("contact",)


def test_a_file_holds_the_events(tmp_path: Any) -> None:
    model = build(example("lin_prism"), formulation="bodies")
    found = simulate(model, 0.5, velocity=np.tile([0.0, -20.0], 3), until="contact")
    found.write(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz", allow_pickle=False) as file:
        assert file["event_name"].tolist() == ["bar1_bar2", "bar1_bar3", "bar2_bar3"]
        assert file["event_kind"].tolist() == ["contact"] * 3
        assert file["event_time"].tolist() == [found.events[0].time] * 3
    replace(found, events=()).write(tmp_path / "none.npz")
    with np.load(tmp_path / "none.npz", allow_pickle=False) as file:
        assert file["event_time"].shape == file["event_name"].shape == (0,)


def test_a_model_without_the_functions_is_refused() -> None:
    structure = place_bars((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    model = simulator(structure, "rk54")
    with pytest.raises(FormulationError, match="lacks functions") as caught:
        simulate(model, 1.0, until="contact")
    assert caught.value.given == "bar_distance"
    model = simulator(structure, "rk54", more=("bar_distance",))
    with pytest.raises(FormulationError, match="built without these events"):
        simulate(model, 1.0, until="contact")
