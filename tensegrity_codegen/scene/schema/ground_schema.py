"""The part of the scene file about the ground: a plane that nodes touch."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Discriminator, Field, Strict, StringConstraints, Tag

from tensegrity_codegen.scene.names import NAME_PATTERN
from tensegrity_codegen.scene.schema.schema_types import (
    NotNegative,
    Number,
    Positive,
    Table,
    Vector,
    tag_by_type,
)

# The name of a node, or in scenes of bodies "body.point".
ContactName: TypeAlias = Annotated[
    str, StringConstraints(pattern=rf"{NAME_PATTERN[:-1]}(\.{NAME_PATTERN[1:-1]})?$")
]
Contacts: TypeAlias = Annotated[
    Annotated[Literal["all"], Tag("@all")]
    | Annotated[tuple[ContactName, ...], Strict(False), Field(min_length=1), Tag("@names")],
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
        None, description="Normal out of the ground; normalised. Default: the last axis of the scene."
    )
    slope_deg: Annotated[float, Field(gt=-90, lt=90, allow_inf_nan=False)] | None = Field(
        None,
        description="Slope [deg], in place of normal: the ground descends along the first axis of the scene.",
    )
    offset: Number = Field(0.0, description="Normal times position, of the points of the plane [m].")
    velocity: Vector | None = Field(
        None, description="Velocity of the ground's surface along the plane, as of a belt [m/s]; default 0."
    )
    contacts: Contacts = Field(
        "all",
        description='Nodes that can touch the ground: "all" that can move along its normal, or a list of '
        'names; in scenes of bodies of "body.point".',
    )
    radius: ContactRadius = Field(
        0.0, description='Radius of the ball about each contact [m]; "bar": of the bar that ends there.'
    )
    stiffness: Positive | None = Field(
        None, description="Contact stiffness k [N/m]; [N/m^1.5] with exponent 1.5. Or `penetration`."
    )
    penetration: Positive | None = Field(
        None, description="Penetration at which the contacts carry equal parts of the weight [m]; gives k."
    )
    exponent: Exponent = Field(
        1.0, description="Exponent p of the penetration d in the normal force k d^p (1 + a d'): 1 or 1.5."
    )
    restitution: Restitution | None = Field(
        None, description="Restitution at one speed, { value, speed }, which gives a. Or `dissipation`."
    )
    dissipation: NotNegative | None = Field(
        None, description="Dissipation a of impacts in the normal force [s/m]; default 0."
    )
    friction: NotNegative = Field(0.0, description="Coefficient of friction mu.")
    static_friction: NotNegative | None = Field(
        None,
        description="Coefficient up to which a contact sticks, at least `friction`, which is the default.",
    )
    stick_stiffness: Positive | None = Field(
        None, description="Tangential stiffness of a sticking contact [N/m]; default: the normal stiffness."
    )
    stick_damping: Positive | None = Field(
        None, description="Tangential damping of a sticking contact [N s/m]; default: critical damping."
    )
