"""The papers beside our results: one page and one data file."""

import json
import tomllib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from tensegrity_codegen.report.number_text import format_number
from tensegrity_codegen.report.pages.page import CAUSES, Chapter, Entry, Page, Section, render_page
from tensegrity_codegen.studies.papers.lin.chapter import build_lin_chapter
from tensegrity_codegen.studies.papers.scs.chapter import build_scs_chapter
from tensegrity_codegen.studies.papers.sk.chapter import build_sk_chapter
from tensegrity_codegen.studies.study import hash_run, make_folder
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.files import plain
from tensegrity_codegen.system.journal import Journal, Resumption
from tensegrity_codegen.system.output_folder import write_folder
from tensegrity_codegen.system.progress import ProgressFunction, part_of
from tensegrity_codegen.system.provenance import describe_provenance

PAGE_NAME, DATA_NAME = "reproduce.html", "reproduce.json"
JOURNAL_NAME = Path("journal", "reproduce.jsonl")
ALL = "all"
# Verdict -> how one and how several results of it are counted.
WORDS = {
    "agrees": ("{} agrees with print", "{} agree with print"),
    "differs": ("{} differs", "{} differ"),
    "unstated": ("{} is a curve without printed numbers", "{} are curves without printed numbers"),
    "new": ("{} is not given in print", "{} are not given in print"),
}
# Unit -> format of the largest errors.
ERROR_FORMATS = {"mm": ".2f", "%": ".2f", "N": ".4f"}
KINDS = (
    "A difference is marked “paper wrong” where a printed formula or count does not hold, “data missing” "
    "where what was computed with is not printed, and “we differ” where our model leaves out what was "
    "measured; an agreement is marked “ours corrected” where it needs data that were corrected here."
)


@dataclass(frozen=True)
class Paper:
    """How the chapter on a paper is made, and its share of the time."""

    build: Callable[[bool, ProgressFunction | None, Journal | None], Chapter]
    share: float


PAPERS: dict[str, Paper] = {
    "sk": Paper(build_sk_chapter, 1.0),
    "lin": Paper(build_lin_chapter, 1.0),
    "scs": Paper(build_scs_chapter, 4.0),
}


@dataclass(frozen=True)
class Reproduction:
    """The files: the page, the data file, and the page's content."""

    html: Path
    data: Path
    page: Page

    def summary(self) -> dict[str, Any]:
        """Return both paths and the outcome of each section as one JSON-ready object."""
        return {
            "html": str(self.html),
            "data": str(self.data),
            "finding": self.page.title,
            "papers": {
                chapter.anchor: [
                    {"source": s.source, "title": s.title, "verdict": s.verdict, "cause": s.cause}
                    | {"result": s.result}
                    for s in chapter.sections
                ]
                for chapter in self.page.chapters
            },
        }


def reproduce(
    papers: Sequence[str],
    folder: str | Path,
    *,
    quick: bool = False,
    progress: ProgressFunction | None = None,
    fresh: bool = False,
    overwrite: bool = False,
    notice: Callable[[Resumption], None] | None = None,
) -> Reproduction:
    """Compute the chapters of the papers and write reproduce.html and reproduce.json into `folder`.

    papers: names of PAPERS, or "all"; quick: smaller sizes and shorter times; progress is called with the
    fraction done. Both files are written after all studies are done, or neither. Sections go into a journal
    in the folder as soon as they are done; the same call again, with the same code on the same machine, takes
    them from there, unless `fresh`; `notice` is called with what is taken.
    """
    names = choose_papers(papers)
    require_plot()
    target = make_folder(folder, (PAGE_NAME, DATA_NAME), overwrite=overwrite)
    key = hash_run("reproduce", str(quick))
    journal = Journal(target / JOURNAL_NAME, key, fresh=fresh, notice=notice)
    page = build_page(names, quick=quick, progress=progress, journal=journal)
    text = json.dumps(page.as_dict(), ensure_ascii=False, allow_nan=False, default=plain)
    files = {PAGE_NAME: render_page(page).encode("utf-8"), DATA_NAME: f"{text}\n".encode()}
    write_folder(target, files, overwrite=overwrite)
    return Reproduction(target / PAGE_NAME, target / DATA_NAME, page)


