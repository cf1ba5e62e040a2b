"""Tsitouras 2011, doi:10.1016/j.camwa.2011.06.002: all conditions of order, and its dense output as printed.

The quadrature conditions, and those of tall trees, are in test_tableaus.py.
"""

import numpy as np
import pytest

from tensegrity_codegen.analyses.simulate import Simulate
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate.batch_integration import integrate_batch
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.scene.schema.model_schema import INTEGRATORS
from tensegrity_codegen.tables.tableaus import TABLEAUS
from tests.models import load
from tests.runtime.build import bar, cable, make_structure
from tests.tables.tableaus.test_tableaus import dense, matrix

TABLE = TABLEAUS["tsit5"]
A = matrix(TABLE)
B, C = A[TABLE.stages], A.sum(axis=1)

# Every rooted tree of up to five nodes as Phi(t), and 1 / gamma(t): Hairer, Norsett, Wanner 1993, II.2.
TREES = {
    "1": (np.ones(7), 1),
    "c": (C, 1 / 2),
    "c2": (C**2, 1 / 3),
    "Ac": (A @ C, 1 / 6),
    "c3": (C**3, 1 / 4),
    "c Ac": (C * (A @ C), 1 / 8),
    "A c2": (A @ C**2, 1 / 12),
    "A Ac": (A @ A @ C, 1 / 24),
    "c4": (C**4, 1 / 5),
    "c2 Ac": (C**2 * (A @ C), 1 / 10),
    "Ac Ac": ((A @ C) ** 2, 1 / 20),
    "c A c2": (C * (A @ C**2), 1 / 15),
    "A c3": (A @ C**3, 1 / 20),
    "c A Ac": (C * (A @ A @ C), 1 / 30),
    "A (c Ac)": (A @ (C * (A @ C)), 1 / 40),
    "A A c2": (A @ A @ C**2, 1 / 60),
    "A A Ac": (A @ A @ A @ C, 1 / 120),
}
NODES = dict(zip(TREES, (1, 2, 3, 3, *(4,) * 4, *(5,) * 9), strict=True))


@pytest.mark.parametrize("tree", TREES)
def test_the_step_meets_every_condition_of_order_five(tree: str) -> None:
    phi, expected = TREES[tree]
    assert B @ phi == pytest.approx(expected, abs=2e-14)


@pytest.mark.parametrize("tree", [tree for tree in TREES if NODES[tree] < 5])
def test_the_error_estimate_leaves_every_tree_up_to_order_four(tree: str) -> None:
    assert dense(TABLE.errors[0], 7) @ TREES[tree][0] == pytest.approx(0.0, abs=2e-12)


def test_the_error_estimate_sees_order_five() -> None:
    weights = dense(TABLE.errors[0], 7)
    assert max(abs(weights @ TREES[tree][0]) for tree in TREES if NODES[tree] == 5) > 1e-5


def weights_at(s: float) -> np.ndarray:
    """Return the weights of the derivatives at fraction s, from the form that integrators evaluate."""
    rise, first, last = B, np.eye(7)[0], np.eye(7)[6]
    highest = dense(TABLE.dense[0], 7)
    r = 1.0 - s
    return s * (rise + r * (first - rise + s * (2 * rise - first - last + r * highest)))


def printed_at(s: float) -> np.ndarray:
    """Return b_i(s) as the paper prints them."""
    return np.array(
        [
            -1.0530884977290216
            * s
            * (s - 1.3299890189751412)
            * (s**2 - 1.4364028541716351 * s + 0.7139816917074209),
            0.1017 * s**2 * (s**2 - 2.1966568338249754 * s + 1.2949852507374631),
            2.490627285651252793 * s**2 * (s**2 - 2.38535645472061657 * s + 1.57803468208092486),
            -16.54810288924490272 * (s - 1.21712927295533244) * (s - 0.61620406037800089) * s**2,
            47.37952196281928122 * (s - 1.203071208372362603) * (s - 0.658047292653547382) * s**2,
            -34.87065786149660974 * (s - 1.2) * (s - 0.666666666666666667) * s**2,
            2.5 * (s - 1) * (s - 0.6) * s**2,
        ]
    )


@pytest.mark.parametrize("s", [0.0, 0.125, 0.5, 0.8, 1.0])
def test_dense_output_is_the_printed_one(s: float) -> None:
    np.testing.assert_allclose(weights_at(s), printed_at(s), rtol=0, atol=1e-13)


@pytest.mark.parametrize("tree", [tree for tree in TREES if NODES[tree] < 5])
def test_dense_output_meets_every_condition_of_order_four(tree: str) -> None:
    phi, expected = TREES[tree]
    for s in np.linspace(0.0, 1.0, 9):
        assert weights_at(s) @ phi == pytest.approx(expected * s ** NODES[tree], abs=2e-13)


# --- in a library ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def pendulum() -> CompiledModel:
    """A mass on a bar that swings in a plane, with a cable that becomes taut."""
    structure = make_structure(
        [[0.0, 0.0, 0.0], [1.0, 0.0, -0.3], [1.2, 0.0, 0.5]],
        [bar(0, 1, rest=1.0, mu=400.0), cable(2, 1, rest=0.9, mu=50.0)],
        anchored={0: "xyz", 2: "xyz"},
        axes="xz",
        gravity=(0.0, 0.0, -9.81),
    )
    quantities = simulation_quantities("node_position")
    return load(structure, *quantities, integrators=("tsit5", "rk853"), batch_width=8)


def test_simulate_meets_the_tolerance_and_finds_the_events(pendulum: CompiledModel) -> None:
    found = simulate(pendulum, 1.0, samples=41, method="tsit5", rtol=1e-8, stepping=Stepping(atol=1e-10))
    best = simulate(pendulum, 1.0, samples=41, method="rk853", rtol=1e-11, stepping=Stepping(atol=1e-12))
    assert found.status == "ok"
    np.testing.assert_allclose(found.node_position, best.node_position, atol=2e-8)
    assert found.log.count == best.log.count > 0


def test_batches_have_the_bits_of_single_runs(pendulum: CompiledModel) -> None:
    starts = pendulum.nominal("coordinate") + 0.01 * np.arange(3)[:, None]
    state = np.hstack([starts, np.zeros_like(starts)])
    options, time = RunOptions("tsit5", control="steps"), np.linspace(0.0, 0.2, 9)
    many = integrate_batch(Motion(pendulum, state, time), options)
    assert many.status == ("ok",) * 3
    for k in range(3):
        alone = integrate_once(Motion(pendulum, state[k], time, watch=Watch(())), options)
        np.testing.assert_array_equal(many.state[k], alone.state)


def test_scenes_and_the_command_line_know_it() -> None:
    assert "tsit5" in INTEGRATORS
    assert "tsit5" in METHODS
    assert "tsit5" in next(item.help for item in Simulate.list_options() if item.name == "method")
