"""Members against their limits, in closed form."""

import math

import numpy as np
import pytest

from tensegrity_codegen.runtime.analysis.analyse import analyse
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.member_limits import check_members
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure

POINTS = [[0, 0, 0], [2, 0, 0], [4, 0, 0]]
INF = math.inf


def strut(**limits):
    """A bar of 2 m and a cable of 2 m; tube of 10 and 8 mm, EA = 1e5 N/m * rest length."""
    structure = make_structure(POINTS, [bar(0, 1, 2.01), cable(1, 2, 1.9)])
    none = {"least_tension": -INF, "most_tension": INF, "yield_stress": INF, "buckling": 0.0}
    values = {name: np.full(2, limits.get(name, none[name])) for name in none}
    more = {name: limits[name] for name in ("clearance", "least_stiffness") if name in limits}
    return structure.with_changes(
        radius=np.array([0.01, 0.0]), inner_radius=np.array([0.008, 0.0]), limits=Limits(**values, **more)
    )


def test_stress_and_buckling() -> None:
    structure = strut()
    found = check_members(structure, np.array([-50.0, 30.0]), np.array([2.0, 2.0]))
    area = math.pi * (0.01**2 - 0.008**2)
    assert found.stress[0] == pytest.approx(-50 / area)
    assert np.isnan(found.stress[1])
    inertia = math.pi / 4 * (0.01**4 - 0.008**4)
    modulus = 1e5 * 2.01 / area
    load = math.pi**2 * modulus * inertia / 2.0**2
    assert found.buckling_load[0] == pytest.approx(load)
    assert found.buckling_factor[0] == pytest.approx(load / 50)
    assert np.isnan(found.buckling_load[1])
    assert found.exceeded == ()
    assert found.worst is None
    heavy, length = np.array([-2.0 * load, 30.0]), np.array([2.0, 2.0])
    assert [item.limit for item in check_members(structure, heavy, length).doubtful] == ["buckling"]
    waived = check_members(strut(buckling=-INF), heavy, length)
    assert (waived.exceeded, waived.doubtful) == ((), ())
    pulled = check_members(structure, np.array([50.0, 30.0]), np.array([2.0, 2.0]))
    assert pulled.buckling_factor[0] == INF


@pytest.mark.parametrize(
    ("limits", "tension", "use"),
    [
        ({"most_tension": 40.0}, 30.0, 0.75),
        ({"most_tension": 40.0}, -30.0, 0.0),
        ({"most_tension": 20.0}, 30.0, 1.5),
        ({"most_tension": -20.0}, -30.0, 2 / 3),
        ({"most_tension": -20.0}, 1.0, INF),
        ({"least_tension": 10.0}, 30.0, 1 / 3),
        ({"least_tension": 10.0}, 0.0, INF),
        ({"least_tension": 0.0}, 1.0, 0.0),
        ({"least_tension": 0.0}, -1.0, INF),
        ({"least_tension": -10.0}, -5.0, 0.5),
        ({"least_tension": -10.0}, -25.0, 2.5),
        ({"least_tension": -10.0}, 25.0, 0.0),
    ],
)
def test_use_of_bounds_of_tension(limits, tension, use) -> None:
    found = check_members(strut(**limits), np.array([tension, tension]), np.array([2.0, 2.0]))
    (name,) = limits
    assert found.use[name] == pytest.approx([use, use])
    assert bool(found.exceeded) is (use > 1)
    assert found.worst == ("e0", name, pytest.approx(use))


def test_the_worst_is_first() -> None:
    structure = strut(least_tension=10.0, yield_stress=1e5, buckling=3.0)
    found = check_members(structure, np.array([-50.0, 30.0]), np.array([2.0, 2.0]))
    found_use = [float(found.use[item.limit][0]) for item in found.exceeded]
    assert {item.member for item in found.exceeded} == {"e0"}
    assert found_use == sorted(found_use, reverse=True)
    assert len(found_use) == 3
    assert found.worst == ("e0", "least_tension", INF)
    assert found.use["yield_stress"][0] == pytest.approx(abs(found.stress[0]) / 1e5)
    assert np.isnan(found.use["yield_stress"][1])  # no section
    assert found.use["buckling"][0] == pytest.approx(3.0 / found.buckling_factor[0])


def test_an_analysis_names_limits_that_are_exceeded() -> None:
    """The bar is 10 mm shorter than its rest length: 1e5 N/m times that is above any limit here."""
    structure = strut(least_tension=-100.0, buckling=2.0, least_stiffness=1e9)
    found = analyse(ReferenceModel(structure))
    (compressed,) = (item for item in found.members.exceeded if item.limit == "least_tension")
    assert compressed.member == "e0"
    assert compressed.value == pytest.approx(-1000.0)
    text = " ".join(found.warnings)
    assert "e0 has a tension of -1000 N, allowed is at least -100 N" in text
    assert "e0 has a safety factor against buckling of" in text
    assert "the smallest eigenvalue of the stiffness is" in text
    bare = analyse(ReferenceModel(strut()))
    assert any(text.startswith("e0 buckles") for text in bare.warnings)
