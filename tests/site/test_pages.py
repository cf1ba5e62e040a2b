"""Pages of the documentation site, without Sphinx: navigation, marks, links."""

import posixpath
import re
import runpy
import sys
from pathlib import Path

import pytest

import tensegrity_codegen
from tensegrity_codegen.cli.app import find_verbs
from tensegrity_codegen.scene.schema.schema import scene_json_schema
from tests.doc_tables import GENERATED

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
sys.path.append(str(DOCS))

from site_pages.expand import expand_page  # noqa: E402
from site_pages.gallery import find_scenes  # noqa: E402
from site_pages.links import CODE, FENCE, LINK, point_links  # noqa: E402
from site_pages.live_pages import compute_fingerprint  # noqa: E402
from site_pages.scene_keys import write_scene_keys  # noqa: E402

PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md"))


def expand(page: str) -> str:
    return expand_page((DOCS / page).read_text(encoding="utf-8"), f"docs/{page}")


@pytest.fixture(scope="module")
def expanded() -> dict[str, str]:
    return {page: expand(page) for page in PAGES}


def find_listed(page: str, text: str) -> list[str]:
    """Return the pages that the navigation of a page lists."""
    listed = []
    for block in re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        names = [line for line in block.splitlines() if line and not line.startswith(":")]
        folder = DOCS / posixpath.dirname(page)
        for name in names:
            found = sorted(folder.glob(f"{name}.md"))
            assert found, (page, name)
            listed += [path.relative_to(DOCS).as_posix() for path in found]
    return listed


def test_the_navigation_lists_every_page_once(expanded: dict[str, str]) -> None:
    listed = [name for page, text in expanded.items() for name in find_listed(page, text)]
    assert sorted(listed) == [page for page in PAGES if page != "index.md"]


def test_no_mark_is_left(expanded: dict[str, str]) -> None:
    assert [page for page, text in expanded.items() if re.search("^<!-- site:", text, re.MULTILINE)] == []


def test_links_lead_to_pages_and_files_of_the_docs(expanded: dict[str, str]) -> None:
    lost = []
    for page, text in expanded.items():
        for _, _, target in LINK.findall("".join(FENCE.split(text)[::2])):
            path = target.partition("#")[0]
            if path and not re.match(r"[a-z]+:", target) and not (DOCS / page).parent.joinpath(path).exists():
                lost.append((page, target))
    assert lost == []


def make_anchor(title: str) -> str:
    """Return the anchor of a heading, as GitHub and myst make it."""
    plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", title.strip()).replace("`", "").replace("*", "")
    return re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")


def find_anchors(text: str) -> set[str]:
    """Return the anchors of a page: of its headings down to the fourth level, and stated ones."""
    text = "".join(FENCE.split(text)[::2])
    made: list[str] = []
    for title in re.findall(r"^#{1,4} (.+?)#*$", text, re.MULTILINE):
        anchor = make_anchor(title)
        again = made.count(anchor)
        made += [anchor, *([f"{anchor}-{again}"] if again else [])]
    return {*made, *re.findall(r'\bid="([^"]+)"', text), *re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE)}


def find_lost(texts: dict[str, str], anchors: dict[str, set[str]]) -> list[str]:
    """Return links of pages, paths from the root, to anchors, pictures or pages that are not there."""
    lost = []
    for page, text in texts.items():
        prose = CODE.sub("", "".join(FENCE.split(text)[::2]))
        targets = [target for _, _, target in LINK.findall(prose)]
        targets += re.findall(r'<(?:img|source)\b[^>]*?\bsrc="([^"]+)"', prose)
        for target in targets:
            path, _, anchor = target.partition("#")
            if re.match(r"[a-z]+:", target):
                continue
            found = posixpath.normpath(posixpath.join(posixpath.dirname(page), path)) if path else page
            there = found in anchors or (ROOT / found).exists()
            if not there or (anchor and anchor not in anchors.get(found, {anchor})):
                lost.append(f"{page}: {target}")
    return lost


ROOT_PAGES = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def test_links_lead_to_anchors_and_pictures_that_are_there(expanded: dict[str, str]) -> None:
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in ROOT_PAGES}
    anchors = {name: find_anchors(text) for name, text in texts.items()}
    anchors |= {f"docs/{page}": find_anchors(text) for page, text in expanded.items()}
    texts |= {f"docs/{page}": (DOCS / page).read_text(encoding="utf-8") for page in PAGES}
    assert find_lost(texts, anchors) == []


def test_a_lost_anchor_or_picture_is_found() -> None:
    text = '# A page\n\n## `a_b` and *c*: 10 %\n\n## Again\n\n## Again\n\n<a id="own"></a>\n'
    assert find_anchors(text) == {"a-page", "a_b-and-c-10-", "again", "again-1", "own"}
    good = (
        "[a](x.md#own) [b](#again-1) ![p](docs/pictures/prism.gif) `[no](x.md#lost)` [w](https://a.example#b)"
    )
    bad = '[a](x.md#lost) [b](#gone) ![p](docs/pictures/none.gif) <img src="none.svg"> [c](none.md)'
    anchors = {"x.md": find_anchors(text), "y.md": find_anchors(text)}
    assert find_lost({"y.md": good}, anchors) == []
    assert len(find_lost({"y.md": bad}, anchors)) == 5


