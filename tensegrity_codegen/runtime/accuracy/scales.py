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

MIN_RELATIVE_ATOL = 1e-9  # least absolute tolerance over length and speed of the structure, if none is given


def find_length(manifest: Manifest) -> float:
    """Return the largest extent of a structure along an axis [m], 1 if it has none."""
    position = manifest.stated_position
    extent = float(np.ptp(position, axis=0).max(initial=0.0)) if len(position) else 0.0
    return extent if extent > 0.0 and math.isfinite(extent) else 1.0


def find_share(options: RunOptions) -> float:
    """Return the absolute tolerance, where none is given, over length and speed of a motion.

    rtol, at least 1e-9; the latter where nothing estimates what the errors of all steps come to.
    """
    return max(options.rtol, MIN_RELATIVE_ATOL) if options.control == "samples" else MIN_RELATIVE_ATOL


def set_atol_by_length(manifest: Manifest, options: RunOptions) -> RunOptions:
    """Return the options with atol: the one given, or a share of the structure's length [m], see find_share.

    In coordinates that are angles the length is 1.
    """
    is_open = options.control == "samples" and (options.method == "auto" or options.atol is None)
    if options.atol is not None:
        return replace(options, is_open=is_open)
    length = 1.0 if find_formulation(manifest.formulation).has_angles else find_length(manifest)
    atol = find_share(options) * length  # until a motion tells its speed: the length in a second
    return replace(options, atol=atol, atol_speed=atol, is_open=is_open)


def set_atol_by_motion(motion: Motion, options: RunOptions) -> RunOptions:
    """Return the options of set_atol_by_length, with as much of a speed V as the tolerance of velocities.

    V is the largest of the length in a second, the speed at the start, and sqrt(a L): the speed after
    crossing the length L with the acceleration a of the start. It serves the first run, after which the
    largest speed of that takes its place, see Tolerance.measure.
    """
    scaled = set_atol_by_length(motion.model.manifest, options)
    if options.atol is not None:
        return scaled
    n_coordinates = len(motion.state) // 2
    share = find_share(options)
    length = scaled.absolute / share
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
    return replace(scaled, atol_speed=share * max(length, speed))


def tolerance_of_options(manifest: Manifest, options: RunOptions) -> Tolerance:
    """Return the tolerance of the states of a model from the options of a run."""
    tolerance = tolerance_for(
        manifest, options.rtol, options.absolute, options.atol_speed, length=find_length(manifest)
    )
    if options.atol_speed is None:
        return tolerance
    share = find_share(options)
    return replace(tolerance, speed_share=share, least_speed=options.atol_speed * MIN_RELATIVE_ATOL / share)
