"""Forces on nodes for a limited time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensegrity_codegen.runtime.model.arrays import to_doubles
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.checks import check_instance, is_number
from tensegrity_codegen.system.errors import InvalidValueError, UnknownNameError, suggest

NODE_LOAD = "node_load"


@dataclass(frozen=True)
class Gust:
    """A force on one node for a limited time.

    Attributes
    ----------
    node : str
        Name of the node.
    force : tuple of float, shape (3,) [N]
        Force, constant in direction.
    start, duration : float [s]
        When it begins, and how long it lasts.
    """

    node: str
    force: tuple[float, float, float]
    start: float = 0.0
    duration: float = 0.2

    @property
    def end(self) -> float:
        """Time at which it ends [s]."""
        return self.start + self.duration


@dataclass(frozen=True)
class GustLoad:
    """Gusts on a model whose loads can change at run time.

    Attributes
    ----------
    gusts : tuple of Gust
        The gusts.
    row : tuple of int
        Row of each one's node among the changeable loads.
    axes : tuple of int
        Modelled axes.
    base : ndarray, shape (k, n_axes) [N]
        Loads without gusts.
    """

    gusts: tuple[Gust, ...]
    row: tuple[int, ...]
    axes: tuple[int, ...]
    base: FloatArray

    def at(self, time: float) -> FloatArray:
        """Return the loads at a time [s], (k, n_axes) [N]; at a change those after it."""
        load = self.base.copy()
        for gust, row in zip(self.gusts, self.row, strict=True):
            if gust.start <= time < gust.end:
                load[row] += np.array(gust.force)[list(self.axes)]
        return load

    def changes_between(self, start: float, end: float) -> list[float]:
        """Return the times at which loads change, after `start` and before `end` [s]."""
        times = {time for gust in self.gusts for time in (gust.start, gust.end)}
        return sorted(time for time in times if start < time < end)


def bind_gust(
    model: CompiledModel, gust: Gust | Sequence[Gust] | None, base: FloatArray | None
) -> GustLoad | None:
    """Return the loads of gusts, None without one.

    Parameters
    ----------
    model : CompiledModel
        With the run-time parameter `node_load`.
    gust : Gust or sequence of Gust, optional
        The gusts.
    base : ndarray, optional [N]
        Loads of the nodes in the order of the parameter; by default those of the scene.

    Returns
    -------
    GustLoad or None
        Loads over time.

    Raises
    ------
    UnknownNameError
        The loads of the node cannot change.
    InvalidValueError
        A force that is no vector of numbers, or a time out of range.
    """
    stated = () if gust is None else (gust,) if isinstance(gust, Gust) else gust
    check_instance(stated, (list, tuple), "gust", "a Gust, or a list of them")
    gusts = tuple(stated)
    if not gusts:
        return None
    spec = next((item for item in model.manifest.arguments if item.name == NODE_LOAD), None)
    known = () if spec is None else spec.over
    for item in gusts:
        _check(item)
        if item.node not in known:
            raise UnknownNameError(
                "the load of this node cannot change at run time",
                where="gust.node",
                given=item.node,
                allowed=", ".join(known) or "none: the library has no run-time parameter node_load",
                hint=suggest(item.node, known) or 'compile the scene for "control"',
            )
    nominal = model.nominal(NODE_LOAD)
    loads = nominal if base is None else np.asarray(base, dtype=float).reshape(nominal.shape)
    rows = tuple(known.index(item.node) for item in gusts)
    return GustLoad(gusts, rows, tuple(model.manifest.axes), loads)


def _check(gust: Gust) -> None:
    check_instance(gust, Gust, "gust", "a Gust, or a list of them")
    check_instance(gust.node, str, "gust.node", "the name of a node")
    force = to_doubles(gust.force, "gust.force", "three finite numbers [N]")
    if force.shape != (3,) or not np.isfinite(force).all():
        raise InvalidValueError(
            "not a force", where="gust.force", given=gust.force, allowed="three finite numbers [N]"
        )
    for name, value in (("start", gust.start), ("duration", gust.duration)):
        if not is_number(value) or value < 0.0:
            raise InvalidValueError(
                "out of range", where=f"gust.{name}", given=value, allowed="a finite number >= 0 [s]"
            )
