"""What a sensitivity leaves of the way of an equilibrium, with the gauge's motions taken out."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tensegrity_codegen.runtime.sensitivity.sensitivity import Sensitivity
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium

Array = NDArray[np.float64]
STEPS = 8e-3 / 80.0 ** (np.arange(5) / 4)  # of the rest lengths: 8e-3 to 1e-4


def move_onto(target: Array, position: Array, gauge: tuple[str, ...]) -> Array:
    """Return positions (n_nodes, 3) moved along the named slides and turns to where they are nearest."""
    slides = ["xyz".index(name[-1]) for name in gauge if name.startswith("slide")]
    turns = ["xyz".index(name[-1]) for name in gauge if name.startswith("turn")]
    assert len(slides) + len(turns) == len(gauge)
    centre, moved = target.mean(axis=0), position.copy()
    for _ in range(30):
        local = moved - centre
        fields = [np.tile(np.eye(3)[axis], len(local)) for axis in slides]
        fields += [np.cross(np.eye(3)[axis], local).ravel() for axis in turns]
        if not fields:
            break
        part = np.linalg.lstsq(np.array(fields).T, (target - moved).ravel(), rcond=None)[0]
        turn = np.zeros(3)
        turn[turns] = part[len(slides) :]
        moved = Rotation.from_rotvec(turn).apply(local) + centre
        moved[:, slides] += part[: len(slides)]
    return moved


def find_remainders(
    model: Any, start: Equilibrium, found: Sensitivity, rest_length: Array, direction: Array
) -> tuple[Array, Array]:
    """Return |r(rho + h d) - r(rho) - h S d| [m] and the same of tensions [N], one for each of STEPS."""
    places, tensions = [], []
    for h in STEPS:
        changed = find_equilibrium(
            model,
            coordinate=start.coordinate,
            arguments={"rest_length": rest_length + h * direction},
            tolerance=1e-13,
            raise_on_failure=False,
        )
        assert changed.is_found, changed.message
        position = move_onto(start.node_position, changed.node_position, found.gauge)
        places.append(np.linalg.norm(position - start.node_position - h * found.node @ direction))
        change = changed.member_tension - start.member_tension
        tensions.append(np.linalg.norm(change - h * found.tension @ direction))
    return np.array(places), np.array(tensions)


def check_slopes(*remainders: Array) -> None:
    """Assert that remainders fall with the square of the step, from each step to the next."""
    for values in remainders:
        slopes = np.diff(np.log(values)) / np.diff(np.log(STEPS))
        assert np.all((slopes > 1.9) & (slopes < 2.1)), slopes
