"""Motions with plastic members: closed form, orders through events, energy, an independent integration."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.simulate.simulate_batch import simulate_batch
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import ActuatedInput, Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.models import simulator
from tests.plastic_cases import follow_mass, integrate_net, make_mass, with_plastic
from tests.runtime.build import bar, cable, make_structure, prism, spring

METHODS = ("rk54", "tsit5", "rk853", "rodas", "radau")
FIRST_YIELD, PEAK = 0.00252680255142, 0.034056941504209
LAWS = [(0.1, 0.0), (0.1, 1.0), (0.3, 0.4), (0.0, 0.0)]


def move(model: CompiledModel, times: Any, method: str, rtol: float, **more: Any) -> Trajectory:
    stepping = Stepping(atol=1e-2 * rtol, control="steps")
    samples = np.array(times, dtype=float)
    return simulate(model, samples[-1], samples=samples, method=method, rtol=rtol, stepping=stepping, **more)


def load_mass(*law: float) -> CompiledModel:
    """Return one library a law, for all tests."""
    return simulator(make_mass(*law), *METHODS, "rk4", more=("state_jacobian", "yield_margin"))


@pytest.fixture(scope="module")
def mass() -> CompiledModel:
    return load_mass()


@pytest.mark.parametrize("method", METHODS)
def test_a_mass_on_a_plastic_spring_yields_and_turns_where_it_should(
    mass: CompiledModel, method: str
) -> None:
    exact = follow_mass([0.0, 0.1])[1]
    motion = move(mass, [0.0, exact[1], 0.1], method, 1e-12)
    assert motion.status == "ok"
    assert motion.log.kind == ("yield",) * 4
    assert motion.log.name == ("e0",) * 4
    assert motion.log.direction.tolist() == [-1, 1, -1, 1]
    assert motion.log.time[0] == pytest.approx(FIRST_YIELD, abs=5e-15)
    assert motion.log.time == pytest.approx(exact, abs=3e-12)
    assert motion.coordinate[1, 0] - 1.0 == pytest.approx(PEAK, abs=1e-13)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("hardening", "isotropic"), LAWS)
def test_the_motion_is_that_of_the_closed_form(method: str, hardening: float, isotropic: float) -> None:
    times = np.linspace(0.0, 0.1, 21)
    exact = follow_mass(times, hardening, isotropic)[0]
    model = load_mass(hardening, isotropic)
    motion = move(model, times, method, 1e-11)
    assert motion.coordinate[-1, 0] - 1.0 == pytest.approx(exact[-1, 0], abs=2e-10)
    assert motion.coordinate[:, 0] - 1.0 == pytest.approx(exact[:, 0], abs=1e-9)  # dense output
    assert motion.velocity[:, 0] == pytest.approx(exact[:, 1], abs=1e-7)
    assert motion.internal is not None
    assert motion.internal[:, :2] == pytest.approx(exact[:, 2:], abs=1e-9)
    assert motion.energy_drift is not None
    assert motion.energy_drift < 1e-7


@pytest.mark.parametrize(("method", "least"), [("rk54", 4.7), ("tsit5", 4.7), ("rk853", 7.5)])
def test_orders_hold_through_yield_and_unloading(method: str, least: float) -> None:
    """Error over the number of steps, with the tolerance; 26 events of flow in a net would hide nothing."""
    end = 0.1
    exact = follow_mass([0.0, end], 0.3, 0.4)[0][-1, 0]
    model = load_mass(0.3, 0.4)
    runs = [move(model, [0.0, end], method, rtol) for rtol in (1e-7, 1e-9, 1e-11, 3e-13)]
    errors = [abs(run.coordinate[-1, 0] - 1.0 - exact) for run in runs]
    steps = [run.n_steps for run in runs]
    order = np.polyfit(np.log(steps), np.log(np.maximum(errors, 1e-16)), 1)[0]
    assert -order > least
    assert errors[-1] < 1e-13


def test_fixed_steps_end_at_events_and_keep_their_order(mass: CompiledModel) -> None:
    times = np.linspace(0.0, 0.1, 11)
    exact = follow_mass(times)[0][:, 0]
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        motion = simulate(
            mass, 0.1, samples=times, method="rk4", stepping=Stepping(step=step, control="steps")
        )
        assert motion.log.kind == ("yield",) * 4
        errors.append(float(np.abs(motion.coordinate[:, 0] - 1.0 - exact).max()))
    assert errors[0] / errors[1] > 12.0
    assert errors[1] / errors[2] > 12.0


def make_net() -> Structure:
    """Return two masses in four cables that yield, harden in their ways and go slack, and a spring."""
    place = [[0, 0, 1], [1, 0, 1], [0.3, 0.9, 1], [0.4, 0.3, 0.2], [0.5, 0.35, -0.3]]
    cables = [(0, 3, 0.94, 2000.0), (1, 3, 1.04, 2000.0), (2, 3, 1.0, 3000.0), (3, 4, 0.51, 1500.0)]
    net = make_structure(
        place,
        [*(cable(*item) for item in cables), spring(0, 4, 1.43, 800.0)],
        anchored=dict.fromkeys(range(3), "xyz"),
        gravity=(0.0, 0.0, -9.81),
        mass=np.array([1.0, 1.0, 1.0, 1.0, 2.0]),
    )
    velocity = np.zeros((5, 3))
    velocity[3:] = [[2.0, -1.0, -2.0], [1.0, 0.5, -4.0]]
    force, hardening, isotropic = [40.0, 30.0, 50.0, 25.0, 0.0], [0.1, 0.2, 0.05, 0.3, 0], [0, 0.5, 1.0, 0, 0]
    return with_plastic(net, force, np.array(hardening), np.array(isotropic)).with_changes(
        node_velocity=velocity
    )


def test_a_net_of_plastic_cables_moves_as_an_independent_integration_says() -> None:
    net = make_net()
    coordinate, plastic = integrate_net(net, 0.6)
    assert plastic[3] > 0.04
    model = simulator(net, "rk54", "rk853", "rodas", more=("plastic_elongation",))
    for method in ("rk54", "rk853", "rodas"):
        motion = move(model, [0.0, 0.6], method, 1e-11)
        assert motion.coordinate[-1] == pytest.approx(coordinate, abs=3e-10)
        assert motion.log.kind.count("yield") == 22
        assert motion.log.kind.count("cable") == 16
        assert motion.internal is not None
        state = {"coordinate": motion.coordinate[-1], "internal": motion.internal[-1]}
        assert model.compute("plastic_elongation", **state) == pytest.approx(plastic, abs=3e-10)
        assert motion.energy_drift is not None
        assert motion.energy_drift < 1e-9


def test_a_prism_of_plastic_members_falls_apart_the_same_by_three_methods() -> None:
    """All bars and cables yield, 177 events in half a second; two of a symmetric pair yield at one time."""
    twisted = prism(mass=0.5)
    limit = np.abs(twisted.static_tension()) * 1.05 + 1e-3
    random = np.random.default_rng(0).normal(size=(6, 3))
    structure = with_plastic(twisted, limit, 0.02, 0.5).with_changes(node_velocity=2.0 * random)
    model = simulator(structure, "rk853", "rodas")
    found = [move(model, [0.0, 0.5], method, 1e-9) for method in ("rk853", "rodas")]
    assert found[0].log.count == found[1].log.count == 177
    assert found[0].coordinate[-1] == pytest.approx(found[1].coordinate[-1], abs=1e-6)
    assert max(motion.energy_drift or 0.0 for motion in found) < 1e-8
    hung = make_structure(
        [[-1, 0, 0], [1, 0, 0], [0, 0, 0]],
        [cable(0, 2, 0.9, 2e3), cable(1, 2, 0.9, 2e3)],
        anchored={0: "xyz", 1: "xyz"},
        gravity=(0.0, 0.0, -9.81),
        mass=3.0,
    )
    velocity = np.array([[0.0] * 3, [0.0] * 3, [0.0, 0.0, -6.0]])
    pair = with_plastic(hung, 230.0, 0.1, 0.3).with_changes(node_velocity=velocity)
    motion = move(simulator(pair, "rk54"), [0.0, 0.5], "rk54", 1e-10)
    assert motion.log.name[:2] == ("e0", "e1")
    assert motion.log.time[0] == motion.log.time[1]
    assert motion.coordinate[-1, :2] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_cable_that_has_yielded_slackens_where_its_rest_length_has_grown() -> None:
    """Pulled once, it goes slack at rest length + q and lets the mass fly."""
    model = simulator(make_mass(0.1, tension_only=True), "rk853")
    motion = move(model, np.linspace(0.0, 0.06, 7), "rk853", 1e-12)
    slack = next(k for k, kind in enumerate(motion.log.kind) if kind == "cable" and motion.log.time[k] > 0.01)
    q = 0.9 * (PEAK - 0.005)
    quarter = float(np.arccos((q - q) / (PEAK - q))) / 100.0  # from the peak to x = q
    turn = follow_mass([0.0, 0.1])[1][1]
    assert motion.log.time[slack] == pytest.approx(turn + quarter, abs=1e-11)
    speed = 100.0 * (PEAK - q)
    left = 0.06 - motion.log.time[slack]
    assert motion.coordinate[-1, 0] - 1.0 == pytest.approx(q - speed * left, abs=1e-11)
    assert motion.member_tension[-1, 0] == 0.0


def test_rigid_bars_and_plastic_cables() -> None:
    """A rigid rod on two plastic cables: energy is kept but for what flow takes, by all methods alike."""
    rod = make_structure(
        [[0, 0, 0.0], [1, 0, 0.0], [0, 0, 1.0], [1, 0.1, 1.0]],
        [bar(0, 1, 1.0, 0.0, mass=1.0), cable(0, 2, 1.0, 2000.0), cable(1, 3, 1.005, 2000.0)],
        anchored={2: "xyz", 3: "xyz"},
        gravity=(0.0, 0.0, -9.81),
        mass=0.5,
    )
    model_of = with_plastic(rod, [0.0, 12.0, 14.0], 0.1, 0.3)
    model = simulator(model_of, "rk853", "rodas", formulation="rigid_bar")
    ends = []
    for method in ("rk853", "rodas"):
        motion = move(model, np.linspace(0.0, 0.8, 9), method, 1e-11)
        assert motion.log.kind.count("yield") >= 4
        assert motion.energy_drift is not None
        assert motion.energy_drift < 1e-8
        ends.append(motion.coordinate[-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-8)


def test_damping_works_beside_the_slider() -> None:
    """t = mu (x - q) + c x' with flow by mu (x - q) alone; the balance holds with what damping takes."""
    model = simulator(make_mass(0.1, damping=3.0), "rk853", more=("energy_rate", "plastic_power"))
    motion = move(model, np.linspace(0.0, 0.05, 2001), "rk853", 1e-11)
    assert motion.status == "ok"
    assert motion.internal is not None
    states = zip(motion.coordinate, motion.velocity, motion.internal, strict=True)
    rate = [float(model.compute("energy_rate", coordinate=q, velocity=v, internal=z)) for q, v, z in states]
    change = float(np.sum((np.array(rate[1:]) + rate[:-1]) / 2 * np.diff(motion.time)))
    assert motion.total_energy[-1] - motion.total_energy[0] == pytest.approx(change, rel=1e-3)


