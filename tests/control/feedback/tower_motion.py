"""The two-stage tower of the paper with 18 motors, and its motion from 55/40 to 65/35 deg under 50 N."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.design.gains import Estimator, Gains
from tensegrity_codegen.control.feedback.kalman import design_kalman
from tensegrity_codegen.control.feedback.loop.sampled_plant import Disturbance, Gust
from tensegrity_codegen.control.feedback.lqr import design_lqr
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.actuators import Sensor
from tests.body_scenes import assemble_document
from tests.control.feedback.pinned_prism import quintic, solve_inputs

SCENE = Path(__file__).resolve().parents[3] / "tensegrity_codegen" / "scene" / "examples" / "svd_tower.toml"
DURATION = 5.0
TOWER_SAMPLE = 0.01  # [s]


def build_tower() -> CompiledModel:
    """Return the compiled tower: a motor of 0.05 m/s in each tendon, no torques."""
    document: dict[str, Any] = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    del document["parameters"], document["inputs"], document["model"]["integrators"]
    document["actuators"] = [{"name": f"m_{k}", "members": [k], "rate": 0.05} for k in document["tendons"]]
    system, request = assemble_document(document)
    return build_library(system, want_analyses(system, request, ("control",))).load()


def find_angles(model: CompiledModel) -> list[int]:
    """Return the indices of the coordinates that are angles."""
    names = model.manifest.coordinate_name
    return [k for k, name in enumerate(names) if name[-2:] not in ("_x", "_y", "_z")]


def move_tower(model: CompiledModel, knots: int = 501) -> Motion:
    """Return the motion: azimuths turn by 10 deg, declinations by -5 deg, quintic, at constant height."""
    time = np.linspace(0.0, DURATION, knots)
    share, rate, change = quintic(time / DURATION)
    turn = np.zeros(len(model.manifest.coordinate_name))
    for k, name in enumerate(model.manifest.coordinate_name):
        if name.startswith("bar"):
            turn[k] = np.radians(10.0 if name.endswith("azimuth") else -5.0)
    coordinate = model.nominal("coordinate") + share[:, None] * turn
    return solve_inputs(
        model, time, coordinate, rate[:, None] * turn / DURATION, change[:, None] * turn / DURATION**2
    )


def design_tower_gains(model: CompiledModel, motion: Motion, **options: Any) -> Gains:
    """Return the gains of the acceptance table, with the weights of the prism."""
    weight = np.concatenate([np.full(18, 100.0), np.full(18, 0.1), np.full(18, 10.0)])
    names = model.manifest.coordinate_name
    return design_lqr(
        model, motion, weight, np.full(18, 1e6), sample=TOWER_SAMPLE, integral_action=names, **options
    )


def design_tower_estimator(model: CompiledModel, motion: Motion, noise: float = 1e-4) -> Estimator:
    """Return the estimator from the lengths of all tendons with noise [m]."""
    sensors = [Sensor("member_length", tuple(range(18)), noise)]
    return design_kalman(model, motion, sensors, sample=TOWER_SAMPLE)


def draw_tower_errors(model: CompiledModel, seed: int, noise: int = 0) -> Disturbance:
    """Return the errors of one draw: 1 deg and 1 cm off, stiffness by 5 %, 5 N on the top for 1 s.

    noise: seed of the noise of measurements.
    """
    rng, angles = np.random.default_rng(seed), find_angles(model)
    off = np.full(18, 0.01)
    off[angles] = np.radians(1.0)
    sign, force = rng.choice([-1.0, 1.0], 18), rng.normal(size=3)
    return Disturbance(
        coordinate_error=off * sign,
        axial_stiffness=1000.0 * np.array([1.05 if e % 2 else 0.95 for e in range(18)]),
        gust=Gust("top_centre", tuple(5.0 * force / np.linalg.norm(force)), 2.0, 1.0),
        seed=noise,
    )
