"""Motions with viscous members: closed forms, orders through slack, energy, an independent integration."""

import functools
from dataclasses import replace
from math import exp, log, pi
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.linear.linearize import linearize, linearize_quantities
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.models import load, simulator
from tests.plastic_cases import follow_mass, with_plastic
from tests.runtime.build import bar, cable, make_structure, spring
from tests.viscous_cases import FRACTION, MU, TIME, integrate_net, make_mass, make_net, with_viscous

Array = NDArray[np.float64]
METHODS = ("rk54", "tsit5", "rk853", "rodas", "radau")


def move(model: CompiledModel, times: Any, method: str, rtol: float, **more: Any) -> Trajectory:
    stepping = Stepping(atol=1e-2 * rtol, control="steps")
    samples = np.array(times, dtype=float)
    return simulate(model, samples[-1], samples=samples, method=method, rtol=rtol, stepping=stepping, **more)


def hold(x: float, kind: Any = cable) -> Structure:
    """Return a viscous cable between two held nodes, stretched by x, beside a mass on an elastic spring."""
    return with_viscous(
        make_structure(
            [[0, 0, 0], [1.0, 0, 0], [0, 1, 0]],
            [kind(0, 1, 1.0 - x, MU), spring(0, 2, 0.9, 50.0)],
            anchored={0: "xyz", 1: "xyz", 2: "xz"},
            inputs=(ActuatedInput("winch", "rest_length", (0,)),),
        ),
        [TIME, 0.0],
        FRACTION,
    )


@functools.cache
def load_mass() -> CompiledModel:
    return simulator(make_mass(), "rk853", batch_width=4, parameters={"rest_length": (0,)})


def load_hold(x: float) -> CompiledModel:
    """One library for all methods."""
    return simulator(hold(x), *METHODS)


@pytest.mark.parametrize("method", METHODS)
def test_the_tension_relaxes_at_a_constant_length(method: str) -> None:
    """t = mu x (h + (1 - h) exp(-s / T)) after a step of length, from p = 0."""
    x, times = 0.05, np.linspace(0.0, 1.0, 11)
    motion = move(load_hold(x), times, method, 1e-11, arguments={"internal": [0.0, 0.0]})
    expected = MU * x * (FRACTION + (1.0 - FRACTION) * np.exp(-times / TIME))
    assert motion.member_tension[:, 0] == pytest.approx(expected, rel=1e-9)
    lost = 0.5 * MU * (1.0 - FRACTION) * x**2 * (1.0 - exp(-2.0 / TIME))
    assert motion.work["viscous_work"] == pytest.approx(-lost, rel=1e-9)


def test_a_slack_cable_recovers_by_itself_and_is_taut_again() -> None:
    """Slack at x = 0.005 with p = 0.02: p' = -h p / T until p = x, then it relaxes with T."""
    x, start, times = 0.005, 0.02, np.linspace(0.0, 2.0, 41)
    motion = move(simulator(hold(x), "rk853"), times, "rk853", 1e-12, arguments={"internal": [start, 0.0]})
    taut = TIME / FRACTION * log(start / x)
    assert [*zip(motion.log.kind, motion.log.direction.tolist(), strict=True)] == [("cable", 1)]
    assert motion.log.time == pytest.approx([taut], abs=1e-11)
    relaxed = (1.0 - FRACTION) * x
    late = relaxed + (x - relaxed) * np.exp(-np.maximum(times - taut, 0.0) / TIME)
    p = np.where(times < taut, start * np.exp(-FRACTION * times / TIME), late)
    assert motion.internal is not None
    assert motion.internal[:, 0] == pytest.approx(p, abs=1e-12)
    assert motion.member_tension[:, 0] == pytest.approx(MU * np.maximum(x - p, 0.0), abs=1e-9)
    assert motion.member_tension[:, 0].min() == 0.0


def test_a_pushed_bar_relaxes_and_a_pushed_cable_is_without_force() -> None:
    for kind, p in ((bar, -0.7e-2 * (1.0 - exp(-1.0))), (cable, 0.0)):
        motion = move(
            simulator(hold(-0.01, kind), "rk853"),
            [0.0, TIME],
            "rk853",
            1e-12,
            arguments={"internal": [0.0, 0.0]},
        )
        assert motion.internal is not None
        assert motion.internal[-1, 0] == pytest.approx(p, abs=1e-13)
        tension = MU * (-0.01 - p) if kind is bar else 0.0
        assert motion.member_tension[-1, 0] == pytest.approx(tension, rel=1e-11)


