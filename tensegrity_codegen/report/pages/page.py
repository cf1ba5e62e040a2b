"""The content of a page of results: chapters of sections with text, remarks, tables and figures.

Lines of a diagram that coincide are drawn as one, with all their names.
"""

import dataclasses
import functools
import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from markupsafe import Markup, escape
from pydantic import TypeAdapter, ValidationError

from tensegrity_codegen.codegen.print.render import template_folder
from tensegrity_codegen.report.number_text import lower_indices
from tensegrity_codegen.report.pages.diagram import Diagram, draw_diagram
from tensegrity_codegen.report.pages.page_table import HINT_WIDTHS, Table
from tensegrity_codegen.report.pages.picture import THEME, Picture, draw_picture
from tensegrity_codegen.system.files import plain, write_text

if TYPE_CHECKING:
    import jinja2

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from tensegrity_codegen.report.pages.diagram import Series
from tensegrity_codegen.report.pictures.canvas import SEQUENCE

Verdict = Literal["agrees", "differs", "wrong", "unstated", "new", "plain"]
VERDICTS: Mapping[str, str] = {
    "agrees": "agrees",
    "differs": "differs",
    "wrong": "wrong",
    "unstated": "no numbers in print",
    "new": "not in print",
    "plain": "",  # nothing to compare with
}
# Why a result differs from print, or agrees only with data or formulas that were corrected here.
Cause = Literal["", "paper_wrong", "data_missing", "we_differ", "ours_corrected"]
CAUSES: Mapping[str, str] = {
    "paper_wrong": "paper wrong",
    "data_missing": "data missing",
    "we_differ": "we differ",
    "ours_corrected": "ours corrected",
}


@dataclass(frozen=True)
class Paragraph:
    """Plain text."""

    text: str
    kind: str = "paragraph"


@dataclass(frozen=True)
class Command:
    """Words to be copied into a terminal, or printed by one; folded: text of the line that opens them."""

    text: str
    kind: str = "command"
    folded: str = ""


@dataclass(frozen=True)
class Remark:
    """Where and why paper and ours agree or differ, with the anchors of the entries that explain it."""

    verdict: Verdict
    text: str
    entries: tuple[str, ...] = ()
    kind: str = "remark"


@dataclass(frozen=True)
class Figure:
    """A picture with a caption, the text for those who cannot see it, and the data that it was drawn from."""

    picture: Picture
    caption: str
    alt: str
    data: Mapping[str, Any] = field(default_factory=dict)
    kind: str = "figure"


Block = Paragraph | Command | Remark | Table | Figure


@dataclass(frozen=True)
class Section:
    """One thing that came out: a title, the outcome, and the rest.

    anchor: unique on the page, letters, digits and hyphens; source: its name in a paper, as in "Table 2",
    else ""; result: the outcome in one short line, "" where the heading of the page states it; cause: key of
    CAUSES; errors: the largest differences from print, (value, unit).
    """

    anchor: str
    source: str
    title: str
    verdict: Verdict
    result: str
    blocks: tuple[Block, ...]
    cause: Cause = ""
    errors: tuple[tuple[float, str], ...] = ()

    @property
    def outcome(self) -> str:
        """The verdict and its cause in words, empty if there is nothing to compare with."""
        return ": ".join(filter(None, (VERDICTS[self.verdict], CAUSES.get(self.cause))))

    @property
    def is_one_figure(self) -> bool:
        """Whether there is nothing but one figure: two such sections stand beside each other."""
        return [block.kind for block in self.blocks] == ["figure"]

    @property
    def groups(self) -> list[tuple[str, list[Block]]]:
        """The blocks in order, neighbouring figures together."""
        rows: list[tuple[str, list[Block]]] = []
        for block in self.blocks:
            if block.kind == "figure" and rows and rows[-1][0] == "figure":
                rows[-1][1].append(block)
            else:
                rows.append((block.kind, [block]))
        return rows


@dataclass(frozen=True)
class Chapter:
    """One paper or scene: short name, title, where it was printed or what it is, and its sections.

    Without a title the page is about this alone: its sections are listed by name, without results.
    """

    anchor: str
    name: str
    title: str
    citation: str
    sections: tuple[Section, ...]


@dataclass(frozen=True)
class Entry:
    """An entry of the list at the end of the page, which remarks point to by its anchor."""

    anchor: str
    name: str
    where: str
    text: str


