"""Structures and motions for tests of feedback: the pinned prism of 12 cables, with inverse dynamics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.control.feedback.design.gains import Gains
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_nodes
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.body_scenes import assemble_document

Array = NDArray[np.float64]


ROOT = Path(__file__).resolve().parents[3]
BARS = (1, 2, 3)
RADIUS, HEIGHT, STIFFNESS = 0.15, 0.30, 500.0
LENGTH = float(np.sqrt(2 * RADIUS**2 * (1 - np.cos(np.radians(155))) + HEIGHT**2))
PREFERRED = {"bottom": 10.0, "top": 16.0, "vertical": 30.0, "opposite": 18.0}  # [N]


def place_prism(twist: float) -> dict[str, Array]:
    """Return the ends b1.. and t1.. of the bars at a twist [rad]."""
    height = np.sqrt(LENGTH**2 - 2 * RADIUS**2 * (1 - np.cos(twist)))
    angle = 2 * np.pi * np.arange(3) / 3
    foot = {f"b{k + 1}": np.array([np.cos(a), np.sin(a), 0.0]) * RADIUS for k, a in enumerate(angle)}
    tip = {
        f"t{k + 1}": np.array([RADIUS * np.cos(a + twist), RADIUS * np.sin(a + twist), height])
        for k, a in enumerate(angle)
    }
    return {**foot, **tip}


def find_angles(twist: float) -> Array:
    """Return declination and azimuth of each bar at a twist [rad], continuous in it, (6,)."""
    place, angles = place_prism(twist), []
    for k in BARS:
        way = (place[f"t{k}"] - place[f"b{k}"]) / LENGTH
        azimuth = np.arctan2(way[1], way[0])
        angles += [np.arccos(way[2]), azimuth]
    return np.array(angles)


def prism_document(*, with_bottom: bool = False) -> dict[str, Any]:
    """Return the scene: bars of 0.05 kg with 0.1 kg at their tips, cables of EA 500 N, 9 or 12 motors."""
    structure = load_nodes(ROOT / "tensegrity_codegen" / "scene" / "examples" / "prism12.toml")
    place = place_prism(np.radians(155))
    foot = {name: list(map(float, place[name])) for name in ("b1", "b2", "b3")}
    body: dict[str, Any] = {"base": {"kind": "fixed", "points": foot}}
    for k in BARS:
        declination, azimuth = np.degrees(find_angles(np.radians(155))[2 * k - 2 : 2 * k])
        body[f"bar{k}"] = {
            "kind": "bar", "length": LENGTH, "mass": 0.05, "anchor": f"base.b{k}",
            "inertia": 0.05 * LENGTH**2 / 12 + 0.1 * LENGTH**2,  # about the foot: with 0.1 kg at the tip
            "declination_deg": float(declination), "azimuth_deg": float(azimuth),
        }  # fmt: skip
    tendons, motors = {}, []
    for e, (i, j) in enumerate(structure.connectivity.tolist()):
        name = structure.member_name[e]
        if structure.is_bar[e]:
            continue
        ends = [structure.node_name[i], structure.node_name[j]]
        length = float(np.linalg.norm(place[ends[0]] - place[ends[1]]))
        tension = PREFERRED[name.rstrip("123")]
        points = [f"base.{end}" if end[0] == "b" else f"bar{end[1]}.B" for end in ends]
        rest = STIFFNESS * length / (STIFFNESS + tension)
        tendons[name] = {"class": "cable", "points": points, "rest_length": rest}
        if with_bottom or not name.startswith("bottom"):
            motors.append({"name": f"m_{name}", "members": [name], "rate": 0.1, "range": [0.1, 0.5]})
    return {
        "name": "pinned_prism",
        "classes": {"cable": {"kind": "cable", "axial_stiffness": STIFFNESS}},
        "bodies": body,
        "tendons": tendons,
        "joint_friction": [{"bodies": [f"bar{k}", "base"], "coefficient": -0.002} for k in BARS],
        "actuators": motors,
        "sensors": [{"kind": "member_length", "members": [f"{kind}{k}" for kind in
                     ("top", "vertical", "opposite") for k in BARS], "noise": 5e-4}],
        "limits": {"least_tension": 5.0},
    }  # fmt: skip


def build_prism(*analyses: str, **options: Any) -> CompiledModel:
    """Return the compiled prism."""
    system, request = assemble_document(prism_document(**options))
    return build_library(system, want_analyses(system, request, analyses or ("control", "simulate"))).load()


def design_gains(model: CompiledModel, motion: Motion, **options: Any) -> Gains:
    """Return the gains of the acceptance table: every coordinate is summed."""
    weight = np.concatenate([np.full(6, 100.0), np.full(6, 0.1), np.full(6, 10.0)])
    names = model.manifest.coordinate_name
    return design_lqr(model, motion, weight, np.full(9, 1e6), integral_action=names, **options)


def draw_errors(model: CompiledModel, seed: int, noise: int = 0) -> Disturbance:
    """Return the errors of one draw: angles off by 1.2 deg, stiffness by 5 %, 5 N on a tip for 0.2 s.

    noise: seed of the noise of measurements.
    """
    rng = np.random.default_rng(seed)
    force = rng.normal(size=3)
    alternate = np.array([1.05 if e % 2 else 0.95 for e in range(len(model.manifest.member_name))])
    return Disturbance(
        coordinate_error=np.radians(1.2) * rng.choice([-1.0, 1.0], 6),
        axial_stiffness=STIFFNESS * alternate,
        gust=Gust(f"bar{rng.integers(1, 4)}_B", tuple(5.0 * force / np.linalg.norm(force)), 0.5, 0.2),
        seed=noise,
    )


def quintic(share: Array) -> tuple[Array, Array, Array]:
    """Return the quintic from 0 to 1 with its first two derivatives."""
    s = np.clip(share, 0.0, 1.0)
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )


def move_prism(
    model: CompiledModel, start: float = 155.0, end: float = 165.0, duration: float = 1.0, knots: int = 101
) -> Motion:
    """Return the motion of the prism from one twist to another [deg], quintic in the twist."""
    time = np.linspace(0.0, duration, knots)
    s, rate, change = quintic(time / duration)
    turn = np.radians(end - start)
    twist = np.radians(start) + turn * s
    step = 1e-4
    before, now, after = (np.array([find_angles(t + d) for t in twist.tolist()]) for d in (-step, 0.0, step))
    now, before, after = (np.unwrap(q, axis=0) for q in (now, before, after))
    first, second = (after - before) / (2 * step), (after - 2 * now + before) / step**2
    q_rate = (turn * rate / duration)[:, None]
    acceleration = first * (turn * change / duration**2)[:, None] + second * q_rate**2
    return solve_inputs(model, time, now, first * q_rate, acceleration)


def solve_inputs(
    model: CompiledModel,
    time: Array,
    coordinate: Array,
    velocity: Array,
    acceleration: Array,
    prefer: Callable[[Array], Array] | None = None,
) -> Motion:
    """Return the motion with tensions nearest to those of the scene that give these accelerations."""
    structure = model.structure
    assert structure is not None
    stiffness, rest = structure.axial_stiffness, structure.rest_length
    free = [e for item in structure.actuators for e in item.members]
    nominal = structure.compute_static_tension(structure_length(model))
    rows = []
    for q, v, a in zip(coordinate, velocity, acceleration, strict=True):
        at = {"coordinate": q, "velocity": v}
        length = np.asarray(model.compute("member_length", **at))
        known = stiffness * (length / rest - 1) * (length > rest)
        slopes = model.compute("equilibrium_matrix", **at)
        slopes = slopes.toarray() if hasattr(slopes, "toarray") else np.asarray(slopes)
        mass = model.compute("mass_matrix", **at)
        mass = mass.toarray() if hasattr(mass, "toarray") else np.asarray(mass)
        wanted = -mass @ (a - np.asarray(model.compute("acceleration", **at))) + slopes @ known
        tension = known.copy()
        tension[free] = nominal[free]
        missing = wanted - slopes @ tension
        tension[free] += np.linalg.lstsq(slopes[:, free], missing, rcond=1e-10)[0]
        rows.append(np.concatenate([tension, stiffness * length / (stiffness + tension) - rest]))
    table = np.array(rows)
    tension, change = table[:, : len(rest)], table[:, len(rest) :]
    inputs = np.tile(np.asarray(model.nominal("input")).ravel(), (len(time), 1))
    names = model.manifest.input_name
    for item in structure.actuators:
        inputs[:, names.index(item.name)] = change[:, item.members[0]]
    first = [item.members[0] for item in structure.actuators]
    return Motion(
        time=time,
        coordinate=coordinate,
        velocity=velocity,
        acceleration=acceleration,
        rest_length=rest[first] + change[:, first],
        input=inputs,
        member_tension=tension,
        peak_rate=np.abs(np.gradient(change[:, first], time, axis=0)).max(axis=0),
        actuators=tuple(item.name for item in structure.actuators),
        input_name=names,
    )


def structure_length(model: CompiledModel) -> Array:
    """Return the member lengths at the scene's coordinates."""
    return np.asarray(model.compute("member_length")).copy()
