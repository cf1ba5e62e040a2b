"""The part of the scene file about rigid bodies: bodies, tendons, joint friction, their loads and inputs.

Angles are written in degrees, with keys that end in `_deg`; a point is named "body.point".
"""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Strict, Tag

from tensegrity_codegen.scene.schema.schema_types import (
    MemberValues,
    Name,
    NotNegative,
    Number,
    PointReference,
    Positive,
    Reference,
    Table,
    Vector,
)

Vector3: TypeAlias = Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=3)]
Points: TypeAlias = dict[Name, Vector3]
Quaternion: TypeAlias = Annotated[tuple[Number, ...], Strict(False), Field(min_length=4, max_length=4)]
PointReferences: TypeAlias = Annotated[tuple[PointReference, ...], Strict(False), Field(min_length=1)]
Row: TypeAlias = Annotated[
    Annotated[Number, Tag("@number")] | Annotated[Vector3, Tag("@row")],
    Discriminator(lambda value: "@row" if isinstance(value, list | tuple) else "@number"),
]
Frame: TypeAlias = Literal["inertial", "body"]


class FixedPart(Table):
    """A body at rest, such as the ground: named points."""

    kind: Literal["fixed"] = Field(description="Kind of body.")
    points: Annotated[Points, Field(min_length=1)] = Field(
        description="Positions of its points [m], by name."
    )


class BarBody(Table):
    """A thin bar from A to B; its points are A and B, its centre of mass is in the middle."""

    kind: Literal["bar"] = Field(description="Kind of body.")
    length: Positive = Field(description="Length [m].")
    mass: Positive | None = Field(None, description="Mass [kg]; or density with radius.")
    density: Positive | None = Field(None, description="Density [kg/m3]; needs radius.")
    radius: Positive | None = Field(None, description="Outer radius [m].")
    inner_radius: NotNegative | None = Field(None, description="Inner radius of a tube [m].")
    inertia: NotNegative | None = Field(
        None,
        description="Transversal inertia about the middle [kg m2]; default that of a hollow cylinder, "
        "mass (length^2 + 3 (radius^2 + inner_radius^2)) / 12.",
    )
    anchor: PointReference | None = Field(
        None, description="Point of another body at which one end is held by a ball joint; none: a free bar."
    )
    end: Literal["A", "B"] = Field("A", description="The held end.")
    centre: Vector3 | None = Field(None, description="Position of the middle of a free bar [m].")
    centre_velocity: Vector3 | None = Field(None, description="Velocity of the middle of a free bar [m/s].")
    direction: Vector3 | None = Field(
        None, description="Direction from A to B, in place of the two angles; only its direction counts."
    )
    azimuth_deg: Number | None = Field(None, description="Azimuth about the polar axis [deg].")
    azimuth_offset_deg: Number = Field(
        0.0, description="Where the azimuth is counted from [deg], about the polar axis."
    )
    declination_deg: Number | None = Field(None, description="Angle from the polar axis [deg].")
    elevation_deg: Number | None = Field(
        None, description="Angle from the plane across the polar axis [deg], in place of the declination."
    )
    azimuth_rate_deg: Number = Field(0.0, description="Rate of the azimuth at the start [deg/s].")
    polar_rate_deg: Number = Field(
        0.0, description="Rate of the declination or elevation at the start [deg/s]."
    )
    polar_axis: Literal["x", "y", "z", "auto"] = Field(
        "auto",
        description='Axis of the angles; "auto": z with angles, with a direction the axis farthest from it.',
    )
    spin: Literal["azimuth", "none"] = Field(
        "azimuth",
        description="Angular velocity for friction and torques: azimuth' e3 + declination' n, or u x u'.",
    )


class PartTable(Table):
    """A shape of a rigid body: for its mass, inertia and pictures, in the frame of the body."""

    kind: Literal["ball", "cylinder", "tube", "capsule", "box"] = Field(description="Kind of shape.")
    mass: NotNegative | None = Field(None, description="Mass [kg]; or density.")
    density: NotNegative | None = Field(None, description="Density [kg/m3].")
    radius: Positive | None = Field(None, description="Outer radius, but of boxes [m].")
    inner_radius: Positive | None = Field(None, description="Inner radius of a tube [m].")
    from_: Vector3 | None = Field(
        None, alias="from", description="First end of the axis of a cylinder, tube or capsule [m]."
    )
    to: Vector3 | None = Field(None, description="Second end of the axis [m].")
    size: Annotated[tuple[Positive, ...], Strict(False), Field(min_length=3, max_length=3)] | None = Field(
        None, description="Sides of a box [m]."
    )
    position: Vector3 | None = Field(None, description="Middle of a ball or box [m]; default the origin.")
    quaternion: Quaternion | None = Field(
        None, description="Turns a box into the frame: w, x, y, z; default none."
    )


class PointTable(Table):
    """A point of a rigid body; with a radius it is the centre of a ball that touches the ground."""

    position: Vector3 = Field(description="Place in the frame [m].")
    radius: NotNegative | None = Field(None, description="Radius of the ball that touches the ground [m].")


Point = Annotated[
    Annotated[Vector3, Tag("@place")] | Annotated[PointTable, Tag("@table")],
    Discriminator(lambda value: "@place" if isinstance(value, list | tuple) else "@table"),
]


