"""The energy balance of motions: what changed over the samples, and whether it may."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.tables.manifest import Manifest

# Energy may change by this fraction of the largest kinetic energy before a run is called wrong.
ENERGY_TOLERANCE = 0.1
# Change of coordinates over the largest of them, below which nothing moves: a hundredth of the default
# absolute tolerance. Multipliers of rigid bars make that of rounding: 1e-13 in a tenth of a second.
MIN_RELATIVE_MOTION = 1e-11


@dataclass(frozen=True)
class EnergyBalance:
    """Of each motion: drift (...), the largest change of the total energy over the largest kinetic energy.

    has_grown (..., n_t): whether there is too much energy by each sample; has_lost (...): whether there ever
    was too little.
    """

    drift: FloatArray
    has_grown: NDArray[np.bool_]
    has_lost: NDArray[np.bool_]

    def judge(
        self, place: int | tuple[()], time: FloatArray, conservative: bool, is_driven: bool, message: str
    ) -> tuple[str, str]:
        """Return status and message of the motion at `place`, whose own message is `message`."""
        grown = self.has_grown[place]
        if grown.any() and not is_driven:
            when = time[int(np.argmax(grown))]
            return "unstable", f"the total energy has grown by t = {when:.6g} s: take a smaller step"
        if conservative and self.has_lost[place]:
            return "inaccurate", "energy is lost that nothing takes: take a smaller step"
        return "ok", message


def balance_energy(kinetic: FloatArray, total: FloatArray, coordinate: FloatArray) -> EnergyBalance:
    """Return the balance of motions from their energies (..., n_t) [J]; samples that are NAN are left out.

    coordinate (..., n_t, n_coordinates): where these change by no more than rounding nothing moves, and the
    energies are rounding too.
    """
    change = total - total[..., :1]
    # Below this the change is rounding of the potential energy, not motion.
    floor = 1e-9 * np.fmax.reduce(np.abs(total - kinetic), axis=-1)
    scale = np.fmax(np.fmax.reduce(kinetic, axis=-1), floor)
    scale = np.where(scale == 0.0, 1.0, scale)
    # Motions that keep their coordinates up to rounding.
    axes = (-2, -1)
    moved = np.fmax.reduce(np.abs(coordinate - coordinate[..., :1, :]), axis=axes, initial=0.0)
    size = np.fmax.reduce(np.abs(coordinate), axis=axes, initial=0.0)
    scale = np.where(moved <= MIN_RELATIVE_MOTION * size, np.inf, scale)
    return EnergyBalance(
        drift=np.asarray(np.fmax.reduce(np.abs(change), axis=-1) / scale),
        has_grown=change > ENERGY_TOLERANCE * scale[..., None],
        has_lost=np.asarray(np.fmax.reduce(-change, axis=-1) > ENERGY_TOLERANCE * scale),
    )


def find_energy_flow(
    manifest: Manifest, power: Callable[[], FloatArray]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether each motion keeps its energy (...), and whether something drives it (...).

    power: energy_rate (..., n_t) [W] at the samples, called only where it depends on something. A model
    without `energy_rate` keeps its energy if its accelerations depend on no velocity. Of contacts
    samples tell nothing: they lose energy in short impacts, and a moving belt brings some in.
    """
    needed = {spec.quantity: spec.arguments for spec in manifest.functions}
    if manifest.motor_name:  # which bring energy in
        return np.array(False), np.array(True)
    if manifest.has_contacts and needed.get("energy_rate", ("velocity",)):
        return np.array(False), np.array(True)
    if "energy_rate" not in needed:
        return np.array("velocity" not in needed["acceleration"]), np.array(False)
    if not needed["energy_rate"]:
        return np.array(True), np.array(False)
    rates = power()
    return ~np.any(rates, axis=-1), np.max(rates, axis=-1) > 0.0
