"""A motion in time: coordinates, inputs and tensions at knots, and values in between."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from tensegrity_codegen.runtime.model.arrays import write_arrays
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_path, check_positive, check_whole
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.files import check_ending
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names, describe_number, describe_range
from tensegrity_codegen.system.table_files import write_csv

# Fields with a row for each knot; `residual` and `internal` too where they have rows.
KNOT_FIELDS = (
    *("time", "coordinate", "velocity", "acceleration"),
    *("rest_length", "input", "member_tension"),
)


def choose_even_knots(total: int, count: Any) -> NDArray[np.int64] | None:
    """Return the indices of `count` of `total` knots, evenly distributed, or None if there are no more."""
    count = check_whole(count, "count", 2, problem="not a number of knots")
    if total <= count:
        return None
    return np.round(np.linspace(0, total - 1, count)).astype(np.int64)


@dataclass(frozen=True, eq=False)
class MotionPoint:
    """A motion at one time.

    Attributes
    ----------
    coordinate, velocity, acceleration : ndarray, shape (n_coordinates,)
        Coordinates and their derivatives.
    input : ndarray, shape (n_inputs,)
        Values of the model's inputs.
    internal : ndarray, shape (n_internal,)
        Deflections of contacts that stick, linear between knots.
    """

    coordinate: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    input: FloatArray
    internal: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Summarised):
    """A motion of an actuated structure, at n_t knots.

    Attributes
    ----------
    time : ndarray, shape (n_t,) [s]
        Times of the knots, rising from 0.
    coordinate, velocity, acceleration : ndarray, shape (n_t, n_coordinates)
        Coordinates of the model [m, rad] and their derivatives.
    rest_length : ndarray, shape (n_t, n_actuators) [m]
        Rest length of the first member of each actuator.
    input : ndarray, shape (n_t, n_inputs)
        Values of all inputs of the model, as `simulate` takes them.
    member_tension : ndarray, shape (n_t, n_members) [N]
        Tensions.
    peak_rate : ndarray, shape (n_actuators,) [m/s]
        Largest rate of each actuator's rest length.
    actuators : tuple of str
        Names of the actuators.
    input_name : tuple of str
        Names of the inputs.
    kinks : tuple of float [s]
        Times at which the acceleration jumps.
    shortest_duration : float [s]
        Shortest duration that the rates of the actuators permit; 0 if nothing limits them.
    path_error : float [m]
        Largest distance of a node between the path and the equilibria that it leads through.
    residual : ndarray, shape (n_t,) [N]
        Largest force on a coordinate that the actuators leave out of balance; of bodies a generalised force
        over the most that a unit of the coordinate moves a node. Without entries for static inputs.
    warnings : tuple of str
        What to check.
    internal : ndarray, shape (n_t, n_internal) [m]
        Internal states of a structure on the ground: deflections of contacts; without columns elsewhere.
    """

    time: FloatArray
    coordinate: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    rest_length: FloatArray
    input: FloatArray
    member_tension: FloatArray
    peak_rate: FloatArray
    actuators: tuple[str, ...]
    input_name: tuple[str, ...]
    kinks: tuple[float, ...] = ()
    shortest_duration: float = 0.0
    path_error: float = 0.0
    residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    warnings: tuple[str, ...] = ()
    internal: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        freeze_fields(self)

    def headline(self) -> str:
        """Return the duration and the number of knots."""
        return f"{self.duration:.6g} s, {len(self.time)} knots"

    def facts(self) -> list[Fact]:
        """Return rest lengths, rates and tensions, for `repr` and notebooks."""
        return [
            ("actuators", count_names(self.actuators)),
            ("rest length", describe_range(self.rest_length, "m")),
            ("largest rate", describe_number(float(np.max(self.peak_rate, initial=0.0)), "m/s")),
            ("tension", describe_range(self.member_tension, "N")),
            ("shortest duration", describe_number(self.shortest_duration, "s")),
            ("path error", describe_number(self.path_error, "m")),
        ]

    @property
    def duration(self) -> float:
        """Time of the last knot [s]."""
        return float(self.time[-1])

    def profile(self, t_end: float | None = None) -> Profile:
        """Return the inputs over time, a cubic spline through the knots, for ``simulate(schedule=...)``.

        Parameters
        ----------
        t_end : float, optional
            Time up to which the last values are held [s]; by default the end of the motion.

        Returns
        -------
        Profile
            Of all inputs of the model.
        """
        if t_end is not None:
            check_positive(t_end, "t_end", "[s]")
        values = {name: self.input[:, k] for k, name in enumerate(self.input_name)}
        if t_end is None or t_end <= self.duration:
            return Profile(self.time, values, "cubic")
        time = np.append(self.time, [self.duration, t_end])
        held = {name: np.append(value, [value[-1], value[-1]]) for name, value in values.items()}
        return Profile(time, held, "cubic")

    def arrays(self) -> dict[str, Any]:
        """Return the arrays by name, for an ``.npz`` file."""
        arrays = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        return arrays | {"actuator_name": np.array(self.actuators), "input_name": np.array(self.input_name)}

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the motion to a file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            ``.npz``: all arrays. ``.csv``: time [s] and the inputs of the actuators [m] at the knots, for
            ``read_profile`` with the kind ``"cubic"``.
        overwrite : bool
            Whether a file that exists is replaced.

        Raises
        ------
        OutputError
            The file cannot be written, exists already, or has another ending.
        """
        check_path(path, "path")
        check_ending(path, ".npz", ".csv")
        if Path(path).suffix.lower() == ".npz":
            write_arrays(path, self.arrays(), overwrite=overwrite)
            return
        columns = [self.input_name.index(name) for name in self.actuators]
        rows = np.column_stack([self.time, self.input[:, columns]]).tolist()
        write_csv(path, ("time", *self.actuators), rows, overwrite=overwrite)

    def at(self, time: float) -> MotionPoint:
        """Return the motion at a time [s]; before the first and after the last knot it is at rest there.

        Coordinates are quintic polynomials between knots, with the positions, velocities and accelerations of
        both, so that their second derivatives are continuous.
        """
        if not isinstance(time, Real) or time != time:
            raise InvalidValueError("not a time", where="time", given=time, allowed="a number [s]")
        since = min(max(time, 0.0), self.duration)
        q, v, a = (np.asarray(piece(since)) for piece in self._pieces)
        if time < 0.0 or time > self.duration:
            v, a = np.zeros_like(v), np.zeros_like(a)
        value = self._profile.pieces.at(since) if self.input_name else np.zeros(0)
        deflected = [np.interp(since, self.time, column) for column in self.internal.T]
        return MotionPoint(q, v, a, value, np.array(deflected))

    def at_knots(self, count: int) -> "Motion":
        """Return the motion through some of its knots, which takes less memory in a controller in C.

        Parameters
        ----------
        count : int
            Number of knots, evenly distributed among those of the motion; the first and the last, and those
            at kinks, are kept in any case.

        Returns
        -------
        Motion
            Interpolated as before; the same motion where it has no more knots. ``peak_rate`` stays that of
            the whole motion.

        Raises
        ------
        InvalidValueError
            Fewer than two knots.
        """
        total = len(self.time)
        even = choose_even_knots(total, count)
        if even is None:
            return self
        bent = [int(np.abs(self.time - kink).argmin()) for kink in self.kinks]
        rows = np.unique(np.concatenate([even, np.array(bent, dtype=np.int64)]))
        selected = {
            name: value[rows]
            for name, value in vars(self).items()
            if name in KNOT_FIELDS or (name in ("residual", "internal") and len(value) == total)
        }
        return replace(self, **selected)

    @cached_property
    def _profile(self) -> Profile:
        return self.profile()

    @cached_property
    def _pieces(self) -> tuple[Any, Any, Any]:
        """Piecewise polynomials of coordinates, velocities and accelerations."""
        knots = np.stack([self.coordinate, self.velocity, self.acceleration], axis=1)
        start = BPoly.from_derivatives(self.time, knots)
        return start, start.derivative(), start.derivative(2)
