"""Warnings of cables in one piece whose sag matters (Ernst 1965)."""

import pytest

from tensegrity_codegen.scene.checks.plausible_sag import warn_of_sag
from tensegrity_codegen.scene.checks.scene_warnings import find_warnings
from tests.scene.samples import build


def span(tension: float, **values: object) -> dict:
    """A cable of EA 1000 N and 1 N/m over 10 m."""
    line = {"kind": "cable", "nodes": ["a", "b"], "axial_stiffness": 1000.0, "prestress": tension}
    rest = 10000.0 / (1000.0 + tension)
    return {
        "name": "span", "axes": "xz", "gravity": [0, -10],
        "nodes": {"a": {"position": [0, 0], "anchored": True}, "b": {"position": [10, 0], "anchored": "z"}},
        "members": {"line": line | {"mass": 1.0 / 10.0 * rest} | values},
    }  # fmt: skip


def test_the_cable_its_number_and_the_key_are_named() -> None:
    (text,) = warn_of_sag(build(span(50.0))[0])
    assert "line (0.0667, so 0.9375 of its stiffness)" in text
    assert "segments = 8" in text
    assert text in find_warnings(build(span(50.0))[0])


def test_the_threshold() -> None:
    # w^2 L^2 EA / (12 T^3) = 0.01 at T = (1e5 / 0.12)^(1/3) = 94.1036 N.
    assert warn_of_sag(build(span(94.2))[0]) == []
    assert len(warn_of_sag(build(span(94.0))[0])) == 1


def test_slack_cables_have_no_stiffness_left() -> None:
    (text,) = warn_of_sag(build(span(0.0))[0])
    assert "line (slack as a straight line)" in text


@pytest.mark.parametrize("values", [{"segments": 4}])
def test_cables_in_segments_and_vertical_ones_are_not_warned_of(values: dict) -> None:
    assert warn_of_sag(build(span(50.0, **values))[0]) == []
    upright = span(50.0)
    upright["nodes"]["b"] = {"position": [0, -10], "anchored": "x"}
    assert warn_of_sag(build(upright)[0]) == []
    weightless = span(50.0)
    del weightless["gravity"]
    assert warn_of_sag(build(weightless)[0]) == []