@dataclass(frozen=True)
class Page:
    """All of a page; `entries` closes it under the heading `entries_title`; facts stand in its foot.

    title: the finding in numbers, computed from the data; subject: of the page, in a few words;
    summary_heads: headings of the table that opens the page.
    """

    title: str
    lead: str
    chapters: tuple[Chapter, ...]
    entries_title: str = ""
    entries: tuple[Entry, ...] = ()
    facts: tuple[str, ...] = ()
    summary_heads: tuple[str, str, str] = ("in the paper", "what", "result")
    subject: str = ""

    def __post_init__(self) -> None:
        anchors = [anchor for anchor, _ in self._anchors()]
        twice = sorted({anchor for anchor in anchors if anchors.count(anchor) > 1})
        if twice:
            raise ValueError(f"anchors that stand twice on one page: {', '.join(twice)}")
        lost = sorted(set(self._wanted()) - {entry.anchor for entry in self.entries})
        if lost:
            raise ValueError(f"remarks point to entries that are not on the page: {', '.join(lost)}")

    def as_dict(self) -> dict[str, Any]:
        """Return all words and numbers of the page, pictures as the data that they were drawn from."""
        return {
            "title": self.title,
            "subject": self.subject,
            "papers": [
                {
                    "name": chapter.name,
                    "title": chapter.title,
                    "citation": chapter.citation,
                    "sections": [_section_dict(section) for section in chapter.sections],
                }
                for chapter in self.chapters
            ],
            "entries": [{"name": e.name, "where": e.where, "text": e.text} for e in self.entries],
            "facts": list(self.facts),
        }

    def entry_name(self, anchor: str) -> str:
        """Return the name of the entry with this anchor."""
        return next(entry.name for entry in self.entries if entry.anchor == anchor)

    def _anchors(self) -> Iterator[tuple[str, str]]:
        for chapter in self.chapters:
            yield chapter.anchor, chapter.name
            yield from ((section.anchor, section.title) for section in chapter.sections)
        yield from ((entry.anchor, entry.name) for entry in self.entries)

    def _wanted(self) -> Iterator[str]:
        for chapter in self.chapters:
            for section in chapter.sections:
                for block in section.blocks:
                    yield from block.entries if isinstance(block, Remark) else ()


def diagram_figure(name: str, diagram: Diagram, caption: str, alt: str) -> Figure:
    """Return a diagram as a figure of a page, its data with it; `name` is unique on the page."""
    return Figure(draw_picture(draw_diagram(diagram), name), caption, alt, diagram.as_dict())


def command_section(command: str) -> Section:
    """Return the section with the command line that makes the page."""
    return Section("command", "", "Command", "plain", "makes this page", (Command(command),))


def as_sentence(text: str) -> str:
    """Return a message as a sentence: its first letter a capital one, except of a name, and a full stop."""
    is_name = not text.partition(" ")[0].rstrip(",:;").replace("-", "").isalpha()
    return f"{text}." if is_name else f"{text[:1].upper()}{text[1:]}."


def _section_dict(section: Section) -> dict[str, Any]:
    """Return a section in JSON's types."""
    return {
        "source": section.source,
        "title": section.title,
        "verdict": section.verdict,
        **({"cause": section.cause} if section.cause else {}),
        "result": section.result,
        "blocks": [_block_dict(block) for block in section.blocks],
    }


def _block_dict(block: Block) -> dict[str, Any]:
    """Return a block in JSON's types; a figure as its data."""
    match block:
        case Table():
            return block.as_dict()
        case Figure():
            return {"kind": block.kind, "caption": block.caption, "data": dict(block.data)}
        case Remark():
            entries = {"entries": list(block.entries)} if block.entries else {}
            return {"kind": block.kind, "verdict": block.verdict, "text": block.text, **entries}
        case Paragraph() | Command():
            return {"kind": block.kind, "text": block.text}


KINDS: dict[str, type[Any]] = {
    "section": Section,
    "paragraph": Paragraph,
    "command": Command,
    "remark": Remark,
    "table": Table,
    "figure": Figure,
}


def section_as_json(section: Section) -> dict[str, Any]:
    """Return all of a section in JSON's types, pictures included."""
    text = json.dumps(dataclasses.asdict(section), allow_nan=False, default=plain)
    result: dict[str, Any] = json.loads(text)
    return result


def read_section(data: Any) -> Section | None:
    """Return the section that section_as_json wrote, None if `data` is no such thing."""
    try:
        blocks = tuple(_adapter(block["kind"]).validate_python(block) for block in data["blocks"])
        section: Section = _adapter("section").validate_python({**data, "blocks": ()})
    except (ValidationError, ValueError, KeyError, TypeError):
        return None
    return replace(section, blocks=blocks)


@functools.cache
def _adapter(kind: str) -> TypeAdapter[Any]:
    return TypeAdapter(KINDS[kind])


@functools.cache
def html_template(folder: str, name: str, **filters: Callable[[str], object]) -> "jinja2.Template":
    """Return the template `name` in `folder`, a folder of templates/, which may use the given filters.

    A name that it uses and nobody gave is an error; values are escaped unless they are Markup.
    """
    import jinja2  # tables of the command line need no templates

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(template_folder() / folder),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters)
    return environment.get_template(name)


# A digit and a space that stand before a unit.
UNIT = re.compile(r"([\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:%|N|mm|m|s|kg|deg|µs|ms|Hz|J|MPa)(?:\W|$))")

# A power of ten as in 1e-6 m, and an option, which a browser would break at their signs.
SHORT = re.compile("[\\d.]+e[-+]\\d+(?:\N{NO-BREAK SPACE}\\w+)?|--[a-z][a-z-]+")


