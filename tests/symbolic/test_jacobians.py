"""Derivatives of quantities to all their arguments, against differences of the quantities."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.emitter import prune
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.quantities import SLOPES
from tensegrity_codegen.tables.request import ModelRequest
from tests.comparison import dense, run_in_casadi
from tests.models import STIFF_PENDULUM
from tests.standing_robot import describe_robot

TRIANGLE: dict[str, Any] = {
    "name": "triangle",
    "axes": "xz",
    "gravity": [0, -9.81],
    "classes": {
        "bar": {"kind": "bar", "spring_constant": 3e3, "damping": 4.0},
        "cable": {"kind": "cable", "spring_constant": 200.0, "damping": 1.0},
    },
    "nodes": {
        "a": {"position": [0, 0.008], "mass": 0.3, "velocity": [0.1, -0.2]},
        "b": {"position": [0.6, -0.004], "mass": 0.3, "velocity": [0.0, -0.1]},
        "c": {"position": [0.3, 0.5], "mass": 0.4, "velocity": [0.3, 0]},
    },
    "members": {
        "ab": {"class": "cable", "nodes": ["a", "b"], "rest_length": 0.55},
        "bc": {"class": "bar", "nodes": ["b", "c"]},
        "ca": {"class": "bar", "nodes": ["c", "a"]},
    },
    "ground": {"stiffness": 5e3, "friction": 0.6, "dissipation": 0.5},
    "inputs": [{"name": "winch", "kind": "rest_length", "members": ["ab"]}],
    "parameters": {"rest_length": ["ab"], "damping": "all", "ground": "all", "node_load": ["c"]},
}
RIGID = STIFF_PENDULUM | {
    "members": STIFF_PENDULUM["members"] | {"bar": {"kind": "bar", "nodes": ["a", "b"]}},
    "parameters": {"node_mass": ["b"]},
}


@pytest.mark.parametrize(
    ("scene", "formulation"),
    [
        (TRIANGLE, "node_position"),
        (STIFF_PENDULUM | {"parameters": {"rest_length": "all"}}, "node_distance"),
        (RIGID, "rigid_bar"),
        (describe_robot(), "rigid_bar"),
    ],
    ids=["ground", "node_distance", "rigid_bar", "bodies"],
)
def test_slopes_are_derivatives_to_all_arguments_in_the_order_of_the_function(
    scene: dict[str, Any], formulation: str
) -> None:
    structure, request = load_scene(scene)
    wanted = ModelRequest((*SLOPES,), formulation=formulation, parameters=request.parameters)
    model = build_model(structure, wanted)
    draw, checked = np.random.default_rng(0), 0
    offered = [name for name, quantity in SLOPES.items() if quantity in model.quantities]
    assert {"acceleration_slopes", "member_tension_slopes"} <= {*offered}
    for name in offered:
        if not model.expression(name).nnz():  # such as positions of no bodies
            continue
        value, slopes = prune(model, (SLOPES[name], name))
        at = {
            argument: model.arguments[argument].nominal for argument in (*value.arguments, *slopes.arguments)
        }
        way = {
            argument: draw.normal(size=at[argument].shape) * (1.0 + np.abs(at[argument]))
            for argument in value.arguments
        }
        step = 1e-7
        ends = [
            dense(run_in_casadi(value, {key: at[key] + sign * step * way[key] for key in value.arguments}))
            for sign in (1.0, -1.0)
        ]
        matrix = dense(run_in_casadi(slopes, {key: at[key] for key in slopes.arguments}))
        along = np.concatenate([way[key].ravel() for key in value.arguments])
        found, expected = matrix @ along, np.ravel((ends[0] - ends[1]) / (2 * step))
        np.testing.assert_allclose(
            found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max() + 1e-10, err_msg=name
        )
        checked += 1
    assert checked >= 4
