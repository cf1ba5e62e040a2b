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
        "", description="Settings for a purpose, for keys that are not given: casadi, acados, f32, mcu."
    )
    formulation: Annotated[str, *_FORMULATION] = Field(
        next(iter(FORMULATIONS)), description="Choice of coordinates."
    )
    options: dict[str, str] = Field(
        default_factory=dict, description="Options of the formulation, by name; see docs/scene.md."
    )
    emitter: Annotated[str, *_EMITTER] = Field(
        EMITTERS[0], description="How the C code is written; auto: by size and request."
    )
    batch_width: Annotated[int, *_BATCH_WIDTH] = Field(
        0,
        description="Number of evaluations that batch functions process together: a power of two from 2 "
        "to 64; 0: no batch functions.",
    )
    precision: Annotated[str, *_PRECISION] = Field(
        next(iter(PRECISIONS)), description="Precision of every number of the library."
    )
    flags: Annotated[str, *_FLAGS] = Field(
        FLAGS[0],
        description="Compiler flags: the same results on every machine, or for the machine that compiles.",
    )
    checks: Literal["finite", "none"] = Field(
        "finite",
        description="Whether functions look for numbers that are not finite and report them by their status.",
    )
    quantities: Annotated[tuple[Annotated[str, *_QUANTITY], ...], Strict(False)] = Field(
        (), description="Requested quantities; default: tensions, accelerations and total energy."
    )
    integrators: Annotated[tuple[Annotated[str, *_INTEGRATOR], ...], Strict(False)] = Field(
        (), description="Time integrators of the library."
    )
    keep: Annotated[tuple[Literal["energy"], ...], Strict(False)] = Field(
        (), description="What integrators with error control can keep constant."
    )
    events: Annotated[tuple[Annotated[str, *_EVENT], ...], Strict(False)] | None = Field(
        None,
        description="Events at which integrators can end their steps; auto: all where a force or its slope "
        "jumps, and a condition. Default: none in libraries of build, auto in those of simulate.",
    )
    solvers: Annotated[tuple[Annotated[str, *_SOLVER], ...], Strict(False)] = Field(
        (), description="Solvers of the library."
    )
    interfaces: Annotated[tuple[Annotated[str, *_INTERFACE], ...], Strict(False)] = Field(
        (),
        description="Ways to call the library besides its C functions: casadi, for casadi.external with "
        "first derivatives; casadi_hessian, with second derivatives too.",
    )

    @model_validator(mode="before")
    @classmethod
    def _complete_by_preset(cls, data: Any) -> Any:
        """Add the settings of the preset for keys that are not given."""
        preset = PRESETS.get(data.get("preset", "")) if isinstance(data, Mapping) else None
        return data if preset is None else {**preset.settings, **data}


class Parameters(Table):
    """What stays changeable at run time; all else is baked in as constants."""

    rest_length: Selection | None = Field(None, description='Rest lengths [m]: "all" or member names.')
    spring_constant: Selection | None = Field(
        None, description='Spring constants [N/m]: "all" or member names.'
    )
    axial_stiffness: Selection | None = Field(
        None, description='Axial stiffnesses [N]: "all" or member names.'
    )
    damping: Selection | None = Field(None, description='Damping constants [N s/m]: "all" or member names.')
    node_mass: NodeSelection | None = Field(None, description='Point masses [kg]: "all" or node names.')
    body_mass: Selection | None = Field(None, description='Masses of bodies [kg]: "all" or names of bodies.')
    body_inertia: Selection | None = Field(
        None, description='Principal inertias of bodies [kg m2], ascending: "all" or names of bodies.'
    )
    node_load: NodeSelection | None = Field(None, description='Loads on nodes [N]: "all" or node names.')
    anchor_position: Selection | None = Field(
        None, description='Positions of anchored nodes [m]: "all" or node names.'
    )
    gravity: Literal["all"] | None = Field(None, description='Gravity vector [m/s2]: "all" only.')
    ground: Selection | None = Field(
        None, description=f'Numbers of the ground: "all" or some of {", ".join(CHANGEABLE)}.'
    )
