"""Did it snap? A shallow truss below and beyond its limit load, of springs and of rigid bars."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.runtime.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.snap import Snap, find_snap
from tests.reference import ReferenceModel
from tests.runtime.build import bar, make_structure, spring
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
