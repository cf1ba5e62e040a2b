"""What a scene does not need is listed, with what it saves; what it needs is not."""

import functools
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.left_out import FEATURES, UNWANTED
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.tables.manifest import LeftOut
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.subjects import all_parameters
from tests.runtime.build import cable, make_structure, spring

pytestmark = pytest.mark.optimised

WANTED = ModelRequest(("member_tension", "acceleration"))


def left_out(structure: Structure, request: ModelRequest = WANTED) -> dict[str, LeftOut]:
    return {row.what: row for row in emit(structure, request).manifest.left_out}


def tower_of(stages: int) -> Structure:
    """A chain of tetrahedra, bars and cables, its first nodes anchored."""
    count = 3 * (stages + 1)
    turn = np.arange(count) % 3 * 2 * np.pi / 3
    position = np.column_stack([np.cos(turn), np.sin(turn), np.arange(count) // 3])
    members = [spring(3 * s + i, 3 * s + 3 + (i + 1) % 3, 1.5) for s in range(stages) for i in range(3)]
    members += [cable(3 * s + i, 3 * s + 3 + i, 0.9) for s in range(stages) for i in range(3)]
    members += [cable(3 * s + i, 3 * s + (i + 1) % 3, 1.6) for s in range(stages) for i in range(3)]
    return make_structure(position.tolist(), members, anchored=dict.fromkeys(range(3), "xyz"), mass=0.4)


def triangle(**more: Any) -> Structure:
    members = [spring(0, 1, 0.9), spring(1, 2, 1.1), spring(2, 0, 1.0)]
    return make_structure([[0, 0, 0], [1, 0, 0], [0.5, 0, 0.8]], members, axes="xz", **more)


def spatial(**more: Any) -> Structure:
    return triangle(**more).with_changes(axes=(0, 1, 2))


def damped(structure: Structure) -> Structure:
    return structure.with_changes(damping=np.full(structure.n_members, 0.1))


def slack(structure: Structure) -> Structure:
    return structure.with_changes(tension_only=np.ones(structure.n_members, dtype=bool))


@functools.cache
def plain() -> dict[str, LeftOut]:
    return left_out(triangle())


# feature: a structure with it, where the triangle is without; the reverse for anchors
CASES = {
    "gravity": triangle(gravity=(0, 0, -9.81)),
    "damping": damped(triangle()),
    "loads": triangle(load={1: (1, 0, 0)}),
    "slack branch": slack(triangle()),
    "anchored coordinates": triangle(anchored={0: "xz"}),
    "axes": spatial(),
}


@pytest.mark.parametrize("what", CASES)
def test_a_row_appears_exactly_where_the_feature_is_absent(what: str) -> None:
    rows = [plain(), left_out(CASES[what])]
    without, with_it = reversed(rows) if what == "anchored coordinates" else rows
    row = without[what]
    assert row.operations > 0
    assert row.object_bytes is None
    assert not row.measured
    assert row.why
    assert what not in with_it


def test_every_feature_has_a_case() -> None:
    assert {feature.what for feature in FEATURES} == {*CASES, "run-time parameters"}


@pytest.mark.parametrize(
    ("what", "parameters"),
    [("gravity", {"gravity": ()}), ("damping", {"damping": (0,)}), ("loads", {"node_load": (1,)})],
)
def test_what_is_changeable_is_not_left_out(what: str, parameters: dict[str, tuple[int, ...]]) -> None:
    assert what not in left_out(triangle(), ModelRequest(WANTED.quantities, parameters=parameters))


def test_constants_that_could_have_been_arguments_are_listed() -> None:
    row = plain()["run-time parameters"]
    # rest lengths and spring constants in both functions, masses in one
    assert row.arguments == 5
    whole = ModelRequest(WANTED.quantities, parameters=all_parameters(triangle()))
    assert "run-time parameters" not in left_out(triangle(), whole)


def test_functions_that_nobody_wants_are_listed_by_name() -> None:
    row = plain()[UNWANTED]
    assert "tangent_stiffness" in row.why
    assert "member_tension" not in row.why
    assert "support_reaction" not in row.why  # nothing is anchored, so there is none
    assert row.functions == row.why.count(",") + 1


def test_a_row_counts_the_arguments_too() -> None:
    row = plain()["damping"]
    assert row.arguments == 4  # velocity and damping, in two functions
    assert row.functions == 0


@pytest.mark.parametrize("quantity", ["support_reaction", "parameter_jacobian"])
def test_quantities_that_end_with_the_anchors_do_not_stand_in_the_way(quantity: str) -> None:
    structure = triangle(anchored={0: "xz"})
    request = ModelRequest(("acceleration", quantity), parameters={"anchor_position": (0,)})
    assert left_out(structure, request)["anchored coordinates"].operations > 0


def test_an_anchored_node_without_mass_does_not_stand_in_the_way() -> None:
    rows = left_out(triangle(anchored={0: "xz"}, mass=[0.0, 1.0, 1.0]))
    assert rows["axes"].operations > 0
    assert rows["anchored coordinates"].operations > 0


def test_bars_alone_have_no_slack_branch_to_leave_out() -> None:
    structure = triangle().with_changes(is_bar=np.ones(3, dtype=bool))
    assert "slack branch" not in left_out(structure)


def test_measured_bytes_are_those_of_the_compiled_variants() -> None:
    seen: list[int] = []

    def size(files: dict[str, str]) -> int:
        seen.append(len(files["small.c"]))
        return seen[-1]

    manifest = emit(triangle(), WANTED, size).manifest
    assert all(row.measured for row in manifest.left_out)
    assert [row.object_bytes for row in manifest.left_out] == [length - seen[0] for length in seen[1:]]
    assert all(row.object_bytes is not None and row.object_bytes > 0 for row in manifest.left_out)


def test_a_structure_that_has_everything_leaves_out_only_what_nobody_wants() -> None:
    members = [cable(0, 1, 0.9, damping=0.1), cable(1, 2, 1.1), spring(2, 0, 1.0)]
    structure = make_structure(
        [[0, 0, 0], [1, 0, 0], [0.5, 0, 0.8]], members, gravity=(0, 0, -9.81), load={1: (1, 0, 0)}
    )
    request = ModelRequest(WANTED.quantities, parameters=all_parameters(structure))
    assert set(left_out(structure, request)) == {UNWANTED}
