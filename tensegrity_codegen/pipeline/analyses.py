"""Needs of each analysis of a library: quantities, integrators, parameters, batch functions.

Each imports what it needs by itself: a motion from the cache needs no statics.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tensegrity_codegen.runtime.contacts.rest_memory import (
    RELAXED_QUANTITIES,
    REST_QUANTITIES,
    RING_QUANTITIES,
)
from tensegrity_codegen.runtime.integrate.methods import BATCH_METHOD, find_method
from tensegrity_codegen.runtime.trajectory.simulation_quantities import (
    CONTACT_QUANTITIES,
    CONTROL_METHOD,
    CONTROL_QUANTITIES,
    simulation_quantities,
)
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.ground_support import (
    ANALYSES_WITHOUT_GROUND,
    MAX_CONTACTS,
    check_analysis,
)
from tensegrity_codegen.structure.inertia_plan import find_massless
from tensegrity_codegen.structure.memory_support import require_no_lag, require_no_memory
from tensegrity_codegen.structure.sliding import require_no_ring_friction
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import check_choice
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.quantities import OF_MOTIONS_BOTH_WAYS, SLOPES
from tensegrity_codegen.tables.request import AUTO_EVENTS, ModelRequest

ANALYSES_WITH_RING_FRICTION = (
    *("simulate", "simulate_batch", "step", "equilibrium", "equilibria", "linearize"),
    *("derivatives", "motion_derivatives"),
)
BATCH_WIDTH = 8  # motions side by side where the request names no number
STEP_METHOD = "rk54"  # of copies that are advanced by samples where none is named
MOST_PAIRS = 500  # of bars whose distances a plan reports without a limit of them


@dataclass(frozen=True)
class Needs:
    """What an analysis needs of a library, besides what is wanted anyway."""

    quantities: tuple[str, ...]
    integrators: tuple[str, ...] = ()
    parameters: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    batch_width: int = 0
    solvers: tuple[str, ...] = ()
    events: tuple[str, ...] | None = None  # of integrators, where the request names none
    copies: bool = False
    directions: tuple[str, ...] = ()  # of derivatives of motions

    def alone(self, request: ModelRequest) -> ModelRequest:
        """Return the request for just this: no other quantities, integrators and solvers."""
        wanted = request.wanting(*self.quantities, integrators=self.integrators, parameters=self.parameters)
        return self._complete(wanted)

    def besides(self, request: ModelRequest) -> ModelRequest:
        """Return the request with this added."""
        wanted = request.wanting(
            *request.quantities,
            *self.quantities,
            integrators=tuple(dict.fromkeys((*request.integrators, *self.integrators))),
            solvers=tuple(dict.fromkeys((*request.solvers, *self.solvers))),
            parameters=self.parameters,
        )
        return self._complete(wanted)

    def _complete(self, request: ModelRequest) -> ModelRequest:
        """Return the request with batches and events of the analysis where it states none."""
        events = self.events if request.events is None else request.events
        request = replace(request, events=events, checks="finite")
        if self.directions:  # of what motions with derivatives do not have, the scene's is left out
            request = replace(request, directions=self.directions, columns=(), integrators=self.integrators)
            return replace(request, batch_width=0, keep=(), interfaces=())
        width = request.batch_width or self.batch_width
        return replace(request, batch_width=width, copies=request.copies or self.copies)


def equilibrium_quantities(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return the quantities that find_equilibrium needs, by the formulation of the request."""
    from tensegrity_codegen.runtime.statics.equilibrium import equilibrium_quantities as of_formulation

    turning = isinstance(structure, BodySystem) and structure.has_unpotential_load
    extra = ("unpotential_force",) if turning else REST_QUANTITIES if structure.yields.any() else ()
    relaxed = RELAXED_QUANTITIES if structure.relaxes.any() else ()
    rings = RING_QUANTITIES if structure.sliding else ()
    return (*of_formulation(request.formulation), *extra, *relaxed, *rings)


def balance_energy(structure: Subject, request: ModelRequest) -> Subject:
    """Return a structure whose motions tell what takes their energy, if its ground and emitter can."""
    ground = structure.ground
    if ground is None or ground.n_contacts > MAX_CONTACTS or request.emitter == "table":
        return structure
    return replace(structure, ground=replace(ground, balances_energy=True))


