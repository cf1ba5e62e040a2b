"""Support of structures on the ground: all that lacks it ends in one error, before any number is computed."""

from typing import Any

from tensegrity_codegen.structure.memory import lack_setting_events
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.request import ModelRequest

FORMULATIONS_WITH_GROUND = ("node_position", "rigid_bar")
EMITTERS_WITH_GROUND = ("auto", "unrolled", "table")
MAX_CONTACTS = 200  # that events serve: each has two, and every event ends a step
# Forces of some members alone, and parts of the stiffness: the ground is not in them.
WITHOUT_GROUND = (
    *("cable_force", "support_reaction", "member_law"),
    *("material_stiffness", "geometric_stiffness", "damping_matrix"),
)
# Analyses that do not know the ground, and their substitutes.
ANCHOR = "remove the section [ground], and anchor the feet where `equilibrium` finds them"
ANALYSES_WITHOUT_GROUND = ("plan", "time_motion")
# Quantities of equilibria, which have one coefficient of friction.
STATIC = ("node_residual", "tangent_stiffness")
ADVICE = f'simulate with formulation "node_position" or "rigid_bar" and {" or ".join(INTEGRATORS)}'


def has_contacts(subject: Any) -> bool:
    """Return whether nodes of a structure or body system touch a ground, or its bars press each other."""
    return bool(getattr(subject, "contact_name", ())) or getattr(subject, "collision", None) is not None


def needs_state_jacobian(subject: Any) -> bool:
    """Return whether implicit integrators take the Jacobian of the whole state: contacts or memory."""
    return has_contacts(subject) or bool(getattr(subject, "internal_name", ()))


def refuse_ground(name: str, what: str, hint: str = ADVICE) -> FormulationError:
    """Return the error of something that does not know the ground of the scene `name`."""
    return FormulationError(
        f"the ground is not supported here: {what}",
        where=f"{name}: ground",
        allowed=f"motions by {', '.join(INTEGRATORS)}, and equilibria, in node positions or with rigid bars",
        hint=hint,
    )


def check_analysis(subject: Any, analysis: str) -> None:
    """Raise FormulationError for an analysis that does not know the ground of a structure."""
    if getattr(subject, "ground", None) is not None and analysis in ANALYSES_WITHOUT_GROUND:
        raise refuse_ground(subject.name, f"the analysis {analysis!r}", ANCHOR)


def require_no_ground(subject: Any, what: str) -> None:
    """Raise FormulationError for a structure with a ground; what: names what does not know it."""
    if getattr(subject, "ground", None) is not None:
        raise refuse_ground(
            subject.name, what, "remove the section [ground] for this, or simulate the motion"
        )


def check_ground(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that a structure or body system on the ground cannot serve."""
    ground = getattr(subject, "ground", None)
    if ground is None:
        return
    name = subject.name
    formulation, options = request.formulation, request.options
    if formulation not in FORMULATIONS_WITH_GROUND:
        raise refuse_ground(name, f"formulation {formulation!r}")
    if options.get("correction", "none") != "none":
        raise refuse_ground(name, "rigid bars with correction", 'choose correction = "none"')
    if ground.has_static_friction:
        _check_static_friction(subject, ground, request)
    if ground.n_contacts > MAX_CONTACTS and set(request.events or ()) & {"ground", "stick"}:
        raise refuse_ground(
            name,
            f"events of {ground.n_contacts} contacts, more than {MAX_CONTACTS}",
            "leave ground and stick out of model.events, or list fewer nodes under ground.contacts",
        )
    if request.emitter not in EMITTERS_WITH_GROUND:
        raise refuse_ground(name, f"emitter {request.emitter!r}", 'choose emitter = "auto"')
    for quantity in request.quantities:
        if quantity in WITHOUT_GROUND:
            raise refuse_ground(name, f"quantity {quantity!r}, or an analysis that needs it")
    requested = {"solvers": request.solvers, "energy that is kept": request.keep}
    for feature, is_wanted in requested.items():
        if is_wanted:
            raise refuse_ground(name, feature)


def _check_static_friction(subject: Any, ground: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request without the events at which slip begins."""
    why = "the force jumps where slip begins, which only steps that end there can follow"
    without = lack_setting_events(subject, request) | {
        "equilibria": bool(set(request.quantities) & set(STATIC)),
        f"events of {ground.n_contacts} contacts": ground.n_contacts > MAX_CONTACTS,
        "model.events without ground and stick": request.lacks_events("ground", "stick"),
    }
    for feature, is_wanted in without.items():
        if is_wanted:
            raise refuse_ground(
                subject.name, f"static_friction above friction with {feature}: {why}", "omit static_friction"
            )
