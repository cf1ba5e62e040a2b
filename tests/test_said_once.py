"""Nothing is said twice: sentences, counts, defaults and limits of the pages.

Pages are README.md, CONTRIBUTING.md and docs/ without decisions and the pages of the gallery. Of a
page counts what is written by hand: no code blocks, nothing between `<!-- NAME: written ... -->` and its end.
"""

import json
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tensegrity_codegen.cli.app import find_verbs
from tensegrity_codegen.cli.verbs.examples import list_examples
from tensegrity_codegen.scene.schema.schema import scene_json_schema
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.presets import PRESETS
from tensegrity_codegen.tables.quantities import QUANTITIES
from tests.doc_tables import GENERATED

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
RUN = 12  # words in a row that may stand in one sentence only

HIDDEN = re.compile(r"^ *```.*?^ *```$|<!--.*?-->|^    .*?$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)")


def read_pages() -> dict[str, str]:
    """Return page -> what is written in it by hand, without code blocks."""
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
    names = {path.relative_to(ROOT).as_posix(): path for path in paths}
    apart = ("docs/decisions/", "docs/gallery/")
    return {
        name: strip(path.read_text(encoding="utf-8"))
        for name, path in names.items()
        if not name.startswith(apart)
    }


def strip(text: str) -> str:
    return HIDDEN.sub("", GENERATED.sub("", text))


