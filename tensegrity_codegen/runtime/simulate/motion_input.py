"""Input of a motion, checked: its start, run-time arguments and schedule, and files of starts."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tensegrity_codegen.runtime.integrate.methods import find_method, list_methods
from tensegrity_codegen.runtime.integrate.motion import Motion, Schedule
from tensegrity_codegen.runtime.integrate.options import MAX_SAMPLES, RunOptions, check_options
from tensegrity_codegen.runtime.model.arguments import INPUT, check_arguments, merge_inputs, unify_name
from tensegrity_codegen.runtime.model.arrays import (
    UNREADABLE,
    check_finite,
    check_shape,
    read_arrays,
    read_names,
    to_array,
)
from tensegrity_codegen.runtime.model.consistent import make_consistent
from tensegrity_codegen.runtime.model.interface import require_double, require_model
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import (
    DrivenArguments,
    bind_profile,
    check_laws,
    check_memory,
    check_not_constant,
    check_rigid,
    follows_in_c,
)
from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.runtime.trajectory.simulation_quantities import require_simulation
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_positive, check_whole
from tensegrity_codegen.system.errors import (
    InvalidValueError,
    SceneSyntaxError,
    UnknownNameError,
    describe_reason,
    suggest,
)
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import Manifest
from tensegrity_codegen.tables.precision import PRECISIONS

MIN_T_END = 1e-150  # [s]: squares of steps are numbers
MAX_BYTES = 8 * 2**30  # of all arrays of a trajectory
OF_NODES = {"node_position": "coordinate", "node_velocity": "velocity"}
HELD_TOLERANCE = 1e-9  # of the largest entry, by which what is held may differ from the scene


def check_sample_memory(manifest: Manifest, samples: int) -> None:
    """Raise InvalidValueError if two states a sample, nodes and tensions would exceed MAX_BYTES."""
    states = 2 * len(manifest.coordinate_name)
    row = 8 * (2 * states + 6 * len(manifest.node_name) + len(manifest.member_name))
    if samples * row > MAX_BYTES:
        raise InvalidValueError(
            "too many samples: they would not fit into memory",
            where="samples",
            given=f"{samples} samples, {samples * row / 2**30:.1f} GiB",
            allowed=f"at most {max(2, MAX_BYTES // row)} for {len(manifest.member_name)} members",
            hint="take fewer samples, or simulate in parts",
        )


def check_profiles(
    model: CompiledModel,
    schedule: Profile | Schedule | Sequence[Profile | Schedule] | None,
    arguments: Mapping[str, Any] | None,
) -> None:
    """Raise InvalidValueError for an input with a profile in one of the schedules, and a constant value."""
    for driver in schedule if isinstance(schedule, Sequence) else (schedule,):
        if isinstance(driver, Profile):
            check_not_constant(driver, arguments or {}, model.manifest.input_name)


def read_sample_times(samples: int | ArrayLike, t_end: float) -> FloatArray:
    """Return the times of samples (n,) [s]: so many equally spaced ones, or those given, from 0 to t_end."""
    if check_positive(t_end, "t_end", "[s]") < MIN_T_END:
        raise InvalidValueError("too short", where="t_end", given=t_end, allowed=f"{MIN_T_END:g} s or more")
    if not isinstance(samples, Sequence | np.ndarray):
        count = check_whole(samples, "samples", 2, MAX_SAMPLES, "not a number of samples")
        return np.linspace(0.0, t_end, count)
    allowed = f"increasing times [s], the first 0 and the last t_end = {t_end}, at most {MAX_SAMPLES}"
    times = np.array(to_array(samples, PRECISIONS["double"], "samples", allowed))
    good = times.ndim == 1 and 2 <= times.size <= MAX_SAMPLES
    if not (good and times[0] == 0.0 and times[-1] == t_end and (np.diff(times) > 0.0).all()):
        raise InvalidValueError("not times of samples", where="samples", given=samples, allowed=allowed)
    return times


def find_start(
    model: CompiledModel,
    coordinate: ArrayLike | None,
    velocity: ArrayLike | None,
    arguments: Mapping[str, Any],
) -> FloatArray:
    """Return the state (n_states,) that a motion starts from; the scene's, where nothing is given."""
    q, v = _read(model, "coordinate", coordinate), _read(model, "velocity", velocity)
    return np.concatenate(make_consistent(model, q, v, arguments))


