"""Pages of results: the model, its data, the HTML, and what a browser makes of it."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tensegrity_codegen.report.number_text import format_number, lower_indices, raise_digits
from tensegrity_codegen.report.pages.diagram import Diagram, Series, draw_diagram
from tensegrity_codegen.report.pages.page import (
    VERDICTS,
    Chapter,
    Command,
    Page,
    Section,
    as_sentence,
    diagram_figure,
    lift_figure,
    render_page,
)
from tensegrity_codegen.report.pages.page_table import Column, Table, compare_cell, number_cell, text_cell
from tensegrity_codegen.report.pages.picture import THEME, draw_picture
from tensegrity_codegen.report.result_tables import outcome_table
from tests.report.browser import find_browser, open_page
from tests.report.sample_page import DIAGRAM, HOSTILE, make_page

in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
VOID = {"meta", "link", "br", "img", "path", "use"}


@pytest.fixture(scope="module")
def page() -> Page:
    return make_page()


@pytest.fixture(scope="module")
def text(page: Page) -> str:
    return render_page(page)


# --- numbers, cells, tables ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "spec", "expected"),
    [
        (-1.25, ".1f", "−1.2"),
        (0.5, "+.2f", "+0.50"),
        (-0.0001, ".2f", "0.00"),
        (-0.0001, "+.2f", "0.00"),
        (1234.5, ",.1f", "1,234.5"),
        (3.2e-12, ".1e", "3.2 × 10⁻¹²"),
        (-5e10, ".0e", "−5 × 10¹⁰"),
        (9.94, ".1e", "9.9"),
        (None, ".2f", "–"),
        (float("nan"), ".2f", "–"),
    ],
)
def test_numbers_are_written_for_reading(value: float | None, spec: str, expected: str) -> None:
    assert format_number(value, spec) == expected


def test_exponents_are_raised_and_indices_lowered() -> None:
    assert raise_digits(-307) == "⁻³⁰⁷"
    assert lower_indices("T_S, M_3, H_δ and rho_e, not snake_case or A_rc", "[", "]") == (
        "T[S], M[3], H[δ] and rho[e], not snake_case or A_rc"
    )


def test_a_cell_compares_with_the_digits_it_shows() -> None:
    cell = compare_cell(31.32, 32.04, ".2f")
    assert cell.lines == (("paper", "31.32"), ("ours", "32.04"), ("difference", "+0.72"))
    assert cell.value["difference"] == 32.04 - 31.32
    assert compare_cell(None, 1.0, ".1f").value == {"paper": None, "ours": 1.0, "difference": None}


def test_columns_that_are_empty_in_every_row_are_not_shown() -> None:
    columns = (Column("a"), Column("b"), Column("c", numeric=False))
    row = (number_cell(1.0, ".0f"), number_cell(None, ".0f"), text_cell(""))
    table = Table("caption", columns, (row, row))
    assert [column.name for column in table.filled.columns] == ["a"]
    assert len(table.as_dict()["rows"][0]) == 3
    other = (*row[:2], text_cell("x"))
    assert [column.name for column in Table("caption", columns, (row, other)).filled.columns] == ["a", "c"]


def test_the_first_figure_stands_beside_the_heading() -> None:
    figure = diagram_figure("one", DIAGRAM, "The finding.", "Lines.")
    sections = (
        Section("first", "", "First", "plain", "", (figure,)),
        Section("second", "", "Second", "plain", "", (Command("make --it"),)),
    )
    page = Page(
        "10 N", "Lead.", (Chapter("all", "prism", "", "6 nodes.", sections),), subject="Plan of prism"
    )
    text = render_page(page)
    header, _, body = text.partition("<main>")
    assert "The finding." in header
    assert "Plan of prism: 6 nodes." in header
    assert "The finding." not in body
    assert body.count("<h2") == body.count('id="first"') == body.count("summary") == 0
    assert '<a href="#second">' in body
    assert ">make <span" in body  # its options are not broken, and it is copied as it is
    assert ">make --it</pre>" in body.replace('<span class="whole">', "").replace("</span>", "")
    assert "user-select: all" in text
    printed = make_page()  # figures of a paper stay where they are
    assert lift_figure(printed) == (None, printed)


def test_a_sentence_keeps_the_letters_of_a_name_that_begins_it() -> None:
    assert as_sentence("post1_1 has a safety factor of 1.2") == "post1_1 has a safety factor of 1.2."
    assert as_sentence("no self-stress exists") == "No self-stress exists."
    assert as_sentence("self-stress: none") == "Self-stress: none."


def test_a_row_needs_a_cell_for_every_column() -> None:
    with pytest.raises(ValueError, match="2 cells, 1 columns"):
        Table("caption", (Column("a"),), ((text_cell("x"), number_cell(1.0, ".1f")),))


# --- the page --------------------------------------------------------------------------------------


def test_anchors_are_unique() -> None:
    with pytest.raises(ValueError, match="twice on one page: same"):
        make_page("same", "same")


def test_remarks_point_to_entries_of_the_page(page: Page) -> None:
    with pytest.raises(ValueError, match="entry-1"):
        Page(page.title, page.lead, page.chapters)


def test_the_data_hold_every_number_and_are_json(page: Page) -> None:
    data = json.loads(json.dumps(page.as_dict(), allow_nan=False))
    section = data["papers"][0]["sections"][0]
    kinds = [block["kind"] for block in section["blocks"]]
    assert kinds == ["paragraph", "figure", "figure", "table", "table", "remark"]
    assert section["blocks"][1]["data"]["series"][0]["y"] == [1.0, 4.0, 2.0]
    assert section["blocks"][3]["rows"][0][:3] == ["tension", 26.11, 26.1082]
    assert section["blocks"][4]["rows"][0][1]["paper"] == 31.32


def test_neighbouring_figures_stand_side_by_side(page: Page) -> None:
    groups = page.chapters[0].sections[0].groups
    assert [(kind, len(blocks)) for kind, blocks in groups] == [
        ("paragraph", 1), ("figure", 2), ("table", 1), ("table", 1), ("remark", 1),
    ]  # fmt: skip


def test_the_terminal_has_a_row_for_each_section(page: Page) -> None:
    table = outcome_table(page)
    assert table.row_count == 2
    assert [str(cell) for cell in table.columns[3].cells] == [VERDICTS["agrees"]] * 2


# --- HTML ------------------------------------------------------------------------------------------


class Tags(HTMLParser):
    """Every tag with its attributes; `problems` names tags that are not closed in order."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.problems: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        if not self.open or self.open.pop() != tag:
            self.problems.append(tag)