def test_a_motion_goes_on_from_its_internal_states(mass: CompiledModel) -> None:
    """Cut in flow, and cut after unloading: the second part ends where the whole motion does."""
    whole = move(mass, [0.0, 0.02, 0.035, 0.1], "rk853", 1e-12)
    assert whole.internal is not None
    for row, time in ((1, 0.02), (2, 0.035)):
        rest = simulate(
            mass,
            0.1 - time,
            method="rk853",
            rtol=1e-12,
            samples=2,
            stepping=Stepping(atol=1e-14, control="steps"),
            coordinate=whole.coordinate[row],
            velocity=whole.velocity[row],
            arguments={"internal": whole.internal[row]},
        )
        assert rest.coordinate[-1] == pytest.approx(whole.coordinate[-1], abs=1e-9)


def test_a_start_beyond_the_yield_force_begins_in_flow() -> None:
    """Pulled to x = 0.02 at once: t = 65 N, q = 0.0135 from the first sample on."""
    stretched = make_mass()
    place = stretched.node_position.copy()
    place[1, 0] = 1.02
    model = simulator(stretched.with_changes(node_position=place, node_velocity=np.zeros((2, 3))), "rk54")
    motion = move(model, [0.0, 1e-3], "rk54", 1e-10)
    assert motion.member_tension[0, 0] == pytest.approx(65.0, rel=1e-12)
    assert motion.internal is not None
    assert motion.internal[:, 0] == pytest.approx([0.0135, 0.0135], rel=1e-12)