@pytest.mark.parametrize("method", METHODS)
def test_creep_under_a_load_is_that_of_the_linear_equations(method: str) -> None:
    """2 x'' = F - mu (x - p), T p' = (1 - h) x - p, by the matrix exponential; it ends at F / (h mu)."""
    times = np.linspace(0.0, 1.5, 16)
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = [[0, 1, 0], [-MU / 2, 0, MU / 2], [(1 - FRACTION) / TIME, 0, -1 / TIME]]
    matrix[1, 3] = 4.0
    state = np.array([0.05, 0.0, 0.035, 1.0])  # where it starts: relaxed as it stands in the scene
    exact = np.array([(scipy.linalg.expm(matrix * time) @ state)[:3] for time in times])
    motion = move(simulator(make_mass(spring), *METHODS), times, method, 1e-12)
    assert motion.internal is not None
    assert motion.coordinate[:, 0] - 1.0 == pytest.approx(exact[:, 0], abs=1e-10)
    assert motion.internal[:, 0] == pytest.approx(exact[:, 2], abs=1e-10)
    assert motion.energy_drift is not None
    assert motion.energy_drift < 1e-9
    rest = scipy.linalg.expm(matrix * 200.0) @ state
    assert rest[0] == pytest.approx(8.0 / (FRACTION * MU), rel=1e-10)


@pytest.mark.parametrize("method", ["rk853", "rodas"])
def test_the_loop_of_a_sinusoidal_length_has_its_area(method: str) -> None:
    """Area pi mu A^2 (1 - h) w T / (1 + w^2 T^2): what goes in over a period, and what is stated as taken."""
    omega, size, mean, n = 3.0 * pi, 0.01, 0.05, 2000
    period = 2.0 * pi / omega
    times = np.linspace(0.0, period, n + 1)
    winch = Profile(times, {"winch": -size * np.sin(omega * times)}, "cubic")
    swing = (1.0 - FRACTION) * size / (1.0 + 1j * omega * TIME)
    start = [(1.0 - FRACTION) * mean + swing.imag, 0.0]  # steady from the first period on
    motion = move(load_hold(mean), times, method, 1e-12, schedule=winch, arguments={"internal": start})
    area = pi * MU * size**2 * (1.0 - FRACTION) * omega * TIME / (1.0 + (omega * TIME) ** 2)
    assert motion.work["viscous_work"] == pytest.approx(-area, rel=1e-9)
    power = motion.member_tension[:-1, 0] * size * omega * np.cos(omega * times[:-1])
    assert float(power.sum()) * period / n == pytest.approx(area, rel=1e-9)
    assert motion.internal is not None
    assert motion.internal[-1, 0] == pytest.approx(start[0], abs=1e-12)


@pytest.fixture(scope="module")
def thrown() -> tuple[CompiledModel, Array]:
    """A mass on a viscous cable and one on a stiff spring, and where an independent integration ends."""
    pair = make_structure(
        [[0.0, 0, 0], [1.05, 0, 0], [0, 1.0, 0], [1.1, 1.0, 0]],
        [cable(0, 1, 1.0, MU), spring(2, 3, 1.0, 2e4)],
        anchored={0: "xyz", 1: "yz", 2: "xyz", 3: "yz"},
        load={1: (8.0, 0, 0)},
        mass=np.array([1.0, 2.0, 1.0, 1.0]),
    ).with_changes(node_velocity=np.array([[0.0] * 3, [-2.0, 0, 0], [0.0] * 3, [0.0] * 3]))
    pair = with_viscous(pair, [TIME, 0.3], FRACTION)
    exact, _, _, kinks = integrate_net(pair, np.array([0.035, 0.07]), 1.2)
    assert kinks == 3
    return simulator(pair, "rk54", "tsit5", "rk853"), exact


@pytest.mark.parametrize(("method", "least"), [("rk54", 4.7), ("tsit5", 4.7), ("rk853", 7.5)])
def test_orders_hold_through_slack_and_taut(
    thrown: tuple[CompiledModel, Array], method: str, least: float
) -> None:
    """Error over the number of steps, with the tolerance; most of them for a stiff spring beside."""
    model, exact = thrown
    runs = [move(model, [0.0, 1.2], method, rtol) for rtol in (1e-7, 1e-8, 1e-9, 1e-10)]
    errors = [float(np.abs(run.coordinate[-1] - exact).max()) for run in runs]
    order = np.polyfit(np.log([run.n_steps for run in runs]), np.log(errors), 1)[0]
    assert -order > least
    assert errors[-1] < 1e-10


def test_fixed_steps_end_at_kinks_and_keep_their_order() -> None:
    thrown = make_mass().with_changes(node_velocity=np.array([[0.0] * 3, [-2.0, 0.0, 0.0]]))
    exact, model = integrate_net(thrown, np.array([0.035]), 1.2)[0][0], simulator(thrown, "rk4")
    errors = []
    for step in (1e-2, 5e-3, 2.5e-3):
        stepping = Stepping(step=step, control="steps")
        motion = simulate(model, 1.2, samples=2, method="rk4", stepping=stepping)
        errors.append(abs(motion.coordinate[-1, 0] - exact))
    assert errors[0] / errors[1] > 12.0
    assert errors[1] / errors[2] > 12.0


