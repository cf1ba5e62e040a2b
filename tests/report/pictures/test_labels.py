"""Names on pictures: where they cover least, and what is left out."""

import itertools

import numpy as np
import pytest

from tensegrity_codegen.report.pictures.marks import MAX_NAMES, choose_names
from tensegrity_codegen.report.pictures.view import PictureChoices
from tests.cases import thorough
from tests.report.samples import draw_structure, frame
from tests.runtime.build import prism


def boxes(figure):
    """Return the boxes of the names that a figure writes, by name."""
    from matplotlib.text import Annotation

    renderer = figure.canvas.get_renderer()
    figure.canvas.draw()
    found = [item for item in figure.findobj(Annotation) if item.get_text()[:1] in "ne" and item.get_text()]
    return {item.get_text(): item.get_window_extent(renderer) for item in found}


@pytest.mark.parametrize(
    ("structure", "shift"), [(prism(), 0.0), *thorough((frame(), 0.0), (frame(), 1000.0), (prism(), 1000.0))]
)
def test_names_of_nodes_do_not_overlap(structure, shift):
    axes = np.isin(np.arange(3), structure.axes)
    moved = structure.with_changes(node_position=structure.node_position + shift * axes)
    found = boxes(draw_structure(moved, choices=PictureChoices(labels=("nodes",))))
    assert set(found) == set(structure.node_name)
    for one, other in itertools.combinations(found.values(), 2):
        assert not one.overlaps(other)


def test_names_of_nodes_stand_near_their_nodes():
    from matplotlib.text import Annotation

    figure = draw_structure(prism(), choices=PictureChoices(labels=("nodes", "members")))
    found = boxes(figure)
    assert set(found) == {*prism().node_name, *prism().member_name}
    for item in figure.findobj(Annotation):
        if item.get_text() in prism().node_name:
            spot = figure.axes[0].transData.transform(item.xy)
            box = found[item.get_text()]
            gap = np.maximum(np.maximum([box.x0, box.y0] - spot, spot - [box.x1, box.y1]), 0.0)
            assert np.linalg.norm(gap) < 20 * figure.dpi / 72


def test_too_many_names_are_left_out_and_stated():
    many = prism(sides=40)
    written, left = choose_names(many, ("nodes", "members"))
    assert written == ("nodes",)
    assert [(item.kind, item.count, item.limit) for item in left] == [("members", 160, MAX_NAMES["members"])]
    assert "160" in left[0].describe()
    assert str(MAX_NAMES["members"]) in left[0].describe()
    assert choose_names(prism(), ("nodes", "members")) == (("nodes", "members"), [])
