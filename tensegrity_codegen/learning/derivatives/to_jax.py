"""Quantities and motions as functions of JAX: callbacks under jit and vmap, with exact derivatives."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.learning.derivatives.differentiable import DTYPES, Differentiable
from tensegrity_codegen.learning.derivatives.motion import MotionFunction
from tensegrity_codegen.learning.derivatives.quantity import QuantityFunction
from tensegrity_codegen.learning.derivatives.xla_call import call_in_c, register_call
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.system.errors import InvalidValueError, check_choice
from tensegrity_codegen.system.extras import JAX, import_extra


def to_jax(
    model: CompiledModel, quantity: str, *, dtype: str = "float64", threads: int = 1, on_error: str = "raise"
) -> Callable[..., Any]:
    """Return a quantity as a function of JAX, with derivatives forward and backward.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"derivatives"``, see compile_scene.
    quantity : str
        Name of the quantity, such as ``"acceleration"`` or ``"member_tension"``.
    dtype : str
        Of the result: ``"float64"`` needs ``jax.config.update("jax_enable_x64", True)``; ``"float32"`` rounds
        what goes in and out, and computes in between with double precision.
    threads : int
        Number of threads of a batch.
    on_error : str
        ``"raise"``, or ``"nan"``: the result of an evaluation that fails is not a number.

    Returns
    -------
    callable
        ``f(coordinate=None, velocity=None, **arguments)`` -> array: values by name, those not given at the
        scene's. Arrays may have leading axes; `jax.vmap` makes one call of all.

    Raises
    ------
    MissingExtraError
        JAX is not installed.
    FormulationError
        The library lacks the quantity or its derivatives.
    UnknownNameError
        A quantity without derivatives, or an unknown word.

    Notes
    -----
    Derivatives are generated Jacobians; second derivatives are refused. Where a force jumps or its slope does
    (cables that go slack, contacts), they are those of one side.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, to_jax
    >>> model = compile_scene("two_nodes.toml", for_="derivatives")
    >>> fall = to_jax(model, "acceleration", dtype="float32")  # doctest: +SKIP
    """
    of_quantity = QuantityFunction(model, quantity, threads=threads, on_error=on_error)
    return _build(of_quantity, dtype, lambda found: found[quantity])


def to_jax_motion(
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
    """Return a motion as a function of JAX, with derivatives forward and backward, through contacts.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"motion_derivatives"``, see compile_scene.
    t_end, samples, method, rtol
        As of `simulate`; method: ``"rk54"``, ``"tsit5"`` or ``"rk853"``.
    outputs : str or sequence of str
        Quantities at the samples: ``"coordinate"``, ``"velocity"``, ``"internal"``, ``"node_position"``,
        ``"node_velocity"``, ``"member_length"``, ``"member_tension"``.
    schedule : Profile, optional
        Inputs over time; what it names is an argument with a value at each knot.
    dtype, threads
        As of `to_jax`.
    on_error : str
        ``"raise"``, or ``"nan"``: where a motion fails, or its derivative means nothing, none of its results
        is a number.

    Returns
    -------
    callable
        ``f(coordinate=None, velocity=None, **arguments)`` -> dictionary of `outputs`, each (n_t, ...).

    Raises
    ------
    MissingExtraError
        JAX is not installed.
    FormulationError
        The library has no derivatives of motions.
    UnknownNameError, InvalidValueError
        As `simulate`; a method that the library lacks.

    Notes
    -----
    Backward by the adjoint in C, for 3 motions whatever the number of arguments; forward by a column beside
    the motion, one for each tangent. A column along all numbers shortens the steps backward, and both ways
    are compared.

    Examples
    --------
    >>> from tensegrity_codegen import compile_scene, to_jax_motion
    >>> model = compile_scene("two_nodes.toml", for_="motion_derivatives")
    >>> drop = to_jax_motion(model, 0.1, dtype="float32")  # doctest: +SKIP
    """
    options: dict[str, Any] = {"samples": samples, "method": method, "rtol": rtol, "schedule": schedule}
    options |= {"outputs": outputs, "threads": threads, "on_error": on_error}
    return _build(MotionFunction(model, t_end, **options), dtype, dict)


def _build(
    function: Differentiable, dtype: str, finish: Callable[[dict[str, Any]], Any]
) -> Callable[..., Any]:
    check_choice(dtype, DTYPES, "dtype", "dtype")
    jax, jnp = import_extra("jax", JAX), import_extra("jax.numpy", JAX)
    outside = jnp.float64 if dtype == "float64" else jnp.float32

    def convert(value: Any) -> Any:
        """Return an array of JAX, which by itself takes texts and the real parts of complex numbers."""
        leaves = jax.tree_util.tree_leaves(value)
        arrays = [leaf if isinstance(leaf, jax.Array) else np.asarray(leaf) for leaf in leaves]
        if any(array.dtype.kind not in "biufV" for array in arrays):  # V: of JAX, such as bfloat16
            raise TypeError("no real numbers")
        return jnp.asarray(value, outside)

    def call(coordinate: Any = None, velocity: Any = None, **arguments: Any) -> Any:
        """Return the values at arguments by name, those not given at the scene's."""
        if dtype == "float64" and not jax.config.jax_enable_x64:
            raise InvalidValueError(
                "JAX would round double precision to single",
                where=function.where,
                allowed='jax.config.update("jax_enable_x64", True) at the start of the program',
                hint='or dtype="float32", which rounds what goes in and out',
            )
        values = {"coordinate": coordinate, "velocity": velocity, **arguments}
        values = function.align(values, convert)
        options: dict[str, Any] = {"function": function, "names": tuple(values), "dtype": outside}
        results = _primitive("evaluate").bind(*values.values(), **options)
        return finish(dict(zip(function.outputs, results, strict=True)))

    return call


