"""The part of the scene file about control: actuators, sensors and limits."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, Strict, Tag

from tensegrity_codegen.scene.schema.schema_types import (
    Name,
    NotNegative,
    PointReference,
    Positive,
    Reference,
    References,
    Table,
    tag_by_type,
)

Names: TypeAlias = Annotated[
    Annotated[Reference, Tag("@name")] | Annotated[References, Tag("@names")],
    Discriminator(tag_by_type(str, "@name", "@names")),
]
PointNames: TypeAlias = Annotated[
    Annotated[PointReference, Tag("@name")]
    | Annotated[Annotated[tuple[PointReference, ...], Strict(False), Field(min_length=1)], Tag("@names")],
    Discriminator(tag_by_type(str, "@name", "@names")),
]
SafetyFactor: TypeAlias = Annotated[
    Annotated[bool, Tag("@flag")] | Annotated[float, Field(ge=1, allow_inf_nan=False), Tag("@number")],
    Discriminator(tag_by_type(bool, "@flag", "@number")),
]


class ActuatorTable(Table):
    """A motor: an input of kind rest_length, whose value u [m] is added to rest lengths."""

    name: Name = Field(description="Name of the actuator, which is an input too.")
    members: Names = Field(description="Names of members, groups or classes; each member once.")
    rate: Positive | None = Field(None, description="Largest rate of the rest lengths [m/s]; none: no limit.")
    range: Annotated[tuple[Positive, ...], Strict(False), Field(min_length=2, max_length=2)] | None = Field(
        None, description="Least and largest rest length of each member [m]; none: no limit."
    )
    delay: NotNegative = Field(0.0, description="Time from the command to the motion [s].")
    time_constant: NotNegative = Field(
        0.0, description="Time constant of the lag between command and motor in motions [s]; 0: no lag."
    )


class MemberSensor(Table):
    """A measurement of members."""

    kind: Literal["member_length", "member_tension"] = Field(description="What is measured.")
    name: Name | None = Field(None, description="Name of the sensor.")
    members: Names = Field(description='Names of members, groups or classes; "all".')
    noise: NotNegative = Field(
        0.0, description="Standard deviation of each measured number, in its unit [m, N]."
    )


class NodeSensor(Table):
    """A measurement of nodes."""

    kind: Literal["node_position", "node_velocity"] = Field(description="What is measured.")
    name: Name | None = Field(None, description="Name of the sensor.")
    nodes: Names | None = Field(None, description='Names of nodes; "all".')
    points: PointNames | None = Field(None, description='Scenes of bodies: points, as "body.point".')
    noise: NotNegative = Field(
        0.0, description="Standard deviation of each measured number, in its unit [m, m/s]."
    )


class MemberLimits(Table):
    """Limits of members."""

    least_tension: NotNegative | None = Field(None, description="Least tension of cables [N].")
    most_tension: Positive | None = Field(
        None, description="Largest tension [N]; for all members: of cables."
    )
    yield_stress: Positive | None = Field(
        None, description="Largest stress, in tension and compression [Pa]; needs radius."
    )
    buckling: SafetyFactor | None = Field(
        None,
        description="Bars do not buckle (Euler, pinned ends): true, or a safety factor from 1; needs radius.",
    )


class LimitsTable(MemberLimits):
    """Limits of all members, of classes and of single members, and of the whole structure."""

    clearance: NotNegative | None = Field(
        None, description="Least distance between the surfaces of bars [m]."
    )
    least_stiffness: NotNegative | None = Field(
        None, description="Least value of the smallest eigenvalue of the tangent stiffness [N/m]."
    )
    classes: dict[Reference, MemberLimits] = Field(
        default_factory=dict, description="Limits by member class; they override those of all members."
    )
    members: dict[Reference, MemberLimits] = Field(
        default_factory=dict, description="Limits by member; they override those of its class."
    )
