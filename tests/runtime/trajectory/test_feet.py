"""Feet of a motion: when nodes touched the ground, how far they slid, how hard they were pressed."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.request import ModelRequest
from tests.ground_cases import GRAVITY, make_belt, make_block, make_slope


def run(structure: Structure, t_end: float, samples: int) -> Trajectory:
    needs = find_needs("simulate", structure, ModelRequest(()))
    model = build_library(structure, needs.alone(ModelRequest(()))).load()
    return simulate(model, t_end, samples=samples, rtol=1e-9, stepping=Stepping(atol=1e-12))


def test_a_block_that_slides_uses_all_friction_on_its_way_down() -> None:
    slope, down = make_slope(np.radians(30.0))
    motion = run(slope, 2.0, 201)
    (foot,) = motion.feet
    travelled = (motion.node_position[-1, 0] - motion.node_position[0, 0]) @ down
    assert (foot.node, foot.first_touch, foot.touches) == ("n0", 0.0, 1)
    assert foot.slide == pytest.approx(travelled, rel=1e-12)
    assert foot.largest_force == pytest.approx(GRAVITY * np.cos(np.radians(30.0)), rel=1e-9)
    assert foot.largest_use == pytest.approx(1.0, abs=1e-12)
    assert foot.penetration == pytest.approx(GRAVITY * np.cos(np.radians(30.0)) / 1e5, rel=1e-9)


def test_a_block_that_sticks_swings_about_its_stick_offset_within_the_cone() -> None:
    slope, _ = make_slope(np.radians(20.0))
    (foot,) = run(slope, 2.0, 201).feet
    assert np.tan(np.radians(20.0)) / 0.5 < foot.largest_use < 1.0  # it starts with its bristle at zero
    assert foot.slide < 2e-4  # stick offset: 3.4e-5 m


def test_a_dropped_block_touches_when_it_has_fallen_and_again_after_each_bounce() -> None:
    motion = run(make_block([0.0, 0.0, 0.5]), 1.5, 151)
    (foot,) = motion.feet
    assert foot.first_touch == pytest.approx(np.sqrt(2 * 0.5 / GRAVITY), rel=1e-9)
    touched = [
        kind == "ground" and sign > 0
        for kind, sign in zip(motion.log.kind, motion.log.direction, strict=True)
    ]
    assert foot.touches == sum(touched) > 3
    assert motion.summary()["feet"] == [foot.as_dict()]


def test_a_block_that_stays_in_the_air_is_no_foot() -> None:
    motion = run(make_block([0.0, 0.0, 0.5]), 0.1, 11)
    assert motion.feet == ()
    assert motion.contacts is not None
    assert not motion.contacts.force.any()


def test_the_way_on_a_belt_is_relative_to_it() -> None:
    belt = make_belt(0.5)
    motion = run(belt, 0.05, 501)
    assert belt.ground is not None
    (foot,) = motion.feet
    moved = motion.node_position[-1, 0] - motion.node_position[0, 0] - 0.05 * belt.ground.velocity
    assert foot.slide == pytest.approx(np.linalg.norm(moved[:2]), rel=1e-6)


def test_files_hold_the_contacts_to_the_bit(tmp_path: Path) -> None:
    structure = make_block([0.1, 0.2, 0.5])
    motion = run(structure, 1.0, 101)
    motion.write(tmp_path / "run.npz")
    read = read_trajectory(tmp_path / "run.npz", structure)
    assert motion.contacts is not None
    assert read.contacts is not None
    np.testing.assert_array_equal(read.contacts.force, motion.contacts.force)
    np.testing.assert_array_equal(read.contacts.penetration, motion.contacts.penetration)
    assert [foot.largest_force for foot in read.feet] == [foot.largest_force for foot in motion.feet]
