"""Functions of named arrays with derivatives forward and backward, over any leading axes of the arrays."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.model.interface import require_double, require_model
from tensegrity_codegen.runtime.model.library import check_threads
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError, check_choice

Arrays = Mapping[str, FloatArray]
Rows = Mapping[str, FloatArray]  # by name: (n, *shape), or a single row (1, *shape) for all
Shape = tuple[int, ...]
ON_ERROR = ("raise", "nan")
DTYPES = ("float64", "float32")  # of JAX and PyTorch


class Differentiable(ABC):
    """A function of named arrays, whose omitted arguments are at the scene's values.

    inputs, outputs: shapes by name, of one evaluation; ignored: arguments of the model that nothing depends
    on. Arrays may have leading axes, which are broadcast; every method does all evaluations in one call, and
    results have these axes. on_error: "raise", or "nan" for results that are not a number where an evaluation
    fails. threads: of all evaluations.
    """

    def __init__(self, model: CompiledModel, threads: int, on_error: str) -> None:
        require_model(model)
        require_double(model.manifest, "a function with derivatives")
        check_threads(threads)
        check_choice(on_error, ON_ERROR, "word", "on_error")
        self.model, self.threads, self.on_error = model, threads, on_error
        self.where: str = model.manifest.name
        self.inputs: dict[str, Shape] = {}
        self.outputs: dict[str, Shape] = {}
        self.ignored: tuple[str, ...] = ()

    @abstractmethod
    def _evaluate(self, values: Rows, count: int) -> Rows: ...

    @abstractmethod
    def _push(self, values: Rows, tangents: Rows, count: int) -> Rows: ...

    @abstractmethod
    def _pull(self, values: Rows, weights: Rows, count: int) -> Rows: ...

    def evaluate(self, values: Arrays) -> dict[str, FloatArray]:
        """Return the outputs by name, (*leading, *shape)."""
        return self._in_rows(self._evaluate, [(values, self.inputs)], self.outputs)

    def push(self, values: Arrays, tangents: Arrays) -> dict[str, FloatArray]:
        """Return the derivatives of the outputs along tangents of the values (forward)."""
        return self._in_rows(self._push, [(values, self.inputs), (tangents, self.inputs)], self.outputs)

    def pull(self, values: Arrays, weights: Arrays) -> dict[str, FloatArray]:
        """Return the derivatives of sum(weight * output) to the values (backward)."""
        shapes = {name: self.inputs[name] for name in values}
        return self._in_rows(self._pull, [(values, self.inputs), (weights, self.outputs)], shapes)

    def call(self, way: str, names: Sequence[str], arrays: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the results of "evaluate", "push" or "pull" of arrays of values, then of others."""
        values = dict(zip(names, arrays, strict=False))
        second = {"evaluate": [], "push": names, "pull": [*self.outputs]}[way]
        second_group = [dict(zip(second, arrays[len(names) :], strict=True))] if second else []
        return list(getattr(self, way)(values, *second_group).values())

    def align(self, values: Mapping[str, Any], convert: Callable[[Any], Any]) -> dict[str, Any]:
        """Return values, but None and what nothing depends on, as arrays with as many leading axes each.

        convert: makes an array of a framework. Raises UnknownNameError for another argument,
        InvalidValueError for another shape, what is no array of numbers, and axes that do not fit together.
        """
        states, arrays = dict.fromkeys((*self.inputs, *self.ignored)), {}
        for name, value in values.items():
            if value is None:
                continue
            check_choice(name, states, "argument", self.where)
            expected = self.inputs.get(name, ())
            where, allowed = f"{self.where}: {name}", f"{expected}, with any leading axes"
            try:
                arrays[name] = convert(value)
            except (TypeError, ValueError, OverflowError, RuntimeError) as error:
                problem = "not an array of real numbers"
                raise InvalidValueError(problem, where=where, given=value, allowed=allowed) from error
            shape = tuple(arrays[name].shape)
            if shape[len(shape) - len(expected) :] != expected or len(shape) < len(expected):
                raise InvalidValueError("wrong shape", where=where, given=shape, allowed=allowed)
        aligned = {name: array for name, array in arrays.items() if name in self.inputs}
        lead = {name: len(array.shape) - len(self.inputs[name]) for name, array in aligned.items()}
        try:
            np.broadcast_shapes(*[tuple(array.shape[: lead[name]]) for name, array in aligned.items()])
        except ValueError as error:
            shapes = ", ".join(f"{name} {tuple(array.shape)}" for name, array in aligned.items())
            problem, allowed = "leading axes do not fit together", "those of one length, of 1, or none"
            raise InvalidValueError(problem, where=self.where, given=shapes, allowed=allowed) from error
        rank = max(lead.values(), default=0)
        return {
            name: array.reshape((1,) * (rank - lead[name]) + tuple(array.shape))
            for name, array in aligned.items()
        }

    def refuse_second(self) -> FormulationError:
        """Return the error of a second derivative."""
        problem = "quantities and motions have no second derivatives here"
        return FormulationError(problem, where=self.where, hint="take differences of gradients")

    def _in_rows(
        self,
        compute: Callable[..., Rows],
        groups: list[tuple[Arrays, Mapping[str, Shape]]],
        shapes: Mapping[str, Shape],
    ) -> dict[str, FloatArray]:
        """Return what `compute` makes of groups of arrays, as rows with their leading axes as one."""
        arrays = [
            {name: np.asarray(value, dtype=np.float64) for name, value in group.items()}
            for group, _ in groups
        ]
        leads = [
            value.shape[: value.ndim - len(shape_of[name])]
            for group, (_, shape_of) in zip(arrays, groups, strict=True)
            for name, value in group.items()
        ]
        lead = np.broadcast_shapes(*leads)
        count = int(np.prod(lead))
        if not count:
            return {name: np.zeros((*lead, *shape)) for name, shape in shapes.items()}
        rows: list[dict[str, FloatArray]] = []
        for group, (_, shape_of) in zip(arrays, groups, strict=True):
            rows.append({})
            for name, value in group.items():
                shape, n_rows = shape_of[name], 1  # one row for all
                if value.size != np.prod(shape):
                    value, n_rows = np.broadcast_to(value, (*lead, *shape)), count
                rows[-1][name] = value.reshape((n_rows, *shape))
        results = compute(*rows, count)
        return {
            name: np.array(np.broadcast_to(results[name], (count, *shape))).reshape((*lead, *shape))
            for name, shape in shapes.items()
        }
