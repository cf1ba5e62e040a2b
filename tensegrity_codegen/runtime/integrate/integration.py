"""Shared parts of all integrations in C: arrays, bound once, and the samples that they fill."""

from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.model.arrays import to_sized
from tensegrity_codegen.runtime.model.interface import require_double
from tensegrity_codegen.runtime.model.library import raise_for_status
from tensegrity_codegen.runtime.profiles.driven import KnotsInC, follows_in_c
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.manifest import SET_STATES, STATUS, IntegratorSpec, Manifest


class BoundIntegrator:
    """One integration of x = (q, q', z): state, samples, arguments and work memory as the C loop reads them.

    Raises FormulationError if the model has no such integrator, InvalidValueError for a state or an
    argument of another size.
    """

    def __init__(self, name: str, motion: Motion) -> None:
        model, state, sample_time = motion.model, motion.state, motion.sample_time
        require_double(model.manifest, "an integration from Python")
        spec = find_integrator(model.manifest, name)
        has_step_control = INTEGRATORS[spec.name].has_step_control
        self.n_moved = 2 * len(model.manifest.coordinate_name)  # states besides the internal ones
        state = np.concatenate([to_sized(state, (self.n_moved,), "state"), read_internal(motion)])
        self.name, self.spec, self.ffi = name, spec, model.library.ffi
        self.call = model.library.symbol(f"{spec.symbol}_run" if has_step_control else spec.symbol)
        schedule = motion.schedule
        self.knots: KnotsInC | None = None  # where arguments follow a profile
        if follows_in_c(schedule, model.manifest):
            self.knots = KnotsInC(self.ffi, model.manifest, schedule)
        self.state = state
        self.sample_time = np.array(sample_time, dtype=np.float64)
        self.samples = np.empty((len(sample_time), len(state)))
        self.samples[0] = state
        self.passed = {
            name: to_sized(motion.arguments.get(name, nominal), nominal.shape, name)
            for name, nominal in ((name, model.nominal(name)) for name in spec.arguments)
        }
        self.work = np.empty(spec.work_size)
        self.tensions = np.empty((len(sample_time), len(spec.tensions)))
        self.tension_member = spec.tensions
        self.n_sampled = self.ffi.new("long long *", 1)

    @property
    def n_reached(self) -> int:
        """Number of samples filled so far."""
        return int(self.n_sampled[0])

    def pointer(self, array: FloatArray) -> Any:
        """Return the C pointer to an array."""
        return self.ffi.from_buffer("double[]", array)

    def arguments(self) -> list[Any]:
        """Return the C pointers to the run-time arguments, in order."""
        return [self.pointer(array) for array in self.passed.values()]

    def check(self, status: int, expected: tuple[str, ...]) -> str:
        """Return the status as a word; raise what it stands for if it is neither ok nor expected here."""
        word = STATUS[status]
        if word != "ok" and word not in expected:
            raise_for_status(status, f"integrate_{self.name}", {"state": self.state, **self.passed})
        return word


def read_internal(motion: Motion) -> FloatArray:
    """Return the internal states that a motion starts from, by default relaxed or zero; derivatives."""
    manifest = motion.model.manifest
    count = len(manifest.internal_name)
    usual: Any = np.zeros(count)
    if "internal" not in motion.arguments and motion.model.has("relaxed_internal"):
        place = np.split(np.asarray(motion.state), 2)[0]
        usual = motion.model.compute("relaxed_internal", **{**motion.arguments, "coordinate": place})
    own = to_sized(motion.arguments.get("internal", usual), (count,), "internal")
    if motion.model.has("settled_internal"):
        own = _settle_start(motion, own)
    if not manifest.column_name:
        return own
    nominal = motion.model.nominal("column")
    start = to_sized(motion.arguments.get("column", nominal), nominal.shape, "column")
    return np.concatenate([own, start.ravel()])


def _settle_start(motion: Motion, internal: FloatArray) -> FloatArray:
    """Return internal states as a run begins with them: within their limits, nothing flowing yet."""
    flags = [name.endswith(f"_{SET_STATES['yield']}") for name in motion.model.manifest.internal_name]
    coordinate, velocity = np.split(np.asarray(motion.state), 2)
    start = {"coordinate": coordinate, "velocity": velocity, "internal": np.where(flags, 0.0, internal)}
    return np.array(motion.model.compute("settled_internal", **{**motion.arguments, **start}))


def find_integrator(manifest: Manifest, name: str) -> IntegratorSpec:
    """Return an integrator of a library; raises FormulationError if it has it not."""
    for spec in manifest.integrators:
        if spec.name == name:
            return spec
    raise FormulationError(
        f"the library has no integrator {name!r}",
        where=manifest.name,
        allowed=f'a library that was built with integrators = ["{name}"]',
        hint=f'build it with integrators=("{name}",), or use one of the methods scipy_*',
    )
