"""The scene file as pydantic models: every key with its sentence, unit and range.

The models check one value at a time; rules of several (references, laws, geometry) are checked when a
scene is assembled. SI units everywhere.
"""

from typing import Annotated, Any

from pydantic import ConfigDict, Discriminator, Field, Strict, Tag, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core.core_schema import NullableSchema

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
from tensegrity_codegen.scene.schema.model_schema import ModelOptions, Parameters
from tensegrity_codegen.scene.schema.part_schema import (
    ActuatorTable,
    BodySensor,
    ForceInput,
    GroundTable,
    Interference,
    LimitsTable,
    Load,
    Member,
    MemberClass,
    MemberSensor,
    Node,
    NodeSensor,
    RestLengthInput,
    SlidingTable,
    TemperatureInput,
)
from tensegrity_codegen.scene.schema.schema_types import Axes, Name, References, SceneName, Table, Vector
from tensegrity_codegen.scene.shapes import Shape
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.summaries import Fact, Summarised, count_names


class SceneParts(Table):
    """Nodes, members and groups: those of a shape, and those that a scene adds to it."""

    nodes: dict[Name, Node] = Field(
        default_factory=dict, description="Nodes by name; added to those of the shape."
    )
    members: dict[Name, Member] = Field(
        default_factory=dict, description="Members by name; added to those of the shape."
    )
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
    axes: Axes = Field(
        "xyz",
        description="Modelled axes. On the others all nodes have the same value, and vectors are 0.",
    )
    large: bool = Field(
        False, description="Members of 50 m and more are meant: no warning asks for lengths in mm."
    )
    gravity: Vector | None = Field(None, description="Gravity vector [m/s2], as [0, 0, -9.81].")
    model: ModelOptions = Field(
        default_factory=ModelOptions, description="Formulation, quantities and other options."
    )
    parameters: Parameters = Field(
        default_factory=Parameters, description="Values that may change at run time."
    )
    classes: dict[Name, MemberClass] = Field(
        default_factory=dict, description="Member classes by name: values that many members share."
    )
    shape: Shape | None = Field(None, description="A shape, which generates nodes and members.")
    bodies: dict[Name, BodyTable] = Field(
        default_factory=dict,
        description="Bodies by name: rigid ones beside nodes and members; or all bodies, with tendons.",
    )
    tendons: dict[Name, Tendon] = Field(
        default_factory=dict, description="Cables between points of bodies, by name."
    )
    sliding: dict[Name, SlidingTable] = Field(
        default_factory=dict, description="Cables with friction at rings by name, where strands are members."
    )
    joint_friction: Annotated[tuple[JointFrictionTable, ...], Strict(False)] = Field(
        (), description="Friction in the joints of bodies."
    )
    interference: Interference = Field(
        default_factory=Interference, description="Which bars may touch; default all that have a radius."
    )
    ground: GroundTable | None = Field(None, description="A plane that nodes touch, with friction.")
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
            Annotated[
                RestLengthInput | TemperatureInput | ForceInput | PointForceInput | TorqueInput,
                Discriminator("kind"),
            ],
            ...,
        ],
        Strict(False),
    ] = Field(
        (), description="Values that are set at run time, 0 in the scene, in the order of the input vector."
    )
    actuators: Annotated[tuple[ActuatorTable, ...], Strict(False)] = Field(
        (), description="Motors that change rest lengths; inputs after those of `inputs`."
    )
    sensors: Annotated[
        tuple[Annotated[MemberSensor | NodeSensor | BodySensor, Discriminator("kind")], ...], Strict(False)
    ] = Field((), description="Measurements of members, nodes and bodies.")
    limits: LimitsTable = Field(
        default_factory=LimitsTable, description="Limits of tensions, stresses, distances and stiffness."
    )

    def __init__(self, **document: Any) -> None:
        try:
            super().__init__(**document)
        except ValidationError as error:
            detail = error.errors(include_url=False)[0]
            location = ".".join(map(str, ("scene", *detail["loc"])))
            raise InvalidValueError(detail["msg"], where=location, given=detail["input"]) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # read_scene validates without it

    def headline(self) -> str:
        """Return the name of the scene."""
        return self.name

    def facts(self) -> list[Fact]:
        """Return the entries of the scene in each section, for `repr` and notebooks."""
        shape = [("shape", self.shape.kind)] if self.shape is not None else []
        names = ("nodes", "members", "bodies", "tendons", "classes", "inputs", "actuators", "loads")
        sections = [(name, getattr(self, name)) for name in names if getattr(self, name)]
        counts = [
            (name, count_names(list(value)) if isinstance(value, dict) else str(len(value)))
            for name, value in sections
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
    return {"$schema": _WithoutNull.schema_dialect, **_without_null_defaults(schema)}


def _without_null_defaults(node: Any) -> Any:
    if isinstance(node, dict):
        return {
            key: _without_null_defaults(value)
            for key, value in node.items()
            if not (key == "default" and value is None)
        }
    return [_without_null_defaults(entry) for entry in node] if isinstance(node, list) else node
