"""The house itself: verbs, checks, floors, and documents that say what the code does."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from tensegrity_codegen.cli.app import app
from tensegrity_codegen.tables.quantities import QUANTITIES
from tests.cli.test_startup import HEAVY, find_loaded
from tests.test_english import MODULES, parse

ROOT = Path(__file__).resolve().parent.parent
VERBS = [
    *(
        "bench",
        "check",
        "clean",
        "contracts",
        "demo",
        "docs",
        "examples",
        "figures",
        "format",
        "golden",
        "help",
    ),
    *("lint", "setup", "test", "test-all", "types", "wheel"),
]
in_checkout = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs the git checkout")
with_make = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")


def run(*command: str, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    kept = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    return subprocess.run(
        command, cwd=folder, env=kept | environment, capture_output=True, text=True, check=False
    )


def document(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


# --- verbs and checks ------------------------------------------------------------------------------


@with_make
def test_make_alone_lists_every_verb_with_a_sentence() -> None:
    listed = re.findall(r"^  make ([a-z-]+) +\S.*$", run("make").stdout, re.MULTILINE)
    assert sorted(listed) == VERBS


@with_make
def test_every_verb_can_be_planned() -> None:
    done = run("make", "-n", *VERBS)
    assert done.returncode == 0, done.stderr


@with_make
def test_make_test_runs_the_tests_and_names_the_checks() -> None:
    plan = run("make", "-n", "test").stdout
    assert "make check" in plan
    assert "pytest -n" in plan
    assert "ruff" not in plan
    checks = run("make", "-n", "check").stdout
    assert all(tool in checks for tool in ("ruff check", "ruff format --check", "/mypy", "lint-imports"))


@with_make
def test_make_test_all_runs_the_tests_that_make_test_leaves_out() -> None:
    plan = run("make", "-n", "test-all").stdout
    selected = re.findall(r'pytest (?:.* )?-m "?(.+?)"?$', plan, re.MULTILINE)
    assert selected == ["not thorough and not peers", "peers", "thorough and not peers"]
    assert "make --no-print-directory check\n" in document(".ci/run")
    assert "make --no-print-directory test\n" in document(".ci/run")


@with_make
def test_the_demo_installs_no_tools_of_tests(tmp_path: Path) -> None:
    plan = run("make", "-n", "demo", f"VENV={tmp_path / 'environment'}").stdout
    assert "'.[plot" in plan
    assert "dev" not in plan


@with_make
def test_setup_says_what_is_missing_when_python_is_too_old(tmp_path: Path) -> None:
    old = tmp_path / "python3.8"
    script = '#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.8.0" && exit 0\nexit 1\n'
    old.write_text(script, encoding="utf-8")
    old.chmod(0o755)
    done = run("make", "setup", f"PYTHON={old}", f"VENV={tmp_path / 'environment'}")
    assert done.returncode != 0
    assert "Python 3.8.0; Python 3.11 or newer is needed" in done.stdout
    assert not (tmp_path / "environment").exists()


@with_make
def test_setup_says_so_when_there_is_no_python(tmp_path: Path) -> None:
    done = run("make", "setup", "PYTHON=", f"VENV={tmp_path / 'environment'}")
    assert done.returncode != 0
    assert "PYTHON=" in done.stdout


def test_the_checks_are_one_executable_script_that_stops_at_the_first_failure() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    text = script.read_text(encoding="utf-8")
    assert text.startswith("#!/usr/bin/env bash\n")
    assert "set -euo pipefail" in text
    assert run("bash", "-n", str(script)).returncode == 0


@in_checkout
def test_no_file_names_a_path_of_one_machine() -> None:
    # The brackets keep this pattern from finding itself.
    pattern = r"(^|[^A-Za-z0-9_.])/(w[o]rk|t[m]p|r[o]ot|h[o]me|U[s]ers)/"
    done = run("git", "grep", "-nIE", pattern)
    assert done.returncode == 1, done.stdout


@in_checkout
def test_no_file_names_a_package_registry() -> None:
    done = run("git", "grep", "-nIiE", r"p[y]pi\.org|python[h]osted|--index[-]url|--extra-index[-]url")
    assert done.returncode == 1, done.stdout


# --- floors ----------------------------------------------------------------------------------------


# A line that is added to a module, and the contract that it breaks.
BREAKS = (
    ("scene/read.py", "import tensegrity_codegen.runtime.integrate.rk4", "Imports point down"),
    ("structure/structure.py", "import tensegrity_codegen.scene.checks.check", "Imports point down"),
    ("runtime/integrate/rk4.py", "import tensegrity_codegen.codegen.compilation.flags", "Imports point down"),
    ("a_new_module.py", '"""Nobody gave me a floor."""', "Imports point down"),
    (
        "runtime/integrate/rk4.py",
        "import casadi",
        "A compiled model runs without CasADi and without what made it",
    ),
    ("scene/read.py", "import casadi", "Scenes are read without CasADi"),
    (
        "symbolic/formulations/another.py",
        "import tensegrity_codegen.symbolic.formulations.node_position",
        "Formulations do not know each other",
    ),
    (
        "runtime/statics/newton.py",
        "import tensegrity_codegen.runtime.simulate.simulate",
        "Rooms of the run time",
    ),
    (
        "codegen/table/members/model.py",
        "import tensegrity_codegen.codegen.table.members.member_loops",
        "No import circle",
    ),
)
# Checks the package in the working folder as it is and with each line, in one process.
LINT_EACH = r"""
import contextlib, io, json, re, sys
from pathlib import Path
from importlinter.cli import lint_imports_command
def find_broken():
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        lint_imports_command.main(["--no-cache"], standalone_mode=False)
    kept = re.findall(r"^(.+) KEPT$", text.getvalue(), re.MULTILINE)
    return len(kept), re.findall(r"^(.+) BROKEN$", text.getvalue(), re.MULTILINE)