class RigidPart(Table):
    """A rigid body.

    Beside nodes and members: by mass and inertia, or by parts. Beside tendons: the origin of its frame is the
    centre of mass, which is its point `centre`, and its orientation is given by Euler angles.
    """

    kind: Literal["rigid"] = Field(description="Kind of body.")
    mass: Number | None = Field(None, description="Mass [kg]; default that of the parts.")
    inertia: Annotated[tuple[Row, ...], Strict(False), Field(min_length=3, max_length=3)] | None = Field(
        None,
        description="Inertia about the centre of mass, body axes [kg m2]: 3 principal values, or 3 rows of "
        "3; default that of the parts.",
    )
    centre_of_mass: Vector3 | None = Field(
        None, description="Place of the centre of mass in the frame, with `inertia` [m]; default the origin."
    )
    parts: Annotated[tuple[PartTable, ...], Strict(False)] = Field(
        (), description="Shapes: their masses give mass and inertia, and pictures show them."
    )
    points: dict[Name, Point] = Field(
        default_factory=dict, description="Places of its points in its frame [m], by name."
    )
    position: Vector3 | None = Field(None, description="Position of the origin of the frame [m].")
    centre: Vector3 | None = Field(None, description="Position of the centre of mass [m].")
    quaternion: Quaternion | None = Field(
        None, description="Turns the frame into the world: w, x, y, z; normalised."
    )
    axis: Vector3 | None = Field(None, description="Axis of the turn by `angle_deg`; normalised.")
    angle_deg: Number | None = Field(None, description="Angle of the turn about `axis` [deg].")
    from_: Vector3 | None = Field(
        None,
        alias="from",
        description="With `to`, in place of a position: the origin is half way, the z axis points from "
        "`from` to `to`, x and y by the shortest turn of z [m].",
    )
    to: Vector3 | None = Field(None, description="See `from` [m].")
    matrix: Annotated[tuple[Vector3, ...], Strict(False), Field(min_length=3, max_length=3)] | None = Field(
        None, description="Rotation matrix: 3 rows, whose columns are the axes of the frame in the world."
    )
    angular_velocity: Vector3 | None = Field(
        None, description="Angular velocity at the start, in the frame [rad/s]."
    )
    psi_deg: Number = Field(0.0, description="First of the 3-1-2 Euler angles, about z [deg].")
    phi_deg: Number = Field(0.0, description="Second Euler angle, about the turned x [deg].")
    theta_deg: Number = Field(0.0, description="Third Euler angle, about the body's own y [deg].")
    centre_velocity: Vector3 | None = Field(None, description="Velocity of the centre [m/s].")
    psi_rate_deg: Number = Field(0.0, description="Rate of psi at the start [deg/s].")
    phi_rate_deg: Number = Field(0.0, description="Rate of phi at the start [deg/s].")
    theta_rate_deg: Number = Field(0.0, description="Rate of theta at the start [deg/s].")


BodyTable: TypeAlias = Annotated[FixedPart | BarBody | RigidPart, Discriminator("kind")]


class Tendon(MemberValues):
    """A cable between two points of bodies: a class with overrides, or all values in place."""

    class_name: Reference | None = Field(None, alias="class", description="Name of a class of kind cable.")
    points: Annotated[tuple[PointReference, ...], Strict(False), Field(min_length=2, max_length=2)] = Field(
        description='The two points that the tendon joins, as "body.point".'
    )


class JointFrictionTable(Table):
    """Friction torque d (w_a - w_b) on the first body, the opposite on the second."""

    bodies: Annotated[tuple[Reference, ...], Strict(False), Field(min_length=2, max_length=2)] = Field(
        description="The two bodies of the joint."
    )
    coefficient: Annotated[float, Field(le=0, allow_inf_nan=False)] = Field(
        description="Coefficient of friction d [N m s], not positive."
    )


class PointLoad(Table):
    """A constant force on a point of a body."""

    point: PointReference = Field(description='The point, as "body.point".')
    force: Vector3 = Field(description="Force [N].")
    frame: Frame = Field(
        "inertial", description="Axes of the force; those of a rigid body turn it with the body."
    )


class BodyTorque(Table):
    """A constant torque on a body."""

    body: Reference = Field(description="Name of the body.")
    torque: Vector3 = Field(description="Torque [N m].")
    frame: Frame = Field("inertial", description="Axes of the torque.")


class PointForceInput(Table):
    """A force of value u [N] along `direction` on every listed point."""

    kind: Literal["point_force"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    points: PointReferences = Field(description='Points, as "body.point".')
    direction: Vector = Field(description="Direction of the force; normalised.")
    frame: Frame = Field("inertial", description="Axes of the direction.")


class TorqueInput(Table):
    """A torque of value u [N m] about `direction` on every listed body."""

    kind: Literal["torque"] = Field(description="Kind of input.")
    name: Name = Field(description="Name of the input.")
    bodies: Annotated[tuple[Reference, ...], Strict(False), Field(min_length=1)] = Field(
        description="Names of bodies."
    )
    direction: Vector = Field(description="Axis of the torque; normalised.")
    frame: Frame = Field("inertial", description="Axes of the direction.")


# Tag of a load -> model that it stands for.
LOAD_TAGS = {"@node": "Load", "@point": "PointLoad", "@body": "BodyTorque"}


def load_tag(value: Any) -> str:
    """Return which kind of load a table means: on a point, on a body, or on a node."""
    keys = value if isinstance(value, dict) else getattr(value, "__dict__", {})
    return "@point" if "point" in keys else "@body" if "body" in keys else "@node"
