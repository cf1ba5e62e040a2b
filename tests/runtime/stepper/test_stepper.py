"""Copies of a motion, advanced sample by sample: as by `simulate`, and independent of each other."""

import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.stepper.stepper import Stepper
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    LibraryError,
    NonFiniteError,
    SceneError,
    UnknownNameError,
)
from tests.cases import thorough
from tests.free_body_cases import make_random
from tests.ground_cases import make_block
from tests.models import EXAMPLES, ROOT, simulator
from tests.ring_cases import make_swing
from tests.runtime.accuracy.test_contacts import draw, measure
from tests.runtime.integrate.test_plastic import make_net
from tests.scene.samples import build

Array = NDArray[Any]
FINE = Stepping(atol=1e-13, max_steps=10_000_000)
SAMPLES = 5


def draw_motion(seed: int) -> tuple[Structure, float]:
    """Return a structure of one kind after the other, and a time [s]: ground, rings, plastic, bodies."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 0:
        return draw(rng)
    if seed % 4 == 1:
        return make_swing(rng.uniform(0.05, 0.4), damping=rng.uniform(0.5, 5.0)), rng.uniform(0.3, 1.0)
    if seed % 4 == 2:
        net = make_net()
        velocity = np.where(net.node_anchored, 0.0, rng.normal(size=(5, 3)) * 3.0)
        return net.with_changes(node_velocity=velocity), rng.uniform(0.2, 0.6)
    return build(make_random(seed))[0], 0.1


@pytest.mark.parametrize("seed", [1, 3, 4, *thorough(0, 2, *range(5, 200))])
def test_samples_are_those_of_simulate_to_its_told_error(seed: int) -> None:
    structure, t_end = draw_motion(seed)
    formulation = "rigid_bar" if structure.is_rigid.any() else "node_position"
    model = simulator(structure, "rk54", formulation=formulation, copies=True)
    times = np.linspace(0.0, t_end, SAMPLES)
    motion = simulate(model, t_end, samples=times, method="rk54", rtol=1e-6)
    assert motion.status == "ok"
    stepper = model.stepper(2, sample=t_end / (SAMPLES - 1), rtol=1e-11, stepping=FINE)
    states = [stepper.state.copy()]
    for _ in times[1:]:
        stepper.step()
        states.append(stepper.state.copy())
    assert stepper.status.tolist() == [0, 0]
    path = np.array(states)
    assert np.array_equal(path[:, 0], path[:, 1])
    n = stepper.coordinate.shape[1]

    class Exact:
        time, coordinate, velocity = times, path[:, 0, :n], path[:, 0, n : 2 * n]

    assert motion.error_estimate is not None
    assert measure(model, motion, Exact, "rk54", 1e-6) <= motion.error_estimate  # type: ignore[arg-type]


@pytest.mark.parametrize("structure", [make_swing(0.2), make_block([0.0, 0.0, 0.3], friction=0.0)])
def test_what_slips_or_touches_moves_as_by_simulate_in_libraries_with_lanes(structure: Structure) -> None:
    model = simulator(structure, "rk54", copies=True, batch_width=8)
    stepper = model.stepper(1, sample=0.05, rtol=1e-9, stepping=Stepping(atol=1e-11))
    run(stepper, samples=12)
    exact = simulate(model, 0.6, samples=2, method="rk54", rtol=1e-10)
    assert stepper.coordinate[0] == pytest.approx(exact.coordinate[-1], abs=1e-7)


@cache
def compile_pinned() -> CompiledModel:
    return compile_scene(EXAMPLES / "pinned_prism.toml", for_="step", integrators=("rk4",))


@cache
def compile_ground() -> CompiledModel:
    """Return random bodies, which fall onto a ground."""
    structure = build(make_random(3))[0]
    model = simulator(structure, "rk54", more=("contact_force",), formulation="rigid_bar", copies=True)
    assert model.manifest.contact_name
    return model


def spread(stepper: Stepper) -> Stepper:
    """Move the copies apart from each other by inputs, and return them."""
    inputs = np.random.default_rng(0).normal(size=stepper.inputs.shape)
    stepper.step(stepper.inputs + inputs, sample=0.03)
    stepper.steps[:] = 0
    assert not stepper.status.any()
    return stepper


def run(stepper: Stepper, inputs: Array | None = None, samples: int = 5) -> Array:
    for _ in range(samples):
        stepper.step(inputs)
    return stepper.state.copy()


@pytest.mark.parametrize("scene", [compile_pinned, compile_ground])
def test_a_copy_has_the_same_bits_in_any_place_and_with_any_threads(scene: Any) -> None:
    model, n = scene(), 37
    one = spread(model.stepper(n, sample=0.01, quantities=("member_tension",)))
    start, inputs = one.snapshot(), one.inputs + 0.01 * np.random.default_rng(1).normal(size=one.inputs.shape)
    order = np.random.default_rng(2).permutation(n)
    other = model.stepper(n, sample=0.01, quantities=("member_tension",), threads=2)
    other.restore({name: array[order] for name, array in start.items()})
    ends = run(one, inputs)
    assert np.array_equal(run(other, inputs[order]), ends[order])
    assert np.array_equal(other.values["member_tension"], one.values["member_tension"][order])
    alone = model.stepper(1, sample=0.01)
    alone.restore({name: array[5:6] for name, array in start.items()})
    assert np.array_equal(run(alone, inputs[5]), ends[5:6])


def test_values_are_the_quantities_of_the_model_at_the_states() -> None:
    model = compile_ground()
    stepper = spread(model.stepper(3, sample=0.01, quantities=("member_tension", "contact_force")))
    run(stepper)
    for k in range(3):
        names = ("coordinate", "velocity", "internal")
        state = {name: getattr(stepper, name)[k] for name in names} | {"input": stepper.inputs[k]}
        for name, array in stepper.values.items():
            assert np.array_equal(array[k], model.compute(name, **state))


@pytest.mark.parametrize("scene", [compile_pinned, compile_ground])
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300, -1e160])
def test_a_copy_that_fails_disturbs_no_other(scene: Any, bad: float) -> None:
    model = scene()
    good, mixed = (spread(model.stepper(11, sample=0.01, quantities=("member_tension",))) for _ in range(2))
    inputs = np.tile(model.nominal("input"), (11, 1))
    wrong = inputs.copy()
    wrong[4, 0] = bad
    wanted, found = run(good, inputs), run(mixed, wrong)
    others = np.arange(11) != 4
    assert np.array_equal(found[others], wanted[others])
    if not mixed.status.any():  # as where a cable that is too long stays slack
        assert np.isfinite(found).all()
        return
    assert mixed.status.astype(bool).tolist() == (~others).tolist()
    assert np.isnan(found[4]).all()
    assert np.isnan(mixed.values["member_tension"][4]).all()
    assert mixed.status_text(4) != "ok"
    assert mixed.steps.tolist() == [5 if other else 0 for other in others]
    mixed.reset(4)
    mixed.step(inputs)
    assert (mixed.status[4], mixed.steps[4]) == (0, 1)


def test_a_snapshot_goes_on_bit_by_bit_also_from_a_file(tmp_path: Path) -> None:
    model = compile_ground()
    stepper = spread(model.stepper(4, sample=0.01))
    run(stepper)
    stepper.save(tmp_path / "copies.npz")
    other, third = stepper.copy(), model.stepper(4, sample=0.01)
    third.load(tmp_path / "copies.npz")
    ends = run(stepper)
    assert np.array_equal(run(other), ends)
    assert np.array_equal(run(third), ends)
    with pytest.raises(InvalidValueError, match="not a snapshot of these copies"):
        model.stepper(3, sample=0.01).load(tmp_path / "copies.npz")
    good, before = stepper.snapshot(), stepper.state.copy()
    for name, value in {
        "steps": ["a"] * 4,
        "status": [99] * 4,
        "next_step": [np.nan] * 4,
        "state": [1.0],
    }.items():
        with pytest.raises(InvalidValueError, match=name):
            stepper.restore({**good, "state": good["state"] + 1.0, name: np.array(value)})
        assert np.array_equal(stepper.state, before)
    (tmp_path / "copies.npz").write_bytes((tmp_path / "copies.npz").read_bytes()[:-50])
    with pytest.raises(SceneError, match=r"copies\.npz"):
        stepper.load(tmp_path / "copies.npz")


def test_fixed_steps_are_those_of_simulate() -> None:
    model = compile_pinned()
    stepper = model.stepper(3, sample=0.01, method="rk4", stepping=Stepping(step=0.001))
    run(stepper, samples=3)
    stepping = Stepping(step=0.001, control="steps")
    motion = simulate(model, 0.03, samples=4, method="rk4", stepping=stepping)
    assert stepper.coordinate[2] == pytest.approx(motion.coordinate[-1], abs=1e-13)
    with pytest.raises(InvalidValueError, match="does not divide the sample") as caught:
        stepper.step(sample=0.0105)
    assert caught.value.hint == "step=0.00105"
    stepper.step(sample=0.005)


def test_parts_of_a_sample_and_arguments_of_each_copy() -> None:
    structure, request = load_scene(EXAMPLES / "pinned_prism.toml")
    model = compile_scene(EXAMPLES / "pinned_prism.toml", for_="step", parameters={"gravity": ()})
    assert structure.n_nodes == len(model.manifest.node_name)
    stepper = model.stepper(2, sample=0.02, rtol=1e-10, arguments={"gravity": [0, 0, 0]})
    stepper.arguments["gravity"][1] = [0.0, 0.0, -9.81]
    stepper.step(sample=0.005)
    stepper.step(sample=0.015)
    for k, gravity in enumerate(([0, 0, 0], [0, 0, -9.81])):
        found = simulate(model, 0.02, samples=2, rtol=1e-10, arguments={"gravity": gravity})
        assert stepper.coordinate[k] == pytest.approx(found.coordinate[-1], abs=1e-9)
    assert request.copies is False


def test_the_told_error_of_a_sample_is_that_to_finer_steps() -> None:
    model = compile_ground()
    loose, fine = (spread(model.stepper(5, sample=0.05, rtol=rtol)) for rtol in (1e-4, 1e-12))
    told = loose.estimate_error()
    before = loose.state.copy()
    fine.restore(loose.snapshot())
    loose.step()
    fine.step()
    true = np.abs(loose.coordinate - fine.coordinate).max(axis=1)
    assert not np.array_equal(before, loose.state)
    assert (true <= 1.5 * told).all()
    assert (told <= 1.5 * true).all()


def test_too_many_steps_are_a_status() -> None:
    stepper = compile_ground().stepper(2, sample=1.0, rtol=1e-10, stepping=Stepping(max_steps=3))
    stepper.step()
    assert [stepper.status_text(k) for k in range(2)] == ["too_many_steps"] * 2


def test_arrays_are_written_into_and_not_replaced() -> None:
    stepper = compile_pinned().stepper(2, sample=0.01)
    with pytest.raises(AttributeError, match=r"inputs\[\.\.\.\]"):
        stepper.inputs = np.zeros((2, 9))
    assert stepper.headline() == "2 copies of pinned_prism, sample 0.01 s, 0 failed"
    assert "member_tension" not in repr(stepper)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"n": 0}, "n: out of range"),
        ({"sample": 0.0}, "sample: out of range"),
        ({"sample": np.nan}, "sample: out of range"),
        ({"method": "radau"}, "explicit integrators"),
        ({"method": "rk4"}, "step: method 'rk4' needs a step"),
        ({"method": "rk4", "stepping": Stepping(step=0.003)}, "does not divide the sample"),
        ({"rtol": 2.0}, "rtol"),
        ({"threads": 0}, "threads"),
        ({"arguments": {"input": [1.0]}}, "input: wrong shape"),
    ],
)
def test_wrong_options(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        compile_pinned().stepper(**{"n": 2, "sample": 0.01} | changes)
    assert problem in str(caught.value)


def test_wrong_calls() -> None:
    model = compile_pinned()
    with pytest.raises(UnknownNameError, match="did you mean 'member_tension'"):
        model.stepper(1, sample=0.01, quantities=("member_tensions",))
    with pytest.raises(UnknownNameError, match="no such argument"):
        model.stepper(1, sample=0.01, arguments={"gravty": [0, 0, 0]})
    plain = compile_scene(EXAMPLES / "pinned_prism.toml", for_="simulate")
    with pytest.raises(LibraryError, match='for_="step"'):
        plain.stepper(1, sample=0.01)
    stepper = model.stepper(3, sample=0.01)
    for inputs in (np.zeros(4), np.zeros((2, 9)), np.zeros((3, 1))):
        with pytest.raises(InvalidValueError, match="wrong shape"):
            stepper.step(inputs)
    for which in ([3], [-1], [True, False], 1.5, "a"):
        with pytest.raises(InvalidValueError, match="no such copies"):
            stepper.reset(which)
    with pytest.raises(NonFiniteError):
        stepper.reset(coordinate=np.full(6, np.nan))
    with pytest.raises(InvalidValueError, match="wrong shape"):
        stepper.reset([0, 1], velocity=np.zeros((3, 6)))


@pytest.mark.thorough
def test_the_loop_in_real_time_holds_the_prism() -> None:
    command = [sys.executable, str(ROOT / "examples" / "real_time.py"), "--seconds", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    lines = done.stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == ["turns began late by", "a turn took"]
    most, end = (float(word) for word in lines[-1].split() if word[0].isdigit())
    assert 1e-4 < most < 1e-2
    assert end < 0.01 * most
