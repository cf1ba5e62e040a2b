"""Scenes that ship with the package, and texts that verbs write."""

from importlib.resources import files
from pathlib import Path

from tensegrity_codegen.system.errors import UnknownNameError, suggest
from tensegrity_codegen.system.files import replaced


def list_examples() -> dict[str, str]:
    """Return name -> text of the scenes that ship with the package."""
    folder = files("tensegrity_codegen.scene").joinpath("examples")
    found = {
        item.name.removesuffix(".toml"): item for item in folder.iterdir() if item.name.endswith(".toml")
    }
    return {name: found[name].read_text(encoding="utf-8") for name in sorted(found)}


def read_example(name: str) -> str:
    """Return the text of an example; UnknownNameError for a name that is none."""
    known = list_examples()
    if name not in known:
        raise UnknownNameError("unknown example", where="examples", given=name, hint=suggest(name, known))
    return known[name]


def write_text(text: str, path: Path, *, overwrite: bool) -> None:
    """Write a text file whole or not at all; OutputError where one exists and may not be replaced."""
    with replaced(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