found = [find_broken()]
for module, line, _ in json.loads(sys.argv[1]):
    path = Path("tensegrity_codegen") / module
    before = path.read_bytes() if path.exists() else None
    path.write_bytes((before or b"") + b"\n" + line.encode() + b"\n")
    found.append(find_broken())
    path.unlink() if before is None else path.write_bytes(before)
print(json.dumps(found))
"""


@pytest.mark.thorough
def test_imports_keep_to_the_floors_and_one_against_them_is_found(tmp_path: Path) -> None:
    shutil.copytree(
        ROOT / "tensegrity_codegen",
        tmp_path / "tensegrity_codegen",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    command = (sys.executable, "-c", LINT_EACH, json.dumps(BREAKS))
    done = run(*command, folder=tmp_path, PYTHONPATH=str(tmp_path), COLUMNS="200")
    assert done.returncode == 0, done.stderr
    (kept, broken), *others = json.loads(done.stdout)
    assert (kept, broken) == (document("pyproject.toml").count("[[tool.importlinter.contracts]]"), [])
    for (module, line, contract), (_, broken) in zip(BREAKS, others, strict=True):
        assert contract in broken, (module, line)


def test_modules_that_need_no_casadi_do_not_load_it() -> None:
    modules = ("runtime.simulate.simulate", "runtime.statics.equilibrium", "scene.assemble.assemble")
    code = "import sys\n"
    for module in (*modules, "pipeline", "cli.app"):
        code += f"import tensegrity_codegen.{module}\nassert 'casadi' not in sys.modules, '{module}'\n"
    done = run(sys.executable, "-c", code)
    assert done.returncode == 0, done.stderr


def test_the_list_of_verbs_imports_no_package_that_computes() -> None:
    loaded = find_loaded("--help")  # a module of cli/ imports these inside functions
    assert sorted({*HEAVY, "pydantic"} & {*loaded}) == []


# Lines of Python that a room may have; who needs more changes the number in the same commit, and says why.
MAX_LINES = {
    "analyses": 5_675,  # options of estimators in sweeps, pages of equilibria
    "cli": 5_350,  # bodies in `check`
    "codegen": 11_100,  # bodies beside bars
    "control": 14_450,  # margins of stiffness, start errors of stiff members, doubts of units, steps in time
    "export": 3_300,  # bodies
    "learning": 2_150,  # environments; derivatives
    "live": 1_300,
    "pipeline": 3_870,  # needs of derivatives; sizes of nearly singular shapes; weights of shapes found
    "report": 6_050,  # surfaces of bodies, pages of load paths and of equilibria with loads and sections
    "runtime": 22_325,  # bodies in motions and statics; turns onto feet
    "scene": 13_640,  # rigid bodies with parts, and their import with reasons; doubts of units
    "structure": 3_750,  # rigid bodies
    "studies": 7_900,
    "sweeps": 8_950,  # bodies
    "symbolic": 6_400,  # rigid bodies
    "system": 2_200,
    "tables": 3_150,  # bodies in the manifest, and their names in texts
}


@pytest.mark.parametrize("room", MAX_LINES)
def test_rooms_keep_to_their_budget_of_lines(room: str) -> None:
    paths = (ROOT / "tensegrity_codegen" / room).rglob("*.py")
    lines = sum(path.read_text(encoding="utf-8").count("\n") for path in paths)
    assert lines <= MAX_LINES[room], f"{room} has {lines} lines"


def test_every_room_has_a_budget_of_lines() -> None:
    folders = {path.parent.name for path in (ROOT / "tensegrity_codegen").glob("*/__init__.py")}
    assert folders == {*MAX_LINES}


@pytest.mark.parametrize("room", ["runtime", "codegen", "scene"])
def test_no_folder_has_more_than_fifteen_modules(room: str) -> None:
    top = ROOT / "tensegrity_codegen" / room
    for folder in (top, *(path for path in top.rglob("*") if path.is_dir())):
        modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        assert len(modules) <= 15, f"{folder.relative_to(ROOT)} has {len(modules)} modules"


MOST_PARAMETERS = 12


def test_functions_have_few_parameters() -> None:
    """What belongs together is an object; options of a verb are dataclasses."""
    many = []
    for path in MODULES:
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.FunctionDef):
                count = len([*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs])
                if count > MOST_PARAMETERS:
                    many.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name} has {count}")
    assert many == []


# --- documents -------------------------------------------------------------------------------------


@in_checkout
def test_every_relative_link_of_a_document_leads_somewhere() -> None:
    tracked = run("git", "ls-files", "*.md").stdout.split()
    missing = [
        f"{name}: {target}"
        for name in tracked
        for target in re.findall(r"\]\(([^)\s]+)\)", document(name))
        if not target.startswith(("http", "#"))
        and not (ROOT / name).parent.joinpath(target.partition("#")[0]).exists()
    ]
    assert missing == []


def test_the_page_of_the_command_line_lists_every_verb() -> None:
    section = document("docs/reference/command_line.md").partition("## All verbs")[2].partition("\n## ")[0]
    verbs = re.findall(r"^\| `([a-z-]+)` \|", section, re.MULTILINE)
    assert sorted(verbs) == sorted(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


@pytest.mark.filterwarnings("error")
def test_the_python_of_the_readme_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = re.search(r"```python\n(.*?)```\n\n```text\n(.*?)```", document("README.md"), re.DOTALL)
    assert code is not None
    example = "tensegrity_codegen/scene/examples/prism.toml"
    shutil.copy(ROOT / example, tmp_path)
    monkeypatch.chdir(tmp_path)
    exec(compile(code[1], "README.md", "exec"), {})
    assert capsys.readouterr().out == code[2]


def test_the_map_of_folders_names_every_room() -> None:
    table = document("CONTRIBUTING.md").partition("## Layout")[2].partition("\n## ")[0]
    rooms = {path.name for path in (ROOT / "tensegrity_codegen").iterdir() if (path / "__init__.py").exists()}
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == rooms
    assert len(rooms) == 17


def test_the_citation_has_the_version_and_date_of_the_latest_release() -> None:
    version, date = re.findall(r"^## \[([\d.]+)\] - (\S+)$", document("CHANGELOG.md"), re.MULTILINE)[0]
    assert f"\nversion: {version}\ndate-released: {date}\n" in document("CITATION.cff")


def test_the_pages_of_the_model_define_what_the_table_of_quantities_holds() -> None:
    pages = ("model", *re.findall(r"^\| \[(\w+)\]", document("docs/model.md"), re.MULTILINE))
    text = "".join(document(f"docs/{page}.md") for page in pages).replace(r"\_", "_")  # in formulas
    assert [name for name in QUANTITIES if name not in text] == []
