"""Warnings of a start outside the limits, with the member and the excess."""

import pytest

from tensegrity_codegen.scene.checks.scene_warnings import find_body_warnings, find_warnings
from tests.body_scenes import EVERYTHING, assemble_document
from tests.scene.samples import build, changed

# The strut: EA 2e5 N, compression 40 N, radius 10 mm, length sqrt(3.25) m; both strings: 100 N/m.
BAR = {"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01, "prestress": -40.0}
ROUND = changed("classes", "strut", to=BAR)


def warnings(key, stated):
    structure, _ = build(changed(key, to=stated, base=ROUND))
    plain, _ = build(ROUND)
    return [text for text in find_warnings(structure) if text not in find_warnings(plain)]


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"least_tension": 10}, []),
        ({"least_tension": 12}, ["at the start bc has a tension of 10 N, allowed is at least 12 N"]),
        (
            {"most_tension": 30},
            ["at the start ab has a tension of 50 N, allowed is at most 30 N"],
        ),
        (
            {"yield_stress": 1e5},
            [
                "at the start ac has a stress of -0.127324 MPa, allowed is at most 0.1 MPa",
            ],
        ),
    ],
)
def test_the_start_is_compared_with_the_limits(limits, expected):
    assert warnings("limits", limits) == expected


def test_cables_without_a_radius_beside_one_that_has_a_yield_stress():
    document = changed("members", "ab", "radius", to=0.001, base=ROUND)
    structure, _ = build({**document, "limits": {"yield_stress": 1e9}})
    assert "no yield stress applies to members without a radius: bc" in find_warnings(structure)


def test_a_bar_that_starts_beyond_its_euler_load():
    # pi^2 EA r^2 / 4 / l^2 = 9.8696 * 2e5 * 2.5e-5 / 3.25 = 15.18 N, under a compression of 40 N
    found = warnings("limits", {"buckling": True})
    assert found == ["at the start ac has a safety factor against buckling of 0.3796, allowed is at least 1"]


def test_ranges_contain_the_rest_lengths():
    item = {"name": "m", "members": ["ab"], "range": [1.6, 2.0]}
    assert warnings("actuators", [item]) == [
        "the range of actuators does not contain the rest length of the scene: m (ab: 1.5 m, by 0.1 m)"
    ]
    assert warnings("actuators", [item | {"range": [1.5, 2.0]}]) == []


def test_tendons_are_compared_too():
    limits = {"members": {"t1": {"least_tension": 1e6}}}
    system, _ = assemble_document({**EVERYTHING, "limits": limits})
    assert any(text.startswith("at the start t1 has a tension") for text in find_body_warnings(system))


def test_bars_nearer_than_the_clearance():
    lower = {"class": "strut", "nodes": ["a", "b"]}
    nodes = {**ROUND["nodes"], "d": {"position": [1.8, 0, 1.5], "mass": 0.1}}
    members = {**ROUND["members"], "ab": lower, "cd": {"class": "strut", "nodes": ["c", "d"]}}
    document = {**ROUND, "nodes": nodes, "members": members}
    for clearance, expected in ((1.47, []), (1.5, ["ab and cd (1.48 m, by 0.02 m)"])):
        structure, _ = build({**document, "limits": {"clearance": clearance}})
        found = [text.partition(": ")[2] for text in find_warnings(structure) if "clearance" in text]
        assert found == expected
