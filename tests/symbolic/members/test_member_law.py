"""The member law case by case: two-sided, taut, slack, on the kink, damped (S&K 2, SCS)."""

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.symbolic.members.member_law import MemberLaw


def law_values(*, tension_only: bool = True, **given: float) -> dict[str, float]:
    """Return every value of a law, evaluated from symbols; k = 100 N/m and rho = 1 m unless given."""
    values = {
        "length": 1.2,
        "rate": 0.0,
        "rest_length": 1.0,
        "spring_constant": 100.0,
        "axial_stiffness": 0.0,
        "damping": 0.0,
    } | given
    symbols = {name: ca.SX.sym(name) for name in values}
    law = MemberLaw(**symbols, tension_only=tension_only)
    names = [
        *("tension", "static_tension", "energy", "tension_by_length", "static_tension_by_length"),
        *("tension_by_rate", "tension_by_rest_length"),
    ]
    function = ca.Function("law", list(symbols.values()), [getattr(law, name)() for name in names])
    results = function(*values.values())
    return {name: float(result) for name, result in zip(names, results, strict=True)}


def test_a_taut_cable_pulls() -> None:
    found = law_values(length=1.2)
    assert found["tension"] == found["static_tension"] == pytest.approx(20.0)
    assert found["energy"] == pytest.approx(2.0)
    assert found["tension_by_length"] == found["static_tension_by_length"] == 100.0
    assert found["tension_by_rest_length"] == -100.0


@pytest.mark.parametrize("length", [1.0, 0.7, 0.0])
def test_a_cable_that_is_not_longer_than_its_rest_length_carries_nothing(length: float) -> None:
    found = law_values(length=length, damping=3.0, rate=10.0)
    assert set(found.values()) == {0.0}


def test_a_cable_on_the_kink_has_no_rate_of_its_own() -> None:
    assert law_values(length=1.0, rate=5.0, damping=1.0)["tension"] == 0.0
    assert law_values(length=np.nextafter(1.0, 2.0), rate=5.0, damping=1.0)["tension"] == pytest.approx(5.0)


@pytest.mark.parametrize("length", [1.2, 1.0, 0.7])
def test_a_two_sided_member_follows_one_line(length: float) -> None:
    found = law_values(length=length, tension_only=False, damping=2.0, rate=3.0)
    assert found["static_tension"] == pytest.approx(100.0 * (length - 1.0))
    assert found["tension"] == pytest.approx(found["static_tension"] + 6.0)
    assert found["energy"] == pytest.approx(50.0 * (length - 1.0) ** 2)
    assert found["tension_by_rate"] == 2.0


def test_axial_stiffness_divides_by_the_rest_length() -> None:
    found = law_values(spring_constant=0.0, axial_stiffness=40.0, rest_length=0.8, tension_only=False)
    assert found["tension"] == pytest.approx(40.0 * (1.2 - 0.8) / 0.8)
    assert found["tension_by_length"] == pytest.approx(50.0)
    assert found["tension_by_rest_length"] == pytest.approx(-40.0 * 1.2 / 0.8**2)


def test_damping_that_would_push_is_cut_off_in_a_cable() -> None:
    """Taut by 20 N, shortening at 5 m/s with 5 N s/m: 20 - 25 < 0, so the damped tension is zero."""
    found = law_values(damping=5.0, rate=-5.0)
    assert found["tension"] == found["tension_by_length"] == found["tension_by_rate"] == 0.0
    assert found["tension_by_rest_length"] == 0.0
    assert found["static_tension"] == pytest.approx(20.0)
    assert found["static_tension_by_length"] == 100.0
    assert found["energy"] == pytest.approx(2.0)


def test_damping_that_leaves_a_pull_is_kept() -> None:
    found = law_values(damping=5.0, rate=-3.0)
    assert found["tension"] == pytest.approx(5.0)
    assert found["tension_by_rate"] == 5.0


def test_a_two_sided_member_may_push_by_damping() -> None:
    assert law_values(damping=5.0, rate=-5.0, tension_only=False)["tension"] == pytest.approx(-5.0)


def test_an_unknown_rate_does_not_reach_a_slack_cable() -> None:
    """Coincident nodes have no l' (0/0), and a slack cable between them carries nothing all the same."""
    found = law_values(length=0.0, rate=np.nan, damping=2.0)
    assert found["tension"] == 0.0
    assert found["tension_by_length"] == 0.0


def test_a_nan_length_is_not_taken_for_slack_by_a_two_sided_member() -> None:
    assert np.isnan(law_values(length=np.nan, tension_only=False)["tension"])


def test_a_law_without_damping_has_no_rate_in_it() -> None:
    length, rate = ca.SX.sym("length"), ca.SX.sym("rate")
    one = ca.SX(1.0)
    law = MemberLaw(length, rate, one, 100 * one, ca.SX(0.0), ca.SX(0.0), True)
    assert not ca.depends_on(law.tension(), rate)
    assert ca.depends_on(law.tension(), length)
