import numpy as np
import pytest

from tensegrity_codegen.report.pictures.view import PlanarView, find_box, fit_view, nice_step
from tests.report.samples import frame, thread
from tests.runtime.build import prism


@pytest.mark.parametrize(
    ("span", "step"), [(1.0, 0.2), (4.9, 1.0), (1.02, 0.2), (2.0, 0.5), (30.0, 10.0), (3e-4, 1e-4)]
)
def test_steps_are_one_two_or_five_times_a_power_of_ten(span, step):
    assert nice_step(span) == pytest.approx(step, rel=1e-12)


def test_ground_of_a_box_is_whole_cells_around_the_points():
    points = np.array([[-0.93, 0.0, 0.1], [0.87, 0.6, 1.4]])
    box = find_box(points, (0, 1, 2))
    cells = (box.high - box.low)[:2] / box.step[:2]
    assert np.allclose(cells, np.round(cells))
    assert np.all(box.low <= points.min(axis=0) + 0.1 * box.step)
    assert np.all(box.high >= points.max(axis=0) - 0.1 * box.step)
    assert box.high[2] == 1.4


def test_planar_box_is_that_of_the_points():
    box = find_box(frame().node_position, (0, 2))
    assert box.low[[0, 2]].tolist() == [0.0, 0.0]
    assert box.high[[0, 2]].tolist() == [2.0, 1.0]
    assert box.ticks(0)[[0, -1]].tolist() == [0.0, 2.0]


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1e6, -3.0, 2.0)])
def test_a_single_point_has_a_box_with_room(place):
    box = find_box([place], (0, 1, 2))
    assert np.all(box.high > box.low)
    assert np.all(np.isfinite(box.corners()))


@pytest.mark.parametrize("thin", [(0, 1), (0, 2), (1, 2), (2,), (0,)])
@pytest.mark.parametrize("shift", [0.0, 0.499, -0.7])
def test_a_thin_scene_has_a_box_with_room(thin, shift):
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]) * 4000.0
    points[:, thin] = np.array([shift, shift + 1.0])[:, None]
    box = find_box(points, (0, 1, 2))
    assert np.all(box.high > box.low)
    assert all(len(box.ticks(axis)) for axis in range(3))
    assert all(len(box.ticks(axis)) > 1 for axis in (0, 1))


def test_perspective_magnifies_what_is_nearer_and_keeps_up_up():
    structure = prism()
    box = find_box(structure.node_position, structure.axes)
    view = fit_view(structure, box, structure.node_position)
    center = (box.low + box.high) / 2
    place, depth = view.project([center, center + np.array([0, 0, 0.1])])
    assert np.allclose(place[0], 0.0)
    assert depth[0] == pytest.approx(0.0, abs=1e-12)
    assert abs(place[1, 0]) < 1e-12
    assert place[1, 1] > 0.09
    near, far = view.magnification([0.5, -0.5])
    assert near > 1 > far > 0.8


def test_a_small_step_sideways_keeps_its_length_at_the_centre():
    structure = prism()
    box = find_box(structure.node_position, structure.axes)
    view = fit_view(structure, box, structure.node_position)
    center, right = (box.low + box.high) / 2, view.rotation[0]
    place, _ = view.project([center, center + 0.01 * right])
    assert np.linalg.norm(place[1] - place[0]) == pytest.approx(0.01, rel=1e-9)


def test_planar_scenes_are_seen_along_their_dropped_axis():
    structure = frame()
    view = fit_view(structure, find_box(structure.node_position, (0, 2)), structure.node_position)
    place, depth = view.project(structure.node_position)
    assert np.array_equal(place, structure.node_position[:, [0, 2]])
    assert not depth.any()


@pytest.mark.parametrize(("axes", "shown"), [("x", (0, 2)), ("y", (1, 2)), ("z", (0, 2))])
def test_scenes_on_a_line_get_a_second_axis(axes, shown):
    structure = thread().with_changes(axes=("xyz".index(axes),))
    view = fit_view(structure, find_box(structure.node_position, structure.axes), structure.node_position)
    assert view == PlanarView(shown)
