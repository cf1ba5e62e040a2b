"""Scenes that ship with the package, and the files that verbs write."""

from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.extras import require_plot
from tensegrity_codegen.system.files import check_ending, check_output, write_text

if TYPE_CHECKING:
    from tensegrity_codegen.report.pages.page import Page


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


def write_page(page: "Page", path: Path, *, overwrite: bool) -> None:
    """Write a page whole or not at all; OutputError where one exists and may not be replaced."""
    from tensegrity_codegen.report.pages.page import render_page

    write_text(render_page(page), path, overwrite=overwrite)


def check_result(
    path: Path | None, *endings: str, inputs: Iterable[Path] = (), overwrite: bool, draws: bool = False
) -> None:
    """Raise before the work begins where a result that is asked for has no place.

    Raises OutputError, and where it has pictures (`draws`) MissingExtraError without what draws them.
    """
    if path is not None:
        check_ending(path, *endings)
        check_output(path, inputs=inputs, overwrite=overwrite)
        if draws:
            require_plot()
