"""Equilibria with rigid bars: by hand, and as the limit of stiff ones."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import InvalidValueError
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, prism, spring
from tests.runtime.rigid_reference import RigidReference, stiffened

DOWN = (0.0, 0.0, -9.81)
FEET = {0: "xyz", 1: "xyz", 2: "xyz"}


def settle(structure: Structure, **options: Any) -> Equilibrium:
    return find_equilibrium(RigidReference(structure), **options)


def rod(i: int, j: int, position: Any, **more: Any) -> dict[str, Any]:
    """A rigid bar between two nodes as they are."""
    return bar(i, j, float(np.linalg.norm(np.subtract(position[i], position[j]))), 0.0, **more)


def pendulum(start: Any = (0, 0, -2), **more: Any) -> Structure:
    place = [[0, 0, 0], start]
    return make_structure(place, [rod(0, 1, place, **more)], anchored={0: "xyz"}, gravity=DOWN, mass=3.0)


@pytest.mark.parametrize(
    ("method", "start"),
    [
        ("newton", (0, 0, 2)),
        ("newton", (1.2, 1.6, 0)),
        ("relaxation", (1.2, 1.6, 0)),
        ("auto", (0, 0.1, -1.9)),
    ],
)
def test_a_bar_with_own_mass_hangs(method: Any, start: Any) -> None:
    """t = (M + m/2) g: half of the bar's weight acts at each of its ends; the stiffness is t / l."""
    structure = pendulum(start, mass=0.5)
    found = settle(structure, method=method)
    length = float(np.linalg.norm(start))
    force = (3.0 + 0.25) * 9.81
    np.testing.assert_allclose(found.node_position[1], [0, 0, -length], atol=1e-7)
    assert found.member_tension[0] == pytest.approx(force, rel=1e-12)
    assert found.smallest_eigenvalue == pytest.approx(force / length, rel=1e-12)
    assert found.neutral_motions == 0


def test_an_a_frame_carries_its_load_in_compression() -> None:
    """t = -P / (2 sin 45 deg) in the plane, where nothing can move."""
    place = [[0, 0, 0], [2, 0, 0], [1, 0, 1]]
    frame = make_structure(
        place, [rod(0, 2, place), rod(1, 2, place)], anchored={0: "xz", 1: "xz"}, axes="xz",
        load={2: (0, 0, -10)},
    )  # fmt: skip
    found = settle(frame)
    np.testing.assert_allclose(found.member_tension, -10 / np.sqrt(2), rtol=1e-14)
    assert found.displacement == 0.0
    assert found.smallest_eigenvalue == np.inf


def test_a_strut_between_two_springs_is_stable_by_their_stiffness_alone() -> None:
    """Upright strut of length 1 under P, held sideways by 2 k: eigenvalue 2 k - P / l, t = -P."""
    place = [[0, 0, 0], [0, 0, 1], [-1, 0, 1], [1, 0, 1]]
    members = [rod(0, 1, place), spring(1, 2, 1.0, 30.0), spring(1, 3, 1.0, 30.0)]
    strut = make_structure(
        place, members, anchored={0: "xz", 2: "xz", 3: "xz"}, axes="xz", load={1: (0, 0, -20)}
    )
    found = settle(strut)
    assert found.member_tension[0] == pytest.approx(-20.0, rel=1e-14)
    assert found.smallest_eigenvalue == pytest.approx(60.0 - 20.0, rel=1e-14)
    heavier = strut.with_changes(node_load=4 * strut.node_load)
    assert settle(heavier).displacement > 0.5


def chain() -> Structure:
    """Three bars in a row that meet (class 2), one with mass, two cables, from an upright start."""
    place = [[0, 0, 0], [0.1, 0, 1], [0.05, 0.02, 2], [0.3, 0, 3], [2, 0, 1]]
    members = [rod(0, 1, place), rod(1, 2, place, mass=0.5), rod(2, 3, place)]
    members += [cable(0, 3, 1.0, 40.0), cable(2, 4, 1.5, 25.0), cable(1, 4, 3.0, 25.0)]
    return make_structure(place, members, anchored={0: "xyz", 4: "xyz"}, gravity=DOWN)


def mixed() -> Structure:
    """A prism on the ground under loads, two of its bars rigid and one stiff, far from equilibrium."""
    start = prism(twist=110.0, anchored=FEET, gravity=DOWN, load={3: (5.0, 2.0, -8.0)}, mass=0.1)
    rigid = np.flatnonzero(start.is_bar)[:2]
    constant = start.spring_constant.copy()
    constant[rigid] = 0.0
    return start.with_changes(spring_constant=constant)


@pytest.mark.parametrize("make", [chain, mixed])
def test_rigid_bars_are_the_limit_of_stiff_ones(make: Any) -> None:
    structure = make()
    found = settle(structure)
    stiff = find_equilibrium(ReferenceModel(stiffened(structure, 1e9)))
    extent = float(np.ptp(found.node_position, axis=0).max())
    assert found.status == "converged"
    assert np.abs(found.node_position - stiff.node_position).max() < 1e-6 * extent
    assert np.abs(found.member_tension - stiff.member_tension).max() < 1e-6 * found.largest_force
    assert found.smallest_eigenvalue == pytest.approx(stiff.smallest_eigenvalue, rel=1e-5)
    rigid = structure.is_rigid
    assert np.abs(found.member_length - structure.rest_length)[rigid].max() < 1e-15 * 8
    assert found.residual < 1e-9 * found.largest_force


def test_a_free_prism_keeps_its_rigid_motions_and_its_self_stress() -> None:
    structure = prism()
    structure = structure.with_changes(
        spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant)
    )
    found = settle(structure)
    stiff = find_equilibrium(ReferenceModel(stiffened(structure, 1e9)))
    assert found.neutral_motions == stiff.neutral_motions == 6
    np.testing.assert_allclose(found.member_tension, stiff.member_tension, rtol=1e-6)
    np.testing.assert_allclose(found.member_length, stiff.member_length, rtol=1e-7)
    assert (found.member_tension[structure.is_bar] < 0).all()


def test_cables_may_go_slack_and_methods_agree() -> None:
    structure = chain()
    newton, relaxed = (settle(structure, method=method) for method in ("newton", "relaxation"))
    assert newton.member_tension[5] == 0.0
    assert np.abs(newton.node_position - relaxed.node_position).max() < 1e-6


def test_what_nothing_holds_has_no_equilibrium() -> None:
    place = [[0, 0, 0], [0, 0, -1]]
    falling = make_structure(place, [rod(0, 1, place)], gravity=DOWN)
    found = settle(falling, raise_on_failure=False)
    assert found.status == "no_equilibrium"


def test_bars_take_other_lengths_where_they_can_and_are_named_where_they_cannot() -> None:
    longer = settle(pendulum(), arguments={"rest_length": [2.5]})
    np.testing.assert_allclose(longer.node_position[1], [0, 0, -2.5], atol=1e-12)
    place = [[0, 0, 0], [2, 0, 0], [1, 0, 1]]
    members = [rod(0, 2, place), rod(1, 2, place)]
    frame = make_structure(place, members, anchored={0: "xz", 1: "xz"}, axes="xz", load={2: (0, 0, -10)})
    with pytest.raises(InvalidValueError, match="has the lengths of the rigid bars"):
        settle(frame, arguments={"rest_length": [0.5, 0.5]})
