import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from PIL import Image

from tensegrity_codegen.report.pictures import canvas, plots
from tensegrity_codegen.report.pictures.plots import plot_trajectory
from tensegrity_codegen.system.errors import InvalidValueError, MissingExtraError, NonFiniteError, OutputError
from tests.cases import thorough
from tests.report.samples import frame, make_trajectory, plot_structure, png_size, thread
from tests.runtime.build import prism


def pixels(path):
    with Image.open(path) as image:
        return np.array(image.convert("RGB"), dtype=int)


def ink(path):
    """Return how many pixels are not white."""
    return int((pixels(path).min(axis=-1) < 250).sum())


@pytest.fixture
def figures(monkeypatch):
    """Keep the figures that are saved."""
    kept = []

    def keep(figure, path, overwrite):
        kept.append(figure)
        canvas.save_figure(figure, path, overwrite=overwrite)

    monkeypatch.setattr(plots, "save_figure", keep)
    return kept


def check_nothing_is_clipped(figure):
    """All panels with their numbers and names, all texts and legends lie inside the figure."""
    renderer = figure.canvas.get_renderer()
    width, height = figure.bbox.width, figure.bbox.height
    parts = [*figure.axes, *figure.texts, *figure.findobj(matplotlib.legend.Legend)]
    assert len(parts) >= 4
    for part in parts:
        extent = part.get_tightbbox(renderer)
        inside = extent.x0 >= -1 and extent.y0 >= -1 and extent.x1 <= width + 1 and extent.y1 <= height + 1
        assert inside, (part, extent, width, height)


@pytest.mark.parametrize(
    ("structure", "with_tension"),
    [
        (prism(), True),
        (thread("z"), False),
        *thorough(*((item, with_tension) for item in (frame(), thread("xyz"), prism(sides=40))
                    for with_tension in (False, True))),
    ],
)  # fmt: skip
def test_picture_has_the_size_of_its_figure_and_no_clipped_text(tmp_path, figures, structure, with_tension):
    tension = structure.static_tension() if with_tension else None
    path = plot_structure(structure, tmp_path / "a.png", member_tension=tension, labels=True)
    (figure,) = figures
    assert png_size(path) == tuple(int(side) for side in np.round(figure.get_size_inches() * figure.dpi, 6))
    assert ink(path) > 3000
    check_nothing_is_clipped(figure)


def test_every_axis_has_the_same_scale(tmp_path, figures):
    plot_structure(frame(), tmp_path / "a.png")
    transform = figures[0].axes[0].transData.transform
    origin, right, up = transform((0, 0)), transform((1, 0)), transform((0, 1))
    assert right[0] - origin[0] == pytest.approx(up[1] - origin[1], rel=1e-9)


def test_the_same_place_gives_the_same_picture_and_another_place_another(tmp_path):
    first = plot_structure(frame(), tmp_path / "a.png").read_bytes()
    assert plot_structure(frame(), tmp_path / "b.png").read_bytes() == first
    moved = frame().node_position + np.array([[0, 0, 0], [0, 0, 0], [0.3, 0, 0.2], [0, 0, 0]])
    assert plot_structure(frame(), tmp_path / "c.png", node_position=moved).read_bytes() != first


