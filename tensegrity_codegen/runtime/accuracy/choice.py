"""The choice of `auto`: by how fast members vibrate, how the rest moves, and the tolerance.

Steps are estimated from the bounds of rates.py; the numbers are measured: docs/decisions/0018-auto-method.md.
"""

import math
from collections import Counter
from dataclasses import dataclass, fields, replace

import numpy as np

from tensegrity_codegen.runtime.accuracy.rates import Rates, find_noise, find_rates
from tensegrity_codegen.runtime.accuracy.vibration import Vibration, find_vibration
from tensegrity_codegen.runtime.integrate.implicit import listen_to_members
from tensegrity_codegen.runtime.integrate.methods import find_method
from tensegrity_codegen.runtime.integrate.motion import Motion
from tensegrity_codegen.runtime.integrate.options import RunOptions
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.profiles.driven import DrivenArguments, find_changing
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.body_places import show_members
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import DAMPED_INTEGRATOR, STIFF_INTEGRATOR

EXPLICIT = ("rk853", "rk54")
MAX_CHEAP_STEPS = 5_000  # steps that resolve every vibration in hundredths of a second
# Relative tolerance above which order 5 is as good as order 8 where forces jump: steps end there, and short
# ones cost rk54 less.
LOOSE_RTOL_WITH_JUMPS = 1e-7
CABLE_SHARE = 0.8  # of the explicit steps, that cables alone need where not bars limit them
IMPLICIT_STEP_COST = 1.5  # time of an implicit step over that of one of rk853
MAX_VIBRATION_SHARE = 0.5  # of the tolerance, that vibrations which implicit steps leave out may take
MAX_EXPLICIT_STEPS = 100_000  # steps, at most, where the implicit method misses the tolerance
# Explicit steps of a run over rings with friction, from which on DAMPED_INTEGRATOR has its turn: a strand
# that goes slack gives its material away in no time.
MAX_STEPS_AT_RINGS = 20_000
MIN_TOLD_RATIO = 1.5  # stiffness over that of cables, below which it is worth no word
MIN_STIFF_RATIO = 100.0  # stiffness over that of cables, from which on a library shall hold both methods
UNLIMITED = 2**62
STEP_RESERVE = 10  # times the estimate, that steps of a tightened run may be
MAX_KNOTS = 9  # of a profile, at which rates are looked at
MIN_ALLOWED_STEPS = 2_000  # implicit steps that are allowed even where explicit ones are no more


@dataclass(frozen=True)
class Choice:
    """A method, a sentence that says why, and the fallback after a failure.

    noise: what rounding of positions makes of velocities [m/s], below which no step can be held; frequency:
    bound of the fastest vibration [rad/s]; fallback: the method after the implicit one fails, "" for none;
    max_steps, max_fallback_steps: of an implicit run, and of one of the fallback; damped_amplitude: amplitude
    [m] up to which the implicit method damps out vibrations; vibration: these, as far as known.
    """

    name: str
    why: str
    fallback: str = ""
    noise: float = 0.0
    frequency: float = 0.0
    max_steps: int = UNLIMITED
    max_fallback_steps: int = UNLIMITED
    damped_amplitude: float = 0.0
    vibration: Vibration | None = None


def integrators_for(
    method: str, structure: Structure | None = None, formulation: str = "node_position", rtol: float = 1e-6
) -> tuple[str, ...]:
    """Return the integrators that a library must hold for `method`, none for SciPy's methods.

    structure (None: one of bodies), formulation, rtol: what is simulated and how well, by which `auto` wants
    one or more.
    """
    if find_method(method).scipy:
        return ()
    return _wanted_by_auto(structure, formulation, rtol) if method == "auto" else (method,)


def _wanted_by_auto(structure: Structure | None, formulation: str, rtol: float) -> tuple[str, ...]:
    if structure is None:
        return (_explicit_for(rtol, False),)
    jumps = bool(np.any(structure.tension_only & (structure.damping > 0)))
    explicit = _explicit_for(rtol, jumps and not structure.bodies)
    if structure.sliding:
        return (explicit, DAMPED_INTEGRATOR)
    if structure.ground is not None or structure.collision is not None or structure.internal_name:
        return (explicit,)
    if (structure.is_rigid & structure.ends_at_body).any():  # which the implicit method does not know
        return (explicit,)
    mu = structure.mu
    free = np.asarray(~structure.node_anchored[:, list(structure.axes)].all(axis=1))
    stiff = structure.is_mixed & (mu > 0) & free[structure.connectivity].any(axis=1)
    soft = float(mu[~structure.is_mixed].max(initial=0.0))
    is_stiff = find_formulation(formulation).in_nodes and bool(np.any(mu[stiff] >= MIN_STIFF_RATIO * soft))
    if is_stiff:
        explicit = "rk853"  # vibrations take most steps, not jumps
    return (explicit, STIFF_INTEGRATOR) if is_stiff else (explicit,)


