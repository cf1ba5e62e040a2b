"""Weights from the scene: units, levers, the rule itself, and what may be summed."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import choose_weights, compile_scene, design_lqr
from tensegrity_codegen.control.feedback.study.tuning import find_scales
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tests.control.feedback.pinned_prism import LENGTH, find_angles


def test_levers_are_the_most_that_a_unit_moves_a_node(model: CompiledModel, motion: Motion) -> None:
    scales = find_scales(model, motion, {})
    declination = find_angles(np.radians(155))[0]
    expected = np.tile([LENGTH, LENGTH * np.sin(declination)], 3)
    np.testing.assert_allclose(scales.lever, expected, rtol=1e-6)
    assert scales.is_angle.all()
    assert scales.size == pytest.approx(0.3, rel=0.1)


def test_static_gains_predict_the_equilibrium_of_another_rest_length(
    model: CompiledModel, motion: Motion
) -> None:
    """By the full acceleration: at q + G du it is zero to first order."""
    scales = find_scales(model, motion, {})
    end = motion.at(motion.duration)
    gain = scales.static_gain / scales.lever[:, None]
    value, size = end.input.copy(), 1e-6
    value[model.manifest.input_name.index(motion.actuators[2])] += size
    still = np.zeros_like(end.coordinate)
    before, after = (
        np.abs(model.compute("acceleration", coordinate=q, velocity=still, input=value)).max()
        for q in (end.coordinate, end.coordinate + size * gain[:, 2])
    )
    assert after < 1e-3 * before


def test_each_weight_is_one_over_the_square_of_what_is_accepted(model: CompiledModel, motion: Motion) -> None:
    tuning = choose_weights(model, motion, tolerance=0.01, effort=2e-3, response_time=0.05, sample=0.01)
    largest = 0.01 / tuning.scales.lever
    wanted = np.concatenate([largest, largest / 0.05, largest * 0.05 / 0.01])
    np.testing.assert_allclose(tuning.Q, wanted**-2, rtol=1e-12)
    np.testing.assert_allclose(tuning.R, 2e-3**-2, rtol=1e-12)
    assert tuning.integral_action == model.manifest.coordinate_name


def test_defaults_follow_the_structure(model: CompiledModel, motion: Motion) -> None:
    tuning = choose_weights(model, motion)
    assert tuning.tolerance == pytest.approx(tuning.scales.size / 20)
    assert tuning.response_time == pytest.approx(1 / tuning.scales.frequency)
    np.testing.assert_allclose(tuning.effort, tuning.tolerance / 20)
    slow = choose_weights(model, motion, sample=0.05)
    assert slow.response_time == pytest.approx(0.1)  # two samples


def test_names_of_sums_and_none(model: CompiledModel, motion: Motion) -> None:
    tuning = choose_weights(model, motion, integral_action=["bar1_azimuth"])
    assert len(tuning.Q) == 13
    assert len(choose_weights(model, motion, integral_action=[]).Q) == 12


@pytest.mark.thorough
def test_more_coordinates_than_actuators_sum_what_these_can_move(
    tmp_path: Path, model: CompiledModel
) -> None:
    text = Path("tensegrity_codegen/scene/examples/pinned_prism.toml")
    scene = (Path(__file__).resolve().parents[4] / text).read_text(encoding="utf-8")
    parts = scene.split("[[actuators]]")
    path = tmp_path / "four.toml"
    path.write_text(parts[0] + "".join("[[actuators]]" + part for part in parts[1:5]), encoding="utf-8")
    from tensegrity_codegen import find_equilibrium
    from tensegrity_codegen.control.feedback.design.linear_samples import build_rest

    four = compile_scene(path, for_=("equilibrium", "control"))
    rest = build_rest(four, find_equilibrium(four), 2.0)
    tuning = choose_weights(four, rest)
    assert np.shape(tuning.integral_action) == (4, 12)
    gains = design_lqr(four, rest, tuning.Q, tuning.R, integral_action=tuning.integral_action)
    assert np.abs(gains.E).max() < 1.0


@pytest.mark.parametrize("name", ["tolerance", "effort", "response_time", "sample"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), True])
def test_values_out_of_range_are_refused(
    model: CompiledModel, motion: Motion, name: str, value: float
) -> None:
    with pytest.raises(InvalidValueError) as caught:
        choose_weights(model, motion, **{name: value})
    assert caught.value.where == name


def test_bars_whose_length_follows_their_tension_are_refused(tmp_path: Path, motion: Motion) -> None:
    path = tmp_path / "rigid.toml"
    path.write_text(
        'name = "rigid"\naxes = "xz"\n'
        '[model]\nformulation = "rigid_bar"\noptions = { bars = "all", correction = "first_order" }\n'
        '[classes.bar]\nkind = "bar"\nspring_constant = 1e6\n'
        '[classes.cord]\nkind = "cable"\nspring_constant = 100\n'
        "[nodes]\na = { position = [0, 0], anchored = true }\nb = { position = [0, 1], mass = 1 }\n"
        "c = { position = [1, 1], anchored = true }\n"
        '[members]\nab = { class = "bar", nodes = ["a", "b"] }\n'
        'bc = { class = "cord", nodes = ["b", "c"], rest_length = 0.9 }\n'
        '[[actuators]]\nname = "m"\nmembers = "bc"\n',
        encoding="utf-8",
    )
    with pytest.raises(FormulationError, match="independent"):
        choose_weights(compile_scene(path, for_="control"), motion)
