"""What is given for a motion: its start, run-time arguments and schedule, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensegrity_codegen.errors import InvalidValueError, NonFiniteError, UnknownNameError
from tensegrity_codegen.runtime.consistency import make_consistent
from tensegrity_codegen.runtime.methods import SCIPY_NAME
from tensegrity_codegen.runtime.model import CompiledModel
from tensegrity_codegen.runtime.motion import Schedule

__all__ = ["check_arguments", "check_schedule", "find_start"]

FloatArray = NDArray[np.float64]


def find_start(
    model: CompiledModel,
    coordinate: ArrayLike | None,
    velocity: ArrayLike | None,
    arguments: Mapping[str, Any],
) -> FloatArray:
    """Return the state (n_states,) that a motion starts from; the scene's, where nothing is given.

    Raises InvalidValueError for another shape or a state that nodes cannot be in, NonFiniteError for numbers
    that are not finite.
    """
    q, v = _read(model, "coordinate", coordinate), _read(model, "velocity", velocity)
    return np.concatenate(make_consistent(model, q, v, arguments))


def check_arguments(model: CompiledModel, arguments: Mapping[str, Any]) -> None:
    """Raise UnknownNameError for a word that is no argument of the model at run time."""
    known = [item.name for item in model.manifest.arguments if item.name not in ("coordinate", "velocity")]
    for name in arguments:
        if name not in known:
            raise UnknownNameError(
                "the model has no such argument at run time",
                where="arguments",
                given=name,
                allowed=", ".join(known) or "none",
                hint="keep it changeable under [parameters] of the scene; pass the initial state as "
                "coordinate= and velocity=",
            )


def check_schedule(model: CompiledModel, schedule: Schedule | None, method: str) -> None:
    """Raise for a method that holds arguments constant, and for words that no schedule can change."""
    if schedule is None:
        return
    if method not in SCIPY_NAME:
        raise InvalidValueError(
            "this method holds parameters and inputs constant",
            where="schedule",
            given=method,
            allowed=", ".join(SCIPY_NAME),
        )
    first = schedule(0.0)
    check_arguments(model, first)
    if "anchor_position" in first:
        raise InvalidValueError("anchors stay where they are", where="schedule", given="anchor_position")


def _read(model: CompiledModel, name: str, value: ArrayLike | None) -> FloatArray:
    nominal = model.nominal(name)
    given = nominal if value is None else np.asarray(value, dtype=np.float64)
    if given.shape != nominal.shape:
        raise InvalidValueError(
            "wrong shape", where=name, given=given.shape, allowed=f"shape {nominal.shape}"
        )
    if not np.all(np.isfinite(given)):
        raise NonFiniteError(f"the initial {name} is not finite", where="simulate", allowed="finite numbers")
    return given
