"""One entry for all methods of integration, their error held to what is asked for."""

from dataclasses import replace

from tensegrity_codegen.runtime.accuracy.automatic import integrate_auto
from tensegrity_codegen.runtime.accuracy.damped_out import integrate_radau_to_samples
from tensegrity_codegen.runtime.accuracy.explicit import integrate_explicit_to_samples
from tensegrity_codegen.runtime.accuracy.scales import scale_to_motion
from tensegrity_codegen.runtime.accuracy.scheduled import integrate_scipy_to_samples
from tensegrity_codegen.runtime.accuracy.step_doubling import check_by_doubling
from tensegrity_codegen.runtime.accuracy.vibrations.fastest import find_fastest
from tensegrity_codegen.runtime.integrate.adaptive import integrate_adaptive
from tensegrity_codegen.runtime.integrate.methods import find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.radau import integrate_radau
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.integrate.rk4 import integrate_rk4
from tensegrity_codegen.runtime.integrate.scipy_methods import integrate_scipy

# By the kind of method: one run, and runs whose error at the samples is controlled.
ONCE = {
    "auto": integrate_auto,
    "fixed": integrate_rk4,
    "adaptive": integrate_adaptive,
    "implicit": integrate_radau,
    "scipy": integrate_scipy,
}
TO_SAMPLES = {
    "auto": integrate_auto,
    "adaptive": integrate_explicit_to_samples,
    "implicit": integrate_radau_to_samples,
    "scipy": integrate_scipy_to_samples,
}


def integrate(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return the states at the sample times by one of METHODS, checked unless `control` is "steps"."""
    options = scale_to_motion(motion, options)
    if options.control == "steps":
        return _tell(integrate_once(motion, options))
    if options.step is not None:
        return check_by_doubling(
            lambda step: integrate_once(motion, replace(options, step=step)),
            options.step,
            motion.model.manifest,
            find_fastest(motion),
        )
    return TO_SAMPLES[find_method(options.method).kind](motion, options)


def _tell(run: RawTrajectory) -> RawTrajectory:
    """Return a good run with the word that nothing is known of its whole error."""
    if run.status != "ok":
        return run
    return replace(
        run, message=f'{run.message}; the error at the samples is not estimated (`control="samples"`)'
    )


def integrate_once(motion: Motion, options: RunOptions) -> RawTrajectory:
    """Return one run of a method, its whole error unchecked unless the method checks it itself."""
    return ONCE[find_method(options.method).kind](motion, options)
