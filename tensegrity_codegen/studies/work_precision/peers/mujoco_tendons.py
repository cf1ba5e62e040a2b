"""MuJoCo: nodes as point masses on slide joints, springs as spatial tendons, bars as these or as bodies.

Rigid bars that meet hang on each other by ball joints, as branches of one tree; those that are anchored by
ball joints at the anchor. Loads on their ends are motors at sites.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.work_precision.measure import Contender, MotionProblem, Run, Unavailable
from tensegrity_codegen.system.arrays import FloatArray

INTEGRATORS = ("RK4", "implicitfast", "Euler")
STEPS = tuple(10.0 ** (-k / 2) for k in range(3, 11))  # of the time span
THIN = 1e-6  # inertia of a rod about itself, over that across it: MuJoCo asks for one
BALL = '<joint type="ball"/>'


def contenders(
    problem: MotionProblem, *, usual: bool = False
) -> Iterator[tuple[str, Callable[[], Contender]]]:
    """Yield MuJoCo with each of its integrators; unless `usual`, elastic bars as rigid bodies too."""
    rigid, bars = problem.structure.is_rigid, problem.structure.is_bar
    for integrator in INTEGRATORS:
        yield f"MuJoCo {integrator}", partial(_make, problem, integrator, rigid)
        if (bars & ~rigid).any() and not usual:
            yield f"MuJoCo (rigid bars) {integrator}", partial(_make, problem, integrator, bars)


def _make(problem: MotionProblem, integrator: str, rigid: NDArray[np.bool_]) -> Contender:
    try:
        import mujoco
    except ImportError:
        raise Unavailable("not installed: mujoco") from None
    mujoco.set_mju_user_warning(_ignore)  # what it would print, and log to a file; it is in the status
    structure, times = problem.structure, problem.sample_time
    text = write_model(structure, integrator, rigid)
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:  # such as a body without mass
        raise Unavailable(str(error).splitlines()[0]) from None
    sites = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"s{k}") for k in range(structure.n_nodes)]
    bodies = model.site_bodyid[sites]
    data = mujoco.MjData(model)
    start = _start_velocity(mujoco, model, data, structure)
    interval = times[1] - times[0]
    on_rods = np.isin(np.arange(structure.n_nodes), structure.connectivity[rigid])[:, None]
    load = np.where(on_rods, 0.0, structure.node_load)  # of the others motors take care

    def run(setting: float) -> Callable[[], Run]:
        count = max(1, int(np.ceil(interval / (setting * problem.t_end) * (1 - 1e-12))))
        model.opt.timestep = interval / count
        mujoco.mj_resetData(model, data)
        data.qvel[:] = start
        data.xfrc_applied[bodies, :3] = load
        data.ctrl[:] = 1.0
        positions = []
        for index in range(len(times)):
            if index:
                mujoco.mj_step(model, data, nstep=count)
            mujoco.mj_kinematics(model, data)
            positions.append(data.site_xpos[sites].copy())
        # MuJoCo sets a state that has become wild back to the start, and warns.
        wild = sum(int(data.warning[k].number) for k in _wild(mujoco))
        status = "unstable" if wild else "ok"
        steps = count * (len(times) - 1)
        return partial(Run, np.array(positions), status, "reset itself" if wild else "", steps, 0)

    added = ", rigid bars" if (rigid & ~structure.is_rigid).any() else ""
    name = f"MuJoCo{' (rigid bars)' if added else ''} {integrator}"
    return Contender(name, "peer", f"MuJoCo{added}", integrator, "step", STEPS, run)


def _ignore(_: str) -> None:
    """Say nothing."""


def _wild(mujoco: Any) -> tuple[Any, ...]:
    kinds = mujoco.mjtWarning
    return (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)


def write_model(structure: Structure, integrator: str, rigid: NDArray[np.bool_] | None = None) -> str:
    """Return the structure as MJCF; Unavailable where MuJoCo has not the same physics.

    rigid: the members that become rigid bodies (n_members,); those without stiffness if not given.
    """
    rigid = structure.is_rigid if rigid is None else rigid
    _check(structure, rigid)
    gravity = _numbers(structure.gravity)
    tendons = "".join(_tendon(structure, int(e)) for e in np.flatnonzero(~rigid))
    ends = np.unique(structure.connectivity[rigid])
    motors = "".join(
        f'<motor site="s{k}" refsite="world" gear="{_numbers(structure.node_load[k])} 0 0 0"/>'
        for k in ends[structure.node_load[ends].any(axis=1)]
    )
    return (
        f'<mujoco><option gravity="{gravity}" integrator="{integrator}">'
        '<flag contact="disable" constraint="disable"/></option>'
        f'<worldbody><site name="world"/>{_write_bodies(structure, rigid)}</worldbody>'
        f"<tendon>{tendons}</tendon><actuator>{motors}</actuator></mujoco>"
    )


def _check(structure: Structure, rigid: NDArray[np.bool_]) -> None:
    if structure.damping[structure.tension_only].any():
        raise Unavailable("its tendons keep their damping when slack")
    if not structure.is_linear[~rigid].all():
        raise Unavailable("its tendons are linear springs")
    if (structure.member_mass[~rigid] > 0).any():
        raise Unavailable("a spring has no mass of its own")


def _write_bodies(structure: Structure, rigid: NDArray[np.bool_]) -> str:
    """Return a body for each rigid bar and each node on none; trees of bars begin at anchors."""
    position, anchored = structure.node_position, structure.node_anchored[:, list(structure.axes)]
    remaining = {int(e) for e in np.flatnonzero(rigid)}
    done: set[int] = set()  # nodes that have a site

    def grow(node: int, origin: FloatArray, joints: str) -> str:
        """Return the bodies of all bars that are left at a node, in a body at `origin`."""
        text = ""
        for bar in sorted(remaining):
            ends = structure.connectivity[bar].tolist()
            if bar not in remaining or node not in ends:
                continue
            remaining.discard(bar)
            far_node = sum(ends) - node
            if far_node in done or anchored[far_node].any():
                raise Unavailable("rigid bars in a loop would be joined by its soft constraints")
            carried = [k for k in (node, far_node) if k not in done]
            done.update(carried)
            inner = grow(far_node, position[node], BALL) + grow(node, position[node], BALL)
            text += _rod(structure, bar, (node, far_node), carried, position[node] - origin, joints + inner)
        return text

    text = ""
    for node in sorted(range(len(position)), key=lambda k: (-int(anchored[k].sum()), k)):
        if node in done:
            continue
        if anchored[node].all() or node not in structure.connectivity[rigid]:
            done.add(node)
            text += _point(structure, node, grow(node, position[node], BALL))
        elif anchored[node].any():
            text += grow(node, np.zeros(3), _slides(structure, node) + BALL)
        else:
            text += grow(node, np.zeros(3), "<freejoint/>")
    return text


def _slides(structure: Structure, node: int) -> str:
    free = [a for a in structure.axes if not structure.node_anchored[node, a]]
    return "".join(f'<joint type="slide" axis="{" ".join("01"[a == b] for b in range(3))}"/>' for a in free)


def _point(structure: Structure, node: int, inner: str) -> str:
    joints, mass = _slides(structure, node), float(structure.node_mass[node])
    inertia = f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"/>' if joints else ""
    position = _numbers(structure.node_position[node])
    return f'<body pos="{position}">{joints}{inertia}<site name="s{node}"/>{inner}</body>'


def _rod(
    structure: Structure, member: int, ends: tuple[int, int], carried: list[int], at: FloatArray, inner: str
) -> str:
    """Return a body: a uniform rod with the point masses of the nodes that it carries, its first end `at`."""
    points = structure.node_position[carried] - structure.node_position[ends[0]]
    along = structure.node_position[ends[1]] - structure.node_position[ends[0]]
    own_mass, masses = float(structure.member_mass[member]), structure.node_mass[carried]
    total, length = own_mass + float(masses.sum()), float(np.linalg.norm(along))
    if not total > 0.0:
        raise Unavailable("a rigid bar without mass")
    centre = (own_mass * along / 2 + masses @ points) / total
    across = own_mass * length**2 / 12 + own_mass * np.sum((along / 2 - centre) ** 2)
    across = max(across + masses @ np.sum((points - centre) ** 2, axis=1), THIN * total * length**2)
    sites = "".join(f'<site name="s{k}" pos="{_numbers(p)}"/>' for k, p in zip(carried, points, strict=True))
    inertia = _numbers(across * np.array([1.0, 1.0, THIN]))
    return (
        f'<body pos="{_numbers(at)}">{inner}<inertial pos="{_numbers(centre)}" mass="{total!r}" '
        f'zaxis="{_numbers(along / length)}" diaginertia="{inertia}"/>{sites}</body>'
    )


def _tendon(structure: Structure, member: int) -> str:
    rest_length = float(structure.rest_length[member])
    mu = float(structure.mu[member])
    spring = f"0 {rest_length!r}" if structure.tension_only[member] else f"{rest_length!r}"
    ends = "".join(f'<site site="s{int(k)}"/>' for k in structure.path(member))
    damping = float(structure.damping[member])
    return f'<spatial stiffness="{mu!r}" damping="{damping!r}" springlength="{spring}">{ends}</spatial>'


def _start_velocity(mujoco: Any, model: Any, data: Any, structure: Structure) -> FloatArray:
    """Return the joint velocities that give the nodes their speeds, by least squares."""
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    rows, targets = [], []
    for node in range(structure.n_nodes):
        block = np.zeros((3, model.nv))
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"s{node}")
        mujoco.mj_jacSite(model, data, block, None, site)
        rows.append(block)
        targets.append(structure.node_velocity[node])
    solution: FloatArray = np.linalg.lstsq(np.concatenate(rows), np.concatenate(targets), rcond=None)[0]
    return solution


def _numbers(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
