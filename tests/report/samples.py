"""Structures and motions, written by hand, that the tests of the report package draw."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.report.pictures import plots
from tensegrity_codegen.report.pictures.canvas import PICTURE_SUFFIXES, check_suffix
from tensegrity_codegen.report.pictures.panel import describe_size, set_up
from tensegrity_codegen.report.pictures.shown import show_structure
from tensegrity_codegen.report.pictures.view import LABELS, PictureChoices
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.structure.structure import Structure
from tests.runtime.build import bar, cable, make_structure


def frame(**more: Any) -> Structure:
    """A planar X-frame in x and z; node 0 held, node 1 held along z."""
    position = [(0, 0, 0), (2, 0, 0), (2, 0, 1), (0, 0, 1)]
    members = [bar(0, 2, 5**0.5), bar(1, 3, 5**0.5)]
    members += [cable(0, 1, 1.9), cable(1, 2, 0.9), cable(2, 3, 1.9), cable(3, 0, 0.9)]
    return make_structure(position, members, axes="xz", anchored={0: "xz", 1: "z"}, **more)


def draw_structure(
    structure: Structure,
    *,
    node_position: Any = None,
    member_tension: Any = None,
    title: str = "",
    labels: bool = False,
    choices: PictureChoices = plots.DEFAULT,
    load: Any = None,
    is_vector: bool = False,
) -> Any:
    """The figure of a structure, by default at its stated positions and without tensions."""
    position = structure.node_position if node_position is None else node_position
    shown = show_structure(structure, position, member_tension, load=load)
    setting = set_up(shown, replace(choices, labels=LABELS) if labels else choices)
    note = describe_size(structure, shown.parts)
    return plots.draw_shown(setting, 0, title or structure.name, note, is_vector=is_vector)


def plot_structure(structure: Structure, path: Path, **given: Any) -> Path:
    """The picture of `draw_structure` in a file."""
    suffix = check_suffix(path, PICTURE_SUFFIXES)
    plots.save_figure(
        draw_structure(structure, is_vector=suffix in plots.VECTOR, **given), path, overwrite=False
    )
    return path


def thread(axes: str = "z") -> Structure:
    """Two nodes on a vertical cable, the upper one held."""
    return make_structure([(0, 0, 0), (0, 0, -1)], [cable(0, 1, 0.8)], axes=axes, anchored={0: axes})


def make_trajectory(
    structure: Structure, samples: int = 11, t_end: float = 1.0, **changes: Any
) -> Trajectory:
    """A swaying motion: free nodes move along the first axis, tensions and energies swing."""
    time = np.linspace(0.0, t_end, samples)
    position = np.repeat(structure.node_position[None], samples, axis=0)
    position[:, :, structure.axes[0]] += 0.1 * np.sin(4 * time)[:, None] * structure.node_position[:, 2]
    sign = np.where(structure.is_bar, -1.0, 1.0)
    kinetic = 0.5 * np.sin(4 * time) ** 2
    places = structure.coordinate_node_axis
    fields: dict[str, Any] = {
        "time": time,
        "coordinate": position[:, places[:, 0], places[:, 1]],
        "velocity": np.zeros((samples, len(places))),
        "node_position": position,
        "node_velocity": np.zeros_like(position),
        "member_tension": (10.0 + np.cos(9 * time))[:, None] * sign,
        "kinetic_energy": kinetic,
        "total_energy": np.full(samples, 2.0),
        "status": "ok",
        "message": "",
        "method": "rk4",
        "node_name": structure.node_name,
        "member_name": structure.member_name,
        "energy_drift": 0.0,
    }
    return Trajectory(**(fields | changes))


def png_size(path: Path) -> tuple[int, int]:
    """Width and height from the header of a PNG file."""
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert data[-8:-4] == b"IEND"
    return struct.unpack(">II", data[16:24])