def test_a_net_of_viscous_members_moves_as_an_independent_integration_says() -> None:
    """27 times a cable goes slack or taut; Radau, Rosenbrock and Runge-Kutta methods agree."""
    net = make_net()
    model = simulator(net, *METHODS)
    start = model.nominal("internal")
    coordinate, dashpot, taken, kinks = integrate_net(net, np.append(start[:5], 0.0), 0.6)
    for method in METHODS:
        motion = move(model, [0.0, 0.3, 0.6], method, 1e-11)
        assert motion.status == "ok"
        assert motion.coordinate[-1] == pytest.approx(coordinate, abs=3e-10)
        assert motion.log.kind == ("cable",) * kinks
        assert motion.internal is not None
        assert motion.internal[-1, :5] == pytest.approx(dashpot[:5], abs=1e-10)
        assert -motion.work["viscous_work"] == pytest.approx(taken, rel=1e-9)
        assert motion.energy_drift is not None
        assert motion.energy_drift < 1e-9


def test_many_motions_go_side_by_side() -> None:
    model = simulator(make_net(), "rk853", batch_width=8)
    speeds = np.random.default_rng(1).normal(size=(5, 6))
    batch = simulate_batch(model, 0.3, velocity=speeds, samples=3, method="rk853", rtol=1e-10)
    for k, speed in enumerate(speeds):
        one = move(model, [0.0, 0.15, 0.3], "rk853", 1e-11, velocity=speed)
        assert batch.status[k] == "ok"
        assert batch.coordinate[k] == pytest.approx(one.coordinate, abs=1e-6)


def test_a_motion_starts_relaxed_where_it_starts() -> None:
    """Of another place and rest length too, alone and in a batch; unless `internal` says otherwise."""
    model = load_mass()
    rests, places = np.array([[1.01], [0.98], [1.2]]), np.array([[1.05], [1.07], [1.05]])
    batch = simulate_batch(
        model, 0.1, coordinate=places, arguments={"rest_length": rests}, samples=3, method="rk853", rtol=1e-9
    )
    for k, (rest, place) in enumerate(zip(rests, places, strict=True)):
        one = move(model, [0, 0.05, 0.1], "rk853", 1e-11, coordinate=place, arguments={"rest_length": rest})
        assert one.internal is not None
        assert batch.internal is not None
        assert one.internal[0, 0] == pytest.approx(0.7 * max(place.item() - rest.item(), 0.0), abs=1e-15)
        assert batch.internal[k] == pytest.approx(one.internal, abs=1e-7)
        assert batch.coordinate[k] == pytest.approx(one.coordinate, abs=1e-7)


def test_linear_models_have_the_dashpot_as_a_state() -> None:
    """m s^2 + mu (1 - (1 - h) / (1 + T s)) = 0, the relaxed member at rest."""
    winch = (ActuatedInput("winch", "rest_length", (0,)),)
    mass = make_mass().with_changes(inputs=winch)
    model = load(mass, *linearize_quantities("node_position", with_inputs=True), "relaxed_internal")
    place = 1.0 + 8.0 / (FRACTION * MU)
    relaxed = model.compute("relaxed_internal", coordinate=[place])
    linear = linearize(model, coordinate=[place], arguments={"internal": relaxed})
    assert linear.state_name[2:] == ("e0_viscous",)
    assert np.abs(linear.residual_rate).max() < 1e-12
    expected = np.roots([2.0 * TIME, 2.0, MU * TIME, MU * FRACTION])
    found = np.linalg.eigvals(linear.A.toarray())
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), rel=1e-10)
    slopes = [0.0, MU / 2.0, -(1.0 - FRACTION) / TIME]
    assert linear.B.toarray().ravel() == pytest.approx(slopes, rel=1e-12)


