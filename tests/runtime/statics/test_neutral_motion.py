"""Motions that cost nothing: their names, and how far nodes moved apart from them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tests.reference import ReferenceModel
from tests.runtime.build import bar, make_structure, prism, spring

TABLE = dict.fromkeys(range(3), "z")


def settle_turned(angle: float, anchored: dict[int, str]) -> tuple[Equilibrium, Equilibrium]:
    """Return the equilibrium of a prism, and that found from the same shape turned and shifted by hand."""
    structure = prism(anchored=anchored)
    settled = find_equilibrium(ReferenceModel(structure))
    turned = settled.node_position @ Rotation.from_euler("z", angle, degrees=True).as_matrix().T + [
        3.0,
        -2.0,
        0.0,
    ]
    moved = structure.with_changes(node_position=turned)
    model = ReferenceModel(moved)
    again = find_equilibrium(model)
    assert again.motions is not None
    distance = again.motions.distance(settled.node_position, again.node_position)
    assert distance.max() < 1e-7
    return settled, again


@pytest.mark.thorough
@pytest.mark.parametrize("angle", [25.0, 120.0, 179.0])
def test_a_prism_on_a_smooth_table_may_slide_and_spin(angle: float) -> None:
    settled, _ = settle_turned(angle, TABLE)
    assert settled.neutral_motion_names == ("slide along x", "slide along y", "turn about z")


def test_free_spin_is_no_change_of_shape() -> None:
    structure = prism(anchored=TABLE)
    rest = find_equilibrium(ReferenceModel(structure))
    # One bar grows by 1 %: the true change is small, and free motion may come on top of it.
    changed = structure.with_changes(
        rest_length=structure.rest_length * np.where(np.arange(12) == 0, 1.01, 1.0)
    )
    start = rest.node_position @ Rotation.from_euler("z", 40, degrees=True).as_matrix().T
    found = find_equilibrium(ReferenceModel(changed.with_changes(node_position=rest.node_position)))
    assert found.motions is not None
    far = np.linalg.norm(found.node_position - start, axis=1).max()
    apart = found.motions.distance(start, found.node_position).max()
    assert apart == pytest.approx(found.change, rel=1e-4)
    assert far > 5 * apart


def test_names_follow_the_supports() -> None:
    free = find_equilibrium(ReferenceModel(prism()))
    assert free.neutral_motion_names == tuple(
        f"{word} {axis}" for word in ("slide along", "turn about") for axis in "xyz"
    )
    pinned = find_equilibrium(ReferenceModel(prism(anchored={0: "xyz"})))
    assert pinned.neutral_motion_names == ("turn about x", "turn about y", "turn about z")
    hinged = find_equilibrium(ReferenceModel(prism(anchored={0: "xyz", 1: "xyz"})))
    (name,) = hinged.neutral_motion_names
    assert name.startswith("turn about")
    held = find_equilibrium(ReferenceModel(prism(anchored=dict.fromkeys(range(3), "xyz"))))
    assert held.neutral_motion_names == ()
    assert held.change == held.displacement


def test_a_loose_end_is_a_mechanism() -> None:
    # A node between two bars in line, without stress: it moves across them at no cost.
    place = [[-1, 0, 0], [1, 0, 0], [0, 0, 0]]
    line = make_structure(place, [bar(0, 2, 1.0), spring(1, 2, 1.0)], anchored={0: "xyz", 1: "xyz"})
    found = find_equilibrium(ReferenceModel(line))
    assert found.neutral_motion_names == ("mechanism", "mechanism")


def test_forces_out_of_balance_are_no_mechanism() -> None:
    """A stiffness below what the forces may change it by is stiffness still, in the report of a failure."""
    structure = prism(anchored=TABLE)
    load = np.zeros((6, 3))
    load[3] = [200.0, 0.0, -1000.0]
    free = ReferenceModel(structure.with_changes(node_load=load))
    lost = find_equilibrium(free, raise_on_failure=False)
    assert lost.status == "no_equilibrium"
    assert lost.neutral_motion_names == ("slide along x", "slide along y", "turn about z")
    assert len(lost.neutral_motion_names) == lost.neutral_motions
    held = prism(anchored=dict.fromkeys(range(3), "xyz")).with_changes(node_load=load)
    ended = find_equilibrium(ReferenceModel(held), max_iterations=1, raise_on_failure=False)
    assert ended.status == "iteration_limit"
    assert ended.neutral_motion_names == ()
