"""Documents agree with the code: glossary, changelog, contributing guide, numbers in docs/."""

import re
from pathlib import Path

from tensegrity_codegen.codegen.integrators.events import MAX_IN_SUCCESSION
from tensegrity_codegen.system.version import VERSION
from tensegrity_codegen.tables.quantities import PARAMETERS, QUANTITIES

ROOT = Path(__file__).resolve().parent.parent


def document(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


# An entry of the glossary: its word, symbol and unit, names, meaning.
ENTRY = re.compile(r"^- \*\*(.+?)\*\*(?:, `(.+?)`)?(?: \[(.+?)\])?(?: \((.+?)\))?: (.+)$", re.MULTILINE)


def glossary_entries() -> list[tuple[str, ...]]:
    """Return the entries of the glossary; every item of its lists is one."""
    text = document("docs/glossary.md")
    found = ENTRY.findall(text)
    assert len(found) == text.count("\n- ") > 100
    return found


def test_the_glossary_gives_units_of_quantities_as_the_code_does() -> None:
    units = {
        name: unit
        for word, _, unit, names, _ in glossary_entries()
        for name in re.findall(r"`(\w+)`", names)
        if name in QUANTITIES and name.removeprefix("member_") == word.replace(" ", "_")
    }
    assert len(units) > 5
    assert units == {name: QUANTITIES[name].unit for name in units}


def test_the_glossary_names_every_run_time_parameter_of_members() -> None:
    text = document("docs/glossary.md")
    names = {"rest_length", "spring_constant", "axial_stiffness", "damping", "node_load", "gravity"}
    assert names <= set(PARAMETERS)
    assert [name for name in sorted(names) if f"`{name}`" not in text] == []


def test_no_word_of_the_glossary_has_two_meanings() -> None:
    words = [word for entry in glossary_entries() for word in entry[0].split(", ")]
    assert [word for word in words if words.count(word) > 1] == []


def test_the_readme_links_the_glossary_and_the_guide() -> None:
    text = document("README.md")
    assert "](docs/glossary.md)" in text
    assert "](CONTRIBUTING.md)" in text


def test_the_latest_release_of_the_changelog_is_the_version_of_the_package() -> None:
    text = document("CHANGELOG.md")
    releases = re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", text, re.MULTILINE)
    assert releases[0][0] == VERSION
    assert [date for _, date in releases] == sorted((date for _, date in releases), reverse=True)
    assert "## [Unreleased]\n" in text.partition(f"## [{VERSION}]")[0]


def test_every_section_of_the_changelog_has_one_of_the_usual_names_once() -> None:
    for release in re.split(r"^## ", document("CHANGELOG.md"), flags=re.MULTILINE)[1:]:
        names = re.findall(r"^### (?!Upgrading from )(.*)$", release, re.MULTILINE)
        assert names == [name for name in ("Added", "Changed", "Removed", "Fixed") if name in names], release


def test_every_path_in_the_contributing_guide_exists() -> None:
    text = document("CONTRIBUTING.md").partition("## Recipes")[2]
    names = re.findall(r"`((?:tensegrity_codegen|tests|docs|templates)/[\w./]*)`", text)
    assert names
    assert [name for name in names if not (ROOT / name).exists()] == []


def test_the_page_of_integrators_states_when_a_run_with_too_many_events_ends() -> None:
    text = document("docs/integrating_in_c.md").replace("\n", " ")
    assert set(re.findall(r"(\d+) in a row(?:,| within)", text)) == {str(MAX_IN_SUCCESSION)}
    assert set(re.findall(r"([\d,]+) trial steps in a row", text)) == {f"{10 * MAX_IN_SUCCESSION:,}"}


LIMITS = re.compile(r"(<!-- limits.*? -->\n)(.*?)(<!-- end of limits -->)", re.DOTALL)


def test_limits_in_short_are_those_of_their_page(update_golden: bool) -> None:
    """README and index have them from docs/limits.md, with links from where they stand."""
    found = LIMITS.search(document("docs/limits.md"))
    assert found is not None
    short = found[2]
    assert short.count("\n- ") + 1 == 4
    for name, folder in (("README.md", "docs/"), ("docs/index.md", "")):
        text = document(name)
        lines = re.sub(r"\]\((?=\w+\.md)", f"]({folder}", short)
        expected = LIMITS.sub(lambda place, lines=lines: place[1] + lines + place[3], text)
        assert lines in expected
        if update_golden:
            (ROOT / name).write_text(expected, encoding="utf-8", newline="\n")
        assert document(name) == expected, "run this test with --update-golden"
