"""The tower driven through its 18 tendons by a table, in C, beside SciPy at its least tolerance."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_codegen import CompiledModel, ModelRequest, Profile, build_library, simulate
from tensegrity_codegen.runtime.integrate.flow import build_derivative
from tensegrity_codegen.runtime.profiles.driven import bind_profile
from tensegrity_codegen.runtime.trajectory.simulation_quantities import simulation_quantities
from tensegrity_codegen.studies.papers.scs.tracking import drive
from tests.codegen.quickly import without_optimisation
from tests.studies.papers.scs.subjects import paper_motion, tower

END, KNOTS = 2.0, 21


@pytest.fixture(scope="module")
def model() -> CompiledModel:
    everything = {"rest_length": tuple(range(18))}
    quantities = simulation_quantities("bodies")
    request = ModelRequest(quantities, everything, formulation="bodies", integrators=("rk54", "rk853"))
    with without_optimisation():
        return build_library(tower().system, request).load()


@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_a_table_of_all_tendons_is_followed_to_1e_11(model: CompiledModel, kind: Any) -> None:
    plan = paper_motion("with_torque")
    knots = np.linspace(0.0, END, KNOTS)
    rows = [drive(plan)(float(t)) for t in knots]
    table = {name: np.array([row[name] for row in rows]) for name in ("rest_length", "input")}
    profile = Profile(knots, table, kind)
    assert profile.values["rest_length"].shape == (KNOTS, 18)
    assert np.ptp(profile.values["rest_length"], axis=0).min() > 1e-3  # every tendon moves
    start = plan.tower.restricted.coordinate(plan.path.at(0.0).s)
    derivative = build_derivative(model, {}, bind_profile(model, profile, {}, END))
    state = np.concatenate([start, np.zeros(len(start))])
    for first, last in pairwise(knots.tolist()):
        state = solve_ivp(derivative, (first, last), state, "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    given: dict[str, Any] = {"coordinate": start, "schedule": profile, "samples": 5}
    for method, tolerance in (("auto", 1e-10), ("rk853", 1e-11), ("rk54", 1e-12)):
        run = simulate(model, END, method=method, rtol=tolerance, atol=0.1 * tolerance, **given)
        assert run.status == "ok"
        assert "scipy" not in run.method
        found = np.concatenate([run.coordinate[-1], run.velocity[-1]])
        np.testing.assert_allclose(found, state, rtol=0.0, atol=1e-11)