def test_tensions_colour_the_members(tmp_path):
    structure = prism()
    pull, push = np.full(12, 5.0), np.full(12, -5.0)
    red = pixels(plot_structure(structure, tmp_path / "pull.png", member_tension=pull))
    blue = pixels(plot_structure(structure, tmp_path / "push.png", member_tension=push))

    def count(picture, more, less):
        return int(
            (
                picture[:, : 2 * picture.shape[1] // 3, more]
                > picture[..., less][:, : 2 * picture.shape[1] // 3] + 60
            ).sum()
        )

    assert count(red, 0, 2) > 2000 > 50 > count(red, 2, 0)
    assert count(blue, 2, 0) > 2000


def test_labels_write_the_names_and_the_title_replaces_the_name(tmp_path, figures):
    plot_structure(frame(), tmp_path / "a.png", labels=True, title="50 $ frame")
    words = {item.get_text() for item in figures[0].findobj(matplotlib.text.Text)}
    assert {"n0", "n3", "e0", "e5", "50 $ frame", "4 nodes, 2 bars, 4 cables"} <= words
    assert "small" not in words
    assert {"bar", "cable", "anchor", "anchor on some axes"} <= words
    assert "slack cable" not in words


@pytest.mark.parametrize("suffix", [".svg", *thorough(".pdf", ".PNG")])
def test_kind_follows_the_suffix(tmp_path, suffix):
    path = plot_structure(frame(), tmp_path / f"a{suffix}")
    start = {".svg": b"<?xml", ".pdf": b"%PDF", ".PNG": b"\x89PNG"}[suffix]
    assert path.read_bytes().startswith(start)


def test_settings_of_the_caller_stay_as_they_are(tmp_path):
    before = dict(matplotlib.rcParams)
    plot_structure(prism(), tmp_path / "a.png")
    assert dict(matplotlib.rcParams) == before
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


@pytest.mark.parametrize("draw", [plot_structure, lambda s, p: plot_trajectory(s, make_trajectory(s), p)])
def test_unknown_suffix_missing_folder_and_missing_package(tmp_path, monkeypatch, draw):
    with pytest.raises(InvalidValueError, match=r"\.png, \.svg, \.pdf"):
        draw(prism(), tmp_path / "a.jpg")
    with pytest.raises(OutputError, match="missing"):
        draw(prism(), tmp_path / "missing" / "a.png")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"\[plot\]"):
        draw(prism(), tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_infinities_are_refused(tmp_path):
    structure = prism()
    bad = structure.node_position.copy()
    bad[2, 1] = np.inf
    with pytest.raises(NonFiniteError, match="node_position"):
        plot_structure(structure, tmp_path / "a.png", node_position=bad)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("structure", [prism(), *thorough(thread("xyz"), frame(), prism(sides=12))])
def test_trajectory_page_shows_the_shapes_and_three_diagrams(tmp_path, figures, structure):
    path = plot_trajectory(structure, make_trajectory(structure, 50), tmp_path / "a.png")
    (figure,) = figures
    assert png_size(path) == tuple(int(side) for side in np.round(figure.get_size_inches() * figure.dpi, 6))
    names = {axes.get_ylabel() for axes in figure.axes}
    assert {"energy [J]", "member tension [N]", "energy change [1]"} <= names
    titles = [axes.get_title() for axes in figure.axes]
    assert {"t = 0 s", "t = 1 s"} <= set(titles)
    check_nothing_is_clipped(figure)


def test_one_sample_with_a_bad_status_is_shown_and_its_status_stands_in_the_heading(tmp_path, figures):
    run = make_trajectory(prism(), 1, status="unstable", message="take a smaller step")
    before = dict(matplotlib.rcParams)
    assert ink(plot_trajectory(prism(), run, tmp_path / "a.png")) > 10_000
    assert dict(matplotlib.rcParams) == before
    words = [item.get_text() for item in figures[0].texts]
    assert any(word.startswith("unstable: take a smaller step") for word in words)


def test_trajectory_of_another_structure_is_refused(tmp_path):
    with pytest.raises(InvalidValueError, match="another structure"):
        plot_trajectory(frame(), make_trajectory(prism()), tmp_path / "a.png")


@pytest.mark.parametrize("stretch", [(1, 1, 1e4), *thorough(((1, 1e4, 1),), ((1e4, 1e4, 1),))], ids=str)
def test_a_mast_or_a_sheet_is_drawn_without_a_warning(stretch, tmp_path):
    structure = prism()
    slender = structure.with_changes(node_position=structure.node_position * stretch)
    plot_structure(slender, tmp_path / "slender.png")
    assert ink(tmp_path / "slender.png") > 100


@pytest.mark.parametrize("name", ["node_position", "node_velocity", "member_tension", "time", "total_energy"])
def test_numbers_too_large_for_a_picture_are_named(tmp_path, name):
    run = make_trajectory(prism())
    large = getattr(run, name).copy()
    large.flat[-1] = 1e300
    with pytest.raises(NonFiniteError, match=f"{name} is too large for a picture in sample"):
        plot_trajectory(prism(), replace(run, **{name: large}), tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_a_load_too_large_for_a_picture_is_named(tmp_path):
    with pytest.raises(NonFiniteError, match="node_load is too large"):
        plot_structure(prism(), tmp_path / "a.png", load=np.full((6, 3), 1e300))
    assert not (tmp_path / "a.png").exists()