def read_tags(text: str) -> Tags:
    tags = Tags()
    tags.feed(text)
    return tags


def test_tags_are_closed_in_order(text: str) -> None:
    tags = read_tags(text)
    assert tags.problems == []
    assert tags.open == []


def test_nothing_is_loaded_and_nothing_runs(text: str) -> None:
    tags = read_tags(text)
    assert not {"script", "iframe", "object", "embed", "audio", "video"} & {tag for tag, _ in tags.found}
    targets = [
        value or "" for _, attributes in tags.found for name, value in attributes.items()
        if name in ("src", "href", "xlink:href", "srcset", "data", "action") or name.startswith("on")
    ]  # fmt: skip
    assert [target for target in targets if not target.startswith(("#", "data:"))] == []
    assert re.findall(r"url\((?!#)[^)]*\)|@import", text) == []
    policy = next(a["content"] for tag, a in tags.found if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert policy.startswith("default-src 'none'")


def test_words_are_escaped(text: str) -> None:
    assert HOSTILE not in text
    assert "&lt;script&gt;alert(" in text
    assert "P&amp;Q" in text


def test_ids_do_not_collide_between_figures(text: str) -> None:
    ids = [attributes["id"] for _, attributes in read_tags(text).found if "id" in attributes]
    assert len(ids) > 20
    assert len(ids) == len(set(ids))
    uses = set(re.findall(r'(?:href="|url\()#([\w-]+)', text))
    assert uses <= set(ids)


def test_every_picture_has_words_for_those_who_do_not_see_it(text: str) -> None:
    tags = read_tags(text)
    assert all(attributes.get("alt") for tag, attributes in tags.found if tag == "img")
    assert all(a.get("aria-label") for _, a in tags.found if a.get("role") == "img")


def test_the_same_page_has_the_same_bytes(text: str) -> None:
    assert render_page(make_page()) == text


def test_the_page_has_dark_colours_too(text: str) -> None:
    light, dark = text.split("prefers-color-scheme: dark", 1)
    for color in THEME:
        assert f"--{color.name}: {color.light};" in light
        assert f"--{color.name}: {color.dark};" in dark


# --- pictures --------------------------------------------------------------------------------------


def test_a_small_picture_is_text_that_follows_the_theme() -> None:
    picture = draw_picture(draw_diagram(DIAGRAM), "name")
    assert picture.png == ""
    assert picture.svg.startswith("<svg ")
    assert "var(--line-0)" in picture.svg
    assert "var(--ink)" in picture.svg
    assert not [color.light for color in THEME if color.light in picture.svg]
    assert ">S</tspan>" in picture.svg
    assert set(re.findall(r' id="([^"]+)"', picture.svg)) == {
        name for name in re.findall(r' id="([^"]+)"', picture.svg) if name.startswith("name-")
    }


def test_a_large_picture_is_a_raster() -> None:
    picture = draw_picture(draw_diagram(DIAGRAM), "name", most_svg=100)
    assert picture.svg == ""
    assert picture.png.startswith("data:image/png;base64,iVBOR")
    assert (picture.width, picture.height) == (470, 317)


def test_logarithmic_ticks_need_no_mathematical_font() -> None:
    diagram = Diagram(
        "x", "y", [Series("", [1, 10], [1e-9, 1e-3])], log_y=True, horizontal=((1e-5, "bound"),)
    )
    svg = draw_picture(draw_diagram(diagram), "log").svg
    assert ">10⁻⁹<" in svg
    assert ">bound<" in svg
    assert "mathdefault" not in svg


def test_a_diagram_keeps_what_is_not_finite_out_of_the_data() -> None:
    data = Diagram("x", "y", [Series("a", [0, 1], [float("nan"), 2.0])]).as_dict()
    assert data["series"][0]["y"] == [None, 2.0]


# --- browser ---------------------------------------------------------------------------------------


@in_browser
@pytest.mark.parametrize("width", [400, pytest.param(1400, marks=pytest.mark.thorough)])
def test_a_browser_shows_all_of_it_without_complaint(width: int, text: str, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    file.write_text(text, encoding="utf-8")
    found = open_page(file, width)
    assert found["console"] == []
    assert found["title"] == "A page"
    assert found["content_width"] <= found["width"] <= width
    assert found["outside"] == []
    assert (found["images"], found["images_shown"]) == (2, 2)
    assert (found["drawings"], found["drawings_shown"]) == (2, 2)
    assert (found["tables"], found["tables_shown"]) == (4, 4)
    assert found["doubled_ids"] == []
    assert found["lost_links"] == []


@pytest.mark.thorough
@in_browser
def test_the_check_in_the_browser_finds_what_is_wrong(text: str, tmp_path: Path) -> None:
    broken = text.replace("data:image/png;base64,", "data:image/png;base64,AAAA", 1)
    broken = broken.replace("<main>", '<main><div style="width: 3000px">wide</div><script>nothing()</script>')
    file = tmp_path / "page.html"
    file.write_text(broken, encoding="utf-8")
    found = open_page(file, 400)
    assert found["images_shown"] == 1
    assert found["content_width"] > 400
    assert len(found["console"]) == 1
