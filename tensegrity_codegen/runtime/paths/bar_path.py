"""Load paths of structures with rigid bars, as zeros of one function of all coordinates.

With p the nearest configuration to q that keeps the lengths, P = Z Z^T the projector on the directions there,

    g(q, lambda) = P f(p, lambda) - sigma (q - p) = 0

has the equilibria for its zeros, whatever sigma > 0 [N/m] is, and at them -dg/dq = P A P + sigma (1 - P)
with A the Hessian of the Lagrangian: symmetric, with the eigenvalues of the structure and sigma.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy

from tensegrity_codegen.runtime.model.interface import Model
from tensegrity_codegen.runtime.model.require import require_model
from tensegrity_codegen.runtime.paths.model_path import ModelPath, Pattern
from tensegrity_codegen.runtime.statics.bar_problem import BarProblem
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError

# sigma as a multiple of the largest stiffness, so that the eigenvalues told are the structure's.
SIGMA_STIFFNESS_RATIO = 10.0


class BarPath(ModelPath):
    """Equilibria of springs and rigid bars with loads base + load factor times pattern.

    Parameters
    ----------
    model : CompiledModel
        A model in the formulation rigid_bar.
    pattern, arguments
        As for ModelPath.

    Raises
    ------
    FormulationError, InvalidValueError
        As for ModelPath; also where no configuration has the lengths of the bars.

    Notes
    -----
    g = P f(p, lambda) - sigma (q - p), with p the configuration nearest to q that has the lengths
    (docs/model.md).
    """

    has_rigid_bars: ClassVar[bool] = True

    def __init__(self, model: Model, pattern: Pattern, arguments: Mapping[str, Any] | None = None) -> None:
        super().__init__(model, pattern, arguments)
        given = {name: value for name, value in self.arguments.items() if name != "velocity"}
        self._problem = BarProblem(model, {**given, **self.loads(1.0)})
        self.memory = self._problem.memory
        start = self._problem.to_search_coordinate(model.nominal("coordinate").ravel())
        stiffest = float(self._problem.row_stiffness(start).max(initial=0.0))
        self._sigma = SIGMA_STIFFNESS_RATIO * stiffest or 1.0
        self._last: tuple[float, BarProblem] | None = None

    def offers(self, quantity: str) -> bool:
        """Return whether `compute` gives the quantity."""
        return quantity == "member_tension" or super().offers(quantity)

    def compute(self, quantity: str, coordinate: FloatArray, load_factor: float) -> Any:
        """Return a quantity of the model at a point of the path; tensions are those of rigid bars too."""
        if quantity != "member_tension":
            return super().compute(quantity, coordinate, load_factor)
        problem, placed = self._at(coordinate, load_factor)
        return problem.forces(placed)[1]

    def residual(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return g, (n,) [N]."""
        problem, placed = self._at(coordinate, load_factor)
        return problem.residual(placed) - self._sigma * (coordinate - placed)

    def stiffness(self, coordinate: FloatArray, load_factor: float, /) -> Any:
        """Return P A P + sigma (1 - P), sparse (n, n) [N/m]."""
        problem, placed = self._at(coordinate, load_factor)
        along = problem.directions(placed)
        held = scipy.sparse.eye_array(self.size) - along @ along.T
        return scipy.sparse.csc_array(along @ problem.stiffness(placed) @ along.T + self._sigma * held)

    def load_vector(self, coordinate: FloatArray, load_factor: float, /) -> FloatArray:
        """Return the part of the pattern that bars leave free, (n,) [N]."""
        problem, placed = self._at(coordinate, load_factor)
        along = problem.directions(placed)
        return np.asarray(along @ (along.T @ super().load_vector(coordinate, load_factor)))

    def _at(self, coordinate: FloatArray, load_factor: float) -> tuple[BarProblem, FloatArray]:
        """Return the static problem under this load and the nearest configuration that keeps the lengths."""
        if self._last is None or self._last[0] != load_factor:
            self._last = (load_factor, self._problem.under(**self.loads(load_factor)))
        problem = self._last[1]
        placed = problem.place(coordinate)
        if placed is None:
            raise NonFiniteError(
                "no configuration near here has the lengths of the rigid bars", where="load path"
            )
        return problem, placed


def build_path(model: Model, pattern: Pattern, arguments: Mapping[str, Any] | None = None) -> ModelPath:
    """Return the load path of a model, for its formulation.

    Parameters
    ----------
    model : CompiledModel
        The model.
    pattern, arguments
        As for ModelPath.

    Returns
    -------
    ModelPath
        A BarPath where the model has rigid bars.

    Raises
    ------
    FormulationError, InvalidValueError
        As for ModelPath.
    """
    require_model(model)
    kind = BarPath if model.manifest.rigid_bar else ModelPath
    return kind(model, pattern, arguments)
