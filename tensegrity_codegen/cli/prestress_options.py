"""The options of `analyse` that write a scene with prestress."""

from pathlib import Path
from typing import Annotated

import typer

from tensegrity_codegen.system.errors import InvalidValueError

OPTION = "--prestress"

PrestressOption = Annotated[
    str | None,
    typer.Option(
        OPTION,
        help="Size [N] of the prestress that --scene-out writes: FORCE of the cable with most tension, "
        "least=FORCE of the cable with least, or MEMBER=FORCE.",
    ),
]
SceneOutOption = Annotated[
    Path | None,
    typer.Option("--scene-out", help="Write the scene with the prestress found as a scene file (.toml)."),
]


def check_prestress(text: str | None, out: Path | None) -> None:
    """Raise InvalidValueError where one of the two options lacks the other."""
    if (text is None) != (out is None):
        raise InvalidValueError(
            "the size of the prestress and the file to write belong together",
            where=OPTION if out is None else "--scene-out",
            allowed="both options, or none",
            hint="analyse SCENE --prestress 100 --scene-out tense.toml",
        )
