"""The record of an identification: values, how sure they are, and what the data do not show."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.sweeps.fitting.measurements import KINDS
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import Fact, Summarised, describe_number

NAMED = 0.2  # part of a direction, of length 1, from which a key of it is named
EQUAL = 0.05  # of the largest part of a direction: parts that count as equal


@dataclass(frozen=True)
class Undetermined:
    """A direction of the numbers that the data do not show."""

    part: Mapping[str, float]  # key -> its part, as a part of its value, the largest first
    error: float  # standard error along it, as a part of the values

    def describe(self) -> str:
        """Return the direction in words: what may change together, and what alone is known."""
        keys, sizes = list(self.part), list(self.part.values())
        if len(keys) == 1:
            return f"{keys[0]} at all"
        named = f"{', '.join(keys[:-1])} and {keys[-1]}"
        if max(sizes) - min(sizes) < EQUAL * max(sizes):
            return f"the sizes of {named}, only their {'ratio' if len(keys) == 2 else 'ratios'}"
        if len(keys) == 2 and abs(sum(sizes)) < EQUAL * max(sizes):
            return f"{named} apart, only their product"
        return "together " + ", ".join(f"{value:+.2g} of {key}" for key, value in self.part.items())


@dataclass(frozen=True, repr=False)
class Identification(Summarised):
    """Numbers of a scene from measurements.

    Attributes
    ----------
    status : str
        ``"ok"``; ``"not_converged"``, ``"interrupted"``: the best values so far; ``"not_explained"``: the
        residual is far above the stated noise; ``"sensitive"``: the motion is too sensitive for derivatives.
    message : str
        What that means here.
    key : tuple of str
        The numbers.
    value, start, standard_error : ndarray, shape (n_keys,)
        Values found and at the start, in the units of the scene, and standard errors.
    interval : ndarray, shape (n_keys, 2)
        95 % intervals, by the quantile of Student's t.
    covariance : ndarray, shape (n_keys, n_keys)
        Covariance of the values.
    noise : mapping of str to float
        Standard deviation of each kind of measurement, given or estimated: position and length [m], velocity
        [m/s], tension [N], frequency [Hz].
    residual : float
        Root mean square of the residuals over the noise; 1 where the model explains all but the noise.
    whiteness : float
        Probability that residuals of pure noise have larger correlations from one time to the next; NaN with
        fewer than 20 times.
    held_out : float
        Root mean square over the noise of the times that were not used; NaN without any.
    undetermined : tuple of Undetermined
        Directions along which the standard error exceeds the sizes of the values.
    without_influence : tuple of str
        Keys that change nothing that was measured.
    n_values, n_motions : int
        Number of measured values used, and of motions (or sets of equilibria) with derivatives.
    warnings : tuple of str
        What a careful reader should know.
    document : mapping
        The scene with the values found; empty for keys that no scene states.
    """

    status: str
    message: str
    key: tuple[str, ...]
    value: FloatArray
    start: FloatArray
    standard_error: FloatArray
    interval: FloatArray
    covariance: FloatArray
    noise: Mapping[str, float]
    residual: float
    whiteness: float
    held_out: float
    undetermined: tuple[Undetermined, ...]
    without_influence: tuple[str, ...]
    n_values: int
    n_motions: int
    warnings: tuple[str, ...] = ()
    document: Mapping[str, Any] = field(default_factory=dict)

    @property
    def correlation(self) -> FloatArray:
        """Correlations of the values, (n_keys, n_keys)."""
        error = np.sqrt(np.diag(self.covariance))
        scale = np.where(error > 0.0, error, 1.0)
        return np.asarray(self.covariance / np.outer(scale, scale))

    def headline(self) -> str:
        """Return status and message."""
        return f"{self.status}: {self.message}"

    def facts(self) -> list[Fact]:
        """Return the values with their standard errors, then residual and noise."""
        rows = zip(self.key, self.value, self.standard_error, strict=True)
        values = [(key, f"{value:.6g} +- {error:.2g}") for key, value, error in rows]
        noise = [
            (f"noise of {kind}", describe_number(size, KINDS[kind][0])) for kind, size in self.noise.items()
        ]
        return [*values, ("residual over noise", f"{self.residual:.3g}"), *noise]

    def as_evidence(self) -> dict[str, Any]:
        """Return all results by name, JSON-ready."""
        values = zip(self.key, self.value, self.start, self.standard_error, self.interval, strict=True)
        return {
            "status": self.status,
            "message": self.message,
            "values": {
                key: {
                    "value": float(value),
                    "start": float(start),
                    "standard_error": float(error),
                    "interval": interval.tolist(),
                }
                for key, value, start, error, interval in values
            },
            "correlation": self.correlation.tolist(),
            "noise": dict(self.noise),
            "residual": self.residual,
            "whiteness": self.whiteness,
            "held_out": self.held_out,
            "undetermined": [
                {"part": dict(direction.part), "error": direction.error, "text": direction.describe()}
                for direction in self.undetermined
            ],
            "without_influence": list(self.without_influence),
            "n_values": self.n_values,
            "n_motions": self.n_motions,
        }

    def write_scene(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the scene with the values found.

        Parameters
        ----------
        path : str or Path
            File to write, ending in ``.toml`` or another ending of scenes.
        overwrite : bool
            Whether to replace a file that exists.

        Raises
        ------
        InvalidValueError
            Some keys are of the assembled structure, and no scene states them.
        OutputError
            The file cannot be written, or exists.
        """
        if not self.document:
            problem = "some of the numbers are of the assembled structure, and no scene states them"
            allowed = "numbers of the scene, as members.NAME.rest_length"
            raise InvalidValueError(problem, where=str(path), given=", ".join(self.key), allowed=allowed)
        write_scene(dict(self.document), path, overwrite=overwrite)
