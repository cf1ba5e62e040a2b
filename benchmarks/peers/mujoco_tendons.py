"""MuJoCo: every node a point mass on slide joints, every member a spatial tendon with a spring.

What is timed is mj_forward, called from C: kinematics, tendon lengths and Jacobians, mass matrix and its
factors, passive forces, accelerations; contacts are off, there are no constraints. MuJoCo has no call that
computes less than that for the same force, and none for the stiffness.
"""

import ctypes
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness.problem import Problem
from harness.tools import Candidate, Tools, Unavailable, Way
from numpy.typing import NDArray

from tensegrity_codegen.studies.work_precision.peers.mujoco_tendons import write_model

NAME = "MuJoCo, mj_forward"
MOST_MEMBERS = 10_000
INTEGRATOR = "Euler"  # which mj_forward does not use


def ways(problem: Problem, quantity: str, tools: Tools) -> list[Way]:
    """Return title and maker of the candidate for that quantity."""
    return [(NAME, lambda: _make(problem, quantity, tools))]


def _make(problem: Problem, quantity: str, tools: Tools) -> Candidate:
    if quantity not in ("node_force", "acceleration"):
        raise Unavailable("MuJoCo computes accelerations only")
    if problem.n_members > MOST_MEMBERS:
        raise Unavailable(f"not attempted above {MOST_MEMBERS} members")
    try:
        import mujoco
    except ImportError:
        raise Unavailable("not installed: mujoco") from None
    started = time.perf_counter()
    model = mujoco.MjModel.from_xml_string(write_model(problem.structure, INTEGRATOR))
    data = mujoco.MjData(model)
    data.qpos[:] = problem.coordinate - problem.fixed_position[problem.free]
    data.qfrc_applied[:] = problem.structure.node_load.reshape(-1)[problem.free]
    made = time.perf_counter() - started
    run = tools.runner.pair(_forward(mujoco), model._address, data._address)

    def value() -> NDArray[np.float64]:
        if quantity == "acceleration":
            return np.array(data.qacc)
        force = np.full(3 * problem.n_nodes, np.nan)  # MuJoCo has no forces on held nodes
        force[problem.free] = problem.mass * data.qacc
        return force

    return Candidate(NAME, run, value, called="C", made=made, kept=(model, data))


def _forward(mujoco: Any) -> Any:
    """Return mj_forward of the shared library that the Python package brings."""
    folder = Path(mujoco.__file__).parent
    library = next(path for path in folder.iterdir() if path.name.startswith(("libmujoco", "mujoco.dll")))
    return ctypes.CDLL(str(library)).mj_forward
