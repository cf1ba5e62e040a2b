"""Design by gradients: numbers of a scene, and inputs over time, so that a motion does what is asked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.gradient import (
    MIN_RTOL,
    TIGHTER,
    Loss,
    compare_with_differences,
    read_loss,
)
from tensegrity_codegen.runtime.simulate.motion_input import read_sample_times
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.scene.schema.schema import Scene
from tensegrity_codegen.sweeps.fitting.keyed_motion import METHOD, KeyedMotion, MotionSlopes, RunSettings
from tensegrity_codegen.sweeps.fitting.keyed_scene import read_bounds
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import (
    check_callback,
    check_instance,
    check_mapping,
    check_names,
    check_positive,
    check_switch,
    check_whole,
)
from tensegrity_codegen.system.errors import ConvergenceError, InvalidValueError, NonFiniteError
from tensegrity_codegen.system.summaries import Fact, Summarised

MANY_KEYS = 8  # from so many numbers on, gradients are taken backwards


class LossGradient:
    """The gradient of a loss of a motion to numbers of its scene.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        As for `read_scene`.
    keys : sequence of str
        Numbers of the scene, as of `identify`; also knots of `schedule`, as ``profile.winch[2]``.
    loss : callable
        Trajectory -> value, and its derivatives to quantities at the samples: a mapping from
        ``"node_position"`` (n_t, n_nodes, 3), ``"node_velocity"``, ``"member_length"`` (n_t, n_members) or
        ``"member_tension"`` to arrays of their shape.
    t_end : float
        End time [s].
    samples : int or array_like
        As of `simulate`.
    method, rtol : str and float
        Integrator with error control, and the relative tolerance of its steps.
    schedule : Profile, optional
        Inputs over time.
    arguments : mapping, optional
        Start (``"coordinate"``, ``"velocity"``, ``"internal"``) and run-time parameters by name, where they
        differ from the scene.
    backwards : bool, optional
        Whether gradients are taken backwards over the steps of a motion, at the cost of 4 to 6 motions; else
        derivatives to each number are integrated beside it, at 0.6 to 1 motion each. By default the former
        from 8 numbers on.

    Attributes
    ----------
    check : bool
        Whether the first gradient is compared with differences, by four to eight motions with tighter steps:
        True unless it is set otherwise before.
    motion : Trajectory or None
        The last motion.
    n_motions : int
        How many there were.
    error : float or None
        Part by which the derivative of the first loss along a change of all numbers is apart from that of
        differences of motions, which share nothing with it; about 1e-6 is the best to expect. None before,
        where no motion nearby ends, and without `check`.
    disagreement : float
        Of gradients that are taken backwards: difference between the derivatives of the last loss along all
        numbers that were found in both ways, as a part of the largest: whether steps are short enough for
        derivatives. Rounding, where they are; both ways share all else.

    Raises
    ------
    UnknownKeyError, InvalidValueError, FormulationError
        As of `identify`.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import LossGradient
    >>> def depth(motion):
    ...     at = np.zeros_like(motion.node_position)
    ...     at[-1, 1, 2] = 1.0
    ...     return motion.node_position[-1, 1, 2], {"node_position": at}
    >>> gradient = LossGradient("two_nodes.toml", ["classes.cord.spring_constant"], depth, 1.0)
    >>> value, slope = gradient([80.0])
    >>> round(value, 4), slope.shape
    (-1.0002, (1,))
    """

    check = True

    def __init__(
        self,
        scene: str | Path | Mapping[str, Any] | Scene,
        keys: Sequence[str],
        loss: Loss,
        t_end: float,
        *,
        samples: int | ArrayLike = 101,
        method: str = METHOD,
        rtol: float = 1e-9,
        schedule: Profile | None = None,
        arguments: Mapping[str, ArrayLike] | None = None,
        backwards: bool | None = None,
        compiler: str | None = None,
    ) -> None:
        check_callback(loss, "loss")
        self.loss = loss
        self.times = read_sample_times(samples, t_end)
        names = check_names(keys, "keys")
        self.backwards = (
            len(names) >= MANY_KEYS if backwards is None else check_switch(backwards, "backwards")
        )
        settings = RunSettings(
            method, rtol, schedule, check_mapping(arguments, "arguments", "arrays by name")
        )
        self.problem = KeyedMotion(scene, names, settings, compiler, backwards=self.backwards)
        self.n_motions, self.disagreement = 0, 0.0
        self.error: float | None = None
        self.motion: Trajectory | None = None

    def __call__(self, values: ArrayLike) -> tuple[float, FloatArray]:
        """Return the loss and its gradient (n_keys,) at values of the keys (n_keys,).

        Raises ConvergenceError where the motion fails, InvalidValueError for values that make no scene or a
        loss of another form, NonFiniteError for a loss that is not finite.
        """
        point = to_doubles(values, "values", "one value a key")
        if point.shape != self.problem.start.shape:
            problem = "one value a key is needed"
            allowed = f"({len(self.problem.keys)},): {', '.join(self.problem.keys)}"
            raise InvalidValueError(problem, where="values", given=point.shape, allowed=allowed)
        self.n_motions += 1
        if self.backwards:
            result, slopes, self.disagreement = self.problem.differentiate_loss(point, self.times, self.loss)
            self.motion, value = result.motion, result.loss
        else:
            value, slopes = self._differentiate(point)
        if self.check and self.n_motions == 1:
            way = self.problem.size * np.sign(slopes)

            def compute_loss(step: float) -> float:
                return read_loss(self.loss, self._run(point + step * way, TIGHTER).motion)[0]

            self.error = compare_with_differences(compute_loss, float(np.abs(slopes).sum()))
        return value, slopes / self.problem.size

    def _run(self, values: FloatArray, accuracy: float = 1.0) -> MotionSlopes:
        """Return the motion and its columns; raises ConvergenceError where it fails."""
        run = self.problem.run(values, self.times, min(accuracy, self.problem.settings.rtol / MIN_RTOL))
        if run.motion.status != "ok":
            problem = f"the motion fails: {run.motion.message}"
            raise ConvergenceError(problem, where=self.problem.assembler.where)
        return run

    def _differentiate(self, values: FloatArray) -> tuple[float, FloatArray]:
        """Return the loss and its derivatives to each value over its size, from columns beside the motion."""
        run = self._run(values)
        self.motion = run.motion
        value, derivatives = read_loss(self.loss, run.motion)
        slopes = np.zeros(len(self.problem.keys))
        for name, derivative in derivatives.items():
            slopes += np.tensordot(derivative, getattr(run, name), axes=derivative.ndim)
        if not np.isfinite(slopes).all():
            raise NonFiniteError("the gradient of the loss is not finite", where="loss", given=value)
        return value, slopes


@dataclass(frozen=True, repr=False)
class Design(Summarised):
    """Numbers of a scene with the least loss that was found.

    Attributes
    ----------
    status, message : str
        ``"ok"``, or ``"not_converged"``: the best values so far.
    key : tuple of str
        The numbers.
    value, start, gradient : ndarray, shape (n_keys,)
        Values found and at the start, and the gradient of the loss there.
    loss, start_loss : float
        Loss there and at the start.
    n_motions : int
        Number of motions that were integrated with derivatives.
    motion : Trajectory
        The motion with the values found.
    document : mapping
        The scene with the values found; empty for keys that no scene states.
    schedule : Profile or None
        Inputs over time, with the knots found.
    """

    status: str
    message: str
    key: tuple[str, ...]
    value: FloatArray
    start: FloatArray
    gradient: FloatArray
    loss: float
    start_loss: float
    n_motions: int
    motion: Trajectory
    document: Mapping[str, Any]
    schedule: Profile | None = None

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}: {self.message}"

    def facts(self) -> list[Fact]:
        """Return the losses, then the values."""
        rows = zip(self.key, self.value, self.start, strict=True)
        values = [(key, f"{value:.6g} (from {start:.6g})") for key, value, start in rows]
        return [("loss", f"{self.loss:.6g} (from {self.start_loss:.6g})"), *values]


def optimise(
    gradient: LossGradient,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    max_iterations: int = 100,
    tolerance: float = 1e-9,
) -> Design:
    """Find the numbers of a scene with the least loss of its motion, from those that it states.

    Parameters
    ----------
    gradient : LossGradient
        The loss, as a function of numbers of a scene.
    bounds : mapping of str to (float, float), optional
        Least and largest value of keys; by default what the scene allows.
    max_iterations : int
        Largest number of iterations.
    tolerance : float
        Relative change of the loss from which the search ends.

    Returns
    -------
    Design
        Values, loss, motion, and the scene with the values.

    Raises
    ------
    UnknownNameError, InvalidValueError
        Bounds of another key, or that exclude the start.
    ConvergenceError
        The motion at the start fails.

    Notes
    -----
    `scipy.optimize.minimize` with L-BFGS-B and the exact gradient, over values that are parts of those at the
    start. A local minimum; losses with contacts have many.

    Examples
    --------
    >>> import numpy as np
    >>> from tensegrity_codegen import LossGradient, optimise
    >>> def miss(motion):  # the mass shall be 1.1 m below the anchor at the end
    ...     at = np.zeros_like(motion.node_position)
    ...     at[-1, 1, 2] = motion.node_position[-1, 1, 2] + 1.1
    ...     return 0.5 * at[-1, 1, 2] ** 2, {"node_position": at}
    >>> gradient = LossGradient("two_nodes.toml", ["classes.cord.spring_constant"], miss, 0.4)
    >>> found = optimise(gradient)
    >>> found.status, round(float(found.motion.node_position[-1, 1, 2]), 4)
    ('ok', -1.1)
    """
    check_whole(max_iterations, "max_iterations", 1)
    check_positive(tolerance, "tolerance")
    check_instance(gradient, LossGradient, "gradient", "LossGradient(...)")
    problem = gradient.problem
    low, high = read_bounds(problem, bounds) / problem.size
    start = problem.start / problem.size
    start_loss, start_slope = gradient(problem.start)
    best: list[Any] = [start_loss, problem.start, start_slope, gradient.motion]

    def compute(scaled: FloatArray) -> tuple[float, FloatArray]:
        values = scaled * problem.size
        try:
            loss, slope = gradient(values)
        except (ConvergenceError, InvalidValueError):
            return 1e3 * (abs(start_loss) + 1.0), np.zeros(len(scaled))  # the line search comes back
        if loss < best[0]:
            best[:] = [loss, values.copy(), slope, gradient.motion]
        return loss, slope * problem.size

    search = scipy.optimize.minimize(
        compute,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low.tolist(), high.tolist(), strict=True)),
        options={"maxiter": max_iterations, "ftol": tolerance, "gtol": 1e-12},
    )
    is_found = bool(search.success)
    summary = f"loss {best[0]:.6g} from {start_loss:.6g}, {gradient.n_motions} motions"
    return Design(
        status="ok" if is_found else "not_converged",
        message=summary if is_found else f"{summary}; {search.message}",
        key=problem.keys,
        value=best[1],
        start=problem.start,
        gradient=best[2],
        loss=float(best[0]),
        start_loss=float(start_loss),
        n_motions=gradient.n_motions,
        motion=best[3],
        document=problem.write(best[1]),
        schedule=problem.build_schedule(best[1]),
    )
