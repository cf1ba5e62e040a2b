"""Profiles bound to a model: the arguments at a time, and what cannot be bound."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import CompiledModel, Profile, simulate, simulate_batch
from tensegrity_codegen.runtime.profiles.driven import bind_profile
from tensegrity_codegen.runtime.trajectory.simulation_quantities import SIMULATION_QUANTITIES
from tensegrity_codegen.structure.structure import ActuatedInput
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError
from tests.models import load
from tests.runtime.build import make_structure, spring

INPUTS = (ActuatedInput("motor", "rest_length", (0,)), ActuatedInput("push", "force", (1,), (1.0, 0.0, 0.0)))
KNOTS = [0.0, 0.5, 1.0]


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    structure = make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)], anchored={0: "xyz", 1: "yz"})
    structure = structure.with_changes(inputs=INPUTS)
    return load(structure, *SIMULATION_QUANTITIES, parameters={"rest_length": (0,)}, integrators=("rk853",))


def test_what_is_not_named_stays(model: CompiledModel) -> None:
    profile = Profile(KNOTS, {"push": [0.0, 2.0, 2.0], "rest_length": [[1.0], [1.1], [1.3]]})
    bound = bind_profile(model, profile, {"input": np.array([0.01, 9.0])}, 1.0)
    assert bound.place == (("input", 1), ("rest_length", 0))
    found = bound(0.25)
    np.testing.assert_allclose(found["input"], [0.01, 1.0])
    np.testing.assert_allclose(found["rest_length"], [1.05])


def test_all_inputs_may_be_one_array(model: CompiledModel) -> None:
    whole = Profile(KNOTS, {"input": [[0.0, 0.0], [0.01, 1.0], [0.0, 2.0]]})
    named = Profile(KNOTS, {"push": [0.0, 1.0, 2.0], "motor": [0.0, 0.01, 0.0]})
    runs = [simulate(model, 1.0, samples=6, schedule=profile) for profile in (whole, named)]
    np.testing.assert_array_equal(runs[0].coordinate, runs[1].coordinate)
    np.testing.assert_allclose(runs[0].input[:, 1], 2.0 * runs[0].time)  # type: ignore[index]
    assert runs[0].input_name == ("motor", "push")
    assert runs[0].energy_drift is None


def test_one_profile_for_each_motion_of_a_batch(model: CompiledModel) -> None:
    profiles = [Profile(KNOTS, {"motor": [0.0, size, 0.0]}) for size in (0.0, 0.01, -0.02)]
    batch = simulate_batch(model, 1.0, samples=5, method="auto", schedule=profiles)
    assert batch.status == ("ok", "ok", "ok")
    for k, profile in enumerate(profiles):
        alone = simulate(model, 1.0, samples=5, schedule=profile)
        np.testing.assert_array_equal(batch.coordinate[k], alone.coordinate)


def test_an_end_before_the_motions_is_rounding_or_refused(model: CompiledModel) -> None:
    nearly = Profile([0.0, 0.1 * 3.0], {"motor": [0.0, 0.01]})
    assert simulate(model, 0.30000000000000010, samples=2, schedule=nearly).status == "ok"
    with pytest.raises(InvalidValueError, match="ends before the motion"):
        simulate(model, 1.0, schedule=nearly)


@pytest.mark.parametrize(
    ("values", "arguments", "message"),
    [
        ({"motor": [[0.0], [0.0], [0.0]]}, {}, "wrong shape"),
        ({"rest_length": [1.0, 1.0, 1.0]}, {}, "wrong shape"),
        ({"motor": [0, 0, 0], "input": np.zeros((3, 2))}, {}, "given twice"),
        ({"motor": [0, 0, 0]}, {"motor": 0.01}, "a profile and a constant value"),
        ({"input": np.zeros((3, 2))}, {"push": 0.5}, "a profile and a constant value"),
        ({"rest_length": np.ones((3, 1))}, {"rest_length": [1.0]}, "a profile and a constant value"),
    ],
)
def test_what_does_not_fit_is_named(
    model: CompiledModel, values: Any, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidValueError, match=message):
        simulate(model, 1.0, schedule=Profile(KNOTS, values), arguments=arguments)


def test_unknown_names_and_other_things(model: CompiledModel) -> None:
    with pytest.raises(UnknownNameError, match="'motor'"):
        simulate(model, 1.0, schedule=Profile(KNOTS, {"moter": [0, 0, 0]}))
    with pytest.raises(InvalidValueError, match="not a schedule"):
        simulate(model, 1.0, schedule={"motor": 0.01})  # type: ignore[arg-type]
    starts, profiles = np.array([[1.0], [1.1], [1.2]]), [Profile(KNOTS, {"motor": [0, 0, 0]})] * 2
    with pytest.raises(InvalidValueError, match="different batch lengths"):
        simulate_batch(model, 1.0, coordinate=starts, schedule=profiles)
