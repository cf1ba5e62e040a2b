import sys
from pathlib import Path

import pytest

from tensegrity_codegen.cli import analysis_verb, verbs
from tensegrity_codegen.cli.app import find_verbs


def test_every_file_is_a_verb_with_a_place_of_its_own() -> None:
    found = find_verbs()
    files = [path for path in Path(verbs.__file__).parent.glob("*.py") if path.name != "__init__.py"]
    made = [name for name in analysis_verb.list_modules() if analysis_verb.read_verb(name) is not None]
    assert len(found) == len(files) + len(made)
    assert {"equilibrium", "linearize", "analyse", "stand"} <= set(made)
    assert len({verb.order for verb in found}) == len(found)


def test_a_verb_is_added_by_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        "from tensegrity_codegen.cli.verb import Verb\n\n\n"
        "def greet() -> None:\n    'Greet.'\n\n\n"
        "VERB = Verb(greet, order=1)\n"
    )
    (tmp_path / "greet_for_test.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(verbs, "__path__", [*verbs.__path__, str(tmp_path)])
    try:
        assert find_verbs()[0].run.__name__ == "greet"
    finally:
        sys.modules.pop("tensegrity_codegen.cli.verbs.greet_for_test", None)