def choose_papers(papers: Sequence[str]) -> tuple[str, ...]:
    """Return the names in the order of PAPERS, each once; raises UnknownNameError."""
    names = (*PAPERS, ALL)
    for name in papers:
        check_choice(name, names, "paper", "reproduce")
    return tuple(name for name in PAPERS if ALL in papers or not papers or name in papers)


def build_page(
    papers: Sequence[str],
    *,
    quick: bool = False,
    progress: ProgressFunction | None = None,
    journal: Journal | None = None,
) -> Page:
    """Return the page on the papers, without writing it; journal: see build_sections."""
    total, errata = sum(PAPERS[name].share for name in papers), read_errata()
    done, chapters = 0.0, []
    for name in papers:
        paper = PAPERS[name]
        section_progress = part_of(progress, done / total, paper.share / total)
        chapters.append(paper.build(quick, section_progress, journal))
        done += paper.share
    size = "Small sizes and short times" if quick else "Full sizes"
    return Page(
        title=_describe_finding(chapters),
        subject=f"Papers on tensegrity structures, computed again: {', '.join(c.name for c in chapters)}",
        lead=_lead(chapters),
        chapters=tuple(chapters),
        entries_title="Errata: what was found in print",
        entries=tuple(entry for name in papers for entry in errata[name]),
        facts=(
            *describe_provenance(),
            f"{size}. All numbers, and the data behind the figures, stand in {DATA_NAME} beside this page.",
        ),
    )


def read_errata() -> dict[str, tuple[Entry, ...]]:
    """Return paper -> errors and unclear points in print, to which remarks point; docs/errata.md has them."""
    text = files(__package__).joinpath("data", "errata.toml").read_text(encoding="utf-8")
    return {name: tuple(Entry(**entry) for entry in entries) for name, entries in tomllib.loads(text).items()}


def _describe_finding(chapters: Sequence[Chapter]) -> str:
    """Return how many of the results with printed numbers agree, how many differ and why, and by how much."""
    sections = [section for chapter in chapters for section in chapter.sections]
    verdicts = [section.verdict for section in sections]
    agree, differ = verdicts.count("agrees"), verdicts.count("differs")
    if not agree + differ:
        return f"{len(verdicts)} results, none of them with numbers in print"
    agreeing = "result agrees" if agree + differ == 1 else "results agree"
    errors = ", ".join(_largest_errors(sections))
    return (
        f"{agree} of {agree + differ} printed {agreeing}{_count_causes(sections, 'agrees')}, "
        f"{differ} differ{'s' if differ == 1 else ''}{_count_causes(sections, 'differs')}"
        f"{f'; largest errors {errors}' if errors else ''}"
    )


def _count_causes(sections: Sequence[Section], verdict: str) -> str:
    """Return the causes of the sections with this verdict, counted, in brackets; empty without any."""
    causes: Counter[str] = Counter(section.cause for section in sections if section.verdict == verdict)
    reasons = ", ".join(f"{text} {causes[cause]}" for cause, text in CAUSES.items() if cause in causes)
    return f" ({reasons})" if reasons else ""


def _largest_errors(sections: Sequence[Section]) -> dict[str, str]:
    """Return the largest error in each unit -> where it stands."""
    largest: dict[str, tuple[float, str]] = {}
    for section in sections:
        for value, unit in section.errors:
            largest[unit] = max(largest.get(unit, (0.0, "")), (value, section.source))
    return {
        f"{format_number(value, ERROR_FORMATS[unit])} {unit}": source
        for unit, (value, source) in largest.items()
    }


def _lead(chapters: Sequence[Chapter]) -> str:
    sections = [section for chapter in chapters for section in chapter.sections]
    verdicts = [section.verdict for section in sections]
    errors = ", ".join(f"{error} ({source})" for error, source in _largest_errors(sections).items())
    counts = [
        WORDS[kind][verdicts.count(kind) > 1].format(verdicts.count(kind))
        for kind in WORDS
        if kind in verdicts
    ]
    return (
        "Every table and figure that the text of the papers defines, computed by the same general models "
        f"that serve any other scene, beside what was printed. Of {len(verdicts)} results "
        f"{', '.join(counts)}. Where one differs, the page says where and why. {KINDS}"
        + (f" Largest errors: {errors}." if errors else "")
    )
