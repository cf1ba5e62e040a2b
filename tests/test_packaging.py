"""The sdist and the wheel hold what is needed, and an installed wheel works away from the checkout."""

import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tensegrity_codegen.cli.app import find_verbs
from tensegrity_codegen.live.three_module import BUNDLED, write_three
from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
from tensegrity_codegen.system.errors import MissingSourceError
from tensegrity_codegen.system.version import VERSION
from tests.cli.test_help_examples import BEFORE, ELSEWHERE, EXAMPLES, write_needed

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).resolve().parent.parent
TEMPLATES = sorted(
    path.relative_to(ROOT / "templates").as_posix()
    for path in (ROOT / "templates").rglob("*.*")
    if path.suffix in (".j2", ".c", ".h", ".js", ".css") and path.parent.name != "three"
)
THREE = [f"templates/live/three/{name}" for name in BUNDLED]
LEFT_OUT = (".git", ".venv", ".*_cache", "__pycache__", "output", "dist", "build", "three")
SCENES = sorted(path.name for path in (ROOT / "tensegrity_codegen/scene/examples").glob("*.toml"))
MODULES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "tensegrity_codegen").rglob("*.py")
    if "__pycache__" not in path.parts
)

# Short commands of the verbs whose example in their help takes minutes.
SHORT = {
    "cache": "cache --clear",
    "play": "play two_nodes.toml --out play.html",
    "report": "report two_nodes.toml --t-end 0.01 --samples 3 --longest 0.01 --no-peers --out report",
    "reproduce": "reproduce sk --quick --out reproduction",
    "show": "show prism.toml --out prism.png",
    "stability": "stability two_nodes.toml --budget 5 --limit 0.5 --no-peers --out stability",
}
COMMANDS = {verb: words for verb, words in EXAMPLES.items() if verb not in ELSEWHERE} | SHORT
EXTRAS = "plot,cc,control,sweep"

# From example scene to C text, with everything that the wheel brings along.
RENDER = """
import pathlib, sys
import tensegrity_codegen
from importlib.resources import files
from tensegrity_codegen import load_scene
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.print.render import template_folder
home = pathlib.Path(tensegrity_codegen.__file__).parent
assert template_folder() == home / "templates", template_folder()
scene = files("tensegrity_codegen.scene").joinpath("examples/prism.toml")
source = emit(*load_scene(str(scene)))
print(home)
print(*sorted(source.files))
print(len(source.files["prism.c"]))
"""


