"""Positions, axes and angular velocities of rigid bodies in motions, by name and in files."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, simulate, simulate_batch
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.trajectory.motion_tables import list_columns
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tests.rigid_scenes import HANGING


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    return compile_scene(HANGING, for_="simulate_batch")


@pytest.fixture(scope="module")
def motion(model: CompiledModel) -> Trajectory:
    return simulate(model, t_end=0.2, samples=5)


def test_a_motion_has_the_places_of_bodies(motion: Trajectory) -> None:
    assert motion.body_name == ("rod", "block")
    assert motion.body_position is not None
    assert motion.body_axes is not None
    assert motion.body_angular_velocity is not None
    turn = np.radians(30)
    axes = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    np.testing.assert_allclose(motion.body_axes[0], [axes, np.eye(3)], atol=1e-14)
    centre = np.array([0.1, 0.0, 0.6]) + 0.05 * np.array(axes)[:, 2]  # 0.1 kg at 0.2 m of 0.4 kg
    np.testing.assert_allclose(motion.body_position[0], [centre, [0, 0, 0.2]], atol=1e-14)
    np.testing.assert_allclose(motion.body_angular_velocity[0], [[0.1, -0.2, 3.0], [0, 0, 0]], atol=1e-13)
    # Points are where centre and axes say, at every sample, and move as the spin says.
    local = np.array([0.01, 0.0, 0.2]) - [0, 0, 0.05]
    rod, spin = motion.body_axes[:, 0], motion.body_angular_velocity[:, 0]
    place = motion.body_position[:, 0] + np.einsum("tij,j->ti", rod, local)
    np.testing.assert_allclose(motion.position("rod_top"), place, atol=1e-13)
    corner = [motion.node_name.index(f"rod_corner{k}") for k in (1, 2, 3, 4)]
    arm = motion.position("rod_top")[:, None] - motion.node_position[:, corner]
    rate = motion.velocity_of("rod_top")[:, None] - motion.node_velocity[:, corner]
    world = np.einsum("tij,tj->ti", rod, spin)[:, None]
    np.testing.assert_allclose(rate, np.cross(world, arm), atol=1e-12)


def test_texts_do_not_show_what_carries_bodies(model: CompiledModel, motion: Trajectory) -> None:
    assert motion.structure is not None
    for text in (repr(model), repr(motion), repr(motion.structure)):
        assert "bodies: 2 (rod, block)" in text
        assert "4 (hook, rod_top, rod_foot, block_eye)" in text
        assert "2 (line, tie)" in text
    assert "0 bars and 2 cables" in repr(motion.structure)
    summary = motion.summary()
    assert summary["displaced_node"] in ("block_eye", "block", "rod_top", "rod_foot")
    assert summary["bar_tension"] is None


def test_files_have_them_and_read_back(motion: Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    motion.write(path)
    assert motion.structure is not None
    found = read_trajectory(path, motion.structure)  # type: ignore[arg-type]
    with np.load(path) as stored:
        assert stored["body_name"].tolist() == ["rod", "block"]
        for name in ("body_position", "body_axes", "body_angular_velocity"):
            np.testing.assert_array_equal(stored[name], getattr(motion, name))
            np.testing.assert_array_equal(getattr(found, name), getattr(motion, name))


def test_tables_have_a_column_for_each_number(motion: Trajectory) -> None:
    columns, axes = list_columns(motion), motion.body_axes
    assert axes is not None
    assert motion.body_angular_velocity is not None
    np.testing.assert_array_equal(columns["body.rod.e3x"], axes[:, 0, 0, 2])
    np.testing.assert_array_equal(columns["body.block.e1z"], axes[:, 1, 2, 0])
    np.testing.assert_array_equal(columns["body.rod.w3 [rad/s]"], motion.body_angular_velocity[:, 0, 2])
    dataset = motion.to_xarray()
    assert dataset["body_axes"].sel(body="rod", axis="x", frame_axis="e3").values[0] == axes[0, 0, 0, 2]
    assert dataset["body_angular_velocity"].dims == ("time", "body", "frame_axis")


def test_a_batch_has_them_of_every_motion(model: CompiledModel, motion: Trajectory) -> None:
    start = model.nominal("coordinate")
    batch = simulate_batch(model, t_end=0.2, samples=5, coordinate=np.stack([start, start]))
    assert batch.body_position is not None
    assert batch.body_position.shape == (2, 5, 2, 3)
    np.testing.assert_allclose(batch[1].body_position, motion.body_position, atol=1e-6)
    assert batch[1].body_name == ("rod", "block")


def test_a_ball_that_rolls_does_not_slide() -> None:
    ball = {"kind": "rigid", "mass": 1.0, "inertia": [0.004, 0.004, 0.004], "position": [0, 0, 0.1]}
    ground = {"normal": [np.sin(0.2), 0, np.cos(0.2)], "stiffness": 1e5, "friction": 0.5}
    ground |= {
        "stick_stiffness": 1e5,
        "stick_damping": 300,
        "dissipation": 0.3,
        "offset": 0.1 * np.cos(0.2) - 0.0999,
    }
    points = {"c": {"position": [0, 0, 0], "radius": 0.1}}
    scene = {
        "name": "ball",
        "gravity": [0, 0, -9.81],
        "bodies": {"ball": ball | {"points": points}},
        "ground": ground,
    }
    for friction, rolls in ((0.5, True), (0.02, False)):
        model = compile_scene({**scene, "ground": ground | {"friction": friction}}, for_="simulate")
        motion = simulate(model, t_end=0.5, samples=101)
        way = float(np.linalg.norm(motion.position("ball_c")[-1] - motion.position("ball_c")[0]))
        (foot,) = motion.feet
        assert way == pytest.approx(0.5 * 0.25 * 9.81 * np.sin(0.2) * (5 / 7 if rolls else 1), rel=0.15)
        assert foot.slide < 1e-3 if rolls else foot.slide > 0.5 * way
