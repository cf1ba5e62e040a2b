"""MuJoCo: nodes as point masses on slide joints, or rigid bars as free bodies; springs as spatial tendons."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.system.arrays import FloatArray

INTEGRATORS = ("RK4", "implicitfast", "Euler")
STEPS = tuple(10.0 ** (-k / 2) for k in range(3, 11))  # of the time span
THIN = 1e-6  # inertia of a rod about itself, over that across it: MuJoCo asks for one


def contenders(problem: MotionProblem) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield MuJoCo with each of its integrators."""
    for integrator in INTEGRATORS:
        yield f"MuJoCo {integrator}", partial(_make, problem, integrator)


def _make(problem: MotionProblem, integrator: str) -> Contender:
    try:
        import mujoco
    except ImportError:
        raise Unavailable("not installed: mujoco") from None
    mujoco.set_mju_user_warning(_ignore)  # what it would print, and log to a file; it is in the status
    structure, times = problem.structure, problem.sample_time
    model = mujoco.MjModel.from_xml_string(write_model(structure, integrator))
    sites = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"s{k}") for k in range(structure.n_nodes)]
    bodies = model.site_bodyid[sites]
    data = mujoco.MjData(model)
    start = _start_velocity(mujoco, model, data, structure)
    apart = times[1] - times[0]

    def run(setting: float) -> Callable[[], Run]:
        count = max(1, int(np.ceil(apart / (setting * problem.t_end) * (1 - 1e-12))))
        model.opt.timestep = apart / count
        mujoco.mj_resetData(model, data)
        data.qvel[:] = start
        data.xfrc_applied[bodies, :3] = structure.node_load
        places = []
        for index in range(len(times)):
            if index:
                mujoco.mj_step(model, data, nstep=count)
            mujoco.mj_kinematics(model, data)
            places.append(data.site_xpos[sites].copy())
        # MuJoCo sets a state that has become wild back to the start, and warns.
        wild = sum(int(data.warning[k].number) for k in _wild(mujoco))
        status = "unstable" if wild else "ok"
        steps = count * (len(times) - 1)
        return partial(Run, np.array(places), status, "reset itself" if wild else "", steps, 0)

    return Contender(f"MuJoCo {integrator}", "peer", "MuJoCo", integrator, "step", STEPS, run)


def _ignore(_: str) -> None:
    """Say nothing."""


def _wild(mujoco: Any) -> tuple[Any, ...]:
    kinds = mujoco.mjtWarning
    return (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)


def write_model(structure: Structure, integrator: str) -> str:
    """Return the structure as MJCF; Unavailable where MuJoCo has not the same physics."""
    _check(structure)
    gravity = " ".join(repr(float(g)) for g in structure.gravity)
    bars = [int(e) for e in np.flatnonzero(structure.is_rigid)]
    carried = {int(node) for e in bars for node in structure.connectivity[e]}
    bodies = [_rod(structure, e) for e in bars]
    bodies += [_point(structure, node) for node in range(structure.n_nodes) if node not in carried]
    tendons = [_tendon(structure, e) for e in range(structure.n_members) if e not in bars]
    return (
        f'<mujoco><option gravity="{gravity}" integrator="{integrator}">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


def _check(structure: Structure) -> None:
    if structure.damping[structure.tension_only].any():
        raise Unavailable("its tendons keep their damping when slack")
    if not structure.is_linear.all():
        raise Unavailable("its tendons are linear springs")
    rigid = structure.is_rigid
    if (structure.member_mass[~rigid] > 0).any():
        raise Unavailable("a spring has no mass of its own")
    if rigid.any():
        if structure.node_load.any():
            raise Unavailable("loads on the ends of rigid bodies")
        ends = structure.connectivity[rigid].ravel()
        if len(set(ends.tolist())) < len(ends) or structure.node_anchored[ends].any():
            raise Unavailable("rigid bars that meet or are anchored would be joined by its soft constraints")


def _point(structure: Structure, node: int) -> str:
    place = _numbers(structure.node_position[node])
    free = [a for a in structure.axes if not structure.node_anchored[node, a]]
    joints = "".join(f'<joint type="slide" axis="{" ".join("01"[a == b] for b in range(3))}"/>' for a in free)
    mass = float(structure.node_mass[node])
    inertia = f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"/>' if joints else ""
    return f'<body pos="{place}">{joints}{inertia}<site name="s{node}"/></body>'


def _rod(structure: Structure, member: int) -> str:
    """Return a free body: a uniform rod with point masses at its ends."""
    i, j = (int(node) for node in structure.connectivity[member])
    own, (mi, mj) = float(structure.member_mass[member]), structure.node_mass[[i, j]]
    ri, rj = structure.node_position[[i, j]]
    total = own + mi + mj
    centre = (own * (ri + rj) / 2 + mi * ri + mj * rj) / total
    length = float(np.linalg.norm(ri - rj))
    across = own * length**2 / 12 + own * np.sum(((ri + rj) / 2 - centre) ** 2)
    across += mi * np.sum((ri - centre) ** 2) + mj * np.sum((rj - centre) ** 2)
    axis = _numbers((rj - ri) / length)
    inertia = _numbers(np.array([across, across, THIN * across]))
    sites = "".join(
        f'<site name="s{node}" pos="0 0 {float((place - centre) @ (rj - ri) / length)!r}"/>'
        for node, place in ((i, ri), (j, rj))
    )
    return (
        f'<body pos="{_numbers(centre)}" zaxis="{axis}"><freejoint/>'
        f'<inertial pos="0 0 0" mass="{float(total)!r}" diaginertia="{inertia}"/>{sites}</body>'
    )


def _tendon(structure: Structure, member: int) -> str:
    rest = float(structure.rest_length[member])
    mu = float(structure.mu[member])
    spring = f"0 {rest!r}" if structure.tension_only[member] else f"{rest!r}"
    ends = "".join(f'<site site="s{int(k)}"/>' for k in structure.path(member))
    damping = float(structure.damping[member])
    return f'<spatial stiffness="{mu!r}" damping="{damping!r}" springlength="{spring}">{ends}</spatial>'


def _start_velocity(mujoco: Any, model: Any, data: Any, structure: Structure) -> FloatArray:
    """Return the joint velocities that give the nodes their speeds, by least squares."""
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    rows, wanted = [], []
    for node in range(structure.n_nodes):
        block = np.zeros((3, model.nv))
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"s{node}")
        mujoco.mj_jacSite(model, data, block, None, site)
        rows.append(block)
        wanted.append(structure.node_velocity[node])
    found: FloatArray = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
    return found


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
