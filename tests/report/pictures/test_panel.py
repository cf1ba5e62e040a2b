"""Axes, views and colours that samples of a picture share; axes that follow."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from tensegrity_codegen import simulate
from tensegrity_codegen.report.pictures.animate import write_animation
from tensegrity_codegen.report.pictures.canvas import SOIL, new_figure
from tensegrity_codegen.report.pictures.panel import Panel, set_up
from tensegrity_codegen.report.pictures.plots import plot_trajectory
from tensegrity_codegen.report.pictures.shown import compute_colors, show_motion, show_structure
from tensegrity_codegen.report.pictures.view import PictureChoices, read_view
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.ground_cases import make_prism
from tests.models import simulator
from tests.report.pictures.test_animate import read_gif
from tests.report.samples import draw_structure, frame, make_trajectory, plot_structure, png_size
from tests.runtime.build import prism
from tests.runtime.integrate.test_ground import rotate


def travel(structure, distance):
    """A motion that ends `distance` sizes away along the first axis."""
    motion = make_trajectory(structure, 5)
    step = np.linspace(0.0, distance, 5)[:, None] * np.ptp(structure.node_position, axis=0).max()
    position = motion.node_position.copy()
    position[:, :, structure.axes[0]] += step
    return make_trajectory(structure, 5, node_position=position)


@pytest.mark.parametrize("view", ["30,-20", *thorough("iso", None, "front", "side", "top", "0,90", "-90,0")])
def test_every_view_shows_all_nodes_with_the_size_asked_for(view, tmp_path):
    choices = PictureChoices(view=read_view(view), size=(640, 480), labels=("nodes",))
    path = plot_structure(
        prism(), tmp_path / "a.png", member_tension=prism().static_tension(), choices=choices
    )
    assert png_size(path) == (640, 480)


@pytest.mark.parametrize(("view", "axes"), [("front", (0, 2)), ("side", (1, 2)), ("top", (0, 1))])
def test_views_along_an_axis_show_lengths_as_they_are(view, axes):
    structure = prism()
    setting = set_up(
        show_structure(structure, structure.node_position, None), PictureChoices(view=read_view(view))
    )
    place, depth = setting.view.project(structure.node_position)
    np.testing.assert_array_equal(place, structure.node_position[:, axes])
    # The eye is in front of the picture: right x up points to it.
    right, up = np.eye(3)[list(axes)]
    np.testing.assert_allclose(depth, structure.node_position @ np.cross(right, up))


def test_an_isometric_view_has_one_scale_on_all_axes():
    structure = prism()
    setting = set_up(
        show_structure(structure, structure.node_position, None), PictureChoices(view=read_view("iso"))
    )
    place, _ = setting.view.project(np.vstack([np.zeros(3), np.eye(3)]))
    lengths = np.linalg.norm(place[1:] - place[0], axis=1)
    np.testing.assert_allclose(lengths, np.sqrt(2 / 3), rtol=1e-4)


def test_a_planar_scene_is_seen_along_its_normal_alone():
    draw_structure(frame(), choices=PictureChoices(view=read_view("front")))
    for other in ("top", "iso", "-90,0"):
        with pytest.raises(InvalidValueError, match="in its plane") as caught:
            draw_structure(frame(), choices=PictureChoices(view=read_view(other)))
        assert caught.value.allowed == "front"


@pytest.mark.parametrize("structure", [prism(), frame()])
def test_axes_that_follow_keep_their_size_and_tell_where_they_are(structure):
    motion = travel(structure, 20.0)
    follow = set_up(show_motion(structure, motion), PictureChoices(follow=True))
    still = set_up(show_motion(structure, motion), PictureChoices())
    axis = structure.axes[0]
    assert (
        np.ptp([follow.box.low[axis], follow.box.high[axis]]) < 0.25 * (still.box.high - still.box.low)[axis]
    )
    np.testing.assert_allclose(
        follow.step, motion.node_position.mean(axis=1) - motion.node_position[0].mean(axis=0)
    )
    panel = Panel(new_figure(4.0, 4.0).add_subplot(), follow, (3.0, 3.0))
    seen = []
    for sample in (0, 4):
        panel.show(sample)
        place, _ = panel.drawing.view.project(motion.node_position[sample])
        low, high = panel.axes.transData.inverted().transform(panel.axes.get_window_extent().corners())[
            [0, 3]
        ]
        assert np.all(place > low - 0.3 * (high - low))
        assert np.all(place < high + 0.3 * (high - low))
        texts = [item.get_text() for item in panel.axes.texts]
        seen.append(texts or [item.get_text() for item in panel.axes.get_xticklabels()])
    assert seen[0] != seen[1]


@pytest.mark.parametrize("structure", [frame(), *thorough(prism())])
def test_a_film_that_follows_moves_the_numbers_of_its_axes(structure, tmp_path):
    motion = travel(structure, 5.0)
    path = write_animation(
        structure, motion, tmp_path / "a.gif", fps=2, choices=PictureChoices(follow=True, size=(300, 260))
    )
    frames, _ = read_gif(path)
    assert len(frames) == 3
    assert frames[0].shape == (260, 300, 3)
    # Below the structure, where numbers stand, the pictures differ; of axes that stand still they do not.
    rows = slice(int(0.55 * 260), int(0.85 * 260))
    assert np.abs(frames[2][rows] - frames[0][rows]).max() > 60


@pytest.mark.thorough
@pytest.mark.parametrize("structure", [frame(), prism()])
def test_a_page_of_a_motion_follows(structure, tmp_path):
    choices = PictureChoices(follow=True, size=(900, 500))
    plot_trajectory(structure, travel(structure, 5.0), tmp_path / "a.png", choices=choices)
    assert png_size(tmp_path / "a.png") == (900, 500)


def test_colours_are_tensions_force_densities_or_stresses():
    structure = prism().with_changes(radius=np.where(prism().is_bar, 0.01, 0.0))
    tension = np.linspace(-3.0, 8.0, 12)
    shown = show_structure(structure, structure.node_position, tension)
    np.testing.assert_allclose(compute_colors(shown, "force_density")[0], tension / structure.member_length())
    stress = compute_colors(shown, "stress")[0]
    np.testing.assert_allclose(stress[structure.is_bar], tension[structure.is_bar] / (np.pi * 1e-4) / 1e6)
    assert np.isnan(stress[~structure.is_bar]).all()
    assert compute_colors(shown, "kind") is None
    with pytest.raises(InvalidValueError, match="no member has a radius"):
        compute_colors(show_structure(prism(), structure.node_position, tension), "stress")
    from matplotlib.text import Text

    figure = draw_structure(structure, member_tension=tension, choices=PictureChoices(color="stress"))
    words = " ".join(item.get_text() for item in figure.findobj(Text))
    assert "stress [MPa]" in words
    assert "stress unknown" in words


def make_drop():
    prism_ = make_prism(rotate((0.0, 0.3, 0.2)))
    model = simulator(prism_, "rk54", more=("contact_force", "penetration"), formulation="rigid_bar")
    return prism_, simulate(model, 0.35, samples=8, method="rk54")


def test_the_plane_of_a_ground_is_drawn_below_the_structure():
    prism_ = make_prism()
    for choices in (PictureChoices(), PictureChoices(view=read_view("front"))):
        setting = set_up(show_structure(prism_, prism_.node_position, None), choices)
        assert setting.box.low[2] <= 0.0 < prism_.node_position[:, 2].min()
        panel = Panel(new_figure(4.0, 4.0).add_subplot(), setting, (3.0, 3.0))
        (plane,) = [item for item in panel.axes.patches if item.get_facecolor()[:3] == to_rgb(SOIL)]
        below = prism_.node_position * [1.0, 1.0, 0.0]
        place, _ = setting.view.project(below)
        assert plane.get_path().contains_points(place, radius=1e-6).all() or choices.view is not None
    far = prism_.with_changes(node_position=prism_.node_position + np.array([0.0, 0.0, 50.0]))
    assert set_up(show_structure(far, far.node_position, None), PictureChoices()).box.low[2] > 40.0


def test_forces_of_the_ground_are_arrows_at_the_feet():
    prism_, motion = make_drop()
    assert motion.contacts is not None
    arrows = {item.name: item for item in set_up(show_motion(prism_, motion), PictureChoices()).arrows}
    ground, pressed = arrows["ground"], np.linalg.norm(motion.contacts.force, axis=2) > 1e-3
    np.testing.assert_array_equal(~np.isnan(ground.tip[..., 0]), pressed)
    assert pressed.any()
    length = (ground.tip - ground.tail) * ground.scale
    np.testing.assert_allclose(length[pressed], motion.contacts.force[pressed])
    still = set_up(show_structure(prism_, prism_.node_position, None), PictureChoices())
    assert "ground" not in {item.name for item in still.arrows}
