"""Explicit methods with error control at the samples: rk54 and rk853, by name or chosen by `auto`."""

from functools import cache, partial

from tensegrity_codegen.runtime.accuracy.error_control import Checks, tighten_until_converged
from tensegrity_codegen.runtime.accuracy.lost_vibration import LostVibration
from tensegrity_codegen.runtime.accuracy.rounding import Rounding
from tensegrity_codegen.runtime.accuracy.scales import tolerance_of_options
from tensegrity_codegen.runtime.accuracy.vibrations.fastest import find_fastest, find_noise
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.tables.tableaus import TABLEAUS


def integrate_explicit_to_samples(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return a run of the explicit method of the options, its estimated error within the tolerance.

    What rounding makes of velocities is in `evidence` where it is more than the tolerance, see
    tighten_until_converged. Raises as integrate_adaptive.
    """
    find_frequency = cache(partial(find_fastest, motion))
    tolerance = tolerance_of_options(motion.model.manifest, options)

    def run(rtol: float, atol: float) -> RawTrajectory:
        return integrate_adaptive(motion, options.within(rtol, atol))

    is_centre = motion.model.manifest.is_centre
    place = motion.state[: len(is_centre)][~is_centre]
    lost = LostVibration(motion, options, find_frequency, integrate_adaptive, options.method)
    checks = Checks(
        least_atol=TABLEAUS[options.method].noise_share * find_noise(place, find_frequency()),
        rounding=Rounding(find_frequency, is_centre),
        lost=partial(lost.estimate, tolerance=tolerance),
    )
    return tighten_until_converged(run, tolerance, checks)
