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
    position = manifest.stated_position
    extent = float(np.ptp(position, axis=0).max(initial=0.0)) if len(position) else 0.0
    return extent if extent > 0.0 and math.isfinite(extent) else 1.0


def set_atol_by_length(manifest: Manifest, options: RunOptions) -> RunOptions:
    """Return the options with atol: the one given, or 1e-9 times the length of the structure [m].

    In coordinates that are angles the length is 1.
    """
    if options.atol is not None:
        return options
    length = 1.0 if find_formulation(manifest.formulation).has_angles else find_length(manifest)
    return replace(options, atol=RELATIVE_ATOL * length)


def set_atol_by_motion(motion: Motion, options: RunOptions) -> RunOptions:
    """Return the options of set_atol_by_length, with 1e-9 times a speed V as the tolerance of velocities.

    V is the largest of the length in a second, the speed at the start, and sqrt(a L): the speed after
    crossing the length L with the acceleration a of the start.
    """
    if options.atol is not None:
        return options
    scaled = set_atol_by_length(motion.model.manifest, options)
    n_coordinates = len(motion.state) // 2
    length = scaled.absolute / RELATIVE_ATOL
    speed = float(np.abs(motion.state[n_coordinates:]).max(initial=0.0))
    try:
        acceleration = motion.model.compute(
            "acceleration",
            coordinate=motion.state[:n_coordinates],
            velocity=motion.state[n_coordinates:],
            **motion.arguments,
        )
        speed = max(speed, math.sqrt(length * float(np.abs(acceleration).max(initial=0.0))))
    except NonFiniteError:  # the integrator reports it
        pass
    return replace(scaled, atol_speed=RELATIVE_ATOL * max(length, speed))


def tolerance_of_options(manifest: Manifest, options: RunOptions) -> Tolerance:
    """Return the tolerance of the states of a model from the options of a run."""
    return tolerance_for(
        manifest, options.rtol, options.absolute, options.atol_speed, length=find_length(manifest)
    )
