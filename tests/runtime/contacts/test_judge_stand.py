"""Verdicts on structures that stand, slide and tip as rigid wholes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.runtime.contacts.judge_stand import Stand, judge_stand
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tests.ground_cases import make_ground
from tests.runtime.build import make_structure, spring

Array = NDArray[np.float64]
SQUARE = [[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]]


def judge(feet: list[list[float]], load: list[float], at: list[float], axes: str = "xyz") -> Stand:
    """Return the verdict on feet below a node that carries the load."""
    structure = place(feet, at, axes)
    external = np.zeros((len(feet) + 1, 3))
    external[-1] = load
    return judge_stand(structure, structure.node_position, external)


def place(feet: list[list[float]], at: list[float], axes: str = "xyz", **more: object) -> Structure:
    members = [spring(k, len(feet), 1.0) for k in range(len(feet))]
    made = make_structure([*feet, at], members, axes=axes, **more)  # type: ignore[arg-type]
    return made.with_changes(ground=make_ground(len(feet) + 1, friction=0.5))


def test_four_feet_share_the_load_by_least_squares() -> None:
    found = judge(SQUARE, [0.0, 0.0, -4.0], [0.5, 0.0, 2.0])
    assert (found.verdict, found.distribution, found.friction_needed) == ("stands", "least_squares", 0.0)
    np.testing.assert_allclose(found.force[:, 2], [1.5, 0.5, 0.5, 1.5], atol=1e-12)  # (1 + x x_i) W / 4
    assert found.tipping_margin == pytest.approx(0.5)
    assert found.edge == ("n0", "n3")


def test_the_margin_is_that_of_the_line_of_action() -> None:
    """A load (h, 0, -w) at the height z meets the ground at x = z h / w."""
    found = judge(SQUARE, [1.0, 0.0, -4.0], [0.0, 0.0, 2.0])
    np.testing.assert_allclose(found.centre_of_pressure, [0.5, 0.0, 0.0], atol=1e-12)
    assert found.friction_needed == pytest.approx(0.25, rel=1e-9)
    assert found.is_standing


@pytest.mark.parametrize(
    ("feet", "load", "height", "verdict"),
    [
        (SQUARE, [3.0, 0.0, -4.0], 0.5, "slides"),
        (SQUARE, [1.5, 0.0, -4.0], 3.0, "tips"),
        (SQUARE, [0.0, 0.0, 1.0], 1.0, "lifts_off"),
        ([[0.0, 0.0, 1.0]], [0.0, 0.0, -1.0], 2.0, "no_foot"),
        ([[0.0, 0.0, 0.0]], [0.0, 0.0, -1.0], 2.0, "one_foot"),
        (SQUARE[:1] + SQUARE[2:3], [0.0, 0.0, -1.0], 2.0, "on_a_line"),
        ([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [0.0, 0.0, -1.0], 2.0, "on_a_line"),
    ],
)
def test_what_does_not_stand_is_named(
    feet: list[list[float]], load: list[float], height: float, verdict: str
) -> None:
    found = judge(feet, load, [0.0, 0.0, height])
    assert (found.verdict, found.is_standing) == (verdict, False)


def test_the_edge_about_which_it_tips() -> None:
    found = judge(SQUARE, [0.0, 0.0, -4.0], [0.0, 1.25, 2.0])
    assert (found.verdict, found.edge) == ("tips", ("n0", "n1"))
    assert found.tipping_margin == pytest.approx(-0.25)
    assert found.motion is not None
    assert found.motion[-1] @ [0.0, 0.0, -4.0] == pytest.approx(1.0)  # unit power
    assert np.all(found.motion[:4, 2] > -1e-12)


def test_two_feet_are_enough_in_the_plane() -> None:
    found = judge([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [0.0, 0.0, -2.0], [0.25, 0.0, 1.0], "xz")
    assert (found.verdict, found.edge) == ("stands", ("n1",))
    assert found.tipping_margin == pytest.approx(0.75)
    np.testing.assert_allclose(found.force[:, 2], [0.75, 1.25])


def test_anchors_are_refused() -> None:
    held = place(SQUARE, [0.0, 0.0, 1.0], anchored={4: "x"})
    with pytest.raises(FormulationError, match="anchors"):
        judge_stand(held, held.node_position, np.zeros((5, 3)))
