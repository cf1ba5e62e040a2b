"""Loads and reactions as arrows: places, one scale, unknown forces."""

import numpy as np
import pytest
from matplotlib.text import Text

from tensegrity_codegen import draw
from tensegrity_codegen.report.pictures.marks import describe_arrows, lay_out_arrows
from tests.runtime.build import bar, cable, make_structure


def gallows(load: float = 6.0, **more):
    """A cable from a held node down to a weight, and a bar that stands on another one."""
    place = [(0, 0, 2.0), (0, 0, 1.0), (3.0, 0, 0), (3.0, 0, 1.0)]
    members = [cable(0, 1, 0.9), bar(2, 3, 1.0)]
    held = {0: "xyz", 2: "xyz"}
    loads = {1: (0, 0, -load), 3: (0, 0, -load / 2)}
    return make_structure(place, members, anchored=held, load=loads, **more)


def lay_out(structure, tension):
    position = structure.node_position[None]
    return lay_out_arrows(structure, position, np.array([tension]), structure.node_load[None])


@pytest.mark.parametrize("shift", [0.0, 1000.0])
def test_arrows_push_into_members_and_pull_at_loose_ends(shift):
    structure = gallows()
    structure = structure.with_changes(node_position=structure.node_position + shift)
    load, reaction = lay_out(structure, [6.0, -3.0])
    z = structure.node_position[:, 2]
    # The weight hangs: its arrow starts below the node; the bar is pushed from above.
    assert load.tail[0, 0, 2] < z[1]
    assert load.tip[0, 1, 2] > z[3]
    for item in (load, reaction):
        force = item.scale * (item.tip - item.tail)[0]
        assert np.abs(np.abs(force[:, 2]) - [6.0, 3.0]).max() < 1e-6
    assert np.all((reaction.tip - reaction.tail)[0, :, 2] > 0)  # both supports hold against the loads
    assert reaction.largest == pytest.approx(6.0)
    texts = [text for _, text in describe_arrows([load, reaction])]
    assert texts[:2] == ["load (largest 6 N)", "reaction (largest 6 N)"]
    assert texts[2] == f"arrow of 0.1 m: {0.1 * load.scale:.3g} N"


@pytest.mark.parametrize("factor", [1e-6, 1.0, 3.7, 1e7])
def test_scale_is_round_and_the_longest_arrow_suits_the_structure(factor):
    structure = gallows(6.0 * factor)
    load, _ = lay_out(structure, [6.0 * factor, -3.0 * factor])
    digit = load.scale / 10 ** np.floor(np.log10(load.scale) + 1e-9)
    assert min(abs(digit - wanted) for wanted in (1, 2, 5, 10)) < 1e-9
    longest = np.linalg.norm(load.tip - load.tail, axis=2).max()
    assert 0.09 * load.size < longest <= 0.25 * load.size * (1 + 1e-9)


def test_reactions_at_members_of_unknown_tension_are_unknown_and_not_zero():
    load, reaction = lay_out(gallows(), [6.0, np.nan])
    assert np.isfinite(reaction.tail[0, 0]).all()
    assert np.isnan(reaction.tail[0, 1]).all()
    assert "1 unknown" in describe_arrows([load, reaction])[1][1]
    joints = lay_out_arrows(
        gallows(),
        gallows().node_position[None],
        np.array([[6.0, -3.0]]),
        gallows().node_load[None],
        np.array([0]),
    )[1]
    assert np.isnan(joints.tail[0, 0]).all()
    assert np.isfinite(joints.tail[0, 1]).all()


def test_without_tensions_there_are_no_reactions_and_without_forces_no_arrows():
    structure = gallows(0.0)
    nothing = lay_out_arrows(structure, structure.node_position[None], None, structure.node_load[None])
    assert nothing == []
    zero = lay_out(structure, [0.0, 0.0])
    assert describe_arrows(zero) == []
    assert all(np.isnan(item.tail).all() for item in zero)


def test_loads_that_change_keep_one_scale():
    structure = gallows()
    factor = np.array([0.0, 2.0, 4.0])[:, None, None]
    position = np.repeat(structure.node_position[None], 3, axis=0)
    load, _ = lay_out_arrows(structure, position, np.zeros((3, 2)), factor * structure.node_load)
    length = np.linalg.norm(load.tip - load.tail, axis=2)
    assert np.isnan(length[0]).all()
    np.testing.assert_allclose(length[2, 0], 2 * length[1, 0])
    assert load.largest == pytest.approx(24.0)


def test_loads_that_are_small_beside_reactions_are_seen_and_the_legend_says_so():
    load, reaction = lay_out(gallows(0.1), [100.0, -3.0])
    length = np.linalg.norm(load.tip - load.tail, axis=2)[0]
    np.testing.assert_allclose(length, 0.05 * load.size)
    held = np.linalg.norm(reaction.tip - reaction.tail, axis=2)[0]
    np.testing.assert_allclose(held, np.array([100.0, 3.0]) / load.scale)
    assert (load.shortest, reaction.shortest) == (pytest.approx(0.05 * load.size), 0.0)
    text = describe_arrows([load, reaction])[-1][1]
    assert text == f"arrow of 0.1 m: {0.1 * load.scale:.3g} N; of loads at least {load.shortest:.2g} m"
    push = gallows(0.1).with_changes(node_load=1e-6 * gallows(0.1).node_load)
    assert np.isnan(lay_out(push, [100.0, -3.0])[0].tail).all()  # rounding stays unseen


def test_a_reaction_keeps_clear_of_the_mark_of_its_support():
    structure = gallows()
    _, reaction = lay_out(structure, [6.0, -3.0])
    z = structure.node_position[[0, 2], 2]
    assert reaction.tail[0, 0, 2] > z[0] + 0.03 * reaction.size  # hangs: its mark is above it
    assert reaction.tip[0, 1, 2] < z[1] - 0.03 * reaction.size


def test_forces_of_a_picture_have_one_unit():
    structure = gallows(7000.0)
    arrows = lay_out(structure, [83500.0, -3500.0])
    texts = [text for _, text in describe_arrows(arrows)]
    assert texts[0] == "load (largest 7 kN)"
    assert all(text.partition(";")[0].rstrip(")").endswith(" kN") for text in texts)
    stiff = structure.with_changes(spring_constant=np.full(2, 1e6))
    words = {item.get_text() for item in draw(stiff).findobj(Text)}
    assert "member tension [kN]" in {text.partition("  (")[0] for text in words}
