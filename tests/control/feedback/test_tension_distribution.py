"""Distribution of tensions: the program of one sample, and the loop above least tensions."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tensegrity_codegen.control.feedback.closed_loop import simulate_control
from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import InvalidValueError
from tests.control.feedback.pinned_prism import STIFFNESS

pytest.importorskip("daqp")

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def distribution(model: CompiledModel, motion: Motion) -> TensionDistribution:
    return design_distribution(model, motion, least_tension=3.0)


def place(
    model: CompiledModel, motion: Motion, time: float, change: Array
) -> tuple[Array, Array, Array, Array]:
    """Return A, lengths, rest lengths and tensions of the nine driven cables, for inputs off by `change`."""
    q = motion.at(time).coordinate
    a = model.compute("equilibrium_matrix", coordinate=q).toarray()[:, 3:]
    length = np.asarray(model.compute("member_length", coordinate=q))[3:]
    assert model.structure is not None
    rest = model.structure.rest_length[3:] + motion.at(time).input + change
    return a, length, rest, STIFFNESS * (length / rest - 1.0)


@pytest.mark.parametrize("seed", range(6))
def test_the_program_is_solved_as_by_least_squares(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    time, change = float(rng.uniform(0.0, 1.0)), 0.004 * rng.normal(size=9)
    a, length, rest, tension = place(model, motion, time, change)
    wanted = motion.at(time).input + change
    low, high = wanted - rng.uniform(0.001, 0.02, 9), wanted + rng.uniform(0.001, 0.02, 9)
    found = distribution.distribute(time, motion.at(time).coordinate, wanted, low, high)
    full = model.compute("equilibrium_matrix", coordinate=motion.at(time).coordinate).toarray()
    share = np.sqrt(1e-6 * np.mean(full**2))
    preferred = np.array([np.interp(time, motion.time, row) for row in motion.member_tension.T])[3:]
    most, least = (STIFFNESS * (length / (rest + bound - wanted) - 1.0) for bound in (low, high))
    yields = most < 3.0
    bounds = (np.where(yields, most - 1e-9, np.maximum(least, 3.0)), most)
    rows, right = np.vstack([a, share * np.eye(9)]), np.concatenate([a @ tension, share * preferred])
    best = lsq_linear(rows, right, bounds, method="bvls", tol=1e-15).x
    reached = STIFFNESS * (length / (rest + found.command - wanted) - 1.0)
    assert reached == pytest.approx(best, abs=1e-4)
    assert found.yielding[3:].tolist() == yields.tolist()


def test_tensions_meet_the_least_one_exactly_and_forces_stay(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution
) -> None:
    """Feedback lets one cable go slack; the others give the same forces."""
    change = np.zeros(9)
    change[7] = 0.02
    time = 0.5
    a, length, rest, tension = place(model, motion, time, change)
    wanted = motion.at(time).input + change
    assert tension[7] < 0.0
    found = distribution.distribute(time, motion.at(time).coordinate, wanted, wanted - 0.05, wanted + 0.05)
    reached = STIFFNESS * (length / (rest + found.command - wanted) - 1.0)
    assert reached.min() >= 3.0 - 1e-6
    assert found.status == "ok"
    lost = np.abs(a @ (reached - tension)).max()
    assert lost < 0.005 * np.abs(a[:, 7] * (tension[7] - 3.0)).max()


def test_the_least_tension_yields_where_the_rate_is_too_small(
    model: CompiledModel, motion: Motion, distribution: TensionDistribution
) -> None:
    change = np.zeros(9)
    change[7] = 0.02
    wanted = motion.at(0.5).input + change
    found = distribution.distribute(0.5, motion.at(0.5).coordinate, wanted, wanted - 0.001, wanted + 0.001)
    assert found.status == "least_tension"
    assert np.flatnonzero(found.yielding).tolist() == [10]  # opposite2: its input is the eighth
    assert found.command[7] == pytest.approx(wanted[7] - 0.001, abs=1e-12)
    assert (np.abs(found.command - wanted) <= 0.001 + 1e-12).all()


@pytest.mark.thorough
def test_the_loop_keeps_tensions_that_feedback_alone_loses(
    model: CompiledModel, motion: Motion, gains: Gains
) -> None:
    stiffness = STIFFNESS * np.array([1.05 if e % 2 else 0.95 for e in range(12)])
    off = Disturbance(axial_stiffness=stiffness, gust=Gust("bar2_B", (4.0, 0.0, 0.0), 1.2, 0.3))
    options: dict[str, Any] = {"t_end": 2.0, "disturbance": off}
    alone = simulate_control(model, motion, gains, **options)
    assert alone.yielding is None
    best = alone.least_tension(1.1)[3:].min()
    shared = simulate_control(
        model, motion, gains, distribution=design_distribution(model, motion, least_tension=10.0), **options
    )
    assert shared.status == "ok"
    assert shared.yielding is not None
    assert shared.yielding.shape == (400, 12)
    assert shared.least_tension(1.1)[3:].min() > best + 0.2
    assert np.degrees(shared.worst_error(0.2)) < 1.2 * np.degrees(alone.worst_error(0.2)) + 0.01
    assert np.abs(np.diff(shared.command, axis=0)).max() <= 0.1 * 0.005 + 1e-12


def test_a_least_tension_beyond_the_range_is_refused_with_its_cable(
    model: CompiledModel, motion: Motion
) -> None:
    least = np.zeros(12)
    least[4] = 900.0
    with pytest.raises(InvalidValueError, match="least_tension of top2") as caught:
        design_distribution(model, motion, least_tension=least)
    assert "the range of an actuator does not allow the least tension" in str(caught.value)
    assert "at most" in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"least_tension": np.nan}, "least_tension"),
        ({"least_tension": np.ones(5)}, "least_tension"),
        ({"preferred": -np.inf}, "preferred"),
        ({"weight": 0.0}, "weight"),
    ],
)
def test_bad_input_is_named(
    model: CompiledModel, motion: Motion, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InvalidValueError, match=words):
        design_distribution(model, motion, **options)


def test_limits_of_the_scene_are_the_default(model: CompiledModel, motion: Motion) -> None:
    found = design_distribution(model, motion)
    assert found.least_tension.tolist() == [5.0] * 12
    assert found.cables.limited.tolist() == list(range(3, 12))