def test_the_jacobian_of_the_state_is_that_of_differences(mass: CompiledModel) -> None:
    step = 1e-6
    for flags in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        state = np.array([1.003, 0.7, 0.002, 0.004, *flags])

        def rate(z: Any) -> Any:
            given = {"coordinate": z[:1], "velocity": z[1:2], "internal": z[2:]}
            return np.asarray(mass.compute("state_derivative", **given))

        found = mass.compute(
            "state_jacobian", coordinate=state[:1], velocity=state[1:2], internal=state[2:]
        ).toarray()
        for k in range(4):
            shift = np.eye(6)[k] * step
            column = (rate(state + shift) - rate(state - shift)) / (2 * step)
            assert found[:, k] == pytest.approx(column, abs=1e-4)


def test_many_motions_are_simulated_one_after_the_other(mass: CompiledModel) -> None:
    speeds = np.array([[1.0], [2.0]])
    batch = simulate_batch(mass, 0.1, velocity=speeds, samples=3, method="rk853", rtol=1e-10)
    for k, speed in enumerate(speeds):
        one = simulate(mass, 0.1, velocity=speed, samples=3, method="rk853", rtol=1e-10)
        assert batch.coordinate[k] == pytest.approx(one.coordinate, abs=1e-7)


@pytest.mark.parametrize(
    ("request_of", "word"),
    [
        ({"emitter": "table"}, "emitter 'table'"),
        ({"precision": "single"}, "single precision"),
        ({"batch_width": 8}, "batch functions"),
        ({"events": ("cable",)}, "without yield"),
        ({"interfaces": ("casadi",)}, "interfaces"),
        ({"keep": ("energy",)}, "energy that is kept"),
        ({"solvers": ("equilibrium",)}, "solvers"),
        ({"columns": ("velocity",)}, "derivatives of motions"),
        ({"formulation": "node_distance"}, "formulation"),
    ],
)
def test_what_does_not_know_plastic_members_is_refused(request_of: dict[str, Any], word: str) -> None:
    with pytest.raises(FormulationError, match=word) as error:
        simulator(make_mass(), "rk54", **request_of)
    # The hint is a choice that helps: another formulation does not where derivatives are asked for.
    is_open = not request_of.keys() & {"keep", "solvers", "columns"}
    assert ("simulate with formulation" in error.value.hint) is is_open
    assert ("leave yield_force out" in error.value.hint) is not is_open


