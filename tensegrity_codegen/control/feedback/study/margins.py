"""Margins of linear closed loops, and the errors that noise of the sensors will cause in them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur, solve_triangular

from tensegrity_codegen.control.feedback.study.linear_loop import LinearLoop
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.structure.frozen import freeze_fields
from tensegrity_codegen.system.arrays import FloatArray

MOST_SAMPLES = 10  # of more delay that are tried
FACTORS = tuple(1.5**k for k in range(1, 7))  # of the actuators' effect that are tried
HALVINGS = 6
FREQUENCIES = 200  # at which a loop is looked at, besides those of its eigenvalues
LOWEST = 1e-4  # of the highest frequency
OFFSETS = (-1.0, -0.5, 0.0, 0.5, 1.0)  # frequencies about an eigenvalue's, in multiples of its decay
REFINED = 21  # frequencies between the neighbours of the worst one
STEP = 1e-6  # of differences; coordinates are lengths of structures of a metre, or angles


@dataclass(frozen=True, eq=False)
class Margins:
    """What a linear loop stands before it becomes unstable.

    is_stable: whether the loop itself is stable.
    delay [s]: largest further delay of all actuators, infinite where ten samples more are not too many.
    gain: largest factor of the effect of all actuators, infinite where 11 is not too much.
    radius: largest modulus of an eigenvalue of the transition of one sample, below 1 for a stable loop.
    disk: disk margin where the effects of all actuators change at once, each by its own factor: at least
        this.
    actuator_disk (n_actuators,): disk margin where the effect of this actuator alone changes.

    With a disk margin d the loop stands each factor f = (2 + e) / (2 - e) of the effect of the actuators, e
    any complex number with abs(e) < d: gains from (2 - d) / (2 + d) to (2 + d) / (2 - d) or phases of up to
    2 arctan(d / 2), and both at the same time where f stays in the disk (P. Seiler, A. Packard, P. Gahinet,
    An introduction to disk margins, IEEE Control Systems Magazine 40, 2020).
    """

    is_stable: bool
    delay: float
    gain: float
    radius: float
    disk: float
    actuator_disk: FloatArray

    def __post_init__(self) -> None:
        freeze_fields(self)


def find_gain_range(disk: float) -> tuple[float, float]:
    """Return the least and the largest factor of the actuators' effect in a disk; infinite from 2 on."""
    return max((2.0 - disk) / (2.0 + disk), 0.0), (2.0 + disk) / (2.0 - disk) if disk < 2.0 else np.inf


def find_phase(disk: float) -> float:
    """Return the phase by which the actuators may lag in a disk [rad]."""
    return 2.0 * float(np.arctan(0.5 * disk))


def find_margins(loop: LinearLoop) -> Margins:
    """Return what a loop stands: delay and gain to about 1 %, disks at its worst frequencies."""
    radius = loop.radius()
    if not radius < 1.0:
        return Margins(False, 0.0, 1.0, radius, 0.0, np.zeros(len(loop.delay)))
    sample = loop.gains.sample
    delays = [sample * count for count in range(1, MOST_SAMPLES + 1)]
    return Margins(
        True,
        _find_first(lambda more: loop.radius(more_delay=more), 0.0, delays),
        _find_first(lambda factor: loop.radius(factor=factor), 1.0, FACTORS),
        radius,
        *find_disks(loop),
    )


def _find_first(radius: Callable[[float], float], stable: float, values: Sequence[float]) -> float:
    """Return the largest value below which loops are stable, infinite where all values are."""
    for value in values:
        if radius(value) < 1.0:
            stable = value
            continue
        above = value
        for _ in range(HALVINGS):
            middle = 0.5 * (stable + above)
            stable, above = (middle, above) if radius(middle) < 1.0 else (stable, middle)
        return stable
    return float("inf")


# Disk margins: the loop is broken where the commands enter the plant.


def find_disks(loop: LinearLoop) -> tuple[float, FloatArray]:
    """Return the disk margins of all actuators at once (at least), and of each one alone (n_actuators,).

    With S the sensitivity at the inputs of the plant, the disk of one actuator is 1 over the largest modulus
    of its diagonal entry of S - 1/2, that of all together at least 1 over the largest singular value.
    """
    transition, push, command = loop.open_at_inputs()
    triangle, vectors = schur(transition, output="complex")
    right, m = vectors.conj().T, len(loop.delay)

    def measure(angle: float) -> FloatArray:
        """Return the size of S - 1/2 at an angle of z [rad]: of each actuator alone, and of all."""
        z = np.exp(1j * angle)
        effect = sum((z ** (-k) * part for k, part in enumerate(push)), np.zeros(push[0].shape))
        states = solve_triangular(z * np.eye(len(triangle)) - triangle, right @ effect)
        found = 0.5 * np.eye(m) + (command @ vectors) @ states
        return np.append(np.abs(np.diag(found)), np.linalg.norm(found, 2))

    # Frequencies: a grid, those of all eigenvalues, then between the neighbours of the worst ones.
    values = np.diag(triangle)
    values = values[np.abs(values) > LOWEST]
    near = [np.abs(np.angle(values)) + part * np.abs(np.log(np.abs(values))) for part in OFFSETS]
    grid = np.geomspace(LOWEST, 1.0, FREQUENCIES) * np.pi
    angles = np.unique(np.clip(np.concatenate([grid, *near]), 0.0, np.pi))
    sizes = np.array([measure(angle) for angle in angles])
    for k in np.unique(sizes.argmax(axis=0)):
        low, high = angles[max(k - 1, 0)], angles[min(k + 1, len(angles) - 1)]
        between = [measure(angle) for angle in np.linspace(low, high, REFINED)]
        sizes = np.vstack([sizes, between])
    largest = sizes.max(axis=0)
    return float(1.0 / largest[-1]), 1.0 / largest[:-1]


# Errors that noise causes, before anything is simulated.


def predict_errors(loop: LinearLoop, model: CompiledModel, coordinate: FloatArray) -> dict[str, float]:
    """Return the distance of each node from its place that noise of the sensors causes, by its name [m].

    Root of its mean square in the stationary loop, infinite where the loop is unstable; 0 without an
    estimator.

    loop: about `coordinate` (n_coordinates,), the end of the motion.
    model: places the nodes.
    """
    covariance, names = loop.covariance(), model.manifest.node_name
    if not np.isfinite(covariance).all():
        return dict.fromkeys(names, float("inf"))
    slope = np.array(
        [
            (place_nodes(model, coordinate + step) - place_nodes(model, coordinate - step)) / (2.0 * STEP)
            for step in STEP * np.eye(len(coordinate))
        ]
    )
    squares = np.maximum(np.einsum("aix,ab,bix->i", slope, covariance, slope), 0.0)
    return dict(zip(names, np.sqrt(squares).tolist(), strict=True))