def split_units(text: str) -> list[str]:
    """Return paragraphs, headings, items of lists and rows of tables, each in one line."""
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:[-*|#>]|\d+\.) ?)", text)
    return [" ".join(part.split()) for part in parts if part.strip()]


def split_sentences(unit: str) -> list[str]:
    """Return the sentences of a unit; cells of a table are some each."""
    return [
        sentence for cell in unit.split(" | ") for sentence in re.split(r"(?<=[.!?])\s+(?=[A-Z`*\[])", cell)
    ]


def normalise(sentence: str) -> str:
    return " ".join(re.findall(r"[\w.+-]*\w", LINK.sub(r"\1", sentence).lower()))


# --- sentences ---------------------------------------------------------------------------------------


def find_repeated_sentences(pages: Mapping[str, str]) -> list[str]:
    """Return runs of twelve words, within a sentence, that stand on two pages.

    Words are compared without markup, case and targets of links: a sentence of twelve words or more is found
    again where its beginning or end was changed. Sentences that name a commit are provenance, and may recur.
    """
    places: dict[str, set[str]] = {}
    for page, text in pages.items():
        for sentence in (sentence for unit in split_units(text) for sentence in split_sentences(unit)):
            if re.search(r"\bcommit [0-9a-f]{7}", sentence):
                continue
            words = normalise(sentence).split()
            for first in range(len(words) - RUN + 1):
                places.setdefault(" ".join(words[first : first + RUN]), set()).add(page)
    found = {" and ".join(sorted(on)): run for run, on in reversed(places.items()) if len(on) > 1}
    return [f"{pair}: {run}" for pair, run in found.items()]


# --- counts ------------------------------------------------------------------------------------------

WORDS = ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven"]
NUMBER = r"\d[\d,]*|" + "|".join(WORDS[2:])


def list_counts() -> dict[str, int]:
    """Return noun, as a pattern -> the count that the code knows."""
    integrators = len(INTEGRATORS)
    return {
        "verbs": len(find_verbs()),
        "quantities": len(QUANTITIES),
        "presets": len(PRESETS),
        "formulations": len(FORMULATIONS),
        "(?:integrators|integration methods|methods of integration)": integrators,
        "(?:example scenes|examples)": len(list_examples()),
        "(?:structures|scenes|examples) (?:in|of) the gallery": len(list((DOCS / "gallery").glob("*.md"))),
        r"structures\]\(gallery\.md\)": len(list((DOCS / "gallery").glob("*.md"))),
    }


def find_counts(pages: Mapping[str, str]) -> list[str]:
    """Return numbers before a noun that the code counts: its count, or any number behind `all`."""
    found = []
    for noun, count in list_counts().items():
        pattern = re.compile(rf"(?:\b(all) )?\b({NUMBER}) {noun}(?!\w)", re.IGNORECASE)
        for page, text in pages.items():
            for unit in split_units(text):
                for match in pattern.finditer(unit):
                    word = match[2].lower().replace(",", "")
                    number = int(word) if word.isdigit() else WORDS.index(word)
                    if number == count or match[1]:
                        found.append(f"{page}: {match[0]}")
    return found


# --- defaults ----------------------------------------------------------------------------------------


def list_names() -> set[str]:
    """Return the keys of scenes and the options of the command line, as words."""
    names: set[str] = set()

    def collect(node: Any) -> None:
        if isinstance(node, dict):
            properties = node.get("properties")
            names.update(properties if isinstance(properties, dict) else ())
            for value in node.values():
                collect(value)
        elif isinstance(node, list):
            for value in node:
                collect(value)

    collect(scene_json_schema())
    stored = json.loads((ROOT / "tests" / "cli" / "options.json").read_text(encoding="utf-8"))
    names.update(option.lstrip("-").replace("-", "_") for options in stored.values() for option in options)
    return {name for name in names if len(name) > 1}


VALUE = r"[`\"(]*(?:-?\d|true\b|false\b|none\b|\"|`(?!-))"
STATED = re.compile(
    rf"\bdefaults?\b(?: is| are| to| of|:)? {VALUE}"  # default 1e-6; defaults to `"auto"`; default: 3
    rf"|\b(?:is|are) {VALUE}[^,;.|]{{0,25}} by default"  # is 1e-7 by default
    rf"|(?<=\()(?:default|by default)\b[^)]*\)"  # (default ...)
    rf"|{VALUE}[^;.|]{{0,25}}(?:,| is| are)(?: which is)? the default\b(?! \w)",  # 5 is the default
    re.IGNORECASE,
)


def find_defaults(pages: Mapping[str, str]) -> list[str]:
    """Return defaults by hand: sentences, and columns `default` of tables of names.

    A sentence offends that has a key or an option between backticks, as `rtol` or `--rtol`, and a value at
    `default` (one of the forms of STATED). A table offends that has a column `default` and such a name in the
    first cell of a row.
    """
    names = list_names()
    found = []
    for page, text in pages.items():
        for unit in split_units(text):
            if "|" not in unit:
                sentences = split_sentences(unit)
                found += [
                    f"{page}: {match[0]} in: {sentence[:160]}"
                    for sentence in sentences
                    for match in STATED.finditer(sentence)
                    if names_of(sentence) & names
                ]
        for head, rows in find_tables(text):
            named = [row.split("|")[1].strip() for row in rows if names_of(row.split("|")[1]) & names]
            cells = [cell.strip().lower() for cell in head.strip("| ").split("|")]
            if "default" in cells and named:
                found.append(f"{page}: column default of {', '.join(named[:5])}")
            found += [
                f"{page}: {match[0]} in: {row[:160]}"
                for row in rows
                for match in STATED.finditer(row)
                if names_of(row) & names
            ]
    return found


def names_of(sentence: str) -> set[str]:
    words = re.findall(r"`-{0,2}([a-z][\w-]*)(?:[= ][^`]*)?`", sentence)
    return {word.replace("-", "_") for word in words}


def find_tables(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the head and the rows of each table."""
    lines = text.splitlines()
    for place, (line, after) in enumerate(pairwise(lines)):
        if line.startswith("|") and re.match(r"\|[ :-]+\|", after):
            rows = []
            for row in lines[place + 2 :]:
                if not row.startswith("|"):
                    break
                rows.append(row)
            yield line, rows


# --- limits ------------------------------------------------------------------------------------------

LIMITS = re.compile(
    r"^#{2,4} (?:Limits|Limitations|What (?:it|this) does not do|What is not in the model)$", re.MULTILINE
)


def find_limits(pages: Mapping[str, str]) -> list[str]:
    """Return pages with two sections of limits, and what differs from links `PAGE#limits` of limits.md."""
    count = {page: len(LIMITS.findall(text)) for page, text in pages.items()}
    links = re.findall(r"\]\(([\w/]+\.md)#limits\)", pages["docs/limits.md"])
    listed = {f"docs/{name}" for name in links}
    having = {page for page in pages if count[page]}
    return [
        *(f"{page}: {number} sections of limits" for page, number in count.items() if number > 1),
        *(f"{name}: linked twice from docs/limits.md" for name in {*links} if links.count(name) > 1),
        *(f"{page}: has a section of limits to which docs/limits.md has no link" for page in having - listed),
        *(f"{page}: has no section of limits, to which docs/limits.md links" for page in listed - having),
    ]


# --- the pages ---------------------------------------------------------------------------------------

CHECKS = (find_repeated_sentences, find_counts, find_defaults, find_limits)


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return read_pages()


@pytest.mark.parametrize("check", CHECKS)
def test_pages_say_everything_once(check: Any, pages: dict[str, str]) -> None:
    assert check(pages) == []


def test_the_four_limits_in_short_stand_between_marks() -> None:
    """Their text is compared in tests/test_documents.py."""
    short = (
        (DOCS / "limits.md").read_text(encoding="utf-8").partition("<!-- limits -->")[2].partition("<!--")[0]
    )
    lines = [line for line in short.splitlines() if line.startswith("- ")]
    assert len(lines) == 4
    for name, text in read_pages().items():
        assert not any(line in text for line in lines), name


LONG = "The tension of a slack cable is zero at all lengths below its rest length, whatever its rate is then."


@pytest.mark.parametrize(
    ("check", "planted", "clean"),
    [
        (find_repeated_sentences, f"And so: {LONG[4:-8]}.", LONG[:40]),
        (find_repeated_sentences, f"- {LONG.replace('slack', '[slack](glossary.md)')}", "A slack cable."),
        (find_repeated_sentences, f"| a | {LONG} |", f"```text\n{LONG}\n```"),
        (find_counts, f"It has {len(find_verbs())} verbs.", "It has three verbs."),
        (find_counts, "All 7 verbs have help.", "All verbs have help."),
        (find_counts, f"{WORDS[len(PRESETS)].capitalize()} presets are there.", "Two presets do."),
        (find_counts, "[All 12 structures](gallery.md)", "[All structures](gallery.md)"),
        (find_defaults, "`rtol` is 1e-7 by default.", "`rtol` is 1e-7 here."),
        (find_defaults, "`--samples N` (default 201) sets it.", "`--samples 201` sets it."),
        (find_defaults, "The step, `--step`, default 1e-3 s.", "The step, `--step`, has a default."),
        (find_defaults, '`polar_axis` defaults to `"auto"`.', "A word defaults to 3."),
        (find_defaults, "`--up z`, which is the default, keeps it.", "`--up z` is like the default case."),
        (find_defaults, "`damping`: 0 is the default.", "`damping` of 0 is allowed."),
        (
            find_defaults,
            "| key | default |\n|---|---|\n| `friction` | 0 |",
            "| key | unit |\n|---|---|\n| `mu` | 1 |",
        ),
        (find_defaults, "| a | b |\n|---|---|\n| `--rtol` | tolerance; default 1e-6 |", ""),
        (find_limits, "## Limits\n\n## Limits\n", "## Limits\n"),
        (find_limits, "none", "## Limits\n"),
    ],
)
def test_what_is_planted_is_found(check: Any, planted: str, clean: str) -> None:
    listed = "- **Structures**: [a](a.md#limits)"
    other = {"docs/b.md": LONG, "docs/limits.md": listed}
    assert check({**other, "docs/a.md": strip(planted)}) != []
    if clean:
        assert check({**other, "docs/a.md": strip(clean)}) == []


def test_what_is_generated_or_code_is_not_read() -> None:
    assert strip("a\n<!-- verbs: written by a test -->\nb\n<!-- end of verbs -->\nc").split() == ["a", "c"]
    assert strip("a\n```sh\nb\n```\nc\n").split() == ["a", "c"]