def _simulate(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    from tensegrity_codegen.runtime.accuracy.choice import integrators_for
    from tensegrity_codegen.structure.rigid_bars import find_rigid_bars

    nodes = structure if isinstance(structure, Structure) else None
    elastic = nodes
    if nodes is not None and (rigid := find_rigid_bars(nodes, request)).any():  # which do not vibrate
        stiffness = {name: getattr(nodes, name) for name in ("spring_constant", "axial_stiffness")}
        elastic = nodes.with_changes(
            **{name: np.where(rigid, 0.0, value) for name, value in stiffness.items()}
        )
    integrators = integrators_for(method or "auto", elastic, request.formulation, rtol)
    contacts = CONTACT_QUANTITIES if nodes is not None and nodes.ground is not None else ()
    return Needs((*simulation_quantities(request.formulation), *contacts), integrators, events=AUTO_EVENTS)


def _simulate_batch(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    needs = _simulate(structure, request, method or BATCH_METHOD, rtol)
    in_batches = find_method(method or BATCH_METHOD).in_batches and not structure.yields.any()
    return replace(needs, batch_width=BATCH_WIDTH if in_batches else 0)


def _step(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    needs = _simulate_batch(structure, request, method or STEP_METHOD, rtol)
    return replace(needs, copies=True)


def _equilibrium(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    return with_snap_check(structure, request, Needs(equilibrium_quantities(structure, request)))


def with_snap_check(structure: Subject, request: ModelRequest, needs: Needs) -> Needs:
    """Return needs with those of the question whether an equilibrium was reached by a jump."""
    # Loads are run-time parameters then, to grow from zero; what the request says of them stands.
    if getattr(structure, "ground", None) is not None:
        return needs
    cables = () if structure.is_bar.all() else ("member_extension",)
    switches = ("switch_margin",) if structure.has_switch.any() else ()
    loads: dict[str, tuple[int, ...]] = {"node_load": tuple(range(structure.n_nodes))}
    loads |= {"gravity": ()} if np.any(structure.gravity) else {}
    return replace(
        needs,
        quantities=tuple(dict.fromkeys((*needs.quantities, *cables, *switches))),
        parameters={**loads, **needs.parameters, **request.parameters},
    )


def _equilibria(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    is_alone = getattr(structure, "ground", None) is not None or bool(getattr(structure, "internal_name", ()))
    width = 0 if is_alone else BATCH_WIDTH
    return Needs(equilibrium_quantities(structure, request), batch_width=width)


def _sensitivity(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    from tensegrity_codegen.runtime.sensitivity.static_system import REST_LENGTH_QUANTITIES

    quantities = equilibrium_quantities(structure, request)
    is_rigid = structure.is_bar if request.options.get("bars") == "all" else structure.mu == 0
    if isinstance(structure, BodySystem) or not is_rigid.all():
        quantities += REST_LENGTH_QUANTITIES
    return Needs((*quantities, *(() if structure.is_bar.all() else ("member_extension",))))


def _linearize(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    from tensegrity_codegen.runtime.linear.linearize import KINK_QUANTITIES, linearize_quantities

    quantities = linearize_quantities(request.formulation, with_inputs=bool(structure.inputs))
    return Needs((*quantities, *(KINK_QUANTITIES if not structure.is_bar.all() else ())))


def _load_path(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    quantities = equilibrium_quantities(structure, request)
    quantities += ("member_extension",) if structure.n_members else ()
    quantities += ("switch_margin",) if structure.has_switch.any() else ()
    quantities += ("bar_distance",) if structure.n_bar_pairs else ()
    return Needs(quantities, parameters={"node_load": tuple(range(structure.n_nodes))})


def _analyse(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    masses = () if isinstance(structure, Structure) and find_massless(structure).any() else ("mass_matrix",)
    has_clearance = structure.n_bar_pairs and math.isfinite(structure.limits.clearance)
    distances = ("bar_distance",) if has_clearance else ()
    return Needs((*equilibrium_quantities(structure, request), "equilibrium_matrix", *masses, *distances))


def _plan(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    from tensegrity_codegen.runtime.sensitivity.static_system import REST_LENGTH_QUANTITIES

    quantities = (*equilibrium_quantities(structure, request), *REST_LENGTH_QUANTITIES, "member_extension")
    if isinstance(structure, Structure):
        quantities += ("equilibrium_matrix",)
    count = structure.n_bar_pairs
    if count and (count <= MOST_PAIRS or math.isfinite(structure.limits.clearance)):
        quantities += ("bar_distance",)
    return Needs(quantities)


def _time_motion(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    massless = isinstance(structure, Structure) and find_massless(structure).any()
    moving = () if massless else ("acceleration", "mass_matrix", "member_tension", "equilibrium_matrix")
    return Needs((*_plan(structure, request, method, rtol).quantities, *moving))


def _control(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    from tensegrity_codegen.runtime.linear.linearize import linearize_quantities

    linear = linearize_quantities(request.formulation, with_inputs=bool(structure.inputs))
    quantities = (*linear, *CONTROL_QUANTITIES)
    if isinstance(structure, BodySystem):
        quantities += ("node_position", "node_velocity", "node_jacobian")
    elif find_formulation(request.formulation).has_rigid_bars:
        quantities += ("consistent_coordinate", "consistent_velocity")
    cable = structure.tension_only
    loaded = range(structure.n_nodes)
    parameters = {
        "axial_stiffness": tuple(np.flatnonzero(cable & (structure.axial_stiffness > 0)).tolist()),
        "spring_constant": tuple(np.flatnonzero(cable & (structure.spring_constant > 0)).tolist()),
        "node_load": tuple(loaded),
    }
    changeable = {key: rows for key, rows in parameters.items() if rows}
    return Needs(quantities, (CONTROL_METHOD,), changeable, events=AUTO_EVENTS)


def _derivatives(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    named = [name for name in request.quantities if name in SLOPES.values()]
    wanted = tuple(dict.fromkeys((*named, "acceleration", "member_tension", "member_length")))
    return Needs((*wanted, *(f"{name}_slopes" for name in wanted)), batch_width=BATCH_WIDTH)


def _motion_derivatives(structure: Subject, request: ModelRequest, method: str, rtol: float) -> Needs:
    needs = _simulate(structure, request, method or BATCH_METHOD, rtol)
    # Forces of contacts are not differentiated, and take longer than the motion.
    kept = [name for name in needs.quantities if name not in CONTACT_QUANTITIES]
    return replace(needs, quantities=(*kept, *OF_MOTIONS_BOTH_WAYS), directions=("tangent",))


# The analyses by the names of their functions.
ANALYSES: Mapping[str, Callable[[Subject, ModelRequest, str, float], Needs]] = {
    "simulate": _simulate,
    "simulate_batch": _simulate_batch,
    "step": _step,
    "equilibrium": _equilibrium,
    "equilibria": _equilibria,
    "sensitivity": _sensitivity,
    "linearize": _linearize,
    "load_path": _load_path,
    "analyse": _analyse,
    "plan": _plan,
    "time_motion": _time_motion,
    "control": _control,
    "derivatives": _derivatives,
    "motion_derivatives": _motion_derivatives,
}


def find_needs(
    analysis: str, structure: Subject, request: ModelRequest, *, method: str = "", rtol: float = 1e-6
) -> Needs:
    """Return the needs of an analysis, one of ANALYSES, with a method and tolerance of simulations."""
    check_choice(analysis, ANALYSES, "analysis", "for_")
    check_analysis(structure, analysis)
    if analysis not in ANALYSES_WITH_RING_FRICTION:
        require_no_ring_friction(structure, f"the analysis {analysis!r}")
    if analysis in (*ANALYSES_WITHOUT_GROUND, "control"):
        require_no_memory(structure, f"the analysis {analysis!r}")
        require_no_lag(structure, f"the analysis {analysis!r}")
    if method:
        find_method(method)
    return ANALYSES[analysis](structure, request, method, rtol)


def want_analyses(
    structure: Subject,
    request: ModelRequest,
    analyses: Iterable[str],
    *,
    method: str = "",
    rtol: float = 1e-6,
    besides: Needs = Needs(()),
) -> ModelRequest:
    """Return the request with all that the analyses need, and `besides`, added; raises as `find_needs`."""
    needs = [find_needs(analysis, structure, request, method=method, rtol=rtol) for analysis in analyses]
    interfaces = () if needs else request.interfaces
    for addition in (*needs, besides):
        request = addition.besides(request)
    return replace(request, interfaces=interfaces)
