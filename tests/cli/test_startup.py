"""Which packages the command line does not import: starting it is most of the time of short commands."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import tensegrity_codegen

ROOT = Path(tensegrity_codegen.__file__).parent.parent
# Runs the command line in this process and says on stderr what it has loaded.
SCRIPT = """
import json, sys
from tensegrity_codegen.cli import main
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
    "tensegrity_codegen.pipeline",
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


def test_a_verb_is_imported_without_the_others() -> None:
    loaded = find_loaded("schema", "--help")
    assert sorted({*HEAVY} & {*loaded}) == []  # Typer imports Pydantic, to read options
    verbs = [name for name in loaded if name.startswith("tensegrity_codegen.cli.verbs.")]
    assert verbs == ["tensegrity_codegen.cli.verbs.schema"]
