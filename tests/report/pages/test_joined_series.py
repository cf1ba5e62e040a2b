"""Lines that coincide are one line with all their names; looks of many lines."""

import numpy as np
import pytest

from tensegrity_codegen.report.pages.diagram import Diagram, Series
from tensegrity_codegen.report.pages.page import (
    choose_looks,
    join_names,
    join_series,
    joined_figure,
)

X = np.linspace(0.0, 1.0, 5)


def line(name: str, y: object, **more: object) -> Series:
    return Series(name, X, y, **more)  # type: ignore[arg-type]


def test_lines_that_coincide_within_the_width_of_a_line_are_one() -> None:
    far, near = line("far", 100 * X), line("near", 100 * X + 0.3)
    joined = join_series([far, near, line("other", 100 * X + 1.0), line("last", 100 * X)])
    assert [item.name for item in joined] == ["far, near, last", "other"]
    assert np.array_equal(joined[0].y, far.y)


def test_gaps_places_and_kinds_keep_lines_apart() -> None:
    gap = np.where(X > 0.9, np.nan, X)
    shifted = Series("shifted", X + 1.0, X)
    series = [line("a", X), line("gap", gap), shifted, line("points", X, style="points")]
    assert [item.name for item in join_series(series)] == ["a", "gap", "shifted", "points"]
    assert [item.name for item in join_series([line("g", gap), line("h", gap)])] == ["g, h"]
    constant = [line("a", np.zeros(5)), line("b", np.zeros(5)), line("c", np.full(5, np.nan))]
    assert [item.name for item in join_series(constant)] == ["a, b", "c"]
    assert join_series([]) == ()


def test_many_names_are_counted() -> None:
    assert join_names(["v1", "v2", "v3"]) == "v1, v2, v3"
    assert join_names([f"v{k}" for k in range(1, 7)]) == "v1, v2 and 4 more"
    assert join_names(["", "v1"]) == "v1"


def test_looks_are_told_apart() -> None:
    looks = choose_looks([f"a{k}" for k in range(20)] + ["a0"])
    assert len(looks) == 20
    assert len(set(looks.values())) == 20
    assert looks["a0"] == (0, "line")


def test_the_data_of_a_figure_has_every_line() -> None:
    pytest.importorskip("matplotlib")
    figure = joined_figure("f", Diagram("x", "y [N]", [line("a", X), line("b", X)]), "caption", "alt")
    assert [item["name"] for item in figure.data["series"]] == ["a", "b"]
    assert "a, b" in figure.picture.svg
