"""The examples of all help texts run, in a folder that has what they presuppose."""

import ast
import shlex
from collections.abc import Sequence
from pathlib import Path

import pytest

from tensegrity_codegen.cli.verbs.examples import list_examples
from tests.cases import thorough
from tests.cli.conftest import Run
from tests.control.feedback.standing_prism import SCENE as STANDING

PACKAGE = Path(__file__).resolve().parents[2] / "tensegrity_codegen"
MARK = "Example: tensegrity-codegen "
TABLES = {
    "nodes.csv": "node,x,y,z,mass,anchored\na,0,0,0,,yes\nb,1,0,0,1,no\n",
    "members.csv": "member,kind,node_i,node_j,spring_constant\ns,cable,a,b,100\n",
}
# Words before an example that write what it reads.
BEFORE = {
    "identify": "simulate prism.toml --t-end 0.2 --samples 21 --out measured.csv",
    "show": "simulate prism.toml --t-end 0.1 --samples 11 --out prism.npz",
    "size": "equilibrium prism.toml --out settled.toml",
    "sweep case": "sweep prism.toml --do evaluate --over 'gravity[2]=-20:0:21' --out loads.zarr",
    "sweep summary": "sweep prism.toml --do evaluate --over 'gravity[2]=-20:0:5' --out loads.zarr",
}
ELSEWHERE = {
    "reproduce": "minutes: tests/studies/papers has its parts",
    "report": "minutes: tests/studies/work_precision",
    "stability": "minutes: tests/studies/stability",
    "cache": "would clear what other tests share: tests/cli/test_cache.py",
    "play": "needs a compiler for pages: tests/cli/test_play.py",
    "show": "draws a film of seconds in a page: tests/cli/test_show.py",
}
LONG = (
    "control",
    "plan",
    "sweep",
    "sweep case",
    "sweep summary",
    "export",
    "load-path",
    "simulate",
    "identify",
)


@pytest.mark.parametrize("words", [(), ("load-path",), ("simulate",), ("sweep",), ("check",)])
def test_help_cuts_no_sentence_and_lists_common_options_last(
    words: tuple[str, ...], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    text = run.good(*words, "--help").out
    assert max(map(len, text.splitlines())) <= 80
    assert [line for line in text.splitlines()[1:] if line.endswith("...")] == []
    if words:
        own, _, common = text.partition("Common options:")
        assert "--json" in common
        assert not {"--json", "--compiler", "--overwrite", "--all"} & set(
            own.partition("Options:")[2].split()
        )


def list_of_help() -> dict[str, str]:
    """Return the examples by verb and sub-command."""
    found = {}
    for path in sorted([*PACKAGE.glob("cli/verbs/*.py"), *PACKAGE.glob("analyses/*.py")]):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            text = (ast.get_docstring(node) or "") if isinstance(node, ast.FunctionDef | ast.ClassDef) else ""
            if MARK in text:
                words = " ".join(text.partition(MARK)[2].split())
                verb, sub = [*words.split(), ""][:2]
                found[f"{verb} {sub}" if sub in ("case", "summary") else verb] = words
    return found


def list_written(words: Sequence[str]) -> list[str]:
    return [words[k + 1] for k, word in enumerate(words[:-1]) if word in ("-o", "--out", "--page")]


def write_needed(words: Sequence[str], folder: Path) -> None:
    """Write the scenes and tables that a command reads."""
    scenes = {f"{name}.toml": text for name, text in list_examples().items()} | {"standing.toml": STANDING}
    for name, text in (scenes | TABLES).items():
        if name in words and name not in list_written(words):
            (folder / name).write_text(text, encoding="utf-8")


EXAMPLES = list_of_help()
RUN = [verb for verb in EXAMPLES if verb not in ELSEWHERE]


def test_every_verb_has_an_example() -> None:
    assert len(EXAMPLES) >= 30
    assert set(ELSEWHERE) | set(BEFORE) | set(LONG) <= set(EXAMPLES)


@pytest.mark.parametrize(
    "verb", [v for v in RUN if v not in LONG] + [*thorough(*(v for v in RUN if v in LONG))]
)
def test_the_example_of_a_help_text_runs(verb: str, run: Run, folder: Path) -> None:
    for package in {"sweep": ("zarr", "xarray", "SALib"), "plan": ("daqp",)}.get(verb.split()[0], ()):
        pytest.importorskip(package)
    words = shlex.split(EXAMPLES[verb])
    write_needed(words, folder)
    if verb in BEFORE:
        before = shlex.split(BEFORE[verb])
        write_needed(before, folder)
        run.good(*before)
    run.good(*words)
    for name in list_written(words):
        assert (folder / name).exists()
