"""Numbers of the ground as run-time parameters: as if the scene stated them, in motions and at rest."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.static_problem import EQUILIBRIUM_QUANTITIES
from tensegrity_codegen.runtime.trajectory.simulation_quantities import CONTACT_QUANTITIES
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tests.ground_cases import make_prism, make_slope
from tests.models import load, simulator
from tests.runtime.integrate.test_ground import rotate

OTHERS = {
    "stiffness": 3e4,
    "dissipation": 0.2,
    "friction": 0.35,
    "stick_stiffness": 1e4,
    "stick_damping": 15.0,
}
ALL = {"ground": tuple(range(len(CHANGEABLE)))}


def change(structure: Structure) -> Structure:
    assert structure.ground is not None
    return structure.with_changes(ground=replace(structure.ground, **OTHERS))


@pytest.mark.parametrize(
    "options", [{"formulation": "rigid_bar"}, {"emitter": "table"}], ids=lambda item: next(iter(item))
)
def test_a_motion_is_that_of_a_scene_with_these_numbers(options: dict[str, Any]) -> None:
    prism = make_prism(rotate((0.0, 0.3, 0.2)))
    if "emitter" in options:  # soft bars, in node positions
        stiff = np.where(prism.is_rigid, 1e4, prism.spring_constant)
        prism = prism.with_changes(spring_constant=stiff)
    free, stated = (
        simulator(item, "rk54", more=CONTACT_QUANTITIES, parameters=parameters, **options)
        for item, parameters in ((prism, ALL), (change(prism), {}))
    )
    assert free.manifest.argument("ground").over == CHANGEABLE == tuple(OTHERS)
    given = {"samples": [0.0, 0.36, 0.4], "method": "rk54", "rtol": 1e-8}
    found = simulate(free, 0.4, arguments={"ground": list(OTHERS.values())}, **given)
    expected = simulate(stated, 0.4, **given)
    assert np.abs(found.node_position - expected.node_position).max() < 1e-13
    assert found.feet[0].largest_use == pytest.approx(expected.feet[0].largest_use, rel=1e-9)


def test_an_equilibrium_is_that_of_a_scene_with_these_numbers() -> None:
    slope, _ = make_slope(np.radians(15.0))
    free = load(slope, *EQUILIBRIUM_QUANTITIES, parameters=ALL)
    stated = load(change(slope), *EQUILIBRIUM_QUANTITIES)
    found = find_equilibrium(free, arguments={"ground": list(OTHERS.values())})
    expected = find_equilibrium(stated)
    assert found.status == expected.status == "converged"
    np.testing.assert_allclose(found.coordinate, expected.coordinate, atol=1e-13)
    assert found.feet is not None
    assert expected.feet is not None
    np.testing.assert_allclose(found.feet.internal, expected.feet.internal, atol=1e-15)


def test_the_parameter_jacobian_has_the_ground() -> None:
    slope, _ = make_slope(np.radians(30.0))
    model = load(slope, "parameter_jacobian", "state_derivative", parameters=ALL)
    z = np.array([2.0 * 9.81e-5, 1e-5])  # slips
    state = {"coordinate": slope.node_position[0], "velocity": np.array([0.2, 0.1, -0.05]), "internal": z}
    nominal = model.nominal("ground")
    found = model.compute("parameter_jacobian", ground=nominal, **state)
    found = found.toarray() if hasattr(found, "toarray") else found
    for k, step in enumerate(1e-6 * np.maximum(nominal, 1.0)):
        ends = [nominal.copy(), nominal.copy()]
        ends[0][k] += step
        ends[1][k] -= step
        above, below = (model.compute("state_derivative", ground=end, **state) for end in ends)
        slope_ = (above - below) / (2 * step)
        assert np.abs(slope_).max() > 0
        np.testing.assert_allclose(found[:, k], slope_, rtol=1e-6, atol=1e-9 * np.abs(slope_).max())


def test_values_that_no_ground_has_are_refused() -> None:
    """Without friction a block slides down by g sin(15 deg) t^2 / 2, as scenes allow."""
    slope, _ = make_slope(np.radians(15.0))
    model = simulator(slope, "rk54", parameters={"ground": (2,)})
    with pytest.raises(InvalidValueError, match=r"arguments\.ground: friction"):
        simulate(model, 0.1, method="rk54", arguments={"ground": [-1.0]})
    moved = simulate(model, 0.1, method="rk54", rtol=1e-9, arguments={"ground": [0.0]}).node_position
    way = float(np.linalg.norm(moved[-1, 0] - moved[0, 0]))
    assert way == pytest.approx(0.5 * 9.81 * np.sin(np.radians(15.0)) * 0.01, rel=1e-6)
