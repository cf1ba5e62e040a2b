"""Text that users read has no words of a private dialect.

Read are the string literals of the package, README, guides, docs and comments of generated
headers. Each word is listed with what to write instead, or why it is unclear. Module docstrings open with the
noun that they are about, and constants have names that say what they bound.
"""

import ast
import functools
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Pattern -> reason, or what to write instead.
DIALECT = {
    r"\btold\b": "write: reported, stated; `unless told otherwise`: unless given",
    r"\bheld to\b": "write: compared with, must meet",
    r"\bmended\b": "write: fixed",
    r"\bwhoever\b": "name the person or program",
    r"\bsaid twice\b|\bstands twice\b": "write: given twice",
    r"\bis none that\b": "say what is violated",
    r"(?<!->)\bwatch(es|ed)?\b": "write: monitors, checks; `run->watch` is a field",
    r"\brounds did not come together\b": "write: no convergence after N refinements",
    r"\bkeeps the runs apart\b": "write: rounding error prevents convergence",
    r"\bnobody\b": "name who or what; `nobody wants`: not requested",
    r"\bunasked\b": "write: by default",
    r"\bcome to the pole\b": "write: reached the pole",
    r"\bin so many words\b|\bthe last word\b": "a figure of speech",
    r"\bhas come to\b": "write: reached",
    r"\bwhat is held\b|\bhold it\b": "write: anchored; constant",
    r"\bhands? out\b": "write: returns",
    r"\b(is|are) baked in\b": "write: are constants in the code",
    r"\bby name resolves\b": "write: use method ...",
    r"\ba slip\b": "write: a mistake",
    r"\bwent well\b|\bended well\b": "write: succeeded",
    r"\bused up\b": "write: no convergence within ...",
    r"\bbeyond reason\b": "give the limit",
    r"\bhopeless\b": "state the reason",
    r"\bsays? so\b": "write what is reported",
    r"\bwants?\b": "write: needs, requests",
    r"\bin vain\b": "write: rejected, without result",
    r"\bleave (it|them) out\b": "write: remove, omit",
    r"\bas it pleases\b": "a figure of speech",
    r"\bgood enough\b": "give the criterion",
    r"\bmakes? friends\b": "a figure of speech",
}
WORDS = {pattern: re.compile(pattern, re.IGNORECASE) for pattern in DIALECT}
# Each pattern begins at the edge of a word: a position within a word is left after one look.
ANY_WORD = re.compile(rf"\b(?:{'|'.join(DIALECT)})", re.IGNORECASE)

# Names that a reader cannot look up: of constants, write what they bound (MAX_STALLED_ITERATIONS).
UNCLEAR_NAMES = {
    *("NEAR", "FAR", "LOST", "KEPT", "LOUDER", "PATIENCE", "STUCK", "CROWDED", "DOUBTED", "DEAD", "FADED"),
    *("EASED",),
    *("SOFT", "USELESS", "NOWHERE", "ENOUGH", "STILL", "TINY", "SAFE", "BALANCED", "WORTH", "CALM"),
    *("tell_left_out", "trust_in_radau", "way_out", "settled", "glide", "leash", "loudness", "crowd"),
}
MODULES = sorted((ROOT / "tensegrity_codegen").rglob("*.py"))


@functools.cache
def parse(path: Path) -> ast.Module:
    """Return the syntax tree of a module, which several tests read."""
    return ast.parse(path.read_text(encoding="utf-8"))


