"""Support of members with memory and of motors with a lag: what lacks it ends in one error, first of all."""

from typing import Any

from tensegrity_codegen.structure.ground_support import FORMULATIONS_WITH_GROUND
from tensegrity_codegen.structure.memory import lack_setting_events
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.request import ModelRequest

MAX_MEMBERS = 200  # whose events integrators watch: each has two margins, and every event ends a step
ADVICE = f'simulate with formulation "node_position" or "rigid_bar" and {" or ".join(INTEGRATORS)}'
ELASTIC = "no choice of formulation or method knows it; leave {key} out, which makes the member elastic"
# What another formulation or emitter does not change.
WHATEVER_IS_CHOSEN = ("solvers in C", "energy that is kept", "derivatives of motions", "live pages")


def require_no_memory(subject: Any, what: str, hint: str = ADVICE) -> None:
    """Raise FormulationError for a structure with members that remember; what: names what does not know them.

    hint: what to try; `{key}` in it becomes the key of the scene that gives a member its memory.
    """
    mask = getattr(subject, "remembers", None)
    if mask is not None and mask.any():
        e = int(mask.argmax())
        law = subject.law_of(e)
        raise FormulationError(
            f"{law.name} members are not supported here: {what}",
            where=f"{subject.name}: members.{subject.member_name[e]}",
            allowed="motions, equilibria and load paths, in node positions or with rigid bars",
            hint=hint.format(key=law.keys[0][-1]),
        )


def require_no_lag(subject: Any, what: str) -> None:
    """Raise FormulationError for a structure whose motors have a time constant; what: does not know them."""
    names = [actuator.name for actuator in subject.actuators if actuator.time_constant]
    if names:
        problem = f"time constants of motors are not supported here: {what}"
        location = f"{subject.name}: actuators.{names[0]}.time_constant"
        allowed = "motions by integrators in C and equilibria, in node positions or with rigid bars"
        raise FormulationError(problem, where=location, allowed=allowed, hint="leave time_constant out")


def _list_foreign(request: ModelRequest) -> dict[str, bool]:
    """Return what knows neither members with memory nor lagging motors -> whether a request wants it."""
    return {
        f"formulation {request.formulation!r}": request.formulation not in FORMULATIONS_WITH_GROUND,
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "solvers in C": bool(request.solvers),
        "energy that is kept": bool(request.keep),
        "derivatives of motions": request.differentiates_motions,
        "live pages, and a pull that changes with time": bool(request.driven),
    }


def check_memory(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that members with memory or lagging motors cannot serve."""
    for feature, is_wanted in _list_foreign(request).items():
        if is_wanted:
            require_no_lag(subject, feature)
            no_choice = feature.startswith(WHATEVER_IS_CHOSEN)
            require_no_memory(subject, feature, ELASTIC if no_choice else ADVICE)
    if not subject.yields.any():
        return
    lacking = {
        f"motions of more than {MAX_MEMBERS} of them": bool(request.integrators)
        and int(subject.yields.sum()) > MAX_MEMBERS,
        **lack_setting_events(subject, request),
    }
    for feature, is_wanted in lacking.items():
        if is_wanted:
            require_no_memory(subject, feature)
