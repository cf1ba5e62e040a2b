"""Batches by methods that have no lanes: motion after motion, as `simulate` does them, in threads."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.runtime.trajectory.batch_trajectory import BatchTrajectory
from tensegrity_codegen.runtime.trajectory.sampled import SAMPLED, STATE
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.errors import NonFiniteError


def simulate_one_by_one(
    motion: Motion,
    options: RunOptions,
    threads: int,
    schedule: Sequence[Profile | Schedule] | Profile | Schedule | None = None,
) -> BatchTrajectory:
    """Return the motions from state (n_batch, n_states), each simulated by itself with the same options.

    The arguments come each with whether it has one row a motion; schedule: as of `simulate_batch`. A motion
    that cannot even begin has the status "non_finite_input" or "unstable" and no samples. Raises what
    `simulate` raises besides.
    """
    n, state, common = motion.state.shape[1] // 2, motion.state, options.as_given()

    def run(k: int) -> Trajectory | tuple[str, str]:
        own = {
            name: array[k] if is_batched else array for name, (array, is_batched) in motion.arguments.items()
        }
        if not all(np.isfinite(array).all() for array in (state[k], *own.values())):
            return "non_finite_input", "the initial state or an argument is not finite"
        try:
            return simulate(
                motion.model,
                motion.t_end,
                samples=len(motion.sample_time),
                coordinate=state[k, :n],
                velocity=state[k, n:],
                arguments=own,
                schedule=schedule[k] if isinstance(schedule, Sequence) else schedule,
                **common,
            )
        except NonFiniteError as error:
            return "unstable", str(error.problem)

    found: list[Trajectory | tuple[str, str]] = []  # or why there is none
    with ThreadPoolExecutor(threads) as pool:  # the calls into C hold no lock of Python's
        try:
            for one in pool.map(run, range(len(state))):
                found.append(one)
                motion.report(len(found) / len(state))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return _stack(motion.model, motion.sample_time, found, options.method)


def _stack(
    model: CompiledModel, time: FloatArray, found: list[Trajectory | tuple[str, str]], method: str
) -> BatchTrajectory:
    """Return the motions as one, NAN where samples were not reached."""
    manifest, n_batch, n_t = model.manifest, len(found), len(time)
    n, nodes, members = len(manifest.coordinate_name), len(manifest.node_name), len(manifest.member_name)
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys((*STATE, *SAMPLED), ())
    shapes |= {"coordinate": (n,), "velocity": (n,), "member_tension": (members,)}
    shapes |= {"node_position": (nodes, 3), "node_velocity": (nodes, 3)}
    arrays: dict[str, Any] = {name: np.full((n_batch, n_t, *shape), np.nan) for name, shape in shapes.items()}
    drift, estimate = np.full(n_batch, np.nan), np.full(n_batch, np.nan)
    counts = np.zeros((4, n_batch), dtype=np.int64)
    counts[2] = -1
    ends: list[tuple[str, str]] = []
    for k, motion in enumerate(found):
        if not isinstance(motion, Trajectory):
            ends.append(motion)
            continue
        ends.append((motion.status, motion.message))
        reached = len(motion.time)
        for name, array in arrays.items():
            array[k, :reached] = getattr(motion, name)
        drift[k] = np.nan if motion.energy_drift is None else motion.energy_drift
        estimate[k] = np.nan if motion.error_estimate is None else motion.error_estimate
        counts[:2, k], counts[3, k] = (reached, motion.n_steps), motion.n_evaluations
    return BatchTrajectory(
        time=time,
        **arrays,
        energy_drift=drift,
        error_estimate=estimate,
        status=tuple(word for word, _ in ends),
        message=tuple(message for _, message in ends),
        n_reached=counts[0],
        n_steps=counts[1],
        n_rejected=counts[2],
        n_evaluations=counts[3],
        method=method,
        step=None,
        node_name=manifest.node_name,
        member_name=manifest.member_name,
        structure=model.structure,
    )
