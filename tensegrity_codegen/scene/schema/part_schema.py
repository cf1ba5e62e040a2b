"""Nodes, members, loads, inputs, the ground, actuators, sensors and limits of a scene file."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Strict, Tag

from tensegrity_codegen.scene.schema.schema_types import (
    FRICTION,
    WRAP,
    Anchored,
    MemberValues,
    Name,
    NodePattern,
    NodeReference,
    NodeReferences,
    NotNegative,
    Number,
    OfRings,
    PointReference,
    Positive,
    Reference,
    References,
    Table,
    Vector,
    tag_by_type,
)

Contacts: TypeAlias = Annotated[
    Annotated[Literal["all"], Tag("@all")] | Annotated[NodeReferences, Tag("@names")],
    Discriminator(tag_by_type(str, "@all", "@names")),
]
ContactRadius: TypeAlias = Annotated[
    Annotated[Literal["bar"], Tag("@bar")] | Annotated[NotNegative, Tag("@number")],
    Discriminator(tag_by_type(str, "@bar", "@number")),
]
Exponent: TypeAlias = Annotated[float, Field(allow_inf_nan=False, json_schema_extra={"enum": [1, 1.5]})]


class Restitution(Table):
    """Speed after an impact over speed before it, at one speed."""

    value: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] = Field(
        description="Speed after the impact over speed before it, between 0 and 1."
    )
    speed: Positive = Field(description="Speed before the impact for which `value` holds [m/s].")


class GroundTable(Table):
    """A plane that nodes touch, with friction."""

    normal: Vector | None = Field(
        None,
        description="Normal out of the ground within the axes of the scene; normalised. Default: the last "
        "axis.",
    )
    slope_deg: Annotated[float, Field(gt=-90, lt=90, allow_inf_nan=False)] | None = Field(
        None,
        description="Slope [deg], in place of normal: the ground descends along the first axis of the "
        "scene, the last axis is up.",
    )
    offset: Number = Field(0.0, description="Normal times position, of the points of the plane [m].")
    velocity: Vector | None = Field(
        None,
        description="Velocity of the ground's surface along the plane, as of a belt [m/s]; default 0. A part "
        "along the normal up to 1e-6 of it is removed as rounding.",
    )
    contacts: Contacts = Field(
        "all",
        description='Nodes that can touch the ground: "all" that can move along its normal, and points of '
        'bodies with a radius; or a list of names and "body.point". Of bodies with angles "all" has neither '
        "centres of mass nor ends of bars that another body holds. Anchored nodes cannot be contacts.",
    )
    radius: ContactRadius = Field(
        0.0,
        description='Radius of the ball about each contact [m]; "bar": the largest radius of the bars that '
        "end there, 0 where none does, so that bars touch as capsules.",
    )
    stiffness: Positive | None = Field(
        None, description="Contact stiffness k [N/m]; [N/m^1.5] with exponent 1.5. Or `penetration`."
    )
    penetration: Positive | None = Field(
        None,
        description="Penetration d at which the n contacts carry equal parts of the weight W along the "
        "normal [m]: k = W / (n d^p).",
    )
    exponent: Exponent = Field(
        1.0,
        description="Exponent p of the penetration d in the normal force k d^p (1 + a d'): 1, or 1.5 as "
        "between a sphere and a plane (Hertz).",
    )
    restitution: Restitution | None = Field(
        None, description="Restitution at one speed, { value, speed }, which gives a. Or `dissipation`."
    )
    dissipation: NotNegative | None = Field(
        None, description="Dissipation a of impacts in the normal force (Hunt and Crossley) [s/m]; default 0."
    )
    friction: NotNegative = Field(0.0, description="Coefficient of friction mu.")
    static_friction: NotNegative | None = Field(
        None,
        description="Coefficient up to which a contact sticks, at least `friction`, which is the default.",
    )
    stick_stiffness: Positive | None = Field(
        None,
        description="Tangential stiffness kt of a sticking contact [N/m]; default: the normal stiffness k, "
        "with exponent 1.5 the slope of the normal force at rest, 1.5 k^(2/3) (W/n)^(1/3).",
    )
    stick_damping: Positive | None = Field(
        None,
        description="Tangential damping of a sticking contact [N s/m]; default: critical damping of the mean "
        "contact, 2 sqrt(kt m), with the effective mass m of a node, or of a body where it is touched.",
    )


def list_number(value: Any) -> Any:
    """Return a number alone as a list of it."""
    return [value] if isinstance(value, int | float) else value


Gains = Annotated[Annotated[tuple[Number, ...], Strict(False)], BeforeValidator(list_number)]


class MemberClass(MemberValues):
    """Values that many members share."""

    kind: Literal["bar", "cable"] = Field(
        description="A bar takes both signs of force, a cable tension only."
    )


class Member(MemberValues):
    """One member from node to node: a class with overrides, or a kind with all values in place."""

    class_name: Reference | None = Field(None, alias="class", description="Name of a member class.")
    kind: Literal["bar", "cable"] | None = Field(
        None, description="Only without a class: a bar takes both signs of force, a cable tension only."
    )
    nodes: Annotated[tuple[NodeReference, ...], Strict(False), Field(min_length=2)] = Field(
        description="The two nodes that the member joins; the member vector is first minus second. Of cables "
        "also the nodes between the ends, rings through which the cable slides, in order."
    )


class SlidingTable(Table):
    """A cable with friction at rings, by its strands: members that slip into one another."""

    strands: Annotated[tuple[Reference, ...], Strict(False), Field(min_length=2)] = Field(
        description="Names of its strands in order, each from the node where the one before ends."
    )
    friction: OfRings = Field(description=f"{FRICTION[0].upper()}{FRICTION[1:]}.")
    wrap_deg: OfRings = Field(0.0, description=f"{WRAP[0].upper()}{WRAP[1:]}.")


class Node(Table):
    """One point: where it is, what it weighs, on which axes it is held."""

    position: Vector = Field(description="Position [m]: 3 numbers, or one for each modelled axis.")
    mass: Positive | None = Field(None, description="Point mass [kg]; bars and cables add their own.")
    anchored: Anchored = Field(
        False, description='Anchored: true (all axes), false, or the anchored axes, for example "xz".'
    )
    velocity: Vector | None = Field(None, description="Velocity at the start [m/s]; 0 on anchored axes.")


NodePatterns: TypeAlias = Annotated[
    Annotated[NodePattern, Tag("@name")]
    | Annotated[tuple[NodePattern, ...], Strict(False), Field(min_length=1), Tag("@names")],
    Discriminator(tag_by_type(str, "@name", "@names")),
]


class Load(Table):
    """A constant force on a node, or on each of several."""

    node: NodePatterns = Field(
        description='Node, "body.point", or pattern such as "t*"; or a list, each once.'
    )
    force: Vector = Field(description="Force [N], constant in direction.")


class RestLengthInput(Table):
    """An actuator: its value u [m] is added to the rest length of every listed member."""

    kind: Literal["rest_length"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    members: References = Field(description="Names of members, groups or classes.")
    gain: Gains | None = Field(
        None,
        description="Change of rest lengths for one unit of u, one number for each of `members`; default 1. "
        "Of a cable in segments that of the whole.",
    )


class TemperatureInput(Table):
    """A change of temperature u [K]: rest lengths become rho (1 + thermal_expansion u)."""

    kind: Literal["temperature"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    members: References = Field(
        description="Names of members, groups or classes, with a `thermal_expansion`."
    )


class ForceInput(Table):
    """A force of value u [N] along `direction` on every listed node."""

    kind: Literal["force"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    nodes: NodeReferences = Field(description='Names of nodes, and "body.point".')
    direction: Vector = Field(description="Direction of the force; normalised, so only its direction counts.")


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
    stiffness: Positive | None = Field(
        None,
        description="Stiffness k of bars that touch [N/m], [N/m^1.5] with exponent 1.5; without it contacts "
        "are detected and have no force.",
    )
    exponent: Exponent = Field(1.0, description="Exponent p of the overlap d in the force k d^p (1 + a d').")
    restitution: Restitution | None = Field(
        None, description="Restitution at one speed, { value, speed }, which gives a. Or `dissipation`."
    )
    dissipation: NotNegative | None = Field(None, description="Dissipation a of impacts [s/m]; default 0.")


Names: TypeAlias = Annotated[
    Annotated[Reference, Tag("@name")] | Annotated[References, Tag("@names")],
    Discriminator(tag_by_type(str, "@name", "@names")),
]
NodeNames: TypeAlias = Annotated[
    Annotated[NodeReference, Tag("@name")] | Annotated[NodeReferences, Tag("@names")],
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
    nodes: NodeNames | None = Field(None, description='Names of nodes, and "body.point"; "all".')
    points: PointNames | None = Field(None, description='Scenes of bodies: points, as "body.point".')
    noise: NotNegative = Field(
        0.0, description="Standard deviation of each measured number, in its unit [m, m/s]."
    )


class BodySensor(Table):
    """A gyro: the angular velocity of bodies, in the axes of their frames."""

    kind: Literal["angular_velocity"] = Field(description="What is measured.")
    name: Name | None = Field(None, description="Name of the sensor.")
    bodies: Names = Field(description='Names of rigid bodies; "all".')
    noise: NotNegative = Field(0.0, description="Standard deviation of each measured number [rad/s].")


class MemberLimits(Table):
    """Limits of members."""

    least_tension: NotNegative | None = Field(
        None, description="Least tension of cables [N], at most `most_tension` of the same member."
    )
    most_tension: Positive | None = Field(
        None, description="Largest tension [N]; for all members: of cables."
    )
    yield_stress: Positive | None = Field(
        None, description="Largest stress, in tension and compression [Pa]; needs radius."
    )
    buckling: SafetyFactor | None = Field(
        None,
        description="Bars do not buckle: the compression times the safety factor (true: 1) is at most "
        "Euler's load pi^2 E I / l^2 of pinned ends; false: Euler's load is not looked at. A number needs "
        "bars with a radius and a stiffness.",
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
