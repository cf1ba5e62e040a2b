"""Long lines of C: what they are broken at, and that nothing else changes."""

import re

import pytest

from tensegrity_codegen.codegen.print.render import LONGEST, wrap_lines

NAMES = ", ".join(f"const parameter_{k}" for k in range(12))
SUM = " + ".join(f"coordinate[{k}]" for k in range(20))


def squeezed(text: str) -> str:
    return re.sub(r"\s+", " ", text)


@pytest.mark.parametrize(
    "line",
    [
        f"static int function({NAMES})",
        f"  const double t1 = {SUM};",
        f"  return a_function_of_a_name({SUM}, {SUM});",
        f"  if (function({', '.join(['NULL'] * 20)}) || !other({', '.join(['NULL'] * 10)})) {{",
        f'  printf("%s, scene %s, and a text with, commas + signs", {", ".join(["argument"] * 12)});',
    ],
)
def test_statements_go_on_with_the_same_words(line: str) -> None:
    found = wrap_lines(f"a;\n{line}\nb;\n").splitlines()
    assert max(map(len, found)) <= LONGEST
    assert (found[0], found[-1]) == ("a;", "b;")
    lead = len(line) - len(line.lstrip()) + 4
    assert all(item.startswith(" " * lead) for item in found[2:-1])
    assert squeezed("".join(item.strip() for item in found[1:-1])).replace(" ", "") == line.replace(" ", "")


def test_strings_stay_whole() -> None:
    text = '"a text, that would break, at its commas, if it were no text, and goes on"'
    words = ", ".join(f'"word{k}"' for k in range(8))
    found = wrap_lines(f"  const char *names[] = {{{words}, {text}}};")
    assert text in found
    assert max(map(len, found.splitlines())) <= LONGEST


def test_comments_go_on_as_comments() -> None:
    words = " ".join(f"word{k}" for k in range(40))
    for text in (f"/* {words} */", f"/* first\n * {words}\n */", f"  /* {words} */"):
        found = wrap_lines(text).splitlines()
        assert max(map(len, found)) <= LONGEST
        assert all(line.lstrip().startswith(("/*", "*")) for line in found)
        expected = [word for word in text.split() if word.strip("*/")]
        assert [word for line in found for word in line.split() if word.strip("*/")] == expected


def test_macros_go_on_behind_a_backslash() -> None:
    found = wrap_lines(f"#define LONG(a) \\\n  do_something({SUM}); \\\n  other(a)\n").splitlines()
    assert max(map(len, found)) <= LONGEST
    assert all(line.endswith(" \\") for line in found[:-1])
    assert found[-1] == "  other(a)"


def test_short_text_stays_as_it_is() -> None:
    text = "static int all_finite(const double *values, int count)\n{\n  return 1; /* , */\n}\n"
    assert wrap_lines(text) is text
