"""Member laws by themselves: every law of the list against differences of its energy and tension."""

import numpy as np
import pytest

from tensegrity_codegen.tables.laws import LAW_PARAMETERS, LAWS, MEMBER_VALUES, find_law
from tensegrity_codegen.tables.laws.law import Law, compute_spring_constant

VALUES = {"rest_length": 0.9, "damping": 0.0} | dict.fromkeys(LAW_PARAMETERS, 0.4)
STIFFNESS = (
    {"spring_constant": 30.0, "axial_stiffness": 0.0},
    {"spring_constant": 0.0, "axial_stiffness": 45.0},
)
ELONGATION = np.array([-0.6, -0.35, -0.1, 0.1, 0.35, 0.55])


def compute_tension(law: Law, member: dict[str, float], length: np.ndarray) -> np.ndarray:
    mu = compute_spring_constant(*(member[name] for name in MEMBER_VALUES[:3]))
    y = law.effective_elongation(length - member["rest_length"], member, np.where)
    return np.asarray(mu * y)


@pytest.mark.parametrize("stiffness", STIFFNESS)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_slopes_and_energy_are_derivatives_and_integral_of_the_tension(
    law: Law, stiffness: dict[str, float]
) -> None:
    member = {**VALUES, **stiffness}
    mu, step = compute_spring_constant(*(member[name] for name in MEMBER_VALUES[:3])), 1e-6
    length = member["rest_length"] + ELONGATION
    tension = compute_tension(law, member, length)
    slope = law.slope(mu, ELONGATION, member, np.where)
    difference = (
        compute_tension(law, member, length + step) - compute_tension(law, member, length - step)
    ) / 2
    assert np.broadcast_to(slope, 6) == pytest.approx(difference / step, rel=1e-8)
    energy = [law.energy(mu, ELONGATION + change, member, np.where) for change in (step, -step)]
    assert tension == pytest.approx((energy[0] - energy[1]) / (2 * step), rel=1e-7)
    shifted = [
        compute_tension(law, member | {"rest_length": member["rest_length"] + change}, length)
        for change in (step, -step)
    ]
    by_rest = law.slope_by_rest_length(member, length, np.where)
    assert by_rest == pytest.approx((shifted[0] - shifted[1]) / (2 * step), rel=1e-7)


def test_a_member_without_parameters_is_a_linear_spring() -> None:
    assert find_law(lambda name: False).is_linear
    assert find_law(lambda name: False).name == "linear"


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_is_found_by_its_first_parameter(law: Law) -> None:
    assert find_law(lambda name: bool(law.parameters) and name == law.parameters[0].name) is law
