"""From a plan to a closed loop in node positions: a prism with stiff bars on held feet."""

import numpy as np
import pytest

from tensegrity_codegen import Gust, design_kalman, design_lqr, plan, simulate_control, time_motion
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.structure.actuators import Sensor
from tensegrity_codegen.tables.request import ModelRequest
from tests.control.feedback.structures import build_prism


@pytest.mark.thorough
def test_a_planned_motion_of_nodes_is_held() -> None:
    structure = build_prism(free=False)
    wanted = want_analyses(structure, ModelRequest(()), ("plan", "time_motion", "control"))
    model = build_library(structure, wanted).load()
    names = [item.name for item in structure.actuators if "bottom" not in item.name]
    motion = time_motion(model, plan(model, "twist=158", actuators=names), duration=1.0)
    n = structure.n_coordinates
    weight = np.concatenate([np.full(n, 1e4), np.ones(n)])
    gains = design_lqr(model, motion, weight, np.full(len(names), 1e4))
    tips = tuple(k for k, name in enumerate(structure.node_name) if name.startswith("t"))
    estimator = design_kalman(model, motion, [Sensor("node_position", tips, 1e-4)])
    assert estimator.substeps > 1  # bars vibrate fast
    off = 1e-4 * np.random.default_rng(0).normal(size=n)
    gust = Gust("t1", (0.0, 0.0, -3.0), 0.5, 0.1)
    for senses, bound in ((None, 1e-6), (estimator, 5e-4)):
        run = simulate_control(
            model, motion, gains, estimator=senses, t_end=2.0, coordinate_error=off, gust=gust
        )
        assert run.status == "ok"
        assert 1e-3 < run.worst_error() < 0.01
        assert run.worst_error(0.5) < bound
