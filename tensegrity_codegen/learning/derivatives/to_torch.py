"""Quantities and motions as functions of PyTorch, with exact derivatives and one call of a batch."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from numpy.typing import ArrayLike

from tensegrity_codegen.learning.derivatives.differentiable import DTYPES, Differentiable
from tensegrity_codegen.learning.derivatives.motion import MotionFunction
from tensegrity_codegen.learning.derivatives.quantity import QuantityFunction
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.system.extras import TORCH, import_extra


def to_torch(
    model: CompiledModel, quantity: str, *, dtype: str = "float64", threads: int = 1, on_error: str = "raise"
) -> Callable[..., Any]:
    """Return a quantity as a function of PyTorch, with derivatives forward and backward.

    Parameters
    ----------
    model, quantity, threads, on_error
        As of `to_jax`.
    dtype : str
        Of the result, ``"float64"`` or ``"float32"``; the library computes with double precision.

    Returns
    -------
    callable
        ``f(coordinate=None, velocity=None, **arguments)`` -> tensor: values by name, those not given at the
        scene's. Tensors may have leading axes, evaluated in one call, as those of `torch.func.vmap` are.

    Raises
    ------
    MissingExtraError
        PyTorch is not installed.
    FormulationError, UnknownNameError
        As `to_jax`.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, to_torch
    >>> model = compile_scene("two_nodes.toml", for_="derivatives")
    >>> fall = to_torch(model, "acceleration")  # doctest: +SKIP
    """
    of_quantity = QuantityFunction(model, quantity, threads=threads, on_error=on_error)
    return _build(of_quantity, dtype, lambda found: found[quantity])


def to_torch_motion(
    model: CompiledModel,
    t_end: float,
    *,
    samples: int | ArrayLike = 2,
    outputs: Sequence[str] = ("coordinate", "velocity"),
    method: str = "rk853",
    rtol: float = 1e-8,
    schedule: Profile | None = None,
    dtype: str = "float64",
    threads: int = 1,
    on_error: str = "raise",
) -> Callable[..., Any]:
    """Return a motion as a function of PyTorch, with derivatives forward and backward, through contacts.

    Parameters
    ----------
    model, t_end, samples, outputs, method, rtol, schedule, threads, on_error
        As of `to_jax_motion`.
    dtype : str
        As of `to_torch`.

    Returns
    -------
    callable
        ``f(coordinate=None, velocity=None, **arguments)`` -> dictionary of `outputs`, each (n_t, ...).

    Raises
    ------
    MissingExtraError
        PyTorch is not installed.
    FormulationError, UnknownNameError, InvalidValueError
        As `to_jax_motion`.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, to_torch_motion
    >>> model = compile_scene("two_nodes.toml", for_="motion_derivatives")
    >>> drop = to_torch_motion(model, 0.1)  # doctest: +SKIP
    """
    options: dict[str, Any] = {"samples": samples, "method": method, "rtol": rtol, "schedule": schedule}
    options |= {"outputs": outputs, "threads": threads, "on_error": on_error}
    return _build(MotionFunction(model, t_end, **options), dtype, dict)


def _build(
    function: Differentiable, dtype: str, finish: Callable[[dict[str, Any]], Any]
) -> Callable[..., Any]:
    check_choice(dtype, DTYPES, "dtype", "dtype")
    torch = import_extra("torch", TORCH)

    def convert(value: Any) -> Any:
        tensor = torch.as_tensor(value)
        if tensor.is_complex():
            raise TypeError("no real numbers")
        return tensor.to(getattr(torch, dtype))

    def call(coordinate: Any = None, velocity: Any = None, **arguments: Any) -> Any:
        """Return the values at arguments by name, those not given at the scene's."""
        values = {"coordinate": coordinate, "velocity": velocity, **arguments}
        values = function.align(values, convert)
        results = _function("evaluate").apply(function, tuple(values), *values.values())
        return finish(dict(zip(function.outputs, results, strict=True)))

    return call


@cache
def _function(way: str) -> Any:
    """Return the function of autograd of a method of Differentiable; all tensors have as many leading axes.

    Tensors of "push" are values and tangents, of "pull" values and weights.
    """
    torch = import_extra("torch", TORCH)

    class Way(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(function: Differentiable, names: tuple[str, ...], *tensors: Any) -> tuple[Any, ...]:
            first = tensors[0] if tensors else torch.zeros(0, dtype=torch.float64)
            arrays = [tensor.detach().cpu().numpy() for tensor in tensors]
            return tuple(torch.as_tensor(x).to(first) for x in function.call(way, names, arrays))

        @staticmethod
        def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
            ctx.function, ctx.names, *tensors = inputs
            ctx.save_for_backward(*tensors)
            ctx.save_for_forward(*tensors)

        @staticmethod
        def backward(ctx: Any, *weights: Any) -> tuple[Any, ...]:
            if way != "evaluate":
                raise ctx.function.refuse_second()
            values = ctx.saved_tensors
            found = _function("pull").apply(ctx.function, ctx.names, *values, *weights)
            return None, None, *(x.sum_to_size(value.shape) for x, value in zip(found, values, strict=True))

        @staticmethod
        def jvp(ctx: Any, _function_change: Any, _names_change: Any, *changes: Any) -> Any:
            if way != "evaluate":
                raise ctx.function.refuse_second()
            values = ctx.saved_tensors
            pairs = zip(changes, values, strict=True)
            tangents = [torch.zeros_like(value) if change is None else change for change, value in pairs]
            return _function("push").apply(ctx.function, ctx.names, *values, *tangents)

        @staticmethod
        def vmap(info: Any, axes: Any, function: Any, names: Any, *tensors: Any) -> Any:
            moved = [
                tensor[None] if axis is None else tensor.movedim(axis, 0)
                for tensor, axis in zip(tensors, axes[2:], strict=True)
            ]
            results = _function(way).apply(function, names, *moved)
            return results, tuple(0 for _ in results)

    return Way