def test_rigid_bars_damping_and_rings_keep_the_balance() -> None:
    """A rigid rod on viscous cables, one of which a damped ring shares: energy but for what is taken."""
    rod = make_structure(
        [[0, 0, 0.0], [1, 0, 0.0], [0, 0, 1.0], [1, 0.1, 1.0], [0.5, 0.4, -0.3]],
        [
            bar(0, 1, 1.0, 0.0, mass=1.0),
            cable(0, 2, 1.0, 2000.0),
            cable(1, 3, 1.005, 2000.0),
            cable(0, 1, 1.35, 900.0),
        ],
        anchored={2: "xyz", 3: "xyz"},
        gravity=(0.0, 0.0, -9.81),
        mass=0.5,
    ).with_changes(ring_nodes=((), (), (), (4,)))
    structure = with_viscous(rod, [0.0, 0.1, 0.3, 0.2], 0.4)
    model = simulator(structure, "rk853", "rodas", formulation="rigid_bar")
    ends = []
    for method in ("rk853", "rodas"):
        motion = move(model, np.linspace(0.0, 0.8, 9), method, 1e-11)
        assert motion.status == "ok"
        assert motion.energy_drift is not None
        assert motion.energy_drift < 1e-8
        assert motion.work["viscous_work"] < -0.1
        ends.append(motion.coordinate[-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


def test_damping_works_beside_springs_and_dashpot() -> None:
    """`energy_rate` is what damping and dashpot take."""
    model = simulator(make_mass(spring, damping=3.0), "rk853", more=("energy_rate", "viscous_power"))
    motion = move(model, np.linspace(0.0, 0.5, 4001), "rk853", 1e-11)
    assert motion.internal is not None
    states = list(zip(motion.coordinate, motion.velocity, motion.internal, strict=True))
    rate, lost = (
        np.array([float(model.compute(name, coordinate=q, velocity=v, internal=z)) for q, v, z in states])
        for name in ("energy_rate", "viscous_power")
    )
    assert rate - lost == pytest.approx(-3.0 * motion.velocity[:, 0] ** 2, abs=1e-9)
    change = float(np.sum((rate[1:] + rate[:-1]) / 2 * np.diff(motion.time)))
    assert motion.total_energy[-1] - motion.total_energy[0] == pytest.approx(change, rel=1e-5)


def test_viscous_and_plastic_members_stand_side_by_side() -> None:
    """Two masses apart, one on each: the viscous one moves as alone, though yield events settle the other."""
    pair = make_structure(
        [[0.0, 0, 0], [1.0, 0, 0], [0.0, 1.0, 0], [1.05, 1.0, 0]],
        [spring(0, 1, 1.0, 1e4), cable(2, 3, 1.0, MU)],
        anchored={0: "xyz", 1: "yz", 2: "xyz", 3: "yz"},
        load={3: (8.0, 0.0, 0.0)},
        mass=np.array([1.0, 1.0, 1.0, 2.0]),
    )
    pair = with_viscous(with_plastic(pair, [50.0, 0.0]), [0.0, TIME], FRACTION)
    pair = pair.with_changes(node_velocity=np.array([[0.0] * 3, [2.0, 0, 0], [0.0] * 3, [0.0] * 3]))
    motion = move(simulator(pair, "rk853"), [0.0, 0.1], "rk853", 1e-12)
    alone = move(load_mass(), [0.0, 0.1], "rk853", 1e-12)
    assert motion.log.kind.count("yield") == 4
    assert motion.coordinate[-1] - 1.0 == pytest.approx(
        [follow_mass([0.0, 0.1])[0][-1, 0], alone.coordinate[-1, 0] - 1.0], abs=1e-9
    )
    assert motion.work["viscous_work"] == pytest.approx(alone.work["viscous_work"], rel=1e-8)
    assert motion.energy_drift is not None
    assert motion.energy_drift < 1e-8


@pytest.mark.parametrize(
    ("request_of", "word"),
    [
        ({"emitter": "table"}, "viscous members are not supported here: emitter 'table'"),
        ({"keep": ("energy",)}, "energy that is kept"),
        ({"solvers": ("equilibrium",)}, "solvers"),
        ({"formulation": "node_distance"}, "formulation"),
        ({"columns": ("velocity",)}, "derivatives of motions"),
        ({"more": ("rest_length_jacobian",)}, "rest_length_jacobian"),
    ],
)
def test_what_does_not_know_viscous_members_is_refused(request_of: dict[str, Any], word: str) -> None:
    with pytest.raises(FormulationError, match=word):
        simulator(make_mass(), "rk54", **request_of)


def test_methods_of_scipy_are_refused() -> None:
    with pytest.raises(FormulationError, match="members with memory"):
        simulate(load_mass(), 0.01, method="scipy_dop853")


@pytest.mark.thorough
def test_viscous_cables_stand_beside_feet_on_the_ground() -> None:
    """A prism drops on its feet: the same by two methods, and the work of all that takes energy balances."""
    from tests.ground_cases import make_prism

    prism = make_prism()
    assert prism.ground is not None
    prism = prism.with_changes(ground=replace(prism.ground, balances_energy=True))
    prism = with_viscous(prism, np.where(prism.tension_only, 0.05, 0.0), 0.5)
    model = simulator(prism, "rk853", "rodas", formulation="rigid_bar")
    found = [move(model, [0.0, 0.4], method, 1e-10) for method in ("rk853", "rodas")]
    assert "ground" in found[0].log.kind
    assert all(motion.energy_drift is not None and motion.energy_drift < 1e-8 for motion in found)
    assert found[0].work["viscous_work"] < 0.0
    assert found[0].coordinate[-1] == pytest.approx(found[1].coordinate[-1], abs=1e-6)