def find_texts(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Return line and text of the string literals of a module that are sentences, without docstrings."""
    skipped: set[int] = set()
    for node in ast.walk(tree):  # which comes to a definition before its docstring
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            if node.body and isinstance(node.body[0], ast.Expr):
                skipped.add(id(node.body[0].value))
            continue
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str) or id(node) in skipped:
            continue
        if " " in node.value.strip() and ";\n" not in node.value:  # not C text
            yield node.lineno, node.value


def without_figures(text: str) -> str:
    """Return a page without what a benchmark writes between two marks, and without code."""
    text = re.sub(r"<!-- figures:.*?<!-- end of figures -->", "", text, flags=re.DOTALL)
    return re.sub(r"```.*?```|`[^`]*`", "", text, flags=re.DOTALL)


def find_dialect(text: str) -> list[str]:
    if not ANY_WORD.search(text):
        return []
    return [pattern for pattern, word in WORDS.items() if word.search(text)]


def test_docstrings_of_modules_open_with_a_noun() -> None:
    opened = {path: ast.get_docstring(parse(path)) or "" for path in MODULES}
    questions = re.compile(r"(What|How|Which|Where|Whether|Who)\b")
    assert [str(path.relative_to(ROOT)) for path, text in opened.items() if questions.match(text)] == []


def test_names_of_constants_and_functions_are_plain() -> None:
    found = []
    for path in MODULES:
        for node in parse(path).body:
            names = [node.name] if isinstance(node, ast.FunctionDef) else []
            if isinstance(node, ast.Assign):
                names += [
                    item.id
                    for target in node.targets
                    for item in ast.walk(target)
                    if isinstance(item, ast.Name)
                ]
            found += [
                f"{path.relative_to(ROOT)}: {name}" for name in names if name.strip("_") in UNCLEAR_NAMES
            ]
    assert found == []


# Names of variables that say of nothing in particular what it is, and how many of 1,000 may be such.
VAGUE = {
    *("found", "given", "told", "kept", "known", "wanted", "asked", "taken", "left", "said", "own"),
    *("nothing", "one", "other", "others", "rest", "part", "parts", "item", "items", "place", "places"),
    *("share", "shares", "first", "last", "least", "most", "both", "each", "whole", "apart", "near"),
    *("far", "more", "word", "words", "what", "which", "where", "there", "behind", "beside", "text"),
}
MAX_VAGUE = 20.0
# Of 1,000 words in docstrings and comments: nouns instead of clauses.
MAX_CLAUSES = {"what": 3.0, "where": 5.0}


def test_variables_are_named_by_nouns() -> None:
    counts = Counter(
        node.id
        for path in MODULES
        for node in ast.walk(parse(path))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    )
    assert 1000 * sum(counts[name] for name in VAGUE) / counts.total() <= MAX_VAGUE


def test_prose_in_code_has_few_clauses() -> None:
    counts: Counter[str] = Counter()
    for path in MODULES:
        texts = [
            ast.get_docstring(node) or ""
            for node in ast.walk(parse(path))
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        ]
        texts += [line.partition("#")[2] for line in path.read_text(encoding="utf-8").splitlines()]
        counts.update(re.findall(r"[a-z']+", " ".join(texts).lower()))
    rates = {word: 1000 * counts[word] / counts.total() for word in MAX_CLAUSES}
    assert {word: rate for word, rate in rates.items() if rate > MAX_CLAUSES[word]} == {}


def test_messages_of_the_package_have_no_words_of_dialect() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text!r}: {', '.join(find_dialect(text))}"
        for path in MODULES
        for line, text in find_texts(parse(path))
        if find_dialect(text)
    ]
    assert found == []


@pytest.mark.parametrize(
    "name",
    [
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")),
    ],
)
def test_documents_have_no_words_of_dialect(name: str) -> None:
    text = without_figures((ROOT / name).read_text(encoding="utf-8"))
    lines = [f"{line}: {', '.join(find_dialect(line))}" for line in text.splitlines() if find_dialect(line)]
    assert lines == []


@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / "generated").glob("*")))
def test_comments_of_generated_headers_have_no_words_of_dialect(name: str) -> None:
    headers = (ROOT / "generated" / name).glob("*.h")
    comments = [text for path in headers for text in re.findall(r"/\*.*?\*/", path.read_text(), re.DOTALL)]
    assert [text for text in comments if find_dialect(text)] == []


C_FILES = sorted(
    path for path in (ROOT / "templates").rglob("*") if path.name.endswith((".h", ".c", ".c.j2", ".h.j2"))
)
C_WORDS = re.compile(r"\b(?:\w+_)?(glide|glides|glided|leash|loudness|crowd|n_stalled|stand|lands)\b")


def find_c_words(text: str) -> list[str]:
    """Return the words that are not used in comments and names of C."""
    comments = re.findall(r"/\*.*?\*/", text, re.DOTALL)
    names = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)
    in_comments = re.findall(r"\b(glides?|glided|leash|loudness|crowd)\b", " ".join(comments))
    return [*in_comments, *(match[1] for match in C_WORDS.finditer(names))]


@pytest.mark.parametrize("path", C_FILES, ids=lambda path: path.relative_to(ROOT / "templates").as_posix())
def test_c_has_plain_names_and_comments(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert find_c_words(text) == []
    assert [line for line in text.splitlines() if line.startswith(",")] == []


def test_every_field_of_a_run_says_what_it_holds() -> None:
    text = (ROOT / "templates/c/run.h").read_text(encoding="utf-8")
    fields = dict(re.findall(r"^  (?:int|double) (\w+);(.*)$", text, re.MULTILINE))
    internal = {
        "n_rapid_events",
        "n_close_events",
        "n_trials",
        "progress_time",
        "time_to_event",
        "usual_step",
    }
    internal |= {"step_limit", "step_to_event", "time_behind_step", "noise_factor", "last_event", "reached"}
    assert fields.keys() >= internal
    assert not fields.keys() & {"succession", "mark", "ahead", "pace", "cut"}
    assert [name for name in internal if not fields[name].lstrip().startswith("/*")] == []


def test_a_word_of_c_is_found() -> None:
    assert find_c_words("/* a glide */ int radau_stand(double loudness); run->leash = 1; double crowd;") == [
        *("glide", "stand", "loudness", "leash", "crowd")
    ]


def test_every_pattern_begins_at_the_edge_of_a_word() -> None:
    branches = [branch for pattern in DIALECT for branch in re.split(r"\|(?![^(]*\))", pattern)]
    assert [branch for branch in branches if not re.match(r"(\(\?<!->\))?\\b", branch)] == []


def test_a_word_of_dialect_is_found() -> None:
    assert find_dialect("what watches no condition") == [r"(?<!->)\bwatch(es|ed)?\b"]
    assert list(find_texts(ast.parse('"""Nobody."""\nx = "nobody wants them"\n'))) == [
        (2, "nobody wants them")
    ]
