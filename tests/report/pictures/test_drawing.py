import numpy as np
import pytest

from tensegrity_codegen.report.pictures.canvas import new_figure
from tensegrity_codegen.report.pictures.drawing import (
    StructureDrawing,
    find_slack,
    find_tension_limit,
    find_thickness,
)
from tensegrity_codegen.report.pictures.marks import group_anchors
from tensegrity_codegen.report.pictures.view import AZIMUTHS, _perspective, find_box, fit_view
from tests.report.samples import frame, thread
from tests.runtime.build import bar, cable, make_structure, prism


def make_drawing(structure, limit=None):
    axes = new_figure(3.0, 3.0).add_subplot()
    view = fit_view(structure, find_box(structure.node_position, structure.axes), structure.node_position)
    return StructureDrawing(axes, structure, view, tension_limit=limit), axes


def test_cables_are_slack_that_are_shorter_than_their_rest_length():
    structure = prism()
    rest = structure.rest_length.copy()
    rest[[0, 1]] *= 1.5
    longer = structure.with_changes(rest_length=rest)
    assert structure.is_bar[[0, 1]].tolist() == [True, False]
    assert np.flatnonzero(find_slack(longer, longer.node_position, None)).tolist() == [1]


def test_cables_without_tension_are_slack_unless_they_are_just_taut():
    structure = prism().with_changes(rest_length=prism().member_length())
    none = np.zeros(structure.n_members)
    assert not find_slack(structure, structure.node_position, none).any()
    assert find_slack(structure, 1.1 * structure.node_position, none).sum() == 9


def test_limit_is_the_largest_magnitude():
    assert find_tension_limit(np.array([[1.0, -7.0], [3.0, 2.0]])) == 7.0
    assert find_tension_limit(np.zeros(3)) is None
    assert find_tension_limit(None) is None


def test_tension_colours_are_symmetrical_about_zero():
    drawing, _ = make_drawing(prism(), limit=20.0)
    assert (drawing.mappable.norm.vmin, drawing.mappable.norm.vmax) == (-20.0, 20.0)
    push, none, pull = drawing.mappable.to_rgba([-20.0, 0.0, 20.0])
    assert push[2] > push[0]
    assert np.ptp(none[:3]) < 0.06
    assert pull[0] > pull[2]


def test_bars_are_thicker_than_cables_and_nearer_members_come_later():
    structure = prism()
    drawing, axes = make_drawing(structure)
    drawing.show(structure.node_position)
    lines = axes.collections[0]
    widths = np.array(lines.get_linewidths()).reshape(-1, 3)[:, 1]
    assert sorted(widths)[-3] > 2 * sorted(widths)[-4]
    middles = structure.node_position[structure.connectivity].mean(axis=1)
    _, depth = drawing.view.project(middles)
    drawn = np.array([path.vertices.mean(axis=0) for path in lines.get_paths()[1::3]])
    ends, _ = drawing.view.project(structure.node_position[structure.connectivity])
    order = [int(np.linalg.norm(ends.mean(axis=1) - spot, axis=1).argmin()) for spot in drawn]
    assert sorted(order) == list(range(structure.n_members))
    assert np.all(np.diff(depth[order]) > -0.02 * np.ptp(depth))


def test_slack_cables_are_dashed():
    structure = frame()
    drawing, axes = make_drawing(structure, limit=5.0)
    tension = np.array([-5.0, -5.0, 5.0, 0.0, 5.0, 5.0])
    drawing.show(structure.node_position, tension)
    styles = axes.collections[0].get_linestyles()
    dashed = [k for k, (_, dashes) in enumerate(styles) if dashes is not None]
    assert drawing.slack.tolist() == [False, False, False, True, False, False]
    assert len(dashed) == 2
    assert dashed[0] // 3 == dashed[1] // 3


def test_full_and_partial_anchors_look_different_and_hanging_ones_point_down():
    drawing, _ = make_drawing(frame())
    (full, full_marks), (partial, partial_marks) = drawing._anchors
    assert full.tolist() == [True, False, False, False]
    assert partial.tolist() == [False, True, False, False]
    assert full_marks.get_markerfacecolor() != partial_marks.get_markerfacecolor()
    standing = full_marks.get_marker().vertices
    ((_, hanging_marks),) = make_drawing(thread())[0]._anchors
    hanging = hanging_marks.get_marker().vertices
    assert standing[:, 1].min() < 0 <= hanging[:, 1].min()


@pytest.mark.parametrize("tension", [None, np.linspace(-3.0, 3.0, 12)])
def test_showing_does_not_change_its_arguments(tension):
    structure = prism()
    drawing, _ = make_drawing(structure, limit=3.0)
    position, kept = structure.node_position.copy(), None if tension is None else tension.copy()
    drawing.show(position, tension)
    assert np.array_equal(position, structure.node_position)
    assert kept is None or np.array_equal(kept, tension)


def test_an_anchor_stands_upright_unless_all_its_members_lead_down():
    place = [(0, 0, 0), (3.0, 0, 1.1), (3.0, 0, -0.9), (6.0, 1.0, 0)]
    members = [cable(0, 1, 2.9), cable(0, 2, 2.9), bar(1, 2, 2.0), cable(1, 3, 2.9), cable(2, 3, 2.9)]
    ring = make_structure(place, members, anchored={0: "xyz", 3: "xyz"})
    for eye in AZIMUTHS:
        view = _perspective(find_box(ring.node_position, ring.axes), np.radians(eye))
        ((chosen, _, hangs),) = group_anchors(ring, view)
        assert chosen.tolist() == [True, False, False, True]
        assert not hangs


def test_no_line_is_thinner_than_two_pixels_and_classes_have_their_own_widths():
    structure = prism()
    axes = new_figure(3.0, 3.0).add_subplot()
    view = fit_view(structure, find_box(structure.node_position, structure.axes), structure.node_position)
    drawing = StructureDrawing(axes, structure, view, line_scale=0.2)
    drawing.show(structure.node_position)
    widths = np.reshape(axes.collections[0].get_linewidths(), (-1, 3))[:, 1] * axes.figure.dpi / 72
    assert widths.min() >= 2.0 - 1e-9
    area = np.where(structure.is_bar, 1.0, np.linspace(1.0, 2.0, structure.n_members))
    wide = find_thickness(structure.with_changes(radius=0.01 * area))
    assert np.all(np.diff(wide[~structure.is_bar]) > 0)
    assert np.all(wide[structure.is_bar] == 1.0)
