"""Derivatives of length and force density of one member whose ends move on given curves."""

import casadi as ca
import pytest

from tensegrity_codegen.symbolic.members.member import Member
from tensegrity_codegen.symbolic.rigid_motion import MemberSeries, half_square

TIME = ca.SX.sym("t")
CURVE = [1.0 + 0.3 * TIME + TIME**3, ca.sin(2.0 * TIME) - 0.2, 0.5 * TIME * TIME]


def vector(n: int) -> list[ca.SX]:
    """Return the n-th derivative of the curve, symbolically."""
    found = ca.vertcat(*CURVE)
    for _ in range(n):
        found = ca.jacobian(found, TIME)
    return [found[k] for k in range(3)]


def at(expression: ca.SX, time: float) -> float:
    return float(ca.Function("f", [TIME], [expression])(time))


@pytest.mark.parametrize("damping", [0.0, 0.7])
@pytest.mark.parametrize("rest_length", [0.9, 1e3])
def test_derivatives_are_those_of_the_member_on_its_way(damping: float, rest_length: float) -> None:
    values = {"rest_length": rest_length, "spring_constant": 30.0, "axial_stiffness": 0.0, "damping": damping}
    numbers = {name: ca.SX(value) for name, value in values.items()}
    member = Member(vector(0), vector(1), numbers, tension_only=True)
    series = MemberSeries(member, vector, keeps_length=False)
    length, density = member.length, member.density
    for n in range(4):
        assert at(series.relative_length(n) * member.length, 0.4) == pytest.approx(at(length, 0.4), rel=1e-12)
        length = ca.jacobian(length, TIME)
    for n in range(3):
        assert at(series.density(n), 0.4) == pytest.approx(at(density, 0.4), rel=1e-12, abs=1e-12)
        density = ca.jacobian(density, TIME)


def test_half_of_the_square_of_a_polynomial() -> None:
    derivatives = [
        2.0,
        3.0,
        10.0,
        0.0,
        0.0,
    ]  # of 2 + 3 t + 5 t^2, whose square is 4 + 12 t + 29 t^2 + 30 t^3 + ...
    for n, expected in enumerate((4.0, 12.0, 58.0, 180.0)):
        found = half_square(n, 0, lambda i, j: ca.SX(derivatives[i] * derivatives[j]))
        assert float(found) == pytest.approx(expected / 2)