def choose_method(motion: Motion, options: RunOptions) -> Choice:
    """Return the best of the methods that the library holds.

    Events that the implicit method of this library does not watch, and the energy, are for explicit methods
    only. Raises FormulationError where the library has no method with error control.
    """
    model = motion.model
    specs = {spec.name: spec for spec in model.manifest.integrators}
    explicit = _choose_explicit(model, tuple(specs), options.rtol)
    watched = set(motion.watch.kinds) if motion.watch else set()
    offered = STIFF_INTEGRATOR in specs and watched <= set(specs[STIFF_INTEGRATOR].events)
    if not offered or not explicit.name or options.keep:
        if not explicit.name and STIFF_INTEGRATOR not in specs:
            raise FormulationError(
                "the library has no integrator with error control",
                where=model.manifest.name,
                allowed='a library that was built with integrators = ["rk853"]',
                hint='build it with integrators=("rk853",), or use one of the methods scipy_*',
            )
        return explicit if explicit.name else Choice(STIFF_INTEGRATOR, "")
    if isinstance(motion.schedule, DrivenArguments) and (changed := find_changing(model, motion.schedule)):
        return replace(
            explicit, why=f"{explicit.why}; the profile changes {changed[0]}, which {STIFF_INTEGRATOR} holds"
        )
    rates = _find_rates(motion, specs[STIFF_INTEGRATOR].tensions)
    if rates is None:
        return explicit
    return _weigh(motion, options, rates, explicit)


def _find_rates(motion: Motion, stiff: tuple[int, ...]) -> Rates | None:
    """Return the rates at the start; with a profile the largest ones at some of its knots."""
    first = find_rates(motion.model, stiff, motion.arguments)
    if first is None or not isinstance(motion.schedule, DrivenArguments):
        return first
    times = motion.schedule.pieces.time
    chosen = times[np.unique(np.linspace(0, len(times) - 1, MAX_KNOTS).astype(np.int64))]
    cases = [{**motion.arguments, **motion.schedule(float(time))} for time in chosen]
    found = [
        first,
        *(rates for case in cases if (rates := find_rates(motion.model, stiff, case)) is not None),
    ]
    return Rates(*(max(getattr(rates, item.name) for rates in found) for item in fields(Rates)))


