"""The integrator of a co-simulation."""

import numpy as np

from tensegrity_codegen.pipeline.analyses import find_needs
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.accuracy.choice import choose_method
from tensegrity_codegen.runtime.accuracy.scales import scale_to_length
from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest

SAMPLES = 101


def settle_method(
    structure: Subject,
    request: ModelRequest,
    method: str,
    *,
    rtol: float,
    t_end: float,
    compiler: str | None,
    may_compile: bool,
) -> str:
    """Return the integrator of a unit: the one given, or for "auto" the one that `simulate` would choose.

    Where the choice is between an explicit method and radau, the library is built to weigh them; without a
    compiler the explicit one is taken. Raises UnknownNameError, and InvalidValueError for a method that
    chooses no steps of its own.
    """
    kind = find_method(method).kind
    if kind not in ("auto", "adaptive", "implicit"):
        raise InvalidValueError(
            "a unit integrates with error control, in its own C code",
            where="method",
            given=method,
            allowed=", ".join(name for name in list_methods("finds_events") if _is_offered(name)),
        )
    names = find_needs("simulate", structure, request, method=method, rtol=rtol).integrators
    if len(names) == 1 or not may_compile:
        return names[0]
    alone = find_needs("simulate", structure, request, method=method, rtol=rtol).alone(request)
    model = build_library(structure, alone, compiler=compiler).load()
    state = np.concatenate([model.nominal("coordinate").ravel(), model.nominal("velocity").ravel()])
    motion = Motion(model, state, np.linspace(0.0, t_end, SAMPLES), {})
    options = scale_to_length(model.manifest, RunOptions(method="auto", rtol=rtol))
    return choose_method(motion, options).name


def _is_offered(name: str) -> bool:
    return find_method(name).kind in ("auto", "adaptive", "implicit")
