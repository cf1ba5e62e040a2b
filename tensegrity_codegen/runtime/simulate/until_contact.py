"""Motions that end at a contact which the integrator itself watches: the event at the end."""

from dataclasses import replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.integrate import integrate
from tensegrity_codegen.runtime.integrate.event_log import Watch
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.integrate.raw_results import RawTrajectory
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.simulate.margins import build_contact_margins
from tensegrity_codegen.runtime.trajectory.motion_event import MotionEvent
from tensegrity_codegen.tables.integrators import STIFF_INTEGRATOR
from tensegrity_codegen.tables.manifest import JUMP_KINDS

SAME = 1e-9  # of the simulated time: contacts this near happen at once


def watches_contact(model: CompiledModel, method: str) -> bool:
    """Whether a run by this method watches contacts by itself: by radau, or where `auto` may choose it."""
    specs = {spec.name: spec for spec in model.manifest.integrators}
    if method == STIFF_INTEGRATOR:
        return True
    return method == "auto" and STIFF_INTEGRATOR in specs and "contact" in specs[STIFF_INTEGRATOR].events


def stop_at_watched_contact(
    motion: Motion, options: RunOptions
) -> tuple[RawTrajectory, tuple[MotionEvent, ...]]:
    """Return the samples up to the first contact and the state there, and that event; all if there is none.

    Bars that overlap touch at the start. Raises FormulationError where the library does not watch contacts or
    lacks bar_distance and its Jacobian, and what the methods raise.
    """
    margins = build_contact_margins(motion.model, motion.arguments)
    touching = margins.values(0.0, motion.state) <= margins.floor
    if touching.any():
        names = tuple(name for name, touches in zip(margins.names, touching, strict=True) if touches)
        raw = RawTrajectory(motion.sample_time[:1], motion.state[None, :], "ok", "", options.method, 0, 0)
    else:
        known = (kind for spec in motion.model.manifest.integrators for kind in spec.events)
        kinds = (*(kind for kind in dict.fromkeys(known) if kind in JUMP_KINDS), "contact")
        raw = integrate(replace(motion, watch=Watch(kinds, ("contact",))), options)
        names = _touching_at_end(raw, SAME * motion.t_end)
    if not names:
        return replace(raw, message="; ".join(filter(None, [raw.message, "no contact"]))), ()
    said = f"contact of {', '.join(names)} at t = {raw.time[-1]:.9g} s"
    n, state = raw.state.shape[1] // 2, raw.state[-1]
    margin = float(np.min(margins.values(float(raw.time[-1]), state)))
    event = MotionEvent("contact", names, float(raw.time[-1]), margin, state[:n], state[n:])
    return replace(raw, message="; ".join(filter(None, [raw.message, said]))), (event,)


def _touching_at_end(raw: RawTrajectory, same: float) -> tuple[str, ...]:
    """Return the pairs of bars whose contact has ended the run, none if it went to its end."""
    log = raw.log
    if not log.count or log.kind[-1] != "contact" or raw.time[-1] < log.time[-1]:
        return ()
    last = float(log.time[-1])
    return tuple(
        name
        for name, kind, time in zip(log.name, log.kind, log.time, strict=True)
        if kind == "contact" and last - time <= same
    )
