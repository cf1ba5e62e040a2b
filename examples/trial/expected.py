"""The numbers that every example has to print, computed by the Python interface.

Python uses solvers of its own: Newton's method in a trust region for equilibria, and motions whose tolerance
bounds the error of the samples. Only the functions of the library are the same.
"""

import numpy as np

from tensegrity_codegen import find_equilibrium, simulate
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.model.model import CompiledModel
from trial.rows import Row

MOTOR = 0.03  # [m]
SAMPLES, END = 5, 0.2


def expect_mast(model: CompiledModel) -> tuple[Row, ...]:
    """Return the rows of the mast: both equilibria and the motion from the first one."""
    members, coordinates = model.manifest.member_name, model.manifest.coordinate_name
    arguments = {"motor": MOTOR}
    rest = find_equilibrium(model)
    moved = find_equilibrium(model, coordinate=rest.coordinate, arguments=arguments)
    motion = simulate(
        model,
        END,
        samples=SAMPLES,
        method="rk853",
        rtol=1e-9,
        stepping=Stepping(atol=1e-12),
        coordinate=rest.coordinate,
        arguments=arguments,
    )
    assert motion.status == "ok", motion.message
    rows = _rows("tension_at_rest", members, rest.member_tension, "N")
    rows += _rows("tension_moved", members, moved.member_tension, "N")
    rows += _rows("position_moved", coordinates, moved.coordinate, "m")
    rows.append(Row("energy", "start", float(motion.total_energy[0]), "J"))
    for time, coordinate in zip(motion.time[1:], motion.coordinate[1:], strict=True):
        rows += _rows(f"motion_{time:.2f}s", coordinates, coordinate, "m")
    for time, name, direction in zip(motion.log.time, motion.log.name, motion.log.direction, strict=True):
        rows.append(Row("taut" if direction > 0 else "slack", name, float(time), "s"))
    rows.append(Row("energy", "end", float(motion.total_energy[-1]), "J"))
    return tuple(rows)


def expect_tower(model: CompiledModel) -> tuple[Row, ...]:
    """Return the rows of the tower: the tensions at the values of its scene."""
    return tuple(_rows("tower_tension", model.manifest.member_name, model.compute("member_tension"), "N"))


def _rows(quantity: str, names: tuple[str, ...], values: np.ndarray, unit: str) -> list[Row]:
    return [Row(quantity, name, float(value), unit) for name, value in zip(names, values, strict=True)]
