"""The face of a model that the analyses need: anything with it can be analysed, compiled or not."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.structure import Structure
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
        """Return `quantity`: a float, an array of its shape, or a sparse array in compressed columns.

        Raises NonFiniteError where an argument or the result is not finite.
        """
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
