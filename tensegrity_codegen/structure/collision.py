"""The force between bars that touch."""

from dataclasses import dataclass
from typing import Any

from tensegrity_codegen.structure.ground_support import FORMULATIONS_WITH_GROUND
from tensegrity_codegen.system.errors import FormulationError, InvalidValueError
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.request import ModelRequest

EXPONENTS = (1.0, 1.5)
# Quantities of structures at rest and derivatives of forces: forces between bars are not in them.
WITHOUT_COLLISION = (
    *("node_residual", "cable_force", "support_reaction", "spring_tension", "member_law"),
    *("tangent_stiffness", "material_stiffness", "geometric_stiffness", "damping_matrix"),
    *("residual_rest_length_jacobian", "tension_jacobian"),
)


@dataclass(frozen=True)
class Collision:
    """Force N = k d^p max(0, 1 + a d') between two bars that overlap by d > 0, along their distance.

    stiffness [N/m]: k, above 0; [N/m^1.5] with exponent 1.5; exponent: power p of the overlap, 1.0 or 1.5;
    dissipation [s/m]: factor a of the rate of overlap, 0 or more (Hunt and Crossley 1975).
    """

    stiffness: float
    exponent: float = 1.0
    dissipation: float = 0.0

    def __post_init__(self) -> None:
        infinity = float("inf")
        rules = (
            ("stiffness", 0.0 < self.stiffness < infinity, "a number above 0 [N/m]"),
            ("exponent", self.exponent in EXPONENTS, "1 or 1.5"),
            ("dissipation", 0.0 <= self.dissipation < infinity, "a number of 0 or more [s/m]"),
        )
        for key, is_met, allowed in rules:
            if not is_met:
                problem = "invalid force between bars"
                value = repr(getattr(self, key))
                raise InvalidValueError(problem, where=f"interference.{key}", given=value, allowed=allowed)


def require_no_collision(subject: Any, what: str) -> None:
    """Raise FormulationError for a structure with forces between bars; what: what does not know them."""
    if getattr(subject, "collision", None) is not None:
        problem = f"forces between bars are not supported here: {what}"
        location = f"{subject.name}: interference.stiffness"
        allowed = f"motions by {', '.join(INTEGRATORS)}, in node positions or with rigid bars"
        hint = "remove interference.stiffness for this: contacts are then only detected"
        raise FormulationError(problem, where=location, allowed=allowed, hint=hint)


def check_collision(subject: Any, request: ModelRequest) -> None:
    """Raise FormulationError for a request that a structure whose bars press each other cannot serve."""
    if getattr(subject, "collision", None) is None:
        return
    foreign = {
        f"formulation {request.formulation!r}": request.formulation not in FORMULATIONS_WITH_GROUND,
        "rigid bars with correction": request.options.get("correction", "none") != "none",
        f"emitter {request.emitter!r}": request.emitter not in ("auto", "unrolled"),
        "solvers": bool(request.solvers),
        "energy that is kept": bool(request.keep),
        "single precision": request.precision != "double",
    }
    foreign |= {f"quantity {name!r}": name in WITHOUT_COLLISION for name in request.quantities}
    for feature, is_foreign in foreign.items():
        if is_foreign:
            require_no_collision(subject, feature)
