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
from harness.candidate import Candidate, Unavailable
from harness.problem import Problem
from harness.tools import Tools, Way
from numpy.typing import NDArray

NAME = "MuJoCo, mj_forward"
MOST_MEMBERS = 10_000


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
    model = mujoco.MjModel.from_xml_string(write_model(problem))
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


def write_model(problem: Problem) -> str:
    """Return the model as MJCF."""
    structure = problem.structure
    gravity = " ".join(repr(float(g)) for g in structure.gravity)
    bodies = [_body(problem, node) for node in range(problem.n_nodes)]
    tendons = [_tendon(problem, member) for member in range(problem.n_members)]
    return (
        f'<mujoco><option gravity="{gravity}"><flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


def _body(problem: Problem, node: int) -> str:
    structure = problem.structure
    place = " ".join(repr(float(x)) for x in structure.node_position[node])
    free = [axis for axis in range(3) if not structure.node_anchored[node, axis]]
    axes = [" ".join("01"[axis == other] for other in range(3)) for axis in free]
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in axes)
    mass = float(structure.node_mass[node])
    inertia = f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-3 1e-3 1e-3"/>' if joints else ""
    return f'<body pos="{place}">{joints}{inertia}<site name="s{node}"/></body>'


def _tendon(problem: Problem, member: int) -> str:
    rest = float(problem.rest_length[member])
    spring = f"0 {rest!r}" if problem.tension_only[member] else f"{rest!r}"
    ends = "".join(f'<site site="s{k}"/>' for k in (problem.first[member], problem.second[member]))
    return f'<spatial stiffness="{float(problem.mu[member])!r}" springlength="{spring}">{ends}</spatial>'


def _forward(mujoco: Any) -> Any:
    """Return mj_forward of the shared library that the Python package brings."""
    folder = Path(mujoco.__file__).parent
    library = next(path for path in folder.iterdir() if path.name.startswith(("libmujoco", "mujoco.dll")))
    return ctypes.CDLL(str(library)).mj_forward
