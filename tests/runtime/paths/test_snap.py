"""Did it snap? A shallow truss below and beyond its limit load, of springs and of rigid bars."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.paths.find_equilibrium import Snap, find_load_snap, find_snap
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.reference import ReferenceModel
from tests.runtime.build import bar, cable, make_structure, spring
from tests.runtime.rigid_reference import RigidReference


def shallow() -> ReferenceModel:
    """Two bars of 1000 N/m from feet 2 m apart to an apex 0.2 m up."""
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, 0.2]]
    members = [bar(i, 2, float(np.hypot(1, 0.2)), 1000.0) for i in (0, 1)]
    return ReferenceModel(make_structure(place, members, anchored={0: "xz", 1: "xz"}, axes="xz"))


def toggle() -> RigidReference:
    """Two rigid bars of 1 m at 30 degrees, one foot on a spring of 50 N/m."""
    c = float(np.cos(np.radians(30)))
    place = [[0, 0, 0], [2 * c, 0, 0], [c, 0, 0.5], [2 * c + 1, 0, 0]]
    members = [bar(0, 2, 1.0, 0.0), bar(2, 1, 1.0, 0.0), spring(1, 3, 1.0, 50.0)]
    return RigidReference(make_structure(place, members, anchored={0: "xz", 1: "z", 3: "xz"}, axes="xz"))


def tell(model: Any, force: float) -> Snap:
    load = np.zeros_like(model.nominal("node_load"))
    load[2, 1] = -force
    found = find_equilibrium(model, arguments={"node_load": load})
    assert found.status == "converged"
    return find_snap(model, found, 0 * load, load)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("make", "limit"),
    [
        # P = 2 k y (l0 / sqrt(1 + y^2) - 1), most where (1 + y^2)^(3/2) = l0
        (shallow, lambda y: 2000 * y * (np.hypot(1, 0.2) / np.sqrt(1 + y * y) - 1)),
        (toggle, None),
    ],
)
def test_beyond_the_limit_load_it_has_snapped(make: Any, limit: Any) -> None:
    if limit is None:
        c0 = np.cos(np.radians(30))
        c = c0 ** (1 / 3)
        most = 200 * (c - c0) * np.sqrt(1 - c * c) / c
    else:
        most = limit(np.sqrt(np.hypot(1, 0.2) ** (2 / 3) - 1))
    below, beyond = tell(make(), 0.9 * most), tell(make(), 1.5 * most)
    assert below == Snap(False, None)
    assert beyond.snapped
    assert beyond.limit_load_factor == pytest.approx(1 / 1.5, rel=1e-8)


def settle(structure: Any) -> tuple[Any, Snap]:
    model = ReferenceModel(structure)
    loads = {name: model.nominal(name) for name in ("node_load", "gravity")}
    found = find_equilibrium(model)
    return found, find_load_snap(model, found, loads)


def truss(weight: float, rest: float = float(np.hypot(1, 0.2)), rise: float = 0.2, force: float = 0.0) -> Any:
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, rise]]
    members = [bar(i, 2, rest, 1000.0) for i in (0, 1)]
    held = {0: "xz", 1: "xz"}
    return make_structure(
        place, members, anchored=held, axes="xz", gravity=(0, 0, -weight), load={2: (0, 0, -force)}
    )


@pytest.mark.thorough
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_weight_and_loads_of_the_scene_are_followed_as_one(share: float) -> None:
    rise = np.sqrt(np.hypot(1, 0.2) ** (2 / 3) - 1)
    most = 2000 * rise * (np.hypot(1, 0.2) / np.sqrt(1 + rise * rise) - 1)
    _, below = settle(truss(0.9 * share * most, force=0.9 * (1 - share) * most))
    found, beyond = settle(truss(1.5 * share * most, force=1.5 * (1 - share) * most))
    assert below.snapped is False
    assert beyond.snapped
    assert beyond.limit_load_factor == pytest.approx(1 / 1.5, rel=1e-8)
    assert any("moves" in text for text in found.warnings)


def test_an_unstable_start_is_told_apart_from_a_stable_one() -> None:
    found, snap = settle(truss(0.0, rest=1.05, rise=0.0))
    assert found.is_start_unstable
    assert "unstable" in found.warnings[0]
    assert (snap.snapped, snap.limit_load_factor) == (True, 0.0)
    stretched, kept = settle(truss(0.0, rest=0.95, rise=0.0))
    assert (stretched.is_start_unstable, kept.snapped) == (False, False)
    assert not any("unstable" in text or "moves" in text for text in stretched.warnings)


def test_prestress_that_drives_the_shape_through_is_a_snap() -> None:
    # Bars too short for the far side of the straight line: they pull the apex down to it and no further.
    pulled, smooth = settle(truss(0.0, rest=1.0, rise=0.1))
    assert (smooth.snapped, pulled.is_found) == (False, True)
    # A spring from the apex to far below pulls it through the line of the feet, with no load at all.
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, 0.2], [0, 0, -2]]
    members = [*(bar(i, 2, float(np.hypot(1, 0.2)), 1000.0) for i in (0, 1)), spring(2, 3, 1.0, 10.0)]
    held = {0: "xz", 1: "xz", 3: "xz"}
    found, through = settle(make_structure(place, members, anchored=held, axes="xz"))
    assert found.node_position[2, 2] < 0
    assert through.snapped
    assert through.limit_prestress_factor is not None
    assert 0 < through.limit_prestress_factor < 1


@pytest.mark.parametrize("rigid", [False, True])
def test_a_column_on_a_hinge_falls_at_any_load(rigid: bool) -> None:
    member = bar(0, 1, 1.0, 0.0 if rigid else 1e4)
    place = [[0, 0, 0], [0, 0, 1]]
    structure = make_structure(place, [member], anchored={0: "xz"}, axes="xz", gravity=(0, 0, -9.81))
    model = (RigidReference if rigid else ReferenceModel)(structure)
    found = find_equilibrium(model)
    loads = {name: model.nominal(name) for name in ("node_load", "gravity")}
    snap = find_load_snap(model, found, loads)
    assert (snap.snapped, snap.limit_load_factor) == (True, 0.0)
    assert found.change == pytest.approx(2.0, rel=1e-2)
    assert any("200%" in text for text in found.warnings)


def test_a_taut_line_that_only_sags_has_not_snapped() -> None:
    found, snap = settle(truss(5.0, rest=1.0, rise=0.0))
    assert found.node_position[2, 2] < -0.1
    assert snap.snapped is False


def test_without_a_load_nothing_snaps_and_without_a_path_nothing_is_known() -> None:
    model = shallow()
    load = np.zeros_like(model.nominal("node_load"))
    found = find_equilibrium(model)
    assert find_snap(model, found, load, load) == Snap(False)
    free = ReferenceModel(make_structure([[0, 0, 0], [1, 0, 0]], [spring(0, 1, 1.0)]))
    pulled = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    settled = find_equilibrium(free, arguments={"node_load": pulled})
    # Unloaded, it turns in every direction at no cost, also against the load.
    assert find_snap(free, settled, 0 * pulled, pulled).snapped is not True


@pytest.mark.thorough
def test_prestress_that_drives_a_free_shape_through_is_a_snap() -> None:
    # The truss of the test above on a triangle of stiff bars instead of anchors.
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, 0.2], [0, 0, -2]]
    frame = [
        bar(i, j, float(np.hypot(x, z)), 1e6) for i, j, x, z in ((0, 1, 2, 0), (0, 3, 1, 2), (1, 3, 1, 2))
    ]
    members = [*frame, *(bar(i, 2, float(np.hypot(1, 0.2)), 1000.0) for i in (0, 1)), spring(2, 3, 1.0, 10.0)]
    found, through = settle(make_structure(place, members, axes="xz"))
    assert np.ptp(found.node_position[:, 2]) < 2.0
    assert through.snapped
    assert through.limit_prestress_factor is not None
    assert 0 < through.limit_prestress_factor < 1


def free_robot(draw: int) -> Structure:
    """Three crossed bars in a net of twelve cables, free to move, their rest lengths not in balance."""
    rng = np.random.default_rng(draw)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    place = np.array([[-4, 1, 0], [4, 1, 0], [0, -4, 1], [0, 4, 1], [1, 0, -4], [1, 0, 4]]) / 10 @ turn
    rods = [bar(i, i + 1, 0.81, 1e5) for i in (0, 2, 4)]
    net = [(i, j) for i in range(6) for j in range(i + 1, 6) if i // 2 != j // 2]
    lengths = [float(np.linalg.norm(place[i] - place[j])) for i, j in net]
    cables = [
        spring(i, j, length * 0.97 * (1 + 0.01 * rng.standard_normal()), 5000.0)
        for (i, j), length in zip(net, lengths, strict=True)
    ]
    return make_structure(place.tolist(), [*rods, *cables])


@pytest.mark.parametrize("draw", [1, *thorough(0, 2, 3, 4, 5)])
def test_a_free_structure_that_settles_has_not_snapped(draw: int) -> None:
    # Loads that hold the given shape give rotations a stiffness of either sign; at the end they have none.
    found, kept = settle(free_robot(draw))
    assert (found.status, kept.snapped) == ("converged", False)


def tightened_prism(by: float, tight: tuple[int, ...], *, free: bool) -> Structure:
    """Three bars and cables at their rest lengths, without prestress; some cables are shorter by `by` [m]."""
    angle = 2 * np.pi * np.arange(3) / 3
    ring = [np.stack([np.cos(a), np.sin(a)], axis=1) for a in (angle, angle + np.radians(150))]
    place = np.vstack([np.column_stack([xy, np.full(3, z)]) for xy, z in zip(ring, (0.0, 1.5), strict=True)])
    ends = [(i, 3 + i) for i in range(3)]
    ends += [(3 + i, 3 + (i + 1) % 3) for i in range(3)] + [((i + 1) % 3, 3 + i) for i in range(3)]
    ends += [(i, (i + 1) % 3) for i in range(3)] if free else []
    length = [float(np.linalg.norm(place[i] - place[j])) for i, j in ends]
    members = [
        bar(i, j, size, 1e7 / size) if k < 3 else cable(i, j, size - by * (k in tight), 1e5 / size)
        for k, ((i, j), size) in enumerate(zip(ends, length, strict=True))
    ]
    return make_structure(place, members, anchored={} if free else dict.fromkeys(range(3), "xyz"))


def ask_with_cables(structure: Structure) -> Snap:
    model = ReferenceModel(structure)
    cables = [name for name, rod in zip(structure.member_name, structure.is_bar, strict=True) if not rod]
    found = find_equilibrium(model)
    return find_load_snap(model, found, {"node_load": model.nominal("node_load")}, cables=cables)


@pytest.mark.parametrize(
    ("by", "tight", "free"),
    [
        (1e-3, (3,), False),
        (0.02, (3,), False),
        (0.1, (3,), True),
        *thorough((1e-6, (3,), False), (0.3, (4, 7), False), (1e-4, (3, 10), True), (0.02, (6,), True)),
    ],
)
def test_cables_tightened_from_no_prestress_do_not_snap(
    by: float, tight: tuple[int, ...], free: bool
) -> None:
    # With the loads that hold the start all eigenvalues are positive from the first small part let go on.
    assert ask_with_cables(tightened_prism(by, tight, free=free)) == Snap(False)


@pytest.mark.parametrize("digits", [3, 7, 9])
def test_prestress_of_a_few_digits_does_not_snap(digits: int) -> None:
    # Two stays pull a mast down with 50 N; the rounding of their tensions is all that is out of balance.
    place = [[-1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1]]
    stay, diagonal = float(f"{50 / np.sqrt(2):.{digits}g}"), float(np.sqrt(2))
    rest = [1 / (1 - 50 / 1.1e7), *(2 * [diagonal / (1 + stay / 2.4e5)])]
    members = [
        bar(1, 3, rest[0], 1.1e7 / rest[0]),
        *(cable(i, 3, rest[1], 2.4e5 / rest[1]) for i in (0, 2)),
    ]
    structure = make_structure(place, members, anchored={0: "xz", 1: "xz", 2: "xz"}, axes="xz")
    assert ask_with_cables(structure) == Snap(False)
