"""Which packages the command line does not import: starting it is most of the time of short commands."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tensegrity_codegen
from tensegrity_codegen.cli import supervised

ROOT = Path(tensegrity_codegen.__file__).parent.parent
# Runs the command line in this process and says on stderr what it has loaded.
SCRIPT = """
import json, sys
from tensegrity_codegen.cli.app import main
try:
    main(sys.argv[1:])
finally:
    print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""
HEAVY = (
    "casadi",
    "cffi",
    "filelock",
    "jinja2",
    "matplotlib",
    "numpy",
    "platformdirs",
    "rich",
    "scipy",
    "tensegrity_codegen.codegen",
    "tensegrity_codegen.pipeline.compile_scene",
    "tensegrity_codegen.structure",
)


def find_loaded(*words: str) -> list[str]:
    """Return the modules that a command has loaded at its end."""
    environment = dict(os.environ) | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, env=environment, timeout=60
    )
    assert ended.returncode == 0, ended.stderr
    modules = json.loads(ended.stderr.splitlines()[-1])
    assert isinstance(modules, list)
    return modules


# What a motion with a library from the cache does not need; a model imports SciPy's parts when it needs them.
FOR_OTHERS = (
    *("casadi", "jinja2", "matplotlib", "scipy.integrate", "scipy.interpolate", "scipy.linalg"),
    *("scipy.optimize", "scipy.sparse", "scipy.special", "tensegrity_codegen.symbolic"),
    *("tensegrity_codegen.runtime.paths", "tensegrity_codegen.runtime.statics"),
    *("tensegrity_codegen.runtime.simulate.simulate_batch", "tensegrity_codegen.scene.formats"),
)


def test_a_motion_with_a_cached_library_imports_no_generator_and_no_part_of_scipy(prism: Path) -> None:
    words = ("simulate", str(prism), "--t-end", "0.01", "--json")
    find_loaded(*words)  # builds the library, unless it is in the cache
    assert sorted({*FOR_OTHERS} & {*find_loaded(*words)}) == []


@pytest.mark.parametrize(
    ("verb", "unused"),
    [
        ("equilibrium", ("scipy.optimize", "scipy.spatial", "scipy.special")),
        ("linearize", ("jinja2", "scipy.linalg", "scipy.optimize", "scipy.spatial", "scipy.special")),
    ],
)
def test_statics_with_a_cached_library_imports_no_part_of_scipy_that_it_does_not_call(
    verb: str, unused: tuple[str, ...], prism: Path
) -> None:
    find_loaded(verb, str(prism), "--json")  # builds the library, unless it is in the cache
    assert sorted({*unused, "casadi"} & {*find_loaded(verb, str(prism), "--json")}) == []


@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (("export", "csv", "{scene}", "--out", "tables", "--overwrite"), ("scipy.sparse", "casadi", "PIL")),
        (("analyse", "{scene}"), ("casadi", "matplotlib", "jinja2")),
        (("linearize", "{scene}"), ("tensegrity_codegen.runtime.statics.newton", "casadi")),
    ],
)
def test_verbs_with_warnings_import_neither_rich_nor_other_formats_and_searches(
    words: tuple[str, ...], unused: tuple[str, ...], prism: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(prism.parent)
    words = (*(word.format(scene=prism) for word in words), "--json")
    find_loaded(*words)  # builds the library, unless it is in the cache
    loaded = find_loaded(*words)
    assert sorted({*unused, "rich"} & {*loaded}) == []
    if "export" in words:
        modules = [name for name in loaded if name.startswith("tensegrity_codegen.export.export_")]
        assert modules == ["tensegrity_codegen.export.export_csv"]
        assert "tensegrity_codegen.cli.verbs.build" not in loaded


def test_schemas_of_sections_are_built_with_that_of_the_scene_which_is_validated() -> None:
    code = "from tensegrity_codegen.scene.schema.schema import Node, Scene\nimport json\n"
    code += "scene = {'name': 'a', 'nodes': {'n': {'position': [0, 0, 0]}}}\n"
    code += "before = [Node.__pydantic_complete__, Scene.__pydantic_complete__]\n"
    code += "Scene.model_validate(scene)\n"
    code += "print(json.dumps([before, [Node.__pydantic_complete__, Scene.__pydantic_complete__]]))"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert json.loads(ended.stdout) == [[False, False], [False, True]], ended.stderr


def test_the_command_line_looks_for_unused_objects_after_many_new_ones() -> None:
    code = "import gc, sys\nfrom tensegrity_codegen.cli import supervised\n"
    code += "supervised._run = lambda: print(gc.get_threshold()[0])\nsupervised.main()"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert ended.stdout.strip() == str(supervised.COLLECTED_AFTER), ended.stderr


def test_a_verb_is_imported_without_the_others() -> None:
    loaded = find_loaded("schema", "--help")
    assert sorted({*HEAVY} & {*loaded}) == []  # Typer imports Pydantic, to read options
    verbs = [name for name in loaded if name.startswith("tensegrity_codegen.cli.verbs.")]
    assert verbs == ["tensegrity_codegen.cli.verbs.schema"]