MOST_WORDS = {"page": 2_500, "docs": 60_000, "README": 600}


def count_words(path: Path) -> int:
    """Return the words of a page as `wc -w` counts, without generated lists."""
    return len(GENERATED.sub("", path.read_text(encoding="utf-8")).split())


def test_pages_are_short() -> None:
    words = {page: count_words(DOCS / page) for page in PAGES if not page.startswith("decisions/")}
    assert {page: count for page, count in words.items() if count > MOST_WORDS["page"]} == {}


def test_the_documentation_is_short() -> None:
    count = sum(count_words(DOCS / page) for page in PAGES if not page.startswith("decisions/"))
    assert count <= MOST_WORDS["docs"]


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= MOST_WORDS["README"]


def test_every_verb_has_a_section(expanded: dict[str, str]) -> None:
    sections = re.findall(r"^## (\S+)$", expanded["reference/command_line.md"], re.MULTILINE)
    assert sections == [verb.word for verb in find_verbs()]
    assert re.search(
        r"^`--t-end <float>`\n: Simulated time", expanded["reference/command_line.md"], re.MULTILINE
    )
    assert "## sweep summary\n" in expanded["reference/command_line.md"]


def test_every_public_name_is_documented_once(expanded: dict[str, str]) -> None:
    text = expanded["reference/python.md"]
    found = re.findall(r"^\.\. auto\w+:: tensegrity_codegen\.(\w+)$", text, re.MULTILINE)
    assert sorted(found) == sorted(set(tensegrity_codegen.__all__) - {"__version__"})


def test_the_keys_of_scenes_are_written_from_the_schema(update_golden: bool) -> None:
    path = DOCS / "reference" / "scene_keys.md"
    text = path.read_text(encoding="utf-8")
    head, mark = re.split(r"(<!-- keys: .*? -->\n)", text)[:2]
    expected = f"{head}{mark}\n{write_scene_keys()}\n\n<!-- end of keys -->\n"
    if update_golden:
        path.write_text(expected, encoding="utf-8", newline="\n")
    assert path.read_text(encoding="utf-8") == expected, "run this test with --update-golden"


def test_every_key_of_scenes_has_an_entry(expanded: dict[str, str]) -> None:
    text = expanded["reference/scene_keys.md"]
    schema = scene_json_schema()
    tables = {"Sections of a scene": schema} | {
        name: table for name, table in schema["$defs"].items() if "properties" in table
    }
    of_classes = tables["MemberClass"]["properties"]
    assert "No description" not in text
    for name, table in tables.items():
        section = text.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        keys = list(table["properties"])
        if "[MemberClass](#memberclass), which" in section:
            keys = [key for key in keys if of_classes.get(key) != table["properties"][key]]
            assert of_classes.keys() - table["properties"].keys() <= {"kind"}
        assert re.findall(r"^`(\w+)` \(", section, re.MULTILINE) == keys, name
    assert "`relaxed_fraction` (number above 0 below 1)" in text
    assert "In a scene: `[classes.NAME]`" in text


def test_every_scene_of_the_gallery_has_a_card_and_a_page(expanded: dict[str, str]) -> None:
    scenes = find_scenes()
    assert len(scenes) >= 18
    cards = re.findall(r'class="card" href="gallery/(\w+)\.html"', expanded["gallery.md"])
    assert sorted(cards) == sorted(scenes)
    assert expanded["gallery.md"].count('<svg class="thumbnail"') == len(scenes)
    for name, path in scenes.items():
        text = expanded[f"gallery/{name}.md"]
        assert f"```toml\n{path.read_text(encoding='utf-8')}```" in text
        assert f'src="../live/{name}.html"' in text
        words = re.sub(r"<[^>]+>|```.*?```", "", text, flags=re.DOTALL).split()
        assert len(words) > 50, name


def test_cards_have_no_marks_of_markdown_and_lines_of_two_pixels(expanded: dict[str, str]) -> None:
    text = expanded["gallery.md"]
    cards = re.findall(r'<a class="card".*?</a>', text, re.DOTALL)
    assert [card for card in cards if "\\" in card] == []
    widths = [float(width) for card in cards for width in re.findall(r'stroke-width="([\d.]+)"', card)]
    assert min(widths) >= 2.0
    style = (DOCS / "site_pages" / "static" / "site.css").read_text(encoding="utf-8")
    assert ".thumbnail line { vector-effect: non-scaling-stroke; }" in style
    assert f"\n{len(cards)} structures.\n" in text


