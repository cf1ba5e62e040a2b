"""Members with memory: expressions against the law in NumPy and compiled functions, at random states."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.tables.laws.plastic import MARGIN_TIME, Plastic
from tensegrity_codegen.tables.laws.viscous import Viscous
from tensegrity_codegen.tables.request import ModelRequest
from tests.models import load
from tests.plastic_cases import make_mass
from tests.runtime.build import cable, spring
from tests.viscous_cases import make_mass as make_viscous

LAW, K = Plastic(), 1e4
QUANTITIES = (
    *("member_tension", "elastic_energy", "node_residual", "tangent_stiffness"),
    *("settled_internal", "yield_margin", "plastic_elongation", "plastic_work", "plastic_power"),
    *("internal_rate", "acceleration", "state_derivative"),
)


def draw(random: np.random.Generator) -> dict[str, Any]:
    """Return a state: elastic, pulled or pushed."""
    q = random.uniform(-0.02, 0.02)
    flags = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))[random.integers(3)]
    return {
        "coordinate": np.array([1.0 + q + random.uniform(-0.01, 0.01)]),
        "velocity": np.array([random.uniform(-2.0, 2.0)]),
        "internal": np.array([q, abs(q) + random.uniform(0.0, 0.01), *flags]),
    }


@pytest.mark.parametrize("isotropic", [0.0, 0.4])
@pytest.mark.parametrize("slack", [False, True])
def test_expressions_are_those_of_the_law_and_of_compiled_functions(isotropic: float, slack: bool) -> None:
    structure = make_mass(0.1, isotropic, tension_only=slack)
    compiled = load(structure, *QUANTITIES)
    model = build_model(structure, ModelRequest(QUANTITIES))
    symbols = [model.arguments[name].symbol for name in ("coordinate", "velocity", "internal")]
    function = ca.Function("all", symbols, [ca.densify(model.expression(name)) for name in QUANTITIES])
    random = np.random.default_rng(7)
    for _ in range(60):
        state = draw(random)
        values_of = [item.toarray() for item in function(*state.values())]
        found = dict(zip(QUANTITIES, values_of, strict=True))
        for name in QUANTITIES:
            value = compiled.compute(name, **state)
            plain = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
            assert found[name].ravel() == pytest.approx(plain.ravel(), rel=1e-13, abs=1e-13)
        x, rate = float(state["coordinate"][0]) - 1.0, float(state["velocity"][0])
        values = {"yield_elongation": 0.005, "hardening": 0.1, "isotropic": isotropic}
        moving = values | dict(zip((*LAW.states, *LAW.flags), state["internal"].tolist(), strict=True))
        resting = LAW.at_rest(moving)
        tension, rest = (K * float(LAW.effective_elongation(x, v, np.where)) for v in (moving, resting))
        bounded = [max(t, 0.0) if slack else t for t in (tension, rest)]
        assert [found["member_tension"].item(), -found["node_residual"].item()] == pytest.approx(bounded)
        margins = LAW.margins((x, rate), moving, np.where, slack)
        assert np.ravel(found["yield_margin"]) == pytest.approx([float(m) for m in margins], abs=1e-15)
        at = float(LAW.limit_slack(x, resting, np.where)) if slack else x
        settled = [float(value) for value in LAW.settle(at, moving, np.where)]
        assert np.ravel(found["settled_internal"])[:2] == pytest.approx(settled, abs=1e-15)
        flow = float(moving["pulled"]) - float(moving["pushed"])
        rates = [0.9 * rate * abs(flow), 0.9 * rate * flow, 0.0, 0.0]
        assert np.ravel(found["internal_rate"]) == pytest.approx(rates)
        assert found["plastic_power"].item() == pytest.approx(-50.0 * rates[1])
        assert found["plastic_work"].item() == pytest.approx(-50.0 * moving["accumulated"])


@pytest.mark.parametrize("kind", [spring, cable])
def test_expressions_of_viscous_members_are_those_of_the_law_and_of_compiled_functions(kind: Any) -> None:
    structure = make_viscous(kind)
    names: tuple[str, ...] = ("cable_margin",) if kind is cable else ()
    names += ("member_tension", "elastic_energy", "node_residual", "relaxed_internal", "viscous_power")
    names += ("energy_rate", "internal_rate", "acceleration", "state_jacobian", "total_energy")
    compiled = load(structure, *names)
    model = build_model(structure, ModelRequest(names))
    symbols = [model.arguments[name].symbol for name in ("coordinate", "velocity", "internal")]
    function = ca.Function("all", symbols, [ca.densify(model.expression(name)) for name in names])
    law, slack, mu, random = Viscous(), kind is cable, 1e3, np.random.default_rng(5)
    values = {"relaxation_time": 0.2, "relaxed_fraction": 0.3}
    for x, rate, p in random.uniform([-0.02, -2.0, -0.02], [0.04, 2.0, 0.03], (60, 3)):
        state = {"coordinate": [1.0 + x], "velocity": [rate], "internal": [p, 0.0]}
        found = dict(zip(names, [item.toarray() for item in function(*state.values())], strict=True))
        for name in names:
            value = compiled.compute(name, **state)
            plain = value.toarray() if hasattr(value, "toarray") else np.asarray(value)
            assert found[name].ravel() == pytest.approx(plain.ravel(), rel=1e-13, abs=1e-13)
        moving = values | {"viscous": p}
        y, rest = (float(law.effective_elongation(x, item, np.where)) for item in (moving, values))
        bounded = [max(mu * t, 0.0) if slack else mu * t for t in (y, rest)]
        assert [found["member_tension"].item(), 8.0 - found["node_residual"].item()] == pytest.approx(bounded)
        assert not slack or found["cable_margin"].item() == pytest.approx(x - p, abs=1e-15)
        flow = float(law.rates((x, rate), moving, np.where, slack)[0])
        lost = 0.2 * mu / 0.7 * flow**2
        assert found["internal_rate"].ravel() == pytest.approx([flow, -lost])
        assert found["viscous_power"].item() == pytest.approx(-lost) == found["energy_rate"].item()
        at = max(x, p) if slack else x
        assert found["elastic_energy"].item() == pytest.approx(float(law.energy(mu, at, moving, np.where)))
        relaxed = 0.7 * (max(x, 0.0) if slack else x)
        assert found["relaxed_internal"].ravel() == pytest.approx([relaxed, 0.0], abs=1e-15)


def test_margins_change_sign_where_flow_begins_and_ends() -> None:
    """Pulled: R - (t - X) at the limit; in flow minus the rate, in metres by a second."""
    values = {"yield_elongation": 0.005, "hardening": 0.1, "isotropic": 0.0, "accumulated": 0.0}
    elastic = values | {"plastic": 0.0, "pulled": 0.0, "pushed": 0.0}
    for x, expected in ((0.004, 0.001), (0.006, -0.001), (-0.005, 0.01)):
        assert float(LAW.margins((x, 1.0), elastic, np.where, False)[0]) == pytest.approx(expected)
    flowing = elastic | {"pulled": 1.0, "plastic": 0.0135}
    for rate in (0.3, -0.2):
        pulled, pushed = LAW.margins((0.02, rate), flowing, np.where, False)
        assert float(pulled) == pytest.approx(-MARGIN_TIME * rate)
        assert float(pushed) > 0.0