def _lead(value: Any, shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(value.shape[: value.ndim - len(shape)])


@cache
def _primitive(way: str) -> Any:
    """Return the primitive of JAX of a method of Differentiable; all arrays have as many leading axes.

    Operands of "push" are values and tangents, of "pull" values and weights: each is linear in the second,
    and the transpose of the transposed.
    """
    jax = import_extra("jax", JAX)
    ad, batching, mlir = (
        import_extra(f"jax.interpreters.{name}", JAX) for name in ("ad", "batching", "mlir")
    )
    primitive = import_extra("jax.extend.core", JAX).Primitive(f"tensegrity_{way}")
    primitive.multiple_results = True

    def find_results(*operands: Any, function: Differentiable, names: Sequence[str], dtype: Any) -> list[Any]:
        inputs, outputs = [function.inputs[name] for name in names], [*function.outputs.values()]
        second = {"evaluate": [], "push": inputs, "pull": outputs}[way]
        pairs = zip(operands, [*inputs, *second], strict=True)
        lead = np.broadcast_shapes(*[_lead(operand, shape) for operand, shape in pairs])
        return [
            jax.core.ShapedArray((*lead, *shape), dtype) for shape in (inputs if way == "pull" else outputs)
        ]

    def compute(*operands: Any, function: Differentiable, names: Sequence[str], dtype: Any) -> list[Any]:
        def call(*arrays: Any) -> list[Any]:
            return [np.asarray(array, dtype) for array in function.call(way, names, arrays)]

        results = find_results(*operands, function=function, names=names, dtype=dtype)
        structs = [jax.ShapeDtypeStruct(result.shape, result.dtype) for result in results]
        return list(jax.pure_callback(call, structs, *operands))

    def compute_in_c(*operands: Any, function: Differentiable, names: Sequence[str], dtype: Any) -> list[Any]:
        options: dict[str, Any] = {"function": function, "names": names, "dtype": dtype}
        can_be = isinstance(function, QuantityFunction) and function.threads == 1 and dtype == np.float64
        if not (can_be and register_call()):
            return compute(*operands, **options)
        results = find_results(*operands, **options)
        return call_in_c(way, cast(QuantityFunction, function), names, operands, results)

    def batch(operands: Any, axes: Any, **options: Any) -> tuple[list[Any], list[int]]:
        pairs = list(zip(operands, axes, strict=True))
        size = next(operand.shape[axis] for operand, axis in pairs if axis is not None)
        moved = [
            operand[None] if axis is None else jax.numpy.moveaxis(operand, axis, 0) for operand, axis in pairs
        ]
        for k in range(len(options["names"]), len(moved)):  # others may stay one row for all
            moved[k] = jax.numpy.broadcast_to(moved[k], (size, *moved[k].shape[1:]))
        results = primitive.bind(*moved, **options)
        return results, [0] * len(results)

    def differentiate(operands: Any, changes: Any, **options: Any) -> tuple[Any, Any]:
        function, names = options["function"], options["names"]
        results, changes = primitive.bind(*operands, **options), [*changes]
        if way == "evaluate":
            shapes = [function.inputs[name] for name in names]
            lead = _lead(results[0], next(iter(function.outputs.values())))
            shaped = [
                (ad.instantiate_zeros(x), (*lead, *shape)) for x, shape in zip(changes, shapes, strict=True)
            ]
            along = [jax.numpy.broadcast_to(change, shape) for change, shape in shaped]
            return results, _primitive("push").bind(*operands, *along, **options)
        if any(type(change) is not ad.Zero for change in changes[: len(names)]):
            raise function.refuse_second()
        second = [ad.instantiate_zeros(change) for change in changes[len(names) :]]
        return results, primitive.bind(*operands[: len(names)], *second, **options)

    def transpose(weights: Any, *operands: Any, **options: Any) -> list[Any]:
        values = operands[: len(options["names"])]
        weights = [ad.instantiate_zeros(weight) for weight in weights]
        transposed = _primitive("pull" if way == "push" else "push")
        return [None] * len(values) + list(transposed.bind(*values, *weights, **options))

    primitive.def_impl(jax.jit(primitive.bind, static_argnames=("function", "names", "dtype")))
    primitive.def_abstract_eval(find_results)
    batching.primitive_batchers[primitive] = batch
    mlir.register_lowering(primitive, mlir.lower_fun(compute, multiple_results=True))
    mlir.register_lowering(primitive, mlir.lower_fun(compute_in_c, multiple_results=True), platform="cpu")
    ad.primitive_jvps[primitive] = differentiate
    ad.primitive_transposes[primitive] = transpose
    return primitive