def test_a_live_page_is_due_where_scene_code_or_command_changed(tmp_path: Path) -> None:
    scene = tmp_path / "a.toml"
    scene.write_text('name = "a"', encoding="utf-8")
    marks = [
        compute_fingerprint(scene, "code", ["play"]),
        compute_fingerprint(scene, "changed code", ["play"]),
        compute_fingerprint(scene, "code", ["play", "--settle"]),
    ]
    scene.write_text('name = "b"', encoding="utf-8")
    marks.append(compute_fingerprint(scene, "code", ["play"]))
    scene.with_suffix(".csv").write_text("time,winch\n0,0\n1,0\n", encoding="utf-8")  # inputs over time
    marks.append(compute_fingerprint(scene, "code", ["play"]))
    assert len(set(marks)) == 5


def test_powers_of_ten_stay_on_one_line_and_links_as_they_are() -> None:
    context = {"body": '<td>3.0e-04 <a href="a.html#-1e-06">of 1e-6</a> b1e-3</td>'}
    runpy.run_path(str(DOCS / "conf.py"))["keep_numbers_whole"](None, "a", "page.html", context, None)
    assert re.findall(r'<span class="whole">(.*?)</span>', context["body"]) == ["3.0e-04", "1e-6"]
    assert 'href="a.html#-1e-06"' in context["body"]
    style = (DOCS / "site_pages" / "static" / "site.css").read_text(encoding="utf-8")
    assert ".table-wrapper .pre, .whole { white-space: nowrap; }" in style


TABLE = """

| scene | x | right | wrong |
|---|---|---|---|
| a | u | 1,500 | 500 |
| b & c | v | 1000 | 0 |
"""


def test_a_table_becomes_bars() -> None:
    text = expand_page(f"<!-- site: bars scene, x: right, wrong -->{TABLE}", "docs/x.md")
    chart, _, table = text.partition("</div>\n\n\n")
    assert table in TABLE
    assert re.findall(r'<span class="name">(.*?)</span>', chart) == ["a u", "b &amp; c v"]
    widths = re.findall(r'part-(\d)" style="width:([\d.]+)%" title="(.*?)"', chart)
    assert widths == [
        ("0", "75.00", "right: 1500"),
        ("1", "25.00", "wrong: 500"),
        ("0", "50.00", "right: 1000"),
    ]
    unknown = f"{TABLE.rstrip()}\n| d | w | not reached | |\n"
    assert expand_page(f"<!-- site: bars scene, x: right, wrong -->{unknown}", "docs/x.md").startswith(chart)
    with pytest.raises(ValueError, match="no column missed; it has scene, x, right, wrong"):
        expand_page(f"<!-- site: bars scene: missed -->{TABLE}", "docs/x.md")


@pytest.mark.parametrize("page", ["stability.md", "benchmarks.md"])
def test_pages_of_measurements_open_with_finding_and_chart(page: str, expanded: dict[str, str]) -> None:
    title, finding, _origin, _repeat, chart, _ = expanded[page].split("\n\n", 5)
    assert title.startswith("# ")
    assert re.search(r"\*\*[^*]*\d[^*]*\*\*", finding)
    assert '<div class="bars"' in chart
    assert chart.count('class="line"') >= 6


def test_an_unknown_mark_or_text_is_an_error() -> None:
    with pytest.raises(ValueError, match="no mark of the site"):
        expand_page("<!-- site: everything -->", "docs/x.md")
    with pytest.raises(ValueError, match="has no text"):
        expand_page("<!-- site: include README.md after no such words -->", "docs/x.md")
    with pytest.raises(ValueError, match="no public names"):
        expand_page("<!-- site: python compute_everything -->", "docs/x.md")


def test_links_to_what_is_no_page_become_names() -> None:
    page = "docs/guides/x.md"
    assert point_links("[laws](tensegrity_codegen/tables/laws/)", "README.md", page) == "laws"
    assert point_links("[`laws/`](../tensegrity_codegen/tables/laws/)", "docs/a.md", page) == "`laws/`"
    assert point_links("[a](docs/model.md#mass)", "README.md", page) == "[a](../model.md#mass)"
    assert point_links("[a](README.md)", "CONTRIBUTING.md", page) == "[a](../overview.md)"
    assert point_links("[a](docs/decisions)", "README.md", page) == "[a](../decisions/README.md)"
    assert point_links("[a](https://a.example)", "README.md", page) == "[a](https://a.example)"