def _weigh(motion: Motion, options: RunOptions, rates: Rates, explicit: Choice) -> Choice:
    """Return the implicit or the explicit method, whichever takes less for these rates."""
    model, state, rtol = motion.model, motion.state, options.rtol
    first, last = float(motion.sample_time[1]), motion.t_end
    size = float(np.abs(state[: len(state) // 2]).max(initial=0.0))
    explicit = replace(explicit, noise=find_noise(motion, rates.frequency), frequency=rates.frequency)
    steps = _explicit_steps(rates.frequency, rates.decay, last, rtol)
    ratio = _tell_ratio(rates)
    if steps <= MAX_CHEAP_STEPS:
        why = f"{explicit.why}; {ratio}; about {_number(steps)} explicit steps resolve all vibrations"
        return replace(explicit, why=why)
    if any(spec.name == "rk853" for spec in model.manifest.integrators):
        explicit = replace(explicit, name="rk853", why="fast vibrations: order 8")
    spec = next(spec for spec in model.manifest.integrators if spec.name == STIFF_INTEGRATOR)
    slow_decay = 0.0 if spec.damped else rates.slow_decay  # in the implicit matrix it costs no steps
    by_implicit = _implicit_steps(rates.slow_frequency, slow_decay, last, rtol)
    compared = (
        f"estimated {_number(steps)} explicit steps, {_number(by_implicit)} steps of {STIFF_INTEGRATOR}"
    )
    if IMPLICIT_STEP_COST * by_implicit >= steps:
        is_damped = slow_decay > 10.0 * rates.slow_frequency
        cause = f"{'damping of cables limits' if is_damped else 'cables limit'} the steps, not bars"
        if CABLE_SHARE * steps > _explicit_steps(rates.slow_frequency, rates.slow_decay, last, rtol):
            cause = f"{ratio}: {compared}, which take longer each"
        return replace(explicit, why=f"{explicit.why}; {cause}")
    amplitude = listen_to_members(motion)["vibration"]
    with np.errstate(all="ignore"):  # members without a length have no direction
        vibration = find_vibration(motion, spec.tensions, rates)
    if not vibration.error(first, last)[0] <= MAX_VIBRATION_SHARE * (options.absolute + rtol * size):
        why = f"{explicit.why}; {ratio} and vibrate by {amplitude:.2g} m, which only short steps resolve"
        return replace(explicit, why=why)
    return replace(
        explicit,
        name=STIFF_INTEGRATOR,
        why=f"{ratio} and vibrate by {amplitude:.2g} m: {compared}",
        fallback=explicit.name if steps <= MAX_EXPLICIT_STEPS else "",
        max_steps=int(MIN_ALLOWED_STEPS + steps / IMPLICIT_STEP_COST)
        if steps <= MAX_EXPLICIT_STEPS
        else UNLIMITED,
        max_fallback_steps=int(MIN_ALLOWED_STEPS + STEP_RESERVE * steps),
        damped_amplitude=float(vibration.others[0]),
        vibration=vibration,
    )


def _tell_ratio(rates: Rates) -> str:
    """Return how much stiffer bars are than cables, in words."""
    if not np.isfinite(rates.stiffness_ratio):
        return "bars and no cables"
    if rates.stiffness_ratio < MIN_TOLD_RATIO:
        return "bars are no stiffer than cables"
    return f"bars are {_number(rates.stiffness_ratio)} times stiffer than cables"


def _number(value: float) -> str:
    """Return a number with two digits that count, in full up to a million."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:,.0f}" if 10.0 <= rounded < 1e7 else f"{rounded:g}"


def _choose_explicit(model: CompiledModel, names: tuple[str, ...], rtol: float) -> Choice:
    """Return the better explicit method for a tolerance, with an empty name where the library has none."""
    held = [name for name in EXPLICIT if name in names]
    cables = any("cable" in spec.events for spec in model.manifest.integrators)
    slopes = next((s.arguments for s in model.manifest.functions if s.quantity == "cable_margin"), ())
    jumps = cables and "velocity" in slopes and not model.manifest.body_places  # which spin fast
    wanted = _explicit_for(rtol, jumps)
    if not held:
        return Choice("", "")
    if wanted not in held:
        return Choice(held[0], f"the library has no {wanted}")
    cause = (
        "tensions of damped cables jump" if jumps and wanted == "rk54" else f"relative tolerance {rtol:.0e}"
    )
    return Choice(
        wanted, f"{_tell_rigid(model)}{cause}: {'order 8' if wanted == 'rk853' else 'order 5 is enough'}"
    )


def _tell_rigid(model: CompiledModel) -> str:
    """Return how many rigid bars there are and how many of them meet, nothing where there are none."""
    ends = dict(zip(model.manifest.member_name, model.manifest.connectivity, strict=True))
    shown = set(show_members(model.manifest.member_name, model.manifest.body_places))
    bars = [bar for bar in model.manifest.rigid_bar if bar in shown]
    if not bars:
        return ""
    free = set(model.manifest.coordinate_place[:, 0].tolist())
    meeting = Counter(node for bar in bars for node in ends[bar] if node in free)
    most = max(meeting.values(), default=1)
    how = "one multiplier each" if most == 1 else f"up to {most} at a node, with coupled multipliers"
    return f"{len(bars)} rigid {'bar' if len(bars) == 1 else 'bars'} (class {most}, {how}); "


def _explicit_for(rtol: float, jumps: bool) -> str:
    return "rk54" if jumps and rtol > LOOSE_RTOL_WITH_JUMPS else "rk853"


def _explicit_steps(frequency: float, decay: float, t_end: float, rtol: float) -> float:
    """Return about how many steps rk853 takes to follow this frequency [rad/s] and decay rate [1/s]."""
    return t_end * (0.75 * frequency * math.pow(1e-6 / rtol, 0.12) + 0.2 * decay)


def _implicit_steps(frequency: float, decay: float, t_end: float, rtol: float) -> float:
    """Return about how many steps the implicit method takes for the motion without stiff members."""
    return t_end * (10.0 * frequency * math.pow(1e-6 / rtol, 0.26) + decay)
