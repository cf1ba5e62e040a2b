"""Load paths with rigid bars: a toggle by hand, a prism against single equilibria."""

import numpy as np
import pytest

from tensegrity_codegen.runtime.paths.continuation import follow_path
from tensegrity_codegen.runtime.paths.model_path import BarPath, ModelPath, build_path
from tensegrity_codegen.runtime.paths.watches import watch_slack
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import FormulationError
from tests.runtime.build import bar, make_structure, prism, spring
from tests.runtime.rigid_reference import RigidReference


def test_a_toggle_of_two_rigid_bars_snaps_where_its_cosine_is_the_cube_root() -> None:
    """P = 4 k l (cos a - cos a0) tan a has its maximum at cos^3 a = cos a0; the foot slides on a spring."""
    a0, k = np.radians(30.0), 50.0
    c0 = np.cos(a0)
    place = [[0, 0, 0], [c0, 0, np.sin(a0)], [2 * c0, 0, 0], [2 * c0 + 1, 0, 0]]
    members = [bar(0, 1, 1.0, 0.0), bar(1, 2, 1.0, 0.0), spring(2, 3, 1.0, k)]
    toggle = make_structure(place, members, anchored={0: "xz", 2: "z", 3: "xz"}, axes="xz")
    pattern = np.zeros((4, 2))
    pattern[1, 1] = -1.0
    path = build_path(RigidReference(toggle), pattern)
    assert isinstance(path, BarPath)
    found = follow_path(path, path.model.nominal("coordinate").ravel(), most=50.0)
    limit = found.find_events("limit")[0]
    c = c0 ** (1 / 3)
    assert limit.load_factor == pytest.approx(4 * k * (c - c0) * np.sqrt(1 - c * c) / c, rel=1e-9)
    assert found.smallest_eigenvalue[0] > 0
    for q, load in zip(found.coordinate[::5], found.load_factor[::5], strict=True):
        tension = path.compute("member_tension", q, load)
        sine = q[1]  # height of the apex
        # The apex is held by both bars: 2 |t| sin a = P.
        assert -2 * tension[0] * sine == pytest.approx(load, abs=1e-7)
        assert np.abs(path.compute("member_extension", q, load)[:2]).max() < 1e-10


@pytest.mark.thorough
def test_a_prism_goes_slack_on_the_way_and_its_points_are_equilibria() -> None:
    structure = prism(anchored={0: "xyz", 1: "xyz", 2: "xyz"})
    structure = structure.with_changes(
        spring_constant=np.where(structure.is_bar, 0.0, structure.spring_constant)
    )
    model = RigidReference(structure)
    pattern = np.zeros((6, 3))
    pattern[3] = (0.0, 0.0, -1.0)
    path = build_path(model, pattern)
    start = find_equilibrium(model).coordinate
    cables = [n for n, is_bar in zip(structure.member_name, structure.is_bar, strict=True) if not is_bar]
    found = follow_path(path, start, most=35.0, watches=[watch_slack(path, cables)])
    assert found.status == "completed"
    assert found.find_events("slack")
    for at in (len(found.load_factor) // 2, -1):
        load = {"node_load": found.load_factor[at] * pattern}
        settled = find_equilibrium(model, coordinate=found.coordinate[at], arguments=load, tolerance=1e-11)
        assert np.abs(settled.coordinate - found.coordinate[at]).max() < 1e-8
        assert settled.smallest_eigenvalue == pytest.approx(found.smallest_eigenvalue[at], rel=1e-6)


def test_a_path_without_rigid_bars_refuses_them() -> None:
    structure = make_structure([[0, 0, 0], [0, 0, -1]], [bar(0, 1, 1.0, 0.0)], anchored={0: "xyz"})
    with pytest.raises(FormulationError, match="build_path"):
        ModelPath(RigidReference(structure), np.ones((2, 3)))