def run(*command: str | Path, folder: Path, **environment: str) -> str:
    """Return stdout of a command; a failure shows all that it wrote."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=folder,
        env=kept | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def build(folder: Path, **environment: str) -> Path:
    """Copy the checkout into a folder and build there as `make wheel` does."""
    copy = folder / "source"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*LEFT_OUT))
    try:
        write_three(copy / "templates" / "live" / "three")
    except MissingSourceError as error:
        pytest.skip(f"{error.problem} ({error.given})")
    words = (sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, copy)
    run(*words, folder=folder, **environment)
    return folder


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist, and the wheel that was built from the sdist."""
    return build(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def fresh(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command in a new environment with the wheel and its extras, from pip."""
    folder = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", folder, folder=folder)
    wheel = f"{next(dist.glob('*.whl'))}[{EXTRAS}]"
    pip = (folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    try:
        run(*pip, wheel, folder=folder)
    except AssertionError as error:
        if not re.search("No matching distribution|NewConnectionError|Temporary failure", str(error)):
            raise
        pytest.skip(f"pip cannot reach the packages that the wheel needs: {str(error).splitlines()[-1]}")
    return folder / "bin" / "tensegrity-codegen"


@pytest.fixture(scope="module")
def installed(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed and nothing else."""
    target = tmp_path_factory.mktemp("installed")
    wheel = next(dist.glob("*.whl"))
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-index")
    run(*pip, "--no-deps", "--target", target, wheel, folder=target)
    return target


def test_the_sdist_holds_all_that_the_project_is_built_and_tested_with(dist: Path) -> None:
    with tarfile.open(dist / f"tensegrity_codegen-{VERSION}.tar.gz") as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted = {
        *MODULES,
        *(f"templates/{name}" for name in TEMPLATES),
        *THREE,
        *(f"tensegrity_codegen/scene/examples/{name}" for name in SCENES),
        *("tensegrity_codegen/py.typed", "pyproject.toml", "Makefile", "README.md", "CHANGELOG.md"),
        *("CONTRIBUTING.md", "LICENSE", "CITATION.cff", ".ci/run"),
        *("tests/test_packaging.py", "docs/model.md", "docs/decisions/0001-floors.md"),
        *("examples/run.py", "examples/mast.toml", "examples/c/mast.c", "examples/rust/src/main.rs"),
    }
    assert wanted - names == set()


def test_the_wheel_holds_modules_templates_examples_and_types_and_nothing_else(dist: Path) -> None:
    with zipfile.ZipFile(next(dist.glob("*.whl"))) as archive:
        names = set(archive.namelist())
    info = f"tensegrity_codegen-{VERSION}.dist-info/"
    wanted = {
        *MODULES,
        *(f"tensegrity_codegen/templates/{name}" for name in TEMPLATES),
        *(f"tensegrity_codegen/{name}" for name in THREE),
        *(f"tensegrity_codegen/scene/examples/{name}" for name in SCENES),
        *(
            path.relative_to(ROOT).as_posix()
            for path in ROOT.glob("tensegrity_codegen/studies/papers/data/*.*")
        ),
        "tensegrity_codegen/py.typed",
    }
    assert {name for name in names if not name.startswith(info)} == wanted
    assert f"{info}licenses/LICENSE" in names


def test_the_installed_command_line_answers_away_from_the_checkout(installed: Path, tmp_path: Path) -> None:
    text = run(
        sys.executable, "-m", "tensegrity_codegen", "--help", folder=tmp_path, PYTHONPATH=str(installed)
    )
    assert "simulate" in text
    assert "import" in text


def test_the_installed_package_lists_its_examples(installed: Path, tmp_path: Path) -> None:
    command = (sys.executable, "-m", "tensegrity_codegen", "examples")
    text = run(*command, folder=tmp_path, PYTHONPATH=str(installed))
    assert [name for name in SCENES if name.removesuffix(".toml") not in text] == []


def test_the_installed_package_renders_with_its_own_templates(installed: Path, tmp_path: Path) -> None:
    text = run(sys.executable, "-c", RENDER, folder=tmp_path, PYTHONPATH=str(installed))
    home, files, size = text.splitlines()
    assert Path(home) == installed / "tensegrity_codegen"
    assert files.split() == ["Makefile", "example.c", "manifest.json", "prism.c", "prism.h"]
    assert int(size) > 10_000


def test_the_installed_package_writes_live_pages_without_a_network(installed: Path, tmp_path: Path) -> None:
    scene = installed / "tensegrity_codegen/scene/examples/two_nodes.toml"
    cache = tmp_path / "empty"
    cache.mkdir(mode=0o700)
    words = ("show", scene, "--out", tmp_path / "two.html", "--modes", "0")
    offline = {"PIP_NO_INDEX": "1", "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(installed)}
    run(sys.executable, "-m", "tensegrity_codegen", *words, folder=tmp_path, **offline)
    page = (tmp_path / "two.html").read_text(encoding="utf-8")
    assert "three.js authors" in page
    assert not list(cache.rglob("*.whl"))


def test_two_builds_at_different_times_and_places_give_the_same_bytes(
    dist: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = build(tmp_path_factory.mktemp("elsewhere"), TZ="Pacific/Auckland", LC_ALL="C", PYTHONHASHSEED="7")
    hashes = [
        {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("tensegrity*")}
        for folder in (dist, other)
    ]
    assert len(hashes[0]) == 2
    assert hashes[0] == hashes[1]


def test_every_verb_has_a_command_for_the_installed_wheel() -> None:
    assert {verb.word for verb in find_verbs()} <= {command.split()[0] for command in COMMANDS.values()}


@pytest.mark.timeout(900)
@pytest.mark.parametrize("verb", COMMANDS)
def test_the_installed_wheel_runs_every_verb(verb: str, fresh: Path, tmp_path: Path) -> None:
    cache = fresh.parent.parent / "cache"  # its own, shared by the verbs of this environment
    cache.mkdir(mode=0o700, exist_ok=True)
    for words in (BEFORE.get(verb) if COMMANDS[verb] == EXAMPLES[verb] else None, COMMANDS[verb]):
        if words is not None:
            write_needed(shlex.split(words), tmp_path)
            alone = {CACHE_VARIABLE: str(cache), "PYTHONNOUSERSITE": "1"}
            run(fresh, *shlex.split(words), folder=tmp_path, **alone)


def test_the_console_script_is_declared(installed: Path) -> None:
    text = (installed / f"tensegrity_codegen-{VERSION}.dist-info" / "entry_points.txt").read_text("utf-8")
    assert "tensegrity-codegen = tensegrity_codegen.cli.supervised:main" in text


def test_the_demo_runs_again_over_results_of_former_versions() -> None:
    recipe = [
        line for line in (ROOT / "Makefile").read_text().splitlines() if line.startswith("\t$(TENSEGRITY)")
    ]
    assert len(recipe) >= 4
    assert all("--overwrite" in line for line in recipe if "--out" in line)