def read_schedule(
    model: CompiledModel,
    schedule: Profile | Schedule | None,
    options: RunOptions,
    arguments: Mapping[str, Any],
    t_end: float,
) -> Schedule | None:
    """Return the schedule with inputs as one array, those that it does not name as in `arguments`."""
    if schedule is None:
        return None
    if not callable(schedule):
        raise InvalidValueError(
            "not a schedule",
            where="schedule",
            given=schedule,
            allowed="a Profile, or a function time [s] -> arguments by name",
        )
    if options.keep:
        raise InvalidValueError(
            "energy cannot be kept constant while parameters or inputs change with time",
            where="keep",
            given=options.keep,
            allowed='keep="" with a schedule',
        )
    # Names that may change with time.
    manifest = model.manifest
    names = schedule.values if isinstance(schedule, Profile) else merge_inputs(manifest, schedule(0.0))
    check_arguments(model.manifest, dict.fromkeys(unify_name(manifest, name) for name in names))
    if "anchor_position" in names:
        raise InvalidValueError(
            "anchor positions cannot change during a motion", where="schedule", given="anchor_position"
        )
    # A profile is bound to the model; a function is called at each time.
    if isinstance(schedule, Profile):
        bound = bind_profile(model, schedule, arguments, t_end)
        check_rigid(model, bound)
        check_memory(model, bound)
        _check_method(model, options.method, bound)
        return bound
    _check_method(model, options.method, schedule)
    base = arguments.get(INPUT)
    return lambda time: merge_inputs(manifest, schedule(time), base)


def _check_method(model: CompiledModel, method: str, schedule: Schedule) -> None:
    """Raise InvalidValueError for a method that cannot follow this schedule."""
    if find_method(method).takes_schedule:
        return
    if not follows_in_c(schedule, model.manifest) or not find_method(method).finds_events:
        is_profile = isinstance(schedule, DrivenArguments)
        raise InvalidValueError(
            "this library's motions take no values over time"
            if is_profile
            else "this method holds parameters and inputs constant, unless they follow a Profile",
            where="schedule",
            given=method,
            allowed=", ".join(list_methods("takes_schedule")),
            hint="state what changes under [[inputs]] in the scene, and build again"
            if is_profile
            else 'method="auto" chooses one of these and checks its error',
        )
    if method == STIFF_INTEGRATOR:
        check_laws(model, schedule)


def _read(model: CompiledModel, name: str, value: ArrayLike | None) -> FloatArray:
    nominal = model.nominal(name)
    array = (
        nominal if value is None else to_array(value, PRECISIONS["double"], name, f"shape {nominal.shape}")
    )
    check_shape(array, nominal.shape, name)
    check_finite(array, "simulate", f"the initial {name} is not finite")
    return array


def read_motion(
    model: CompiledModel,
    options: RunOptions,
    t_end: float,
    samples: int | ArrayLike,
    arguments: Mapping[str, Any] | None,
    schedule: Profile | Schedule | None,
    coordinate: ArrayLike | None,
    velocity: ArrayLike | None,
) -> Motion:
    """Return the motion that these arguments of `simulate` ask for; raises as that."""
    require_model(model)
    times = read_sample_times(samples, t_end)
    check_options(options, t_end, len(times))
    require_double(model.manifest, "a simulation from Python")
    require_simulation(model)
    check_sample_memory(model.manifest, len(times))
    check_profiles(model, schedule, arguments)
    values = merge_inputs(model.manifest, arguments)
    check_arguments(model.manifest, values)
    drive = read_schedule(model, schedule, options, values, t_end)
    values |= drive(0.0) if isinstance(drive, DrivenArguments) else {}
    state = find_start(model, coordinate, velocity, values)
    return Motion(model, state, times, values, schedule=drive)


