"""Numbers along axes: enough of them on short logarithmic axes, powers of ten without mathematical fonts."""

import numpy as np
import pytest

from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.diagram import format_tick

pytest.importorskip("matplotlib")


def texts_of(values: object, *, log: bool) -> tuple[list[str], str]:
    """Return the visible texts along the vertical axis, and the common power of ten."""
    from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram

    y = np.asarray(values, dtype=float)
    figure = draw_diagram(Diagram("x", "y", [Series("", np.arange(len(y)), y)], log_y=log))
    figure.canvas.draw()
    axes = figure.axes[0]
    low, high = axes.get_ylim()
    ticks = zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)
    shown = [label.get_text() for place, label in ticks if low <= place <= high]
    return shown, axes.yaxis.get_offset_text().get_text()


@pytest.mark.parametrize("values", [(0.6, 0.9), (0.5, 3.0), (0.2, 30.0), (1e-6, 1e3), (2e-9, 3e-9)])
def test_a_logarithmic_axis_has_at_least_two_numbers(values: tuple[float, float]) -> None:
    shown, _ = texts_of(values, log=True)
    assert len([text for text in shown if text]) >= 2, shown


def test_whole_numbers_along_an_axis_stay_whole() -> None:
    from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram

    figure = draw_diagram(Diagram("number", "y", [Series("", np.arange(1, 16), np.ones(15), "points")]))
    places = figure.axes[0].get_xticks()
    assert np.array_equal(places, np.round(places))


def test_small_and_large_numbers_have_a_common_power() -> None:
    _, power = texts_of([1e-11, 3e-11], log=False)
    assert power.startswith("× 10⁻¹¹")
    assert texts_of([0.001, 0.002], log=False)[1] == ""
    shown, power = texts_of([1000.0001, 1000.0002], log=False)
    assert power == ""
    assert len(set(shown)) == len(shown) > 1


def test_ticks_in_short() -> None:
    assert [format_tick(value) for value in (1e-3, 0.5, 2e-7)] == ["10⁻³", "0.5", "2 × 10⁻⁷"]


def test_short_numbers_of_sentences() -> None:
    values = (2.45928, 0.0, -0.5232, 1234.4, 99_999.0, 2.5e7, 4.79e-5, 999.7, None, float("nan"))
    assert [format_short(value) for value in values] == [
        *("2.46", "0", "−0.523", "1,234", "99,999", "2.5 × 10⁷", "4.79 × 10⁻⁵", "1,000", "–", "–"),
    ]
    assert format_short(165.004, 4) == "165"


def test_texts_of_vertical_marks_stand_above_the_axes_in_rows() -> None:
    from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram

    marks = ((0.5, "end of motion"), (0.4, "gust"))
    figure = draw_diagram(Diagram("x", "y", [Series("", [0.0, 3.0], [1.0, 2.0])], vertical=marks))
    figure.draw_without_rendering()
    (axes,) = figure.axes
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 2
    assert min(box.y0 for box in boxes) >= axes.get_window_extent().y1
    assert max(box.y1 for box in boxes) <= figure.bbox.y1
    assert not boxes[0].overlaps(boxes[1])
