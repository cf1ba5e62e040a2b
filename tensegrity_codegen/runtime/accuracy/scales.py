"""The absolute tolerance where none is given: by the length and the speed of the structure itself."""

import math
from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.tolerance import Tolerance, tolerance_for
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.system.errors import NonFiniteError
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.manifest import Manifest

RELATIVE_ATOL = 1e-9  # absolute tolerance over length and speed of the structure


def find_length(manifest: Manifest) -> float:
    """Return the largest extent of a structure along an axis [m], 1 if it has none."""
    place = manifest.stated_position
    extent = float(np.ptp(place, axis=0).max(initial=0.0)) if len(place) else 0.0
    return extent if extent > 0.0 and math.isfinite(extent) else 1.0


def scale_to_length(manifest: Manifest, options: RunOptions) -> RunOptions:
    """Return the options with an absolute tolerance: the one given, or 1e-9 times the length in SI units."""
    if options.atol is not None:
        return options
    scale = 1.0 if find_formulation(manifest.formulation).has_angles else find_length(manifest)
    return replace(options, atol=RELATIVE_ATOL * scale)


def scale_to_motion(motion: Motion, options: RunOptions) -> RunOptions:
    """Return the same, with 1e-9 times the speed V of a motion as the tolerance of velocities.

    V is the largest of the length in a second, the speed at the start, and sqrt(a L): the speed after
    crossing the length L with the acceleration a of the start.
    """
    if options.atol is not None:
        return options
    scaled = scale_to_length(motion.model.manifest, options)
    n = len(motion.state) // 2
    length, speed = scaled.absolute / RELATIVE_ATOL, float(np.abs(motion.state[n:]).max(initial=0.0))
    try:
        found = motion.model.compute(
            "acceleration", coordinate=motion.state[:n], velocity=motion.state[n:], **motion.arguments
        )
        speed = max(speed, math.sqrt(length * float(np.abs(found).max(initial=0.0))))
    except NonFiniteError:  # the integrator says so
        pass
    return replace(scaled, atol_speed=RELATIVE_ATOL * max(length, speed))


def tolerance_of_options(manifest: Manifest, options: RunOptions) -> Tolerance:
    """Return the tolerance of a model's states that a run is asked for."""
    return tolerance_for(
        manifest, options.rtol, options.absolute, options.atol_speed, length=find_length(manifest)
    )