def read_starts(path: str | Path, manifest: Manifest) -> dict[str, Any]:
    """Return coordinate, velocity and arguments for `simulate_batch` from an .npz file.

    It holds one or more of coordinate and velocity (n_batch, n_coordinates), node_position and node_velocity
    (n_batch, n_nodes, 3), and run-time arguments and inputs by name, those without a leading axis for all
    motions.
    Raises SceneSyntaxError for what is no such file, UnknownNameError for another name, InvalidValueError for
    nodes that are moved where they are held.
    """
    # Names that the file may have.
    arguments = [argument.name for argument in manifest.arguments if argument.name not in OF_NODES.values()]
    arguments += [name for name in manifest.input_name if unify_name(manifest, name) != name]
    states = [*OF_NODES.values(), *(OF_NODES if manifest.coordinate_node_axis else ())]
    try:
        for name in read_names(Path(path)):
            if name not in (*states, *arguments):
                raise UnknownNameError(
                    "neither a state nor a run-time argument",
                    where=str(path),
                    given=name,
                    allowed=", ".join((*states, *arguments)),
                    hint=suggest(name, (*states, *arguments)),
                )
        data = read_arrays(Path(path), (*states, *arguments))
    except UNREADABLE as error:
        raise SceneSyntaxError(
            "not a file of initial states",
            where=str(path),
            given=describe_reason(error),
            allowed="an .npz file of NumPy arrays",
        ) from error
    # States of nodes become coordinates; other arrays are arguments.
    starts: dict[str, Any] = {"arguments": {}}
    for name, array in data.items():
        if name in arguments:
            starts["arguments"][name] = array
            continue
        key = OF_NODES.get(name, name)
        if key in starts:
            of_nodes = next(array_name for array_name, state in OF_NODES.items() if state == key)
            raise InvalidValueError(
                "two arrays give the same state",
                where=str(path),
                given=f"{of_nodes} and {key}",
                allowed=f"one of {of_nodes} and {key}",
            )
        starts[key] = _pick(array, name, manifest, str(path)) if name in OF_NODES else array
    return starts


def _pick(array: FloatArray, name: str, manifest: Manifest, where: str) -> FloatArray:
    """Return the free coordinates (n_batch, n_coordinates) of all nodes' values (n_batch, n_nodes, 3)."""
    stated = manifest.stated_position if name == "node_position" else np.zeros((len(manifest.node_name), 3))
    if array.ndim != 3 or array.shape[1:] != stated.shape or array.dtype.kind not in "fiu":
        raise InvalidValueError(
            "wrong shape",
            where=f"{where}: {name}",
            given=f"{array.dtype} {array.shape}",
            allowed=f"numbers (n_batch, {len(stated)}, 3)",
        )
    node_axis = manifest.coordinate_place
    is_held = np.ones(stated.shape, dtype=bool)
    is_held[node_axis[:, 0], node_axis[:, 1]] = False
    difference = np.where(is_held, np.abs(array - stated), 0.0)
    if not np.all(difference <= HELD_TOLERANCE * max(1.0, float(np.abs(stated).max()))):
        motion, node, _ = (int(k) for k in np.argwhere(~(difference <= HELD_TOLERANCE))[0])
        raise InvalidValueError(
            "an anchored node cannot start at another position",
            where=f"{where}: {name}",
            given=f"motion {motion}, node {manifest.node_name[node]}: {array[motion, node].tolist()}",
            allowed=f"{stated[node].tolist()} on the anchored axes",
        )
    return np.ascontiguousarray(array[:, node_axis[:, 0], node_axis[:, 1]], dtype=np.float64)
