"""Requirements of an analysis on a model, checked before it begins."""

from collections.abc import Iterable
from typing import Any

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, LibraryError
from tensegrity_codegen.tables.manifest import Manifest


def require_model(model: Any) -> None:
    """Raise InvalidValueError for what is no model, such as the path of a scene."""
    if not isinstance(getattr(model, "manifest", None), Manifest):
        raise InvalidValueError(
            "not a compiled model",
            where="model",
            given=model,
            allowed="what compile_scene(...) or build_library(...).load() returns",
            hint="model = compile_scene(...) of the scene's path, dictionary or Scene",
        )


def require_quantities(model: Model, quantities: Iterable[str], purpose: str) -> None:
    """Raise FormulationError where a model does not compute all of these; purpose: "a load path needs"."""
    needed = tuple(quantities)
    missing = [name for name in needed if not model.has(name)]
    if missing:
        raise FormulationError(
            f"the model lacks functions that {purpose}",
            where=model.manifest.name,
            given=", ".join(missing),
            allowed=", ".join(needed),
            hint="build the model with these quantities",
        )


def require_double(manifest: Manifest, analysis: str) -> None:
    """Raise LibraryError, naming the analysis, unless the library computes in double precision."""
    if manifest.precision != "double":
        raise LibraryError(
            f"{analysis} needs a library of double precision",
            where=f"{manifest.name}: model.precision",
            given=f"precision {manifest.precision!r}",
            allowed='precision "double"',
            hint="build the scene in double precision for this, and in single precision beside it",
        )
