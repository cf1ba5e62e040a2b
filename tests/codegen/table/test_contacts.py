"""Contacts as loops over them, beside expressions written out."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.structure.structure import Structure
from tests.ground_cases import make_ground
from tests.models import load, simulator
from tests.runtime.build import cable, make_structure

QUANTITIES = (
    *("acceleration", "state_derivative", "node_force", "potential_energy", "total_energy"),
    *("contact_force", "penetration", "contact_margin"),
)
OF_FRICTION = ("internal_rate", "stick_margin")


def make_net(count: int, **ground: Any) -> Structure:
    """Return a net of count x count nodes on the ground, uneven by a millimetre; one corner held."""
    place = np.linspace(0.0, 1.0, count)
    rng = np.random.default_rng(count)
    nodes = [[x, y, 1e-3 * rng.normal()] for x in place for y in place]
    along = [(count * i + j, count * i + j + 1) for i in range(count) for j in range(count - 1)]
    across = [(count * i + j, count * (i + 1) + j) for i in range(count - 1) for j in range(count)]
    length = 0.98 * place[1]
    net = make_structure(
        nodes,
        [cable(i, j, length, 500.0, damping=0.1) for i, j in along + across],
        anchored={0: "xy"},
        gravity=(0.0, 0.0, -9.81),
        mass=0.01,
    )
    radius = np.linspace(1e-4, 2e-4, count * count)
    return net.with_changes(ground=make_ground(count * count, radius=radius, stick_damping=63.0, **ground))


@pytest.mark.parametrize(
    "ground",
    [
        {},
        {"friction": 0.0},
        {"exponent": 1.5, "normal": [0.6, 0.0, 0.8], "velocity": [0.8, 0.0, -0.6]},
    ],
)
def test_loops_are_the_expressions(ground: dict[str, Any]) -> None:
    ground = {name: np.array(value) if isinstance(value, list) else value for name, value in ground.items()}
    net, rng = make_net(4, **ground), np.random.default_rng(3)
    names = (*QUANTITIES, *(OF_FRICTION if net.internal_name else ()))
    unrolled, table = (load(net, *names, emitter=emitter) for emitter in ("unrolled", "table"))
    size = len(net.coordinate_node_axis)
    for _ in range(20):
        state = {
            "coordinate": unrolled.nominal("coordinate") + 2e-4 * rng.normal(size=size),
            "velocity": rng.normal(size=size) * 10.0 ** rng.uniform(-4, 0),
        }
        if net.internal_name:
            state["internal"] = rng.normal(size=32) * 10.0 ** rng.uniform(-6, -3)
        for name in names:
            expected = np.asarray(unrolled.compute(name, **state))
            np.testing.assert_allclose(
                table.compute(name, **state), expected, atol=1e-12 * np.abs(expected).max(), err_msg=name
            )


def test_many_contacts_move_without_events_and_the_message_says_so() -> None:
    net = make_net(15)
    model = simulator(net, "rk54", emitter="table")
    assert model.manifest.integrators[0].events == ()
    stepping = Stepping(control="steps")
    motion = simulate(model, 0.05, samples=[0.0, 0.05], method="rk54", rtol=1e-5, stepping=stepping)
    assert motion.status == "ok"
    assert "225 contacts with the ground are not monitored" in motion.message
    assert motion.total_energy[-1] < motion.total_energy[0]
