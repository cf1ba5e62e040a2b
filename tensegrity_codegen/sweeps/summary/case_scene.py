"""The scene of one case of a stored sweep."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.describe import describe_structure
from tensegrity_codegen.scene.describe_bodies import describe_bodies
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.sweeps.apply.array_keys import INPUT, ArrayKey
from tensegrity_codegen.sweeps.apply.assembler import build_assembler
from tensegrity_codegen.sweeps.store.folder import read_stored_sweep
from tensegrity_codegen.sweeps.summary.results import SweepResults
from tensegrity_codegen.system.errors import InvalidValueError


def check_case(results: SweepResults, case: int) -> None:
    """Raise InvalidValueError unless the sweep has a case with this number."""
    if not 0 <= case < results.count:
        raise InvalidValueError(
            "no such case",
            where=str(results.path),
            given=case,
            allowed=f"whole numbers from 0 to {results.count - 1}",
        )


def build_case_scene(path: str | Path, keys: Mapping[str, float]) -> Mapping[str, Any]:
    """Return the scene of a stored sweep as a plain dictionary, with these values of its keys.

    Values of inputs are not in it, for a scene states none. Where keys name arrays of the structure, as
    ``rest_length.s1``, the scene lists all its nodes and members with their own values.

    Raises
    ------
    OutputError
        The folder is not a sweep.
    TensegrityError
        The values are no scene.
    """
    document = read_stored_sweep(path).identity["scene"]
    assembler = build_assembler(document, list(keys), source=str(path))
    values = list(keys.values())
    case = assembler.assemble(values)
    if not any(isinstance(key, ArrayKey) and key.array != INPUT for key in assembler.keys):
        return assembler.write(values)
    if isinstance(case.subject, BodySystem):
        return describe_bodies(case.subject, case.request)
    return describe_structure(case.subject, case.request)
