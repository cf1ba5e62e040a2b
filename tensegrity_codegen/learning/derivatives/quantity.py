"""A quantity of a model as a function with derivatives, by its generated Jacobian."""

from typing import Any

import numpy as np
import scipy

from tensegrity_codegen.learning.derivatives.differentiable import Differentiable, Rows
from tensegrity_codegen.runtime.model.interface import require_quantities
from tensegrity_codegen.runtime.model.model import CompiledFunction, CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.tables.quantities import SLOPES


class QuantityFunction(Differentiable):
    """A quantity at states and run-time parameters; others than those that it depends on are ignored.

    Raises UnknownNameError for another quantity than those of SLOPES, FormulationError for a library without
    the quantity or its derivatives.
    """

    def __init__(
        self, model: CompiledModel, quantity: str, *, threads: int = 1, on_error: str = "raise"
    ) -> None:
        super().__init__(model, threads, on_error)
        of_quantity = {quantity_name: name for name, quantity_name in SLOPES.items()}
        check_choice(quantity, of_quantity, "quantity with derivatives", "quantity")
        slopes = of_quantity[quantity]
        call = f'compile_scene(..., for_="derivatives", quantities={(quantity, slopes)})'
        require_quantities(model, (quantity, slopes), f"these derivatives need: {call}")
        self.quantity, self.function, self.slopes = quantity, model.function(quantity), model.function(slopes)
        sizes_of = {argument.name: argument.shape for argument in model.manifest.arguments}
        shapes = {name: sizes_of[name] for name in self.function.arguments}
        self.inputs, self.outputs = shapes, {quantity: self.function.spec.shape}
        self.ignored = tuple(name for name, shape in sizes_of.items() if np.prod(shape))
        pattern = self.slopes.spec.pattern
        assert pattern is not None
        columns = np.arange(pattern.shape[1], dtype=np.int32)
        indices = (np.array(pattern.row, dtype=np.int32), np.repeat(columns, np.diff(pattern.column_start)))
        entries = np.arange(len(indices[0]))
        # Of each non-zero its row and column, and matrices that add up those of each row, and of each column.
        self.places: list[tuple[Any, Any]] = [
            (index, scipy.sparse.csr_array((np.ones(entries.size), (index, entries)), (size, entries.size)))
            for index, size in zip(indices, pattern.shape, strict=True)
        ]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()]).tolist()
        self.parts = {name: slice(*ends) for name, *ends in zip(shapes, [0, *ends], ends, strict=False)}

    def _evaluate(self, values: Rows, count: int) -> Rows:
        result = self._call(self.function, values)
        return {self.quantity: result.reshape((-1, *self.function.spec.shape))}

    def _push(self, values: Rows, tangents: Rows, count: int) -> Rows:
        slopes = self._call(self.slopes, values)
        (_, to_rows), (column, to_columns) = self.places
        along = np.zeros((count, to_columns.shape[0]))
        for name, tangent in tangents.items():
            along[:, self.parts[name]] = tangent.reshape(len(tangent), -1)
        change = (to_rows @ (slopes * along[:, column]).T).T
        return {self.quantity: change.reshape((-1, *self.function.spec.shape))}

    def _pull(self, values: Rows, weights: Rows, count: int) -> Rows:
        slopes, weight = self._call(self.slopes, values), weights[self.quantity]
        (row, _), (_, to_columns) = self.places
        gradient = (to_columns @ (slopes * weight.reshape(len(weight), -1)[:, row]).T).T
        return {name: gradient[:, self.parts[name]].reshape((-1, *self.inputs[name])) for name in values}

    def _call(self, function: CompiledFunction, values: Rows) -> FloatArray:
        """Return rows of a function, not a number where it fails, or raise what the first of these raises."""
        arguments = [values.get(name, self.model.nominal(name)[None]) for name in function.arguments]
        if not arguments:
            return function.values([], None)[None]
        is_single = all(len(value) == 1 for value in arguments)
        arrays = [value if is_single or len(value) > 1 else value[0] for value in arguments]
        answer, status = function.batch(*arrays, threads=self.threads, on_error="status")
        if status.any() and self.on_error == "raise":
            function.batch(*arrays)
        result = np.asarray(answer)
        result[status != 0] = np.nan
        return result
