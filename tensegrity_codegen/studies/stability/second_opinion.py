"""A reference in extended precision, where no two methods in double precision agree: by shorter steps."""

import math
import time

import numpy as np

from tensegrity_codegen.studies.stability.cases import Case
from tensegrity_codegen.studies.stability.extended import ExtendedMotion, has_extended_precision
from tensegrity_codegen.studies.stability.judge import Truth, is_agreed
from tensegrity_codegen.studies.stability.own import SAMPLES
from tensegrity_codegen.system.errors import TensegrityError

RESOLVED = 0.6  # radians of the fastest vibration in a step, at first: some 1e-9 off a step
DECAYED = 2.0  # decay times in a step: order 8 is stable up to 6
SHORTER = 1.5  # times the steps in the next run, 25 times as exact where no cable goes slack or taut
AGREEMENTS = 2  # one after the other; where cables go slack, two runs can agree by chance


def certify_extended(case: Case, limit: float) -> Truth | None:
    """Return states that steps in extended precision and shorter ones agree on, None where time is up before.

    Only where all members are linear springs. limit: seconds of CPU time.
    """
    structure = case.structure
    if case.expects_refusal or case.is_rigid or not has_extended_precision():
        return None
    if not structure.is_linear.all():
        return None
    deadline = time.process_time() + limit
    times = np.linspace(0.0, case.t_end, SAMPLES)
    try:
        motion = ExtendedMotion(structure)
        frequency, decay = motion.fastest()
        step = min(RESOLVED / max(frequency, 1e-300), DECAYED / max(decay, 1e-300), times[1])
        count, agreed = max(1, math.ceil(times[1] / step)), 0
        before = motion.run(times, count, deadline)
        while before is not None:
            count = math.ceil(SHORTER * count)
            state = motion.run(times, count, deadline)
            if state is None:
                return None
            apart = np.abs(state - before).astype(np.float64)
            agreed = agreed + 1 if is_agreed(case, state.astype(np.float64), apart) else 0
            if agreed == AGREEMENTS:
                tension = motion.tension(state)
                between = np.abs(tension - motion.tension(before))
                return Truth(state.astype(np.float64), apart, tension, between)
            before = state
    except (TensegrityError, np.linalg.LinAlgError):
        return None
    return None
