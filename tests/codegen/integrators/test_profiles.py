"""A pull in integrators, a spring and a damper between a node and a point, beside SciPy with the same law."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_codegen.cli.picture import request_play
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.accuracy.integrate import integrate_once
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.placement import place_nodes, place_velocities
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments
from tensegrity_codegen.runtime.profiles.pieces import build_linear
from tensegrity_codegen.system.errors import FormulationError
from tests.cases import thorough
from tests.live.pages import EXAMPLES
from tests.rigid_scenes import HANGING as RODS

RAMP, T_END = 0.02, 0.1  # s
STIFFNESS, DAMPING = 200.0, 2.0


CASES = [("planar", "", "rk54"), ("prism", "node_distance", "rk54"), ("svd_tower", "", "rk54")]


@pytest.mark.parametrize(
    ("name", "formulation", "method"),
    [("prism", "", "rk54"), ("rods", "", "rk54"), *thorough(("prism", "", "radau"), *CASES)],
)
def test_a_pull_is_a_spring_and_a_damper_to_a_point(name: str, formulation: str, method: str) -> None:
    subject, request = load_scene(RODS if name == "rods" else EXAMPLES / f"{name}.toml")
    request = replace(request, formulation=formulation or request.formulation)
    model = build_library(subject, request_play(subject, request)).load()
    places, axes = model.manifest.coordinate_place, list(model.manifest.axes)
    node = subject.node_name.index("block_eye") if name == "rods" else subject.n_nodes - 1
    start = model.manifest.stated_position[node, axes]
    # The spring comes up while the point moves along the first axis, both in straight lines.
    later = [node, STIFFNESS, DAMPING, *start + 0.05]
    pieces = build_linear(np.array([0.0, RAMP, T_END]), np.array([[node, 0.0, 0.0, *start], later, later]))
    state = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    n, loads = len(state) // 2, model.nominal("node_load")

    def rates(time: float, state: np.ndarray) -> np.ndarray:
        _, stiffness, damping, *point = pieces.at(time)
        given = {"coordinate": state[:n], "velocity": state[n:]}
        if len(places):
            place, rate = place_nodes(model, state[:n]), place_velocities(model, state[:n], state[n:])
        else:
            place, rate = model.compute("node_position", **given), model.compute("node_velocity", **given)
        load = loads.copy()
        load[node] += stiffness * (point - place[node, axes]) - damping * rate[node, axes]
        return np.concatenate([state[n:], model.compute("acceleration", node_load=load, **given)])

    expected = solve_ivp(rates, (0.0, T_END), state, "DOP853", rtol=1e-9, atol=1e-11, max_step=RAMP / 4).y[
        :, -1
    ]
    schedule = DrivenArguments(pieces, tuple(("pull", k) for k in range(3 + len(axes))), {})
    motion = Motion(model, state, np.array([0.0, T_END]), schedule=schedule)
    found = integrate_once(motion, RunOptions(method=method, rtol=1e-9, atol=1e-11)).state[-1]
    free = integrate_once(
        replace(motion, schedule=None), RunOptions(method=method, rtol=1e-9, atol=1e-11)
    ).state[-1]
    moved = np.abs(found - free).max()
    assert moved > 1e-3
    np.testing.assert_allclose(found, expected, atol=1e-5 * moved)


@pytest.mark.parametrize("change", [{"driven": ("push",)}, {"driven": ("pull",), "parameters": {}}])
def test_what_cannot_change_with_time_is_refused(change: dict) -> None:
    subject, request = load_scene(EXAMPLES / "prism.toml")
    with pytest.raises(FormulationError, match="integrators cannot change this with time"):
        build_library(subject, replace(request, **change))
