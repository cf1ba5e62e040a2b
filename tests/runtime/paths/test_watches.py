"""Load factors at which members buckle or exceed a limit, in closed form."""

import numpy as np
import pytest
from scipy import optimize

from tensegrity_codegen.runtime.paths.continuation import follow_path
from tensegrity_codegen.runtime.paths.model_path import build_path
from tensegrity_codegen.runtime.paths.watches import watch_members
from tensegrity_codegen.structure.limits import Limits
from tests.reference import ReferenceModel
from tests.runtime.build import bar, make_structure

RADIUS, STIFFNESS = 0.01, 1e4  # [m], [N/m] of a bar of 1 m


def test_a_strut_buckles_and_yields_where_it_must() -> None:
    structure = make_structure(
        [[0, 0, 0], [0, 0, 1]], [bar(0, 1, 1.0, STIFFNESS)], anchored={0: "z"}, axes="z"
    )
    structure = structure.with_changes(radius=np.array([RADIUS]))
    stated = {"yield_stress": 2e5, "least_tension": -50.0, "most_tension": 9.0, "buckling": 2.0}
    limits = Limits(**{name: np.array([value]) for name, value in stated.items()})

    def follow(subject, most):
        path = build_path(ReferenceModel(subject), np.array([[0.0], [-1.0]]))
        found = follow_path(path, np.array([1.0]), most=most, watches=watch_members(path, subject))
        assert found.status == "completed"
        return {event.names[0]: event.load_factor for event in found.events}

    def buckle(factor):
        euler = np.pi**2 * STIFFNESS * RADIUS**2 / 4
        return optimize.brentq(lambda load: factor * load * (1 - load / STIFFNESS) ** 2 - euler, 0, 100)

    assert follow(structure, 80.0) == pytest.approx({"e0 (buckling)": buckle(1)}, rel=1e-9)
    limited = structure.with_changes(limits=limits)
    waived = Limits(**{**{name: getattr(limits, name) for name in stated}, "buckling": np.array([-np.inf])})
    assert "e0 (buckling)" not in follow(structure.with_changes(limits=waived), 80.0)
    expected = {
        "e0 (buckling)": buckle(2),
        "e0 (least_tension)": 50.0,
        "e0 (yield_stress)": 2e5 * np.pi * RADIUS**2,
    }
    assert follow(limited, 80.0) == pytest.approx(expected, rel=1e-9)
    assert follow(limited, -20.0) == pytest.approx({"e0 (most_tension)": -9.0}, rel=1e-9)
