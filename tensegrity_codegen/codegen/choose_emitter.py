"""Choice of the emitter where the scene leaves it open: `model.emitter = "auto"`.

The rule is a function of a few facts; where its numbers come from: docs/decisions/0014-auto-emitter.md.
"""

from dataclasses import dataclass, replace

from tensegrity_codegen.codegen.integrators.events import EVENT_QUANTITIES, choose_events
from tensegrity_codegen.codegen.lanes.emitter import FORCE_QUANTITIES
from tensegrity_codegen.codegen.lanes.kernel import BLOCKS
from tensegrity_codegen.codegen.table.emitter import TABLE
from tensegrity_codegen.codegen.unrolled import MOST_MEMBERS
from tensegrity_codegen.scene.subject import Subject
from tensegrity_codegen.structure.ground_support import needs_state_jacobian
from tensegrity_codegen.structure.ring_support import has_rings
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.formulations import find_formulation
from tensegrity_codegen.tables.integrators import called_quantities
from tensegrity_codegen.tables.request import ModelRequest

AUTO = "auto"
LEAST_VECTOR_MEMBERS = 4  # that fill one vector of the emitter lanes
MOST_STRAIGHT_LINE_MEMBERS = (
    100  # members up to which straight-line code is faster than loops and compiles quickly
)


@dataclass(frozen=True)
class EmitterFacts:
    """What the choice depends on.

    has_vectors: whether the emitter lanes writes one of the wanted functions in vectors.
    lacking: wanted quantities that the emitter table does not serve.
    most_members: largest number of members that the emitter unrolled takes.
    has_rings: whether cables slide through rings.
    """

    formulation: str
    n_members: int
    has_vectors: bool = False
    lacking: tuple[str, ...] = ()
    most_members: int = MOST_MEMBERS
    has_rings: bool = False


@dataclass(frozen=True)
class EmitterChoice:
    """The name of an emitter, and a sentence that says why it was chosen."""

    name: str
    why: str


def choose_emitter(facts: EmitterFacts) -> EmitterChoice:
    """Return the emitter for these facts."""
    count = facts.n_members
    members = describe_count(count, "member")
    is_open = not facts.lacking or count > facts.most_members  # which unrolled would refuse all the same
    emitters = find_formulation(facts.formulation).emitters
    if facts.has_rings:
        return EmitterChoice("unrolled", "cables through rings: the only emitter that knows them")
    if "table" in emitters and "lanes" not in emitters and count > MOST_STRAIGHT_LINE_MEMBERS and is_open:
        return EmitterChoice(
            "table", f"{members}, more than {MOST_STRAIGHT_LINE_MEMBERS}: loops, for statics"
        )
    if "lanes" not in emitters:
        return EmitterChoice("unrolled", f"the only emitter for the formulation {facts.formulation!r}")
    if count <= MOST_STRAIGHT_LINE_MEMBERS and facts.has_vectors:
        why = f"{members}, forces or stiffness requested: four members at a time are fastest"
        return EmitterChoice("lanes", why)
    if count <= MOST_STRAIGHT_LINE_MEMBERS:
        why = f"{members}, nothing to do four members at a time: straight-line code is fastest"
        return EmitterChoice("unrolled", why)
    if facts.lacking and count <= facts.most_members:
        why = f"{members}, and loops over tables do not serve {', '.join(facts.lacking)}"
        return EmitterChoice("unrolled", why)
    return EmitterChoice(
        "table",
        f"{members}, more than {MOST_STRAIGHT_LINE_MEMBERS}: loops whose code does not grow",
    )


def find_facts(structure: Subject, request: ModelRequest) -> EmitterFacts:
    """Return what the choice depends on; what makes no difference stays at its default."""
    facts = EmitterFacts(request.formulation, structure.n_members, has_vectors(structure, request))
    if has_rings(structure):
        return replace(facts, has_rings=True)
    emitters = find_formulation(request.formulation).emitters
    if "lanes" in emitters:
        is_open = MOST_STRAIGHT_LINE_MEMBERS < facts.n_members <= MOST_MEMBERS
        return replace(facts, lacking=_find_lacking(structure, request)) if is_open else facts
    if "table" in emitters and facts.n_members > MOST_STRAIGHT_LINE_MEMBERS:
        try:
            return replace(facts, lacking=_find_lacking(structure, request))
        except FormulationError:  # options that loops do not have
            return replace(facts, lacking=("rigid bars with these options",))
    return facts


def has_vectors(structure: Subject, request: ModelRequest) -> bool:
    """Return whether the emitter lanes writes more than unrolled does: see lanes.emitter."""
    return (
        "lanes" in find_formulation(request.formulation).emitters
        and len(structure.axes) == 3
        and request.precision == "double"
        and structure.n_members >= LEAST_VECTOR_MEMBERS
        and getattr(structure, "ground", None) is None
        and any(name in FORCE_QUANTITIES or name in BLOCKS for name in request.quantities)
    )


def list_candidates(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return the emitters worth a measurement: the one named, or all that write different code."""
    if request.emitter != AUTO or has_rings(structure):
        return ("unrolled" if request.emitter == AUTO else request.emitter,)
    return ("unrolled", *(("lanes",) if has_vectors(structure, request) else ()), "table")


def _find_lacking(structure: Subject, request: ModelRequest) -> tuple[str, ...]:
    """Return what is wanted, also by wanted integrators, and the emitter table does not serve."""
    wanted = [*request.quantities, *called_quantities(request.integrators, needs_state_jacobian(structure))]
    if request.integrators:
        # Quantities behind the events that integrators watch, see events.find_events.
        kinds = request.events
        if kinds is None:
            kinds = choose_events(request, structure)
        wanted += [EVENT_QUANTITIES[kind] for kind in kinds if kind in EVENT_QUANTITIES]
    model = TABLE.build(structure, request)
    return tuple(name for name in dict.fromkeys(wanted) if not TABLE.is_offered(model, name))
