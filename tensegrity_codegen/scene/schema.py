"""The scene file as pydantic models: every key with its sentence, unit and range.

The models check one value at a time; what needs several (references, laws, geometry) is checked when a
scene is assembled. SI units everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    StringConstraints,
    Tag,
    WithJsonSchema,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import NullableSchema

from tensegrity_codegen.quantities import QUANTITIES
from tensegrity_codegen.scene.names import KEYWORDS, NAME_PATTERN, NAME_RULE
from tensegrity_codegen.scene.shapes import Shape

__all__ = [
    "EMITTERS",
    "FORMULATIONS",
    "INTEGRATORS",
    "ForceInput",
    "Load",
    "Member",
    "MemberClass",
    "ModelOptions",
    "Node",
    "Parameters",
    "RestLengthInput",
    "Scene",
    "SceneParts",
    "scene_json_schema",
]

# What a scene may ask for. A new formulation, emitter or integrator adds its name here.
FORMULATIONS = ("node_position", "node_distance")
EMITTERS = ("unrolled",)
INTEGRATORS = ("rk4",)


def _refuse_keyword(name: str) -> str:
    if name in KEYWORDS:
        raise PydanticCustomError("name_keyword", "the name is a keyword of C or C++")
    return name


def _one_of(what: str, known: tuple[str, ...]) -> tuple[AfterValidator, WithJsonSchema]:
    def check(name: str) -> str:
        if name not in known:
            raise PydanticCustomError("unknown_name", "unknown {what}", {"what": what, "known": known})
        return name

    return AfterValidator(check), WithJsonSchema({"type": "string", "enum": list(known)})


def _tag(word: type, yes: str, no: str) -> Callable[[Any], str]:
    return lambda value: yes if isinstance(value, word) else no


_QUANTITY = _one_of("quantity", tuple(QUANTITIES))
_FORMULATION = _one_of("formulation", FORMULATIONS)
_EMITTER = _one_of("emitter", EMITTERS)
_INTEGRATOR = _one_of("integrator", INTEGRATORS)

# A new name, and a reference to one that is defined elsewhere.
Name: TypeAlias = Annotated[
    str,
    StringConstraints(pattern=NAME_PATTERN),
    AfterValidator(_refuse_keyword),
    Field(description=NAME_RULE),
]
Reference: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
References: TypeAlias = Annotated[tuple[Reference, ...], Strict(False), Field(min_length=1)]

Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vector: TypeAlias = Annotated[tuple[Number, ...], Strict(False), Field(min_length=1, max_length=3)]

Axes: TypeAlias = Literal["x", "y", "z", "xy", "xz", "yz", "xyz"]
Anchored: TypeAlias = Annotated[
    Annotated[bool, Tag("@flag")] | Annotated[Axes, Tag("@axes")],
    Discriminator(_tag(str, "@axes", "@flag")),
]
Selection: TypeAlias = Annotated[
    Annotated[Literal["all"], Tag("@all")] | Annotated[References, Tag("@names")],
    Discriminator(_tag(str, "@all", "@names")),
]


class _Table(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class _MemberValues(_Table):
    """What a member class sets and a member may override."""

    spring_constant: Positive | None = Field(None, description="Spring constant mu = dt/dl [N/m].")
    axial_stiffness: Positive | None = Field(
        None, description="Axial stiffness EA [N]; the spring constant is EA / rest_length."
    )
    rest_length: Positive | None = Field(None, description="Length without tension [m].")
    prestress: Number | None = Field(
        None, description="Tension at the stated node positions [N], positive in tension."
    )
    strain: Annotated[float, Field(gt=-1, allow_inf_nan=False)] | None = Field(
        None, description="(length - rest_length) / rest_length at the stated node positions."
    )
    damping: NotNegative | None = Field(
        None, description="Damping constant c [N s/m]: adds c times the rate of length to the tension."
    )
    mass: Positive | None = Field(None, description="Bars only: own mass [kg], spread evenly along the bar.")
    density: Positive | None = Field(
        None, description="Bars only: density [kg/m3]; needs radius; mass = density * section * length."
    )
    radius: Positive | None = Field(None, description="Outer radius of the round section [m].")
    inner_radius: NotNegative | None = Field(
        None, description="Bars only: inner radius of a tube [m], less than radius."
    )
    tension_only: bool | None = Field(
        None,
        description="Cables only: no force when slack (default true); false makes a two-sided spring.",
    )


class MemberClass(_MemberValues):
    """Values that many members share."""

    kind: Literal["bar", "cable"] = Field(
        description="A bar takes both signs of force, a cable tension only."
    )


class Member(_MemberValues):
    """One member between two nodes: a class with overrides, or a kind with all values in place."""

    class_name: Reference | None = Field(None, alias="class", description="Name of a member class.")
    kind: Literal["bar", "cable"] | None = Field(
        None, description="Only without a class: a bar takes both signs of force, a cable tension only."
    )
    nodes: Annotated[tuple[Reference, ...], Strict(False), Field(min_length=2, max_length=2)] = Field(
        description="The two nodes that the member joins; the member vector is first minus second."
    )


class Node(_Table):
    """One point: where it is, what it weighs, on which axes it is held."""

    position: Vector = Field(description="Position [m]: 3 numbers, or one for each modelled axis.")
    mass: Positive | None = Field(None, description="Point mass [kg]; bars add their own.")
    anchored: Anchored = Field(
        False, description='Held in place: true (all axes), false, or the held axes, for example "xz".'
    )
    velocity: Vector | None = Field(None, description="Velocity at the start [m/s]; 0 on anchored axes.")


class Load(_Table):
    """A constant force on one node."""

    node: Reference = Field(description="Name of the node.")
    force: Vector = Field(description="Force [N], constant in direction.")


class RestLengthInput(_Table):
    """An actuator: its value u [m] is added to the rest length of every listed member."""

    kind: Literal["rest_length"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    members: References = Field(description="Names of members, groups or classes.")


class ForceInput(_Table):
    """A force of value u [N] along `direction` on every listed node."""

    kind: Literal["force"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    nodes: References = Field(description="Names of nodes.")
    direction: Vector = Field(description="Direction of the force; normalised, so only its direction counts.")


class ModelOptions(_Table):
    """What is wanted of the scene."""

    formulation: Annotated[str, *_FORMULATION] = Field(FORMULATIONS[0], description="Choice of coordinates.")
    options: dict[str, str] = Field(
        default_factory=dict, description="The formulation's own choices, by name; see its documentation."
    )
    emitter: Annotated[str, *_EMITTER] = Field(EMITTERS[0], description="Way of writing the C code.")
    quantities: Annotated[tuple[Annotated[str, *_QUANTITY], ...], Strict(False)] = Field(
        (), description="Wanted quantities; none: tensions, accelerations and total energy."
    )
    integrators: Annotated[tuple[Annotated[str, *_INTEGRATOR], ...], Strict(False)] = Field(
        (), description="Time integrators to put into the library."
    )


class Parameters(_Table):
    """What stays changeable at run time; all else is baked in as constants."""

    rest_length: Selection | None = Field(None, description='Rest lengths [m]: "all" or member names.')
    spring_constant: Selection | None = Field(
        None, description='Spring constants [N/m]: "all" or member names.'
    )
    axial_stiffness: Selection | None = Field(
        None, description='Axial stiffnesses [N]: "all" or member names.'
    )
    damping: Selection | None = Field(None, description='Damping constants [N s/m]: "all" or member names.')
    node_mass: Selection | None = Field(None, description='Point masses [kg]: "all" or node names.')
    node_load: Selection | None = Field(None, description='Loads on nodes [N]: "all" or node names.')
    anchor_position: Selection | None = Field(
        None, description='Positions of anchored nodes [m]: "all" or node names.'
    )
    gravity: Literal["all"] | None = Field(None, description='Gravity vector [m/s2]: "all" only.')


class SceneParts(_Table):
    """Nodes, members and groups: what a shape stands for, and what a scene adds to it."""

    nodes: dict[Name, Node] = Field(default_factory=dict, description="Nodes by name.")
    members: dict[Name, Member] = Field(default_factory=dict, description="Members by name.")
    groups: dict[Name, References] = Field(
        default_factory=dict, description="Named sets of members, by name: lists of member names."
    )


class Scene(SceneParts):
    """A tensegrity structure and what is wanted of it. SI units."""

    name: Name = Field(description="Name of the scene: the prefix of all names in the generated C.")
    axes: Axes = Field("xyz", description='Modelled axes; two or one of them make a planar scene, as "xz".')
    gravity: Vector | None = Field(None, description="Gravity vector [m/s2], as [0, 0, -9.81]; default none.")
    model: ModelOptions = Field(default_factory=ModelOptions, description="What is wanted of the scene.")
    parameters: Parameters = Field(
        default_factory=Parameters, description="What stays changeable at run time; default nothing."
    )
    classes: dict[Name, MemberClass] = Field(
        default_factory=dict, description="Member classes by name: values that many members share."
    )
    shape: Shape | None = Field(None, description="Nodes and members generated from a few words.")
    loads: Annotated[tuple[Load, ...], Strict(False)] = Field((), description="Constant forces on nodes.")
    inputs: Annotated[
        tuple[Annotated[RestLengthInput | ForceInput, Discriminator("kind")], ...], Strict(False)
    ] = Field(
        (), description="Actuated inputs: rest-length changes and forces, in the order of the input vector."
    )


class _WithoutNull(GenerateJsonSchema):
    """TOML has no null: an optional key is simply left out."""

    def nullable_schema(self, schema: NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file, for editors that complete and check TOML."""
    schema = Scene.model_json_schema(schema_generator=_WithoutNull)
    return {"$schema": _WithoutNull.schema_dialect, **_without_null_defaults(schema)}


def _without_null_defaults(node: Any) -> Any:
    if isinstance(node, dict):
        return {
            key: _without_null_defaults(value)
            for key, value in node.items()
            if not (key == "default" and value is None)
        }
    return [_without_null_defaults(item) for item in node] if isinstance(node, list) else node