def render_page(page: Page) -> str:
    """Return the page as HTML; all its words are escaped, only SVG pictures are taken as they are."""
    opening, remaining = lift_figure(page)
    settings = {"theme": THEME, "hint_widths": HINT_WIDTHS, "opening": opening}
    template = html_template("pages", "page.html.j2", rich=_enrich, whole=_keep_whole)
    return template.render(page=remaining, **settings)


def lift_figure(page: Page) -> tuple[Figure | None, Page]:
    """Return the figure beside the heading, the first one of no paper, and the page without it."""
    unprinted = [section for chapter in page.chapters for section in chapter.sections if not section.source]
    figure = next((block for part in unprinted for block in part.blocks if isinstance(block, Figure)), None)

    def leave(sections: tuple[Section, ...]) -> Iterator[Section]:
        for section in sections:
            blocks = tuple(block for block in section.blocks if block is not figure)
            if blocks or not section.blocks:
                yield replace(section, blocks=blocks)

    chapters = tuple(replace(chapter, sections=tuple(leave(chapter.sections))) for chapter in page.chapters)
    return figure, replace(page, chapters=chapters)


def write_page(page: Page, path: Path, *, overwrite: bool) -> None:
    """Write a page whole or not at all; OutputError if one exists and may not be replaced."""
    write_text(render_page(page), path, overwrite=overwrite)


def _keep_whole(text: str) -> Markup:
    """Return escaped text, options and powers of ten of which stay on one line."""
    return Markup(SHORT.sub('<span class="whole">\\g<0></span>', str(escape(text))))


def _enrich(text: str) -> Markup:
    """Return escaped text with lowered indices, and with numbers and units on one line."""
    tied = _keep_whole(UNIT.sub("\\1\N{NO-BREAK SPACE}", text))
    tied = tied.replace(" × 10", "\N{NO-BREAK SPACE}×\N{NO-BREAK SPACE}10")
    return Markup(lower_indices(tied, "<sub>", "</sub>"))


Look = tuple[int, Literal["line", "dashed", "dotted", "dashdot"]]

# Of the height of a diagram: lines that are nowhere further apart cannot be told apart.
INDISTINGUISHABLE_DISTANCE = 0.004
MAX_NAMES = 3
STYLES: tuple[Literal["line", "dashed", "dotted", "dashdot"], ...] = ("line", "dashed", "dotted", "dashdot")


def choose_looks(names: Iterable[str]) -> Mapping[str, Look]:
    """Return number of the colour and style of each name: all colours solid, then dashed, then dotted."""
    order = list(dict.fromkeys(names))
    count = len(SEQUENCE)
    return {name: (k % count, STYLES[k // count % len(STYLES)]) for k, name in enumerate(order)}


def join_series(series: Sequence[Series]) -> tuple[Series, ...]:
    """Return series of which those that coincide are one line, with the look of the first and all names."""
    # The range of all finite values, zero without any.
    values = np.concatenate([np.zeros(0), *(np.ravel(np.asarray(line.y, dtype=float)) for line in series)])
    finite = values[np.isfinite(values)]
    height = float(np.ptp(finite)) if len(finite) else 0.0
    groups: list[list[Series]] = []
    for line in series:
        for group in groups:
            if _coincide(group[0], line, INDISTINGUISHABLE_DISTANCE * height):
                group.append(line)
                break
        else:
            groups.append([line])
    return tuple(replace(group[0], name=join_names([line.name for line in group])) for group in groups)


def join_names(names: Sequence[str], limit: int = MAX_NAMES) -> str:
    """Return names in one text: "v1, v2, v3", or "v1, v2 and 4 more"."""
    shown = [name for name in names if name]
    if len(shown) <= limit:
        return ", ".join(shown)
    return f"{', '.join(shown[: limit - 1])} and {len(shown) - limit + 1} more"


def joined_figure(name: str, diagram: Diagram, caption: str, alt: str) -> Figure:
    """Return a diagram as a figure whose coinciding lines are drawn as one; its data has every line."""
    drawn = replace(diagram, series=join_series(diagram.series))
    return Figure(draw_picture(draw_diagram(drawn), name), caption, alt, diagram.as_dict())


def _coincide(line: Series, candidate: Series, distance: float) -> bool:
    """Return whether two lines have the same places and values within `distance`."""
    if line.style != candidate.style and "points" in (line.style, candidate.style):
        return False
    line_y, second = (np.asarray(curve.y, dtype=float) for curve in (line, candidate))
    abscissas = [np.asarray(curve.x, dtype=float) for curve in (line, candidate)]
    if line_y.shape != second.shape or not np.array_equal(abscissas[0], abscissas[1]):
        return False
    finite = np.isfinite(line_y)
    if not np.array_equal(finite, np.isfinite(second)):
        return False
    return bool(np.all(np.abs(line_y[finite] - second[finite]) <= distance))
