"""The interface of models that analyses need, their requirements, and names of states."""

from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, LibraryError
from tensegrity_codegen.tables.manifest import Manifest


class Model(Protocol):
    """A model that computes quantities by name, with omitted arguments at the scene's values."""

    @property
    def manifest(self) -> Manifest:
        """What the model says of itself: names, sizes, nominal values."""
        ...

    def has(self, quantity: str) -> bool:
        """Return whether the model computes `quantity`."""
        ...

    def compute(self, quantity: str, /, **arguments: Any) -> Any:
        """Return `quantity`: a float, an array or a sparse array; NonFiniteError if not finite."""
        ...

    def nominal(self, argument: str, /) -> NDArray[np.float64]:
        """Return the scene's value of one argument, a copy in its shape."""
        ...


class Described(Protocol):
    """What is known of a model without computing: manifest and structure."""

    @property
    def manifest(self) -> Manifest:
        """Names, sizes, nominal values."""
        ...

    @property
    def structure(self) -> Structure | BodySystem | None:
        """What it was made from, with its actuators, sensors and limits."""
        ...


def require_model(model: Any) -> None:
    """Raise InvalidValueError unless this is a model; the path of a scene is none."""
    if not isinstance(getattr(model, "manifest", None), Manifest):
        raise InvalidValueError(
            "not a compiled model",
            where="model",
            given=model,
            allowed="what compile_scene(...) or build_library(...).load() returns",
            hint="model = compile_scene(...) of the scene's path, dictionary or Scene",
        )


def require_quantities(model: Model, quantities: Iterable[str], purpose: str) -> None:
    """Raise FormulationError if a model does not compute all of these; purpose: "a load path needs"."""
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


def name_states(manifest: Manifest) -> tuple[str, ...]:
    """Return names such as `b1.x` for node coordinates and `b1.x'` for their rates; others by their own."""
    node_axes = manifest.coordinate_node_axis
    names = [f"{manifest.node_name[node]}.{'xyz'[axis]}" for node, axis in node_axes]
    names = names or list(manifest.coordinate_name)
    return (*names, *(f"{name}'" for name in names), *manifest.internal_name)


def name_moving_states(manifest: Manifest) -> tuple[str, ...]:
    """Return the names of coordinates and their rates, without those of internal states."""
    return name_states(manifest)[: 2 * len(manifest.coordinate_name)]
