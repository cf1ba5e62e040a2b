"""Disturbances of a study, drawn anew for each run: errors of start and stiffnesses, gusts; and its times."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.loop.control_run import ControlRun
from tensegrity_codegen.control.feedback.loop.sampled_plant import (
    NODE_LOAD,
    Disturbance,
    Gust,
    check_span,
    keep_bars,
    read_disturbance,
)
from tensegrity_codegen.control.feedback.study.tuning import Scales, find_angles
from tensegrity_codegen.control.planning.target_text import ANGLES, LENGTHS
from tensegrity_codegen.runtime.model.arguments import INPUT
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import (
    check_callback,
    check_instance,
    check_positive,
    check_whole,
    is_number,
)
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError, UnknownNameError, suggest
from tensegrity_codegen.system.name_patterns import find_matching

STIFFNESSES = ("axial_stiffness", "spring_constant")
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
START_ERROR = re.compile(rf"\s*({NUMBER})\s*(deg|rad|mm|cm|m)?\s*")
SAFE_PART = 0.1  # of the shortest rigid distance: an error of the start with which nothing collapses
KEPT_WITHIN = 1e-6  # m, by which rigid parts may still move once they have their lengths
PROBE, HELD_WITHIN = 1e-3, 1e-8  # change of coordinates [m, rad], and of the position of a held node [m]
STIFF = 10.0  # times the largest force at rest: a member that an error loads by more is stiff
PROBED_PART, MAX_CORRECTIONS = 1e-6, 8  # of the size, to find by how much errors load members; of an error
SIMULATED_PART = 3.0  # simulated time over that of the motion
# Time constants of the slowest error, from the end of the motion until errors are compared.
COMPARED_CONSTANTS = 3.0
MAX_EXTENSION = 10.0  # times the usual simulated time, for slow errors
COMPARED_PART = 6.0  # simulated time over that at whose end errors are compared
ROUNDING = 1e-9  # of a sample


@dataclass(frozen=True)
class RandomGust:
    """A force of random direction on one of the nodes of a pattern, for a limited time.

    Attributes
    ----------
    nodes : str
        Name or pattern of nodes: ``"t1"``, ``"bar*_B"``, ``"*"``.
    force : float or tuple of float [N]
        Its size, in a random direction; or the force itself.
    start, duration : float [s]
        When it begins, and how long it lasts.
    """

    nodes: str
    force: float | tuple[float, float, float]
    start: float = 0.0
    duration: float = 0.2


@dataclass(frozen=True)
class StatedErrors:
    """The disturbances of the loops of a study.

    Attributes
    ----------
    start_error : float, optional [m]
        By how much each coordinate is off at the start, as the displacement of a node; its sign is drawn. By
        default a hundredth of the longest side of the box around the nodes, and at most a tenth of the
        shortest rigid bar or distance of corners of a body; a member that it would load by ten times the
        largest force at rest, or beyond its `most_tension`, is loaded by no more than these.
    start_angle : float, optional [rad]
        The same of coordinates that are angles, in place of `start_error`.
    stiffness_error : float
        Part by which the stiffness of each cable is off. In the first draw its sign alternates from
        cable to cable, in others it is drawn.
    gusts : tuple of Gust or RandomGust
        Forces on nodes.
    """

    start_error: float | None = None
    start_angle: float | None = None
    stiffness_error: float = 0.05
    gusts: tuple[Gust | RandomGust, ...] = ()


@dataclass(frozen=True)
class Draws:
    """Draws of the disturbances of a study.

    Attributes
    ----------
    number : int
        How many there are.
    seed : int
        Of the draws and of the noise of measurements.
    last : float, optional [s]
        Time before the end in which errors are compared; by default a sixth of the simulated time.
    batch : callable, optional
        `simulate_control_batch`: simulates many draws at once, in C; loops with a distribution are simulated
        in Python.
    warn : callable, optional
        Called with each warning of the linear loops before the first draw is simulated.
    """

    number: int = 5
    seed: int = 0
    last: float | None = None
    batch: Callable[..., Sequence[ControlRun]] | None = None
    warn: Callable[[str], None] | None = None


MAX_DRAWS = 10_000


def read_draws(draws: int | Draws) -> Draws:
    """Return the draws, also of their number alone; raises InvalidValueError for values out of range."""
    stated = draws if isinstance(draws, Draws) else Draws(draws)
    check_whole(stated.number, "draws", 1, MAX_DRAWS)
    check_whole(stated.seed, "seed", 0)
    check_callback(stated.batch, "batch")
    check_callback(stated.warn, "warn")
    return stated


@dataclass(frozen=True, eq=False)
class DrawnErrors:
    """The errors of one draw."""

    coordinate: FloatArray  # (n_coordinates,): added to the start
    arguments: Mapping[str, Any]  # run-time parameters of the simulated model
    gusts: tuple[Gust, ...]  # forces
    stiffness: Mapping[str, float]  # factor of each cable by its name


def read_start_errors(texts: Sequence[str]) -> tuple[float | None, float | None]:
    """Return the `start_error` [m] and the `start_angle` [rad] that texts such as ``"3mm"`` state."""
    length = angle = None
    for text in texts:
        match = START_ERROR.fullmatch(text)
        unit = (match[2] or "") if match else ""
        is_angle = unit in ("deg", "rad")
        if match is None or (angle if is_angle else length) is not None:
            problem = "not an error of the start" if match is None else "an error of the start is given twice"
            allowed = "a length (0.003, 3mm, 1cm) and an angle (1.2deg, 0.02rad), each at most once"
            raise InvalidValueError(problem, where="start_error", given=text, allowed=allowed)
        if is_angle:
            angle = float(np.radians(float(match[1]) * ANGLES[unit]))
        else:
            length = float(match[1]) * LENGTHS[unit]
    return length, angle


def check_errors(model: CompiledModel, stated: StatedErrors) -> None:
    """Raise InvalidValueError for a value out of range, UnknownNameError for a pattern without nodes."""
    for name, unit in (("start_error", "m"), ("start_angle", "rad"), ("stiffness_error", "1")):
        value = getattr(stated, name)
        limit = 1.0 if name == "stiffness_error" else np.inf
        is_default = value is None and name != "stiffness_error"
        if not is_default and not (is_number(value) and 0.0 <= value < limit):
            allowed = f"a number >= 0{' and < 1' if limit == 1.0 else ''} [{unit}]"
            raise InvalidValueError("out of range", where=name, given=value, allowed=allowed)
    if stated.start_angle is not None and not find_angles(model.manifest).any():
        raise InvalidValueError(
            "no coordinate is an angle", where="start_error", given=f"{stated.start_angle:g} rad",
            allowed="a displacement [m]",
        )  # fmt: skip
    check_instance(stated.gusts, (list, tuple), "errors.gusts", "a list of Gust or RandomGust")
    for gust in stated.gusts:
        check_instance(gust, (Gust, RandomGust), "errors.gusts", "a Gust or RandomGust")
        check_span(gust.start, gust.duration)
        if isinstance(gust, RandomGust):
            check_instance(gust.nodes, str, "gust.node", "the name or pattern of nodes")
            _select_nodes(model, gust)
            sizes = to_doubles(gust.force, "gust.force", "a finite number, or three [N]")
            if sizes.shape not in ((), (3,)) or not np.isfinite(sizes).all():
                raise InvalidValueError(
                    "not a force",
                    where="gust.force",
                    given=gust.force,
                    allowed="a finite number, or three [N]",
                )


def draw_errors(
    model: CompiledModel, stated: StatedErrors, scales: Scales, seed: int, draw: int
) -> DrawnErrors:
    """Return the errors of a draw, the same for the same seed and number."""
    rng = np.random.default_rng([seed, draw])
    length = stated.start_error
    if length is None:
        length = min(0.01 * scales.size, SAFE_PART * _find_least_rigid(model))
    error = length / scales.lever
    if stated.start_angle is not None:
        error = np.where(scales.is_angle, stated.start_angle, error)
        if stated.start_error is None:
            error = np.where(scales.is_angle, error, 0.0)
    error = error * rng.choice([-1.0, 1.0], len(error))
    arguments, factors = _draw_stiffness(model, stated.stiffness_error, rng, draw)
    gusts = tuple(_draw_gust(model, gust, rng) for gust in stated.gusts)
    return DrawnErrors(error, arguments, gusts, factors)


def draw_all_errors(
    model: CompiledModel, motion: Motion, stated: StatedErrors, scales: Scales, draws: Draws
) -> tuple[DrawnErrors, ...]:
    """Return the errors of all draws.

    Raises InvalidValueError for errors of the start with which rigid parts find no way to their lengths.
    """
    drawn = tuple(draw_errors(model, stated, scales, draws.seed, k) for k in range(draws.number))
    if stated.start_error is None and stated.start_angle is None:
        drawn = _spare_stiff_members(model, motion, scales, drawn)
    shortest = _find_least_rigid(model)
    for errors in drawn if np.isfinite(shortest) else ():
        try:
            state = read_disturbance(model, motion, Disturbance(coordinate_error=errors.coordinate)).state
            is_kept = np.abs(keep_bars(model, state.copy()) - state).max() <= KEPT_WITHIN
        except NonFiniteError:
            is_kept = False
        if not is_kept:
            raise InvalidValueError(
                "with so large an error of the start rigid bars or bodies collapse", where="start_error",
                given=f"{np.abs(errors.coordinate).max():.3g} m", allowed="much less than the shortest of "
                f"the rigid bars, and of the distances between corners of a body: {shortest:.3g} m",
                hint=f"a tenth of it: `start_error={SAFE_PART * shortest:.1g}` [m]",
            )  # fmt: skip
    return drawn


def _spare_stiff_members(
    model: CompiledModel, motion: Motion, scales: Scales, drawn: tuple[DrawnErrors, ...]
) -> tuple[DrawnErrors, ...]:
    """Return the errors, changed least where they would load members far more than anything is at rest."""
    point, largest = motion.at(0.0), np.abs(motion.member_tension[0]).max(initial=0.0)
    at = {**read_disturbance(model, motion, None).given, "velocity": point.velocity, INPUT: point.input}
    elastic = ~np.isin(model.manifest.member_name, model.manifest.rigid_bar)

    def load(way: FloatArray) -> FloatArray:
        q = point.coordinate + way / scales.lever
        return np.array(model.compute("member_tension", coordinate=q, **at))[elastic]

    resting, steps = load(np.zeros(len(scales.lever))), PROBED_PART * scales.size * np.eye(len(scales.lever))
    slope = np.array([load(step) - load(-step) for step in steps]).T / (2 * PROBED_PART * scales.size)
    limit = np.inf if model.structure is None else model.structure.limits.most_tension[elastic]
    room = np.maximum(limit - resting, 0.0)  # how much more tension limits permit
    spared = []
    for errors in drawn if largest > 0.0 else ():
        way, stiff = errors.coordinate * scales.lever, np.zeros(len(resting), dtype=bool)
        for _ in range(MAX_CORRECTIONS):
            added = load(way) - resting
            stiff |= (np.abs(slope @ way) > STIFF * largest) | (added > room)
            excess = (added - np.clip(added, -largest, np.minimum(room, largest)))[stiff]
            if not excess.any():
                break
            way = way - np.linalg.lstsq(slope[stiff], excess, rcond=PROBED_PART)[0]
        spared.append(replace(errors, coordinate=way / scales.lever) if stiff.any() else errors)
    return tuple(spared) or drawn


def _find_least_rigid(model: CompiledModel) -> float:
    """Return the shortest rigid bar or distance between corners of a body [m]; inf without any."""
    structure = model.structure
    if not (model.manifest.rigid_bar and isinstance(structure, Structure)):
        return np.inf
    return float(structure.member_length()[structure.is_rigid].min(initial=np.inf))


def _draw_stiffness(
    model: CompiledModel, error: float, rng: np.random.Generator, draw: int
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    manifest = model.manifest
    specs = [argument for argument in manifest.arguments if argument.name in STIFFNESSES]
    cables = sorted({name for argument in specs for name in argument.over}, key=manifest.member_name.index)
    alternating = np.where(np.arange(len(cables)) % 2 == 0, -1.0, 1.0)
    sign = rng.choice([-1.0, 1.0], len(cables))
    if draw == 0 or abs(sign.sum()) == len(cables):  # equal factors of all cables change hardly any shape
        sign = alternating
    factor = dict(zip(cables, (1.0 + error * sign).tolist(), strict=True))
    if error == 0.0:
        return {}, factor
    stiffness = {
        argument.name: np.asarray(model.nominal(argument.name), dtype=float).ravel()
        * np.array([factor[name] for name in argument.over])
        for argument in specs
    }
    return stiffness, factor


def _draw_gust(model: CompiledModel, gust: Gust | RandomGust, rng: np.random.Generator) -> Gust:
    if isinstance(gust, Gust):
        return gust
    node = str(rng.choice(_select_nodes(model, gust)))
    axes = list(model.manifest.axes)
    drawn = rng.normal(size=len(axes))
    force = np.zeros(3)
    if np.ndim(gust.force) == 0:
        force[axes] = float(gust.force) * drawn / np.linalg.norm(drawn)  # type: ignore[arg-type]
    else:
        force[:] = gust.force
    x, y, z = force.tolist()
    return Gust(node, (x, y, z), gust.start, gust.duration)


def _select_nodes(model: CompiledModel, gust: RandomGust) -> list[str]:
    """Return the nodes of a pattern whose loads can change and that are not anchored."""
    manifest = model.manifest
    spec = manifest.find_argument(NODE_LOAD)
    nodes = () if spec is None else spec.over
    index = {name: k for k, name in enumerate(nodes)}
    allowed = "a free node of the scene, or a pattern such as 't*'"
    matching = find_matching(gust.nodes, index, "gust.node", allowed, "no free node has this name")
    # Nodes that no coordinate moves.
    q = np.asarray(model.nominal("coordinate"), dtype=float)
    change = PROBE * np.random.default_rng(0).normal(size=q.shape)
    moved = np.linalg.norm(place_nodes(model, q + change) - place_nodes(model, q), axis=1)
    held = {name for name, way in zip(manifest.node_name, moved.tolist(), strict=True) if way < HELD_WITHIN}
    free = [nodes[k] for k in matching if nodes[k] not in held]
    if not free:
        raise UnknownNameError(
            "only anchored nodes have this name",
            where="gust.node",
            given=gust.nodes,
            allowed=allowed,
            hint=suggest(gust.nodes, [name for name in nodes if name not in held]),
        )
    return free


# Times of a study: sample, motion, simulated time, gusts; checked before work begins.


def check_times(
    sample: float | None = None,
    *,
    duration: float | None = None,
    t_end: float | None = None,
    last: float | None = None,
) -> None:
    """Raise InvalidValueError for a time that is no finite number > 0, or for times that do not fit."""
    for name, value in (("sample", sample), ("duration", duration), ("t_end", t_end), ("last", last)):
        if value is not None:
            check_positive(value, name, "[s]")
    if sample is None:
        return
    if duration is not None and not _is_a_sample(duration, sample):
        raise InvalidValueError(
            "the sample time does not fit the motion",
            where="sample",
            given=f"{sample:g} s, motion of {duration:g} s",
            allowed=f"at most {duration:g} s",
        )
    if t_end is not None:
        read_times(sample, t_end, t_end, last)


def find_default_times(motion: Motion, *time_constants: float) -> tuple[float, float]:
    """Return the simulated time by default, and that from which errors are compared [s].

    Three times the motion, or once where it is at rest; up to ten times that where errors with these time
    constants [s], in which they fall to 1/e, would else be compared before they have fallen to 5 %.
    """
    usual = (SIMULATED_PART if motion.velocity.any() else 1.0) * motion.duration
    needed = [find_needed_time(motion, constant) for constant in time_constants]
    end = max([usual, *(time for time in needed if time <= MAX_EXTENSION * usual)])
    return end, end * (1.0 - 1.0 / COMPARED_PART)


def find_needed_time(motion: Motion, time_constant: float) -> float:
    """Return the simulated time in which an error has fallen to 5 % when errors are compared [s]."""
    moving = motion.duration if motion.velocity.any() else 0.0
    return (moving + COMPARED_CONSTANTS * time_constant) / (1.0 - 1.0 / COMPARED_PART)


def read_times(sample: float, default: float, t_end: float | None, last: float | None) -> tuple[float, float]:
    """Return the simulated time, and that before its end in which errors are compared [s]."""
    check_times(t_end=t_end, last=last)
    end = default if t_end is None else t_end
    if not _is_a_sample(end, sample):
        raise InvalidValueError(
            "the simulated time is shorter than a sample",
            where="sample" if t_end is None else "t_end",
            given=f"{end:g} s",
            allowed=f"at least one `sample` ({sample:g} s)",
        )
    if last is None:
        _check_window(sample, end, t_end)
        return float(end), float(end / COMPARED_PART)
    if last > end or not _is_a_sample(last, sample):
        allowed = f"from a sample of {sample:g} s to the simulated time of {end:g} s"
        raise InvalidValueError("out of range", where="last", given=last, allowed=allowed)
    return float(end), float(last)


def _check_window(sample: float, end: float, t_end: float | None) -> None:
    """Raise InvalidValueError if the part at whose end errors are compared is shorter than a sample."""
    if _is_a_sample(end / COMPARED_PART, sample):
        return
    raise InvalidValueError(
        "errors are compared in the last sixth of the simulated time, which is shorter than a sample",
        where="sample" if t_end is None else "t_end",
        given=f"{sample if t_end is None else end:g} s",
        allowed=f"at most {end / COMPARED_PART:g} s"
        if t_end is None
        else f"at least {COMPARED_PART * sample:g} s",
        hint=f"or give `last`, at least {sample:g} s",
    )


def check_gust_times(gusts: Sequence[Gust | RandomGust], end: float) -> None:
    """Raise InvalidValueError for a gust that begins at the end of the simulated time or after it."""
    for gust in gusts:
        if not gust.start < end:
            raise InvalidValueError(
                "the gust begins after the simulated time",
                where="gust.start",
                given=gust.start,
                allowed=f"a number >= 0 and < {end:g} [s]",
                hint="an earlier start, or a larger `t_end`",
            )


def _is_a_sample(value: float, sample: float) -> bool:
    """Return whether a time is at least a sample, but for rounding."""
    return value >= sample * (1.0 - ROUNDING)
