"""A whole motion as a CasADi function, for shooting in optimal control problems."""

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.integrate.adjoint import TapedRun, directed_shapes
from tensegrity_codegen.runtime.integrate.options import RunOptions, Stepping, read_stepping
from tensegrity_codegen.runtime.model.interface import require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.motion_input import read_motion
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_names
from tensegrity_codegen.system.errors import check_choice

STARTS = ("coordinate", "velocity")


def motion_function(
    model: CompiledModel,
    t_end: float,
    by: Sequence[str],
    *,
    samples: int | ArrayLike = 2,
    method: str = "rk853",
    rtol: float = 1e-8,
    arguments: Mapping[str, Any] | None = None,
) -> ca.Function:
    """Return the states of a motion as a CasADi function of its start and of run-time parameters.

    Parameters
    ----------
    model : CompiledModel
        A library with the quantity ``"adjoint_rate"``.
    t_end, samples, method, rtol
        As of `simulate`, see `motion_gradient`.
    by : sequence of str
        Arguments of the function: ``"coordinate"`` and ``"velocity"`` at the start, run-time parameters,
        ``"input"``.
    arguments : mapping, optional
        Values of other run-time parameters and inputs.

    Returns
    -------
    casadi.Function
        Of the arguments in the order of `by`, as columns, or (n_axes, k) where the argument is a table of k
        vectors; its result is the matrix of states (n_states, n_t): coordinates, velocities, internal states.
        Keep a reference to it for as long as functions that call it are used.

    Raises
    ------
    UnknownNameError
        Another argument.
    FormulationError
        The library has no gradients of motions; otherwise as `simulate`.

    Notes
    -----
    First derivatives are exact, by one pass backwards for each row that CasADi asks for. There are no second
    ones: let the solver approximate the Hessian (``ipopt.hessian_approximation="limited-memory"``). A motion
    that fails has NaN, from which line searches retreat.

    Examples
    --------
    >>> from tensegrity_codegen import build_library, ModelRequest, load_scene, motion_function
    >>> structure, _ = load_scene("two_nodes.toml")
    >>> request = ModelRequest(
    ...     ("member_tension", "acceleration", "kinetic_energy", "total_energy", "adjoint_rate"),
    ...     integrators=("rk853",), parameters={"rest_length": (0,)})
    >>> shoot = motion_function(build_library(structure, request).load(), 0.5, ["velocity", "rest_length"])
    >>> shoot.size_out(0)[1]
    2
    """
    require_model(model)
    options = read_stepping(Stepping(control="steps")).with_method(method, rtol)
    allowed = (*STARTS, *directed_shapes(model.manifest))
    by = check_names(by, "by")
    for name in by:
        check_choice(name, allowed, "argument of the motion", "by")
    motion = read_motion(model, options, t_end, samples, arguments, None, None, None)
    TapedRun(motion, options)  # raises where the library has no adjoint
    return _Motion(_Shooting(model, options, t_end, motion.sample_time, tuple(by), dict(arguments or {})))


class _Shooting:
    """Settings of motions, and the shapes of the arguments that they depend on."""

    def __init__(
        self,
        model: CompiledModel,
        options: RunOptions,
        t_end: float,
        times: FloatArray,
        by: tuple[str, ...],
        arguments: dict[str, Any],
    ) -> None:
        self.model, self.options, self.t_end, self.times = model, options, t_end, times
        self.by, self.arguments = by, arguments
        self.shapes = [model.manifest.argument(name).shape for name in by]
        count = 2 * len(model.manifest.coordinate_name) + len(model.manifest.internal_name)
        self.result = (count, len(times))

    def size(self, k: int) -> tuple[int, int]:
        """Return the size of argument k in CasADi."""
        shape = self.shapes[k]
        return (shape[0], 1) if len(shape) == 1 else (shape[1], shape[0])

    def run(self, given: Sequence[ca.DM]) -> tuple[TapedRun, FloatArray | None]:
        """Return a run that is at its end, and its states (n_t, n_states); None if it fails."""
        values = {
            name: np.array(value).T.reshape(shape)
            for name, value, shape in zip(self.by, given, self.shapes, strict=True)
        }
        starts = [values.pop(name, None) for name in STARTS]
        arguments = self.arguments | values
        motion = read_motion(self.model, self.options, self.t_end, self.times, arguments, None, *starts)
        run = TapedRun(motion, self.options)
        raw = run.finish()
        if raw.status != "ok":
            return run, None
        return run, raw.state if raw.internal is None else np.hstack([raw.state, raw.internal])


class _Motion(ca.Callback):  # type: ignore[misc]
    """States at the samples."""

    def __init__(self, shooting: _Shooting) -> None:
        ca.Callback.__init__(self)
        self.shooting, self.kept = shooting, list[Any]()
        self.construct("motion", {})

    def get_n_in(self) -> int:
        return len(self.shooting.by)

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return self.shooting.by[i]

    def get_name_out(self, i: int) -> str:
        return "state"

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self.shooting.size(i))

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self.shooting.result)

    def eval(self, given: Sequence[ca.DM]) -> list[Any]:
        _, states = self.shooting.run(given)
        return [np.full(self.shooting.result, np.nan) if states is None else states.T]

    def has_reverse(self, count: int) -> bool:
        return True

    def get_reverse(
        self, count: int, name: str, names_in: Sequence[str], names_out: Sequence[str], options: Any
    ) -> ca.Function:
        reverse = _Reverse(self.shooting, count, name, (tuple(names_in), tuple(names_out)))
        self.kept.append(reverse)
        return reverse


class _Reverse(ca.Callback):  # type: ignore[misc]
    """Products of `count` seeds with the derivatives of the states, all by the names that CasADi gives."""

    def __init__(
        self, shooting: _Shooting, count: int, name: str, names: tuple[tuple[str, ...], tuple[str, ...]]
    ) -> None:
        ca.Callback.__init__(self)
        self.shooting, self.count, self.names = shooting, count, names
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.names[0])

    def get_n_out(self) -> int:
        return len(self.names[1])

    def get_name_in(self, i: int) -> str:
        return self.names[0][i]

    def get_name_out(self, i: int) -> str:
        return self.names[1][i]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        rows, columns = self.shooting.result
        n_in = len(self.shooting.by)
        if i < n_in:
            return ca.Sparsity.dense(*self.shooting.size(i))
        return ca.Sparsity.dense(rows, columns if i == n_in else columns * self.count)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        rows, columns = self.shooting.size(i)
        return ca.Sparsity.dense(rows, columns * self.count)

    def eval(self, given: Sequence[ca.DM]) -> list[Any]:
        shooting, n_in = self.shooting, len(self.shooting.by)
        run, states = shooting.run(given[:n_in])
        sizes = [shooting.size(k) for k in range(n_in)]
        adjoints = [np.full((rows, columns * self.count), np.nan) for rows, columns in sizes]
        if states is None:
            return adjoints
        seeds = np.split(np.array(given[n_in + 1]), self.count, axis=1)
        n = len(shooting.model.manifest.coordinate_name)
        for index, seed in enumerate(seeds):
            back = run.go_back(seed.T)
            by = {**back.number, "coordinate": back.state[:n], "velocity": back.state[n : 2 * n]}
            for adjoint, name, (_, columns) in zip(adjoints, shooting.by, sizes, strict=True):
                # Vectors of a table are columns in CasADi.
                value = by[name].reshape(-1, adjoint.shape[0]).T
                adjoint[:, index * columns : (index + 1) * columns] = value
        return adjoints
