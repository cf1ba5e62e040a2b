"""The standard of pages: layouts of tables, colours, looks of methods, and that the checks find faults."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.live.live_page import live_folder
from tensegrity_codegen.report.pages.diagram import (
    METHOD_STYLES,
    Diagram,
    choose_styles,
    draw_diagram,
    find_style,
    method_series,
)
from tensegrity_codegen.report.pages.page import Chapter, Page, Section, render_page
from tensegrity_codegen.report.pages.page_table import (
    HINT_WIDTHS,
    Column,
    ColumnText,
    Table,
    choose_layout,
    number_cell,
    text_cell,
)
from tensegrity_codegen.report.pages.picture import THEME, draw_picture, find_dark_color, use_variables
from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.system.provenance import describe_provenance
from tests.report.driver import running_browser
from tests.report.page_checks import check_in_browser, in_browser, probe_page
from tests.report.page_html import check_static
from tests.report.sample_page import make_section

Float = NDArray[np.float64]
# Colour vision, linear RGB: G. M. Machado, M. M. Oliveira and L. A. F. Fernandes (2009), severity 1.
VISION = {
    "all": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(color: str) -> Float:
    values = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    lights = sorted(float(TO_XYZ[1] @ linear(color)) for color in (one, other))
    return (lights[1] + 0.05) / (lights[0] + 0.05)


def lab(rgb: Float) -> Float:
    x = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / np.array([0.9505, 1.0, 1.089])
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


# --- colours ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_are_seen_on_the_page(scheme: str) -> None:
    colors = {color.name: getattr(color, scheme) for color in THEME}
    for name in ("ink", "muted", "good", "bad", "new"):
        for below in ("paper", "card"):
            assert contrast(colors[name], colors[below]) >= 4.5, (name, below)
    lines = [value for name, value in colors.items() if name.startswith("line-")]
    assert min(contrast(line, colors["paper"]) for line in lines) >= 3.0
    for graphic in ("bar", "unknown") if scheme == "dark" else ("bar",):  # light: unknown has an outline
        assert contrast(colors[graphic], colors["paper"]) >= 3.0, graphic
    for matrix in VISION.values():
        seen = [lab(matrix @ linear(line)) for line in lines]
        assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)) > 20.0


def test_colours_of_scales_turn_dark_with_the_page() -> None:
    assert find_dark_color("#ffffff") == "#141414"
    assert find_dark_color("#000000") == "#ebebeb"
    dark = find_dark_color("#07305f")  # of strong compression
    assert contrast(dark, "#14181d") > 5.0
    r, g, b = linear(dark)
    assert b > g > r  # still blue
    style = use_variables('<path id="#07305f" style="fill: #07305f; stroke: #1f2933"/>')
    assert style == f'<path id="#07305f" style="fill: light-dark(#07305f, {dark}); stroke: var(--ink)"/>'


def test_live_pages_have_the_same_colours() -> None:
    style = (live_folder() / "style.css").read_text(encoding="utf-8")
    script = (live_folder() / "palette.js").read_text(encoding="utf-8")
    for color in THEME:
        if color.name in ("ink", "muted", "grid", "paper", "card"):
            assert f"--{color.name}: {color.light};" in style
            assert f"--{color.name}: {color.dark};" in style
    for scheme in ("light", "dark"):
        lines = [getattr(color, scheme) for color in THEME if color.name.startswith("line-")]
        assert f"{scheme}: {json.dumps(lines)}," in script


# --- methods ---------------------------------------------------------------------------------------


def test_every_method_of_the_package_has_a_look_of_its_own() -> None:
    looks = [METHOD_STYLES[name.replace("scipy_", "scipy ")] for name in METHODS]
    assert len(set(looks)) == len(METHODS)
    ours = [METHOD_STYLES[name] for name, method in METHODS.items() if method.kind != "scipy"]
    assert len({look.color for look in ours}) == len(ours) - 1 == 6  # both implicit methods share one


def test_a_method_looks_the_same_under_all_its_names() -> None:
    assert find_style("rk853") == find_style("node_position, rk853 by 1e-6").__class__(0, "line", "o")
    assert find_style("scipy_radau") == find_style("SciPy Radau") != find_style("radau")
    assert find_style("CVODES (CasADi)") != find_style("CasADi C (gcc)")
    assert find_style("table (gcc native)").color == find_style("table (clang native)").color
    assert find_style("some new peer") == find_style("some new peer")


def test_no_two_methods_of_one_diagram_look_the_same() -> None:
    names = [f"table, build {k}" for k in range(12)]
    chosen = choose_styles(names)
    assert len(set(chosen.values())) == 12
    assert {look.color for look in chosen.values()} == {find_style("table").color}
    series = [method_series(name, [0, 1], [k, k], chosen[name]) for k, name in enumerate(names)]
    svg = draw_picture(draw_diagram(Diagram("x", "y", series)), "looks").svg
    assert "var(--line-2)" in svg
    assert "var(--line-0)" not in svg


# --- tables ----------------------------------------------------------------------------------------


def test_wide_tables_become_cards_on_a_phone_and_narrow_ones_stay() -> None:
    narrow = [ColumnText(False, ("what", ""), ["a"]), ColumnText(True, ("value", "N"), ["1.25"])]
    assert choose_layout(narrow) == "table"
    wide = [ColumnText(True, (f"column {k}", "m"), ["1.234 × 10⁻⁵"]) for k in range(5)]
    assert choose_layout(wide).split()[1] == "cards"
    assert int(choose_layout(wide).split()[2].removeprefix("hint-")) in HINT_WIDTHS
    unbroken = [ColumnText(False, ("message", ""), ["x" * 60])]
    assert "cards" in choose_layout(unbroken)
    assert choose_layout([ColumnText(False, ("message", ""), ["words " * 60])]) == "table"


def make_table(count: int, columns: int = 3, **more: object) -> Table:
    heads = (Column("name", numeric=False), *(Column(f"value {k}", "N m") for k in range(columns - 1)))
    rows = tuple(
        (text_cell(f"row {n}"), *(number_cell(n * 1e3**k, ".6g") for k in range(columns - 1)))
        for n in range(count)
    )
    return Table("All of it.", heads, rows, **more)  # type: ignore[arg-type]


def test_long_tables_show_some_rows_and_fold_all() -> None:
    table = make_table(118, head=(100, 3), head_note="the 2 largest")
    text = render_page(make_page(table))
    before, _, folded = text.partition("<details>")
    assert "All 118 rows" in folded
    assert ">row 100<" in before
    assert ">row 5<" not in before
    assert folded.count("<tr>") == 119
    assert make_table(14).is_long is False
    assert make_table(15).head_text == "the first 8"
    assert make_table(15, head=(1, 2)).head_text == "2 of 15 rows"
    assert make_table(1).row_count == "1 row"


def make_page(*tables: Table, draws: bool = False) -> Page:
    """Return a page of tables, with all other kinds of blocks where pictures are wanted too."""
    sections = [Section(f"s{k}", "all", "T", "plain", "r", (t,)) for k, t in enumerate(tables)]
    if draws:
        sections.append(Section("pictures", "", "T", "plain", "", make_section("p").blocks[1:-1]))
    chapter = Chapter("c", "prism", "a chapter", "12 members.", tuple(sections))
    return Page("3 of 118 wrong", "What it is about.", (chapter,), subject="A subject", facts=("A fact.",))


def test_the_foot_says_where_and_when(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    versions, place = describe_provenance()
    assert "tensegrity_codegen" in versions
    assert place.startswith("Written on 1970-01-02; ")


# --- the checks ------------------------------------------------------------------------------------


def test_a_page_of_this_kind_passes_and_faults_are_found() -> None:
    text = render_page(make_page(make_table(40, 9), make_table(3, 2, folded="More")))
    check_static(text, ["3", "118"])
    faults = {
        "3 of 118 wrong</h1>": "some wrong</h1>",
        "3 of 118 wrong</title>": "A page</title>",
        'content="light dark"': 'content="light"',
        '<link rel="icon" href="data:,">': '<link rel="icon" href="https://example.org/x.png">',
        'data-head="name"': "",
        'href="#s0"': 'href="#last"',
    }
    for old, new in faults.items():
        assert old in text.replace(" – A subject</title>", "</title>"), old
        with pytest.raises((AssertionError, KeyError)):
            check_static(text.replace(" – A subject</title>", "</title>").replace(old, new, 1), ["3", "118"])
    with pytest.raises(AssertionError):
        check_static(text, ["4"])
    with pytest.raises(AssertionError):
        check_static(text.replace("What it is about.", "Nobody was told."), [])


@in_browser
def test_a_browser_shows_all_of_it(tmp_path: Path) -> None:
    names = [text_cell(name) for name in ("members.left1.rest_length", "cable_12" * 4)]
    named = Table("Names", (Column("key", numeric=False), Column("member", numeric=False)), (tuple(names),))
    tables = (make_table(40, 9), make_table(5, 26), make_table(3, 2, folded="More"), named)
    text = render_page(make_page(*tables, draws=True))
    file = tmp_path / "page.html"
    file.write_text(text, encoding="utf-8")
    check_in_browser(file, ["3", "118"])


@in_browser
def test_the_browser_finds_faults(tmp_path: Path) -> None:
    text = render_page(make_page(make_table(40, 9), make_table(5, 26)))
    file = tmp_path / "page.html"
    faults = {
        "hidden": (
            "</style>",
            ".scroll { overflow: hidden !important; } td { width: 400px; display: inline-block; }</style>",
        ),
        "unhinted": ("</style>", ".swipe { display: none !important; }</style>"),
        "broken": ("</style>", "td { display: block !important; width: 3px; word-break: break-all }</style>"),
        "weak": ("</style>", ".lead { color: #888 !important; }</style>"),
        "complaints": ("<main>", "<main><script>nothing()</script>"),
        "overflow": ("<main>", '<main><div style="width: 3000px">wide</div>'),
    }
    with running_browser() as browser:
        for name, (old, new) in faults.items():
            file.write_text(text.replace(old, new, 1), encoding="utf-8")
            found = [probe_page(browser, file, width, "light")[name] for width in (400, 1400)]
            assert any(value != [] and value != 0 for value in found), name
