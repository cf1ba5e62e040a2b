"""Scenes of one study are told apart by their names."""

from collections import Counter
from collections.abc import Sequence

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import DuplicateNameError


def check_scene_names(structures: Sequence[Structure]) -> None:
    """Raise DuplicateNameError if two structures have one name."""
    for name, count in Counter(structure.name for structure in structures).items():
        if count > 1:
            raise DuplicateNameError(
                f"{count} scenes have the same name",
                where="SCENE",
                given=name,
                allowed="one scene of each name",
                hint="give each scene a `name` of its own",
            )
