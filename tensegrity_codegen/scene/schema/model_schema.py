"""The section [model] of a scene file: formulation, quantities, integrators and other choices."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, Strict, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from tensegrity_codegen.scene.schema.schema_types import NodeSelection, Selection, Table
from tensegrity_codegen.structure.ground import CHANGEABLE
from tensegrity_codegen.tables.formulations import FORMULATIONS
from tensegrity_codegen.tables.integrators import INTEGRATORS
from tensegrity_codegen.tables.manifest import EVENT_KINDS
from tensegrity_codegen.tables.precision import PRECISIONS
from tensegrity_codegen.tables.presets import PRESETS
from tensegrity_codegen.tables.quantities import QUANTITIES
from tensegrity_codegen.tables.request import AUTO_EVENTS, BATCH_WIDTHS, INTERFACES

# Choices of a scene. A new emitter or solver adds its name here.
EMITTERS = ("auto", "unrolled", "lanes", "table")
FLAGS = ("reference", "native", "small")
EVENTS = (*AUTO_EVENTS, *EVENT_KINDS)
SOLVERS = ("equilibrium",)


def _one_of(what: str, known: tuple[str, ...]) -> tuple[AfterValidator, WithJsonSchema]:
    def check(name: str) -> str:
        if name not in known:
            raise PydanticCustomError("unknown_name", "unknown {what}", {"what": what, "known": known})
        return name

    return AfterValidator(check), WithJsonSchema({"type": "string", "enum": list(known)})


_QUANTITY = _one_of("quantity", tuple(QUANTITIES))
_FORMULATION = _one_of("formulation", tuple(FORMULATIONS))
_EMITTER = _one_of("emitter", EMITTERS)
_PRECISION = _one_of("precision", tuple(PRECISIONS))
_FLAGS = _one_of("flags", FLAGS)
_INTEGRATOR = _one_of("integrator", tuple(INTEGRATORS))
_EVENT = _one_of("kind of event", EVENTS)
_SOLVER = _one_of("solver", SOLVERS)
_INTERFACE = _one_of("interface", INTERFACES)
_PRESET = _one_of("preset", ("", *PRESETS))


def _check_batch_width(width: int) -> int:
    if width not in BATCH_WIDTHS:
        raise PydanticCustomError("batch_width", "not a batch width")
    return width


_BATCH_WIDTH = (
    AfterValidator(_check_batch_width),
    WithJsonSchema({"type": "integer", "enum": list(BATCH_WIDTHS)}),
)


class ModelOptions(Table):
    """Formulation, quantities and other options."""

    preset: Annotated[str, *_PRESET] = Field(
        "",
        description="Settings for a purpose, for keys that are not given. "
        + " ".join(f"{preset.name}: {preset.title}." for preset in PRESETS.values()),
    )
    formulation: Annotated[str, *_FORMULATION] = Field(
        next(iter(FORMULATIONS)),
        description="Choice of coordinates. Where it is not given, a scene with bars without stiffness or "
        "rigid bodies is rigid_bar, a scene of bodies with tendons bodies.",
    )
    options: dict[str, str] = Field(
        default_factory=dict,
        description="Options of the formulation, the default first. "
        + " ".join(
            f"{name}: {', '.join(' '.join((key, *choices)) for key, choices in formulation.options.items())}."
            for name, formulation in FORMULATIONS.items()
            if formulation.options
        ),
    )
    emitter: Annotated[str, *_EMITTER] = Field(
        EMITTERS[0],
        description="How the C code is written. unrolled (lanes means the same): nodes line by line, one "
        "loop for the laws of all members, up to about a hundred members; table: loops whose code does not "
        "grow with the structure; auto: one of these by size and request.",
    )
    batch_width: Annotated[int, *_BATCH_WIDTH] = Field(
        0,
        description="Number of evaluations, or motions, that batch functions process together: a power of "
        "two from 2 to 64; 0: no batch functions.",
    )
    precision: Annotated[str, *_PRECISION] = Field(
        next(iter(PRECISIONS)), description="Precision of every number of the library."
    )
    flags: Annotated[str, *_FLAGS] = Field(
        FLAGS[0],
        description="Compiler flags: reference, the same results on every machine; native, for the machine "
        "that compiles; small, optimised for size.",
    )
    checks: Literal["finite", "none"] = Field(
        "finite",
        description="finite: functions look for arguments and results that are not finite and report them "
        "by their status; none: they do not. Integrators, batches, solvers and analyses always look.",
    )
    quantities: Annotated[tuple[Annotated[str, *_QUANTITY], ...], Strict(False)] = Field(
        (),
        description="Requested quantities; each becomes one C function. Default: member_tension, "
        "acceleration, total_energy; where a free node has no mass member_tension, node_residual, "
        "potential_energy.",
    )
    integrators: Annotated[tuple[Annotated[str, *_INTEGRATOR], ...], Strict(False)] = Field(
        (),
        description="Time integrators of the library. "
        + " ".join(f"{name}: {row.title}." for name, row in INTEGRATORS.items()),
    )
    keep: Annotated[tuple[Literal["energy"], ...], Strict(False)] = Field(
        (),
        description="What rk54 and rk853 can keep constant from step to step, if a run requests it; in node "
        "positions and rigid bars without damping.",
    )
    events: Annotated[tuple[Annotated[str, *_EVENT], ...], Strict(False)] | None = Field(
        None,
        description="Events at which integrators can end their steps. cable: slack or taut; switch: of a "
        "member law; contact: of bars with a radius; collision: of bars that press each other; ground, "
        "stick: of nodes on the ground; yield: of plastic members; motor: whose rate is limited; ring: "
        "where a cable with friction slips or sticks; condition: the caller's; auto: all at which a force "
        "or its slope jumps, and a condition, where 1 to 400 members, contacts and rings have such events. "
        "Default: none in libraries of build and of compile_scene without for_, auto in all that integrate "
        "motions, and where events set internal states (members that yield, static friction).",
    )
    solvers: Annotated[tuple[Annotated[str, *_SOLVER], ...], Strict(False)] = Field(
        (),
        description="Solvers of the library. equilibrium: needs potential_energy, tangent_stiffness and "
        "node_residual (of bodies: coordinate_force), for up to 60 coordinates.",
    )
    interfaces: Annotated[tuple[Annotated[str, *_INTERFACE], ...], Strict(False)] = Field(
        (),
        description="Ways to call the library of build besides its C functions. casadi: casadi.external "
        "with first derivatives; casadi_hessian: with second derivatives too; acados: its integrators. "
        "Double precision only.",
    )

    @model_validator(mode="before")
    @classmethod
    def _complete_by_preset(cls, data: Any) -> Any:
        """Add the settings of the preset for keys that are not given."""
        preset = PRESETS.get(data.get("preset", "")) if isinstance(data, Mapping) else None
        return data if preset is None else {**preset.settings, **data}


class Parameters(Table):
    """What stays changeable at run time; all else is constant in the code."""

    rest_length: Selection | None = Field(
        None, description='Rest lengths [m]: "all" or names of members, groups and classes.'
    )
    spring_constant: Selection | None = Field(
        None, description="Spring constants [N/m] of members that have one; as rest_length."
    )
    axial_stiffness: Selection | None = Field(
        None, description="Axial stiffnesses [N] of members that have one; as rest_length."
    )
    damping: Selection | None = Field(None, description="Damping constants [N s/m]; as rest_length.")
    node_mass: NodeSelection | None = Field(None, description='Point masses [kg]: "all" or node names.')
    body_mass: Selection | None = Field(
        None,
        description='Masses of rigid bodies [kg], at constant centre and inertia: "all" or names.',
    )
    body_inertia: Selection | None = Field(
        None,
        description="Principal inertias of rigid bodies [kg m2] about their centres, ascending; their axes "
        'are constant: "all" or names.',
    )
    node_load: NodeSelection | None = Field(None, description='Loads on nodes [N]: "all" or node names.')
    anchor_position: Selection | None = Field(
        None, description='Positions of anchored nodes [m]: "all" or node names.'
    )
    gravity: Literal["all"] | None = Field(
        None,
        description='Gravity vector [m/s2]: "all". Turned against the ground it stands for another slope.',
    )
    ground: Selection | None = Field(
        None, description=f'Numbers of the ground: "all" or some of {", ".join(CHANGEABLE)}.'
    )