def test_methods_of_scipy_and_profiles_of_plastic_members_are_refused() -> None:
    winch = (ActuatedInput("winch", "rest_length", (0,)), ActuatedInput("push", "force", (1,), (1.0, 0, 0)))
    model = simulator(make_mass().with_changes(inputs=winch), "rk54")
    with pytest.raises(FormulationError, match="SciPy"):
        simulate(model, 0.01, method="scipy_dop853")
    profile = Profile(np.array([0.0, 0.1]), {"winch": np.array([0.0, 0.01])})
    with pytest.raises(InvalidValueError, match="plastic members are constant"):
        simulate(model, 0.1, schedule=profile, method="rk54")
    pushed = Profile(np.array([0.0, 0.1]), {"push": np.array([0.0, 10.0])})
    assert simulate(model, 0.1, schedule=pushed, method="rk54").status == "ok"


@pytest.mark.thorough
def test_plastic_cables_stand_beside_feet_on_the_ground() -> None:
    """A prism drops on its feet: slip, yield and slack in one motion, the same by two methods."""
    from tests.ground_cases import make_prism

    prism = make_prism()
    force = np.where(prism.tension_only, 20.5, 0.0)
    prism = with_plastic(prism, force, 0.1, 0.5)
    model = simulator(prism, "rk853", "rodas", formulation="rigid_bar")
    found = [move(model, [0.0, 0.4], method, 1e-10) for method in ("rk853", "rodas")]
    assert {"yield", "ground"} <= set(found[0].log.kind)
    assert found[0].coordinate[-1] == pytest.approx(found[1].coordinate[-1], abs=1e-6)
