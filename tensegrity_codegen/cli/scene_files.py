"""Scenes that ship with the package."""

from importlib.resources import files

from tensegrity_codegen.system.errors import check_choice


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
    check_choice(name, known, "example", "examples")
    return known[name]
