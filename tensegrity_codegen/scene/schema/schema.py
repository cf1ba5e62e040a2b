"""The scene file as pydantic models: every key with its sentence, unit and range.

The models check one value at a time; what needs several (references, laws, geometry) is checked when a
scene is assembled. SI units everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import PydanticCustomError
from pydantic_core.core_schema import NullableSchema

from tensegrity_codegen.formulations import FORMULATIONS
from tensegrity_codegen.manifest import EVENT_KINDS
from tensegrity_codegen.marks import MARK
from tensegrity_codegen.precision import PRECISIONS
from tensegrity_codegen.presets import PRESETS
from tensegrity_codegen.quantities import QUANTITIES
from tensegrity_codegen.request import BATCH_WIDTHS, INTERFACES
from tensegrity_codegen.results.summaries import Fact, Summarised, count_names
from tensegrity_codegen.scene.schema.body_schema import (
    BodyTable,
    BodyTorque,
    JointFrictionTable,
    PointForceInput,
    PointLoad,
    Tendon,
    TorqueInput,
    load_tag,
)
from tensegrity_codegen.scene.schema.control_schema import (
    ActuatorTable,
    LimitsTable,
    MemberSensor,
    NodeSensor,
)
from tensegrity_codegen.scene.schema.schema_types import (
    Anchored,
    Axes,
    MemberValues,
    Name,
    Positive,
    Reference,
    References,
    SceneName,
    Selection,
    Table,
    Vector,
    tag_by_type,
)
from tensegrity_codegen.scene.shapes import Shape
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.tableaus import EXPLICIT

__all__ = [
    "EMITTERS",
    "EVENTS",
    "FLAGS",
    "FORMULATIONS",
    "INTEGRATORS",
    "SOLVERS",
    "ForceInput",
    "Interference",
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

# What a scene may ask for. A new emitter, integrator or solver adds its name here.
EMITTERS = ("auto", "unrolled", "lanes", "table")
FLAGS = ("reference", "native", "small")
INTEGRATORS = (*EXPLICIT, "radau")
EVENTS = tuple(EVENT_KINDS)
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
_INTEGRATOR = _one_of("integrator", INTEGRATORS)
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


class MemberClass(MemberValues):
    """Values that many members share."""

    kind: Literal["bar", "cable"] = Field(
        description="A bar takes both signs of force, a cable tension only."
    )


class Member(MemberValues):
    """One member between two nodes: a class with overrides, or a kind with all values in place."""

    class_name: Reference | None = Field(None, alias="class", description="Name of a member class.")
    kind: Literal["bar", "cable"] | None = Field(
        None, description="Only without a class: a bar takes both signs of force, a cable tension only."
    )
    nodes: Annotated[tuple[Reference, ...], Strict(False), Field(min_length=2, max_length=2)] = Field(
        description="The two nodes that the member joins; the member vector is first minus second."
    )


class Node(Table):
    """One point: where it is, what it weighs, on which axes it is held."""

    position: Vector = Field(description="Position [m]: 3 numbers, or one for each modelled axis.")
    mass: Positive | None = Field(None, description="Point mass [kg]; bars add their own.")
    anchored: Anchored = Field(
        False, description='Anchored: true (all axes), false, or the anchored axes, for example "xz".'
    )
    velocity: Vector | None = Field(None, description="Velocity at the start [m/s]; 0 on anchored axes.")


class Load(Table):
    """A constant force on one node."""

    node: Reference = Field(description="Name of the node.")
    force: Vector = Field(description="Force [N], constant in direction.")


class RestLengthInput(Table):
    """An actuator: its value u [m] is added to the rest length of every listed member."""

    kind: Literal["rest_length"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    members: References = Field(description="Names of members, groups or classes.")


class ForceInput(Table):
    """A force of value u [N] along `direction` on every listed node."""

    kind: Literal["force"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    nodes: References = Field(description="Names of nodes.")
    direction: Vector = Field(description="Direction of the force; normalised, so only its direction counts.")


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
        description="Events at which integrators with error control end their steps; "
        "default: cables that can go slack, if there are 1 to 400, and a condition of the caller.",
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
    node_mass: Selection | None = Field(None, description='Point masses [kg]: "all" or node names.')
    node_load: Selection | None = Field(None, description='Loads on nodes [N]: "all" or node names.')
    anchor_position: Selection | None = Field(
        None, description='Positions of anchored nodes [m]: "all" or node names.'
    )
    gravity: Literal["all"] | None = Field(None, description='Gravity vector [m/s2]: "all" only.')


class Interference(Table):
    """Which bars may touch."""

    pairs: Annotated[
        Annotated[Literal["all"], Tag("@all")]
        | Annotated[
            Annotated[
                tuple[
                    Annotated[tuple[Reference, ...], Strict(False), Field(min_length=2, max_length=2)], ...
                ],
                Strict(False),
            ],
            Tag("@names"),
        ],
        Discriminator(tag_by_type(str, "@all", "@names")),
    ] = Field("all", description='Pairs of bars whose distance is computed: "all", or a list of [bar, bar].')


class SceneParts(Table):
    """Nodes, members and groups: what a shape stands for, and what a scene adds to it."""

    nodes: dict[Name, Node] = Field(default_factory=dict, description="Nodes by name.")
    members: dict[Name, Member] = Field(default_factory=dict, description="Members by name.")
    groups: dict[Name, References] = Field(
        default_factory=dict, description="Named sets of members, by name: lists of member names."
    )


class Scene(Summarised, SceneParts):
    """A tensegrity structure and what is requested of it, checked key by key. SI units.

    Its fields are the sections and keys of a scene file.

    Examples
    --------
    >>> from tensegrity_codegen import read_scene
    >>> scene = read_scene("prism.toml")
    >>> scene.shape.height, scene.classes["cable"].spring_constant
    (0.3, 200.0)
    >>> scene.to_toml().splitlines()[0]
    'name = "prism"'
    """

    model_config = ConfigDict(
        json_schema_extra={"description": "A tensegrity structure and what is requested of it. SI units."}
    )

    name: SceneName = Field(description="Name of the scene: the prefix of all names in the generated C.")
    axes: Axes = Field("xyz", description='Modelled axes; two or one of them make a planar scene, as "xz".')
    gravity: Vector | None = Field(None, description="Gravity vector [m/s2], as [0, 0, -9.81]; default none.")
    model: ModelOptions = Field(
        default_factory=ModelOptions, description="Formulation, quantities and other options."
    )
    parameters: Parameters = Field(
        default_factory=Parameters, description="Values that may change at run time; default none."
    )
    classes: dict[Name, MemberClass] = Field(
        default_factory=dict, description="Member classes by name: values that many members share."
    )
    shape: Shape | None = Field(None, description="A shape, which generates nodes and members.")
    bodies: dict[Name, BodyTable] = Field(
        default_factory=dict, description="Rigid bodies by name, in place of nodes and members."
    )
    tendons: dict[Name, Tendon] = Field(
        default_factory=dict, description="Cables between points of bodies, by name."
    )
    joint_friction: Annotated[tuple[JointFrictionTable, ...], Strict(False)] = Field(
        (), description="Friction in the joints of bodies."
    )
    interference: Interference = Field(
        default_factory=Interference, description="Which bars may touch; default all that have a radius."
    )
    loads: Annotated[
        tuple[
            Annotated[
                Annotated[Load, Tag("@node")]
                | Annotated[PointLoad, Tag("@point")]
                | Annotated[BodyTorque, Tag("@body")],
                Discriminator(load_tag),
            ],
            ...,
        ],
        Strict(False),
    ] = Field((), description="Constant forces on nodes; forces and torques on bodies.")
    inputs: Annotated[
        tuple[
            Annotated[RestLengthInput | ForceInput | PointForceInput | TorqueInput, Discriminator("kind")],
            ...,
        ],
        Strict(False),
    ] = Field(
        (), description="Actuated inputs: rest-length changes and forces, in the order of the input vector."
    )
    actuators: Annotated[tuple[ActuatorTable, ...], Strict(False)] = Field(
        (), description="Motors that change rest lengths; inputs after those of `inputs`."
    )
    sensors: Annotated[
        tuple[Annotated[MemberSensor | NodeSensor, Discriminator("kind")], ...], Strict(False)
    ] = Field((), description="Measurements of members and nodes.")
    limits: LimitsTable = Field(
        default_factory=LimitsTable, description="Limits of tensions, stresses, distances and stiffness."
    )

    def headline(self) -> str:
        """Return the name of the scene."""
        return self.name

    def facts(self) -> list[Fact]:
        """Return what the scene has in each section, for `repr` and notebooks."""
        shape = [("shape", self.shape.kind)] if self.shape is not None else []
        names = ("nodes", "members", "bodies", "tendons", "classes", "inputs", "actuators", "loads")
        found = [(name, getattr(self, name)) for name in names if getattr(self, name)]
        counts = [
            (name, count_names(list(value)) if isinstance(value, dict) else str(len(value)))
            for name, value in found
        ]
        return [*shape, *counts, ("quantities", ", ".join(self.model.quantities) or "default")]

    def __str__(self) -> str:
        return repr(self)

    def to_document(self) -> dict[str, Any]:
        """Return the scene as a plain document: the dictionary that its TOML file stands for.

        Returns
        -------
        dict
            Tables, lists, texts and numbers, with the keys that the scene was given.
        """
        return self.model_dump(by_alias=True, exclude_unset=True)

    def to_toml(self) -> str:
        """Return the scene as the text of a TOML file.

        Returns
        -------
        str
            TOML; reading it gives an equal scene, with the same numbers bit by bit. Comments of the file
            that the scene was read from, and its layout, are not kept.
        """
        return format_scene(self.to_document())


class _WithoutNull(GenerateJsonSchema):
    """TOML has no null: an optional key is simply left out."""

    def nullable_schema(self, schema: NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file, for editors that complete and check TOML."""
    schema = Scene.model_json_schema(schema_generator=_WithoutNull)
    head = {"$schema": _WithoutNull.schema_dialect, "$comment": MARK}
    return {**head, **_without_null_defaults(schema)}


def _without_null_defaults(node: Any) -> Any:
    if isinstance(node, dict):
        return {
            key: _without_null_defaults(value)
            for key, value in node.items()
            if not (key == "default" and value is None)
        }
    return [_without_null_defaults(item) for item in node] if isinstance(node, list) else node
