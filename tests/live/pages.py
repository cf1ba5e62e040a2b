"""Structures, motions and pages for tests of live pages, without a compiler."""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.live.live_page import render_live
from tensegrity_codegen.live.live_scene import LiveScene
from tensegrity_codegen.live.three_module import find_three
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import MissingSourceError

EXAMPLES = Path(__file__).parents[2] / "tensegrity_codegen" / "scene" / "examples"
GALLERY = Path(__file__).parents[2] / "docs" / "gallery"


def load(name: str) -> Any:
    """Return the structure of an example."""
    return load_scene(EXAMPLES / f"{name}.toml")[0]


def sway(structure: Structure, samples: int = 200, part: float = 0.1) -> Trajectory:
    """Return a motion in which free nodes sway by a part of the size, tensions following the lengths."""
    time = np.linspace(0.0, 2.0, samples)
    size = float(np.ptp(structure.node_position, axis=0).max()) or 1.0
    phase = np.arange(structure.n_nodes * 3).reshape(-1, 3)
    moving = ~structure.node_anchored & np.isin(np.arange(3), structure.axes)
    step = part * size * np.sin(3.0 * time[:, None, None] + phase) * moving
    position = structure.node_position + step
    ends = position[:, structure.connectivity]
    length = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    tension = np.array([structure.compute_static_tension(row) for row in length])
    energy = 1.0 + np.sin(time) ** 2
    places = structure.coordinate_node_axis
    return Trajectory(
        time=time, coordinate=position[:, places[:, 0], places[:, 1]],
        velocity=np.zeros((samples, len(places))), node_position=position,
        node_velocity=np.zeros_like(position), member_tension=tension,
        kinetic_energy=energy, total_energy=3.0 * energy, status="ok", message="", method="none",
        node_name=structure.node_name, member_name=structure.member_name, structure=structure,
    )  # fmt: skip


@functools.cache
def _find() -> tuple[str, str] | str:
    try:
        return find_three()
    except MissingSourceError as error:
        return f"{error.problem} ({error.given})"


def require_three() -> tuple[str, str]:
    """Return the module of three.js and its licence, or skip the test where pip cannot download it."""
    found = _find()
    if isinstance(found, str):
        pytest.skip(found)
    return found


def write_page(scene: LiveScene, path: Path) -> Path:
    """Write a live page, and return its path."""
    path.write_text(render_live(scene, *require_three()), encoding="utf-8")
    return path
