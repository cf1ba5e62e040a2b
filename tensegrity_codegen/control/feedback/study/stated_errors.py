"""Disturbances of a study: errors of the start and of stiffnesses, gusts; drawn anew for each run."""

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from tensegrity_codegen.control.feedback.loop.disturbances import NODE_LOAD, Gust
from tensegrity_codegen.control.feedback.study.scales import Scales, find_angles
from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.model.placement import place_nodes
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, is_number
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest

STIFFNESSES = ("axial_stiffness", "spring_constant")
NEARBY, STILL = 1e-3, 1e-8  # change of coordinates [m, rad], and of the position of a held node [m]


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
    """What disturbs the loops of a study.

    Attributes
    ----------
    start_error : float, optional [m]
        By how much each coordinate is off at the start, as the displacement of a node; its sign is drawn. By
        default a hundredth of the longest side of the box around the nodes.
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


@dataclass(frozen=True, eq=False)
class DrawnErrors:
    """The errors of one draw.

    coordinate (n_coordinates,): added to the start; arguments: run-time parameters of the simulated model;
    gusts: forces; stiffness: factor of each cable by its name.
    """

    coordinate: FloatArray
    arguments: Mapping[str, Any]
    gusts: tuple[Gust, ...]
    stiffness: Mapping[str, float]


def check_errors(model: CompiledModel, stated: StatedErrors) -> None:
    """Raise InvalidValueError for a value out of range, UnknownNameError for a pattern without nodes."""
    for name, unit in (("start_error", "m"), ("start_angle", "rad"), ("stiffness_error", "1")):
        value = getattr(stated, name)
        most = 1.0 if name == "stiffness_error" else np.inf
        is_default = value is None and name != "stiffness_error"
        if not is_default and not (is_number(value) and 0.0 <= value < most):
            allowed = f"a number >= 0{' and < 1' if most == 1.0 else ''} [{unit}]"
            raise InvalidValueError("out of range", where=name, given=value, allowed=allowed)
    if stated.start_angle is not None and not find_angles(model).any():
        raise InvalidValueError(
            "no coordinate is an angle", where="start_error", given=f"{stated.start_angle:g} rad",
            allowed="a displacement [m]",
        )  # fmt: skip
    check_instance(stated.gusts, (list, tuple), "errors.gusts", "a list of Gust or RandomGust")
    for item in stated.gusts:
        check_instance(item, (Gust, RandomGust), "errors.gusts", "a Gust or RandomGust")
        for name in ("start", "duration"):
            value = getattr(item, name)
            if not is_number(value) or value < 0.0:
                raise InvalidValueError(
                    "out of range", where=f"gust.{name}", given=value, allowed="a finite number >= 0 [s]"
                )
        if isinstance(item, RandomGust):
            check_instance(item.nodes, str, "gust.node", "the name or pattern of nodes")
            _find_nodes(model, item)
            sizes = to_doubles(item.force, "gust.force", "a finite number, or three [N]")
            if sizes.shape not in ((), (3,)) or not np.isfinite(sizes).all():
                raise InvalidValueError(
                    "not a force",
                    where="gust.force",
                    given=item.force,
                    allowed="a finite number, or three [N]",
                )


def draw_errors(
    model: CompiledModel, stated: StatedErrors, scales: Scales, seed: int, draw: int
) -> DrawnErrors:
    """Return the errors of a draw, the same for the same seed and number.

    Parameters
    ----------
    model : CompiledModel
        Compiled for ``"control"``.
    stated : StatedErrors
        What disturbs.
    scales : Scales
        Lengths of the structure.
    seed, draw : int
        Seed of the study, number of the draw from 0.

    Returns
    -------
    DrawnErrors
        Errors as `simulate_control` takes them.
    """
    rng = np.random.default_rng([seed, draw])
    length = 0.01 * scales.size if stated.start_error is None else stated.start_error
    error = length / scales.lever
    if stated.start_angle is not None:
        error = np.where(scales.is_angle, stated.start_angle, error)
        if stated.start_error is None:
            error = np.where(scales.is_angle, error, 0.0)
    error = error * rng.choice([-1.0, 1.0], len(error))
    arguments, factors = _draw_stiffness(model, stated.stiffness_error, rng, draw)
    gusts = tuple(_draw_gust(model, item, rng) for item in stated.gusts)
    return DrawnErrors(error, arguments, gusts, factors)


def _draw_stiffness(
    model: CompiledModel, part: float, rng: np.random.Generator, draw: int
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    manifest = model.manifest
    specs = [item for item in manifest.arguments if item.name in STIFFNESSES]
    cables = sorted({name for item in specs for name in item.over}, key=manifest.member_name.index)
    alternating = np.where(np.arange(len(cables)) % 2 == 0, -1.0, 1.0)
    sign = rng.choice([-1.0, 1.0], len(cables))
    if draw == 0 or abs(sign.sum()) == len(cables):  # equal factors of all cables change hardly any shape
        sign = alternating
    factor = dict(zip(cables, (1.0 + part * sign).tolist(), strict=True))
    if part == 0.0:
        return {}, factor
    given = {
        item.name: np.asarray(model.nominal(item.name), dtype=float).ravel()
        * np.array([factor[name] for name in item.over])
        for item in specs
    }
    return given, factor


def _draw_gust(model: CompiledModel, item: Gust | RandomGust, rng: np.random.Generator) -> Gust:
    if isinstance(item, Gust):
        return item
    node = str(rng.choice(_find_nodes(model, item)))
    axes = list(model.manifest.axes)
    drawn = rng.normal(size=len(axes))
    force = np.zeros(3)
    if np.ndim(item.force) == 0:
        force[axes] = float(item.force) * drawn / np.linalg.norm(drawn)  # type: ignore[arg-type]
    else:
        force[:] = item.force
    x, y, z = force.tolist()
    return Gust(node, (x, y, z), item.start, item.duration)


def _find_nodes(model: CompiledModel, item: RandomGust) -> list[str]:
    """Return the nodes of a pattern whose loads can change and that are not anchored."""
    manifest = model.manifest
    spec = next((argument for argument in manifest.arguments if argument.name == NODE_LOAD), None)
    known = () if spec is None else spec.over
    found = [name for name in known if fnmatchcase(name, item.nodes)]
    held = _find_held(model)
    free = [name for name in found if name not in held]
    if not free:
        raise UnknownNameError(
            "no free node has this name" if not found else "only anchored nodes have this name",
            where="gust.node",
            given=item.nodes,
            allowed="a free node of the scene, or a pattern such as 't*'",
            hint=suggest(item.nodes, [name for name in known if name not in held]),
        )
    return free


def _find_held(model: CompiledModel) -> set[str]:
    """Return the nodes that no coordinate moves."""
    q = np.asarray(model.nominal("coordinate"), dtype=float)
    change = NEARBY * np.random.default_rng(0).normal(size=q.shape)
    moved = np.linalg.norm(place_nodes(model, q + change) - place_nodes(model, q), axis=1)
    names = model.manifest.node_name
    return {name for name, way in zip(names, moved.tolist(), strict=True) if way < STILL}
