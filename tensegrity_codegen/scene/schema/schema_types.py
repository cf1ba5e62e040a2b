"""The words that scene models are made of: names, references, numbers, vectors, selections, member values."""

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    StringConstraints,
    Tag,
    model_validator,
)
from pydantic_core import PydanticCustomError

from tensegrity_codegen.scene.names import FILE_NAME_PROBLEM, FILE_NAMES, KEYWORDS, NAME_PATTERN, NAME_RULE

MAX_SEGMENTS = 10_000  # of one cable


def _refuse_keyword(name: str) -> str:
    if name in KEYWORDS:
        raise PydanticCustomError("name_keyword", "the name is a keyword of C or C++")
    return name


def _refuse_file_name(name: str) -> str:
    if name.lower() in FILE_NAMES:
        raise PydanticCustomError("name_of_file", FILE_NAME_PROBLEM)
    return name


def tag_by_type(word: type, yes: str, no: str) -> Callable[[Any], str]:
    """Return a discriminator: the tag `yes` for values of type `word`, else `no`."""
    return lambda value: yes if isinstance(value, word) else no


# A new name, and a reference to one that is defined elsewhere.
Name: TypeAlias = Annotated[
    str,
    StringConstraints(pattern=NAME_PATTERN),
    AfterValidator(_refuse_keyword),
    Field(description=NAME_RULE),
]
SceneName: TypeAlias = Annotated[Name, AfterValidator(_refuse_file_name)]
Reference: TypeAlias = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
PointReference: TypeAlias = Annotated[
    str,
    StringConstraints(pattern=f"{NAME_PATTERN[:-1]}[.]{NAME_PATTERN[1:]}"),
    Field(description="body.point"),
]
NodeReference: TypeAlias = Annotated[
    str, StringConstraints(pattern=rf"{NAME_PATTERN[:-1]}(\.{NAME_PATTERN[1:-1]})?$")
]
NodePattern: TypeAlias = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z*?\[][A-Za-z0-9_.*?!\[\]-]{0,126}$")
]
NodeReferences: TypeAlias = Annotated[tuple[NodeReference, ...], Strict(False), Field(min_length=1)]
References: TypeAlias = Annotated[tuple[Reference, ...], Strict(False), Field(min_length=1)]

Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Positive: TypeAlias = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vector: TypeAlias = Annotated[tuple[Number, ...], Strict(False), Field(min_length=1, max_length=3)]

Axes: TypeAlias = Literal["x", "y", "z", "xy", "xz", "yz", "xyz"]
Anchored: TypeAlias = Annotated[
    Annotated[bool, Tag("@flag")] | Annotated[Axes, Tag("@axes")],
    Discriminator(tag_by_type(str, "@axes", "@flag")),
]
Selection: TypeAlias = Annotated[
    Annotated[Literal["all"], Tag("@all")] | Annotated[References, Tag("@names")],
    Discriminator(tag_by_type(str, "@all", "@names")),
]
NodeSelection: TypeAlias = Annotated[
    Annotated[Literal["all"], Tag("@all")] | Annotated[NodeReferences, Tag("@names")],
    Discriminator(tag_by_type(str, "@all", "@names")),
]


class Table(BaseModel):
    """A table of the scene file: no other keys, no conversions, frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, defer_build=True)


class SectionTable(Table):
    """A round section by its sizes in metres: a tube or a rod."""

    tube: Annotated[tuple[Positive, ...], Strict(False), Field(min_length=2, max_length=2)] | None = Field(
        None, description="Outer diameter and thickness of the wall [m]."
    )
    rod: Positive | None = Field(None, description="Diameter [m].")

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        if (self.tube is None) == (self.rod is None):
            raise PydanticCustomError("section_kind", "either tube or rod")
        return self


Section: TypeAlias = Annotated[
    Annotated[str, Tag("@name")] | Annotated[SectionTable, Tag("@table")],
    Discriminator(tag_by_type(str, "@name", "@table")),
]


# One number for all rings of a cable, or one for each.
OfRings: TypeAlias = Annotated[
    Annotated[NotNegative, Tag("@number")]
    | Annotated[Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=1)], Tag("@list")],
    Discriminator(lambda value: "@list" if isinstance(value, (list, tuple)) else "@number"),
]
FRICTION = "coefficient of friction at each ring, one number or one for each"
WRAP = "angle that the cable turns at each ring [deg], as around a drum; 0 or left out: as the nodes say"


class MemberValues(Table):
    """What a member class sets and a member may override."""

    spring_constant: Positive | None = Field(None, description="Spring constant mu = dt/dl [N/m].")
    axial_stiffness: Positive | None = Field(
        None, description="Axial stiffness EA [N]; the spring constant is EA / rest_length."
    )
    youngs_modulus: Positive | None = Field(
        None, description="Young's modulus E [Pa]; needs a section or radius; axial_stiffness = E A."
    )
    switch_elongation: Number | None = Field(
        None,
        description="Elongation at which the slope of a bilinear member switches [m], not 0; of cables > 0.",
    )
    switch_force: Number | None = Field(
        None, description="Tension at which the slope of a bilinear member switches [N], not 0."
    )
    stiffness_ratio: NotNegative | None = Field(
        None, description="Slope of a bilinear member beyond the switch over that before it."
    )
    yield_elongation: Positive | None = Field(
        None,
        description="Elongation at which plastic flow of a member begins [m]; in compression at minus this.",
    )
    yield_force: Positive | None = Field(
        None, description="Tension at which plastic flow of a member begins [N], in place of the elongation."
    )
    hardening: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        None, description="Slope of a plastic member in flow over that before it, below 1; default 0."
    )
    isotropic: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = Field(
        None,
        description="Share of the hardening of a plastic member that widens its elastic range in place of "
        "moving it; default 0.",
    )
    relaxation_time: Positive | None = Field(
        None, description="Time constant of a viscous member's tension at a constant length [s]."
    )
    relaxed_fraction: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] | None = Field(
        None, description="Stiffness of a viscous member after infinite time over that at once, 0 to 1."
    )
    rest_length: Positive | None = Field(
        None, description="Length without tension [m]; default the length at the stated positions."
    )
    prestress: Number | None = Field(
        None, description="Tension at the stated node positions [N], positive in tension."
    )
    strain: Annotated[float, Field(gt=-1, allow_inf_nan=False)] | None = Field(
        None,
        description="(length - rest_length) / rest_length at the stated node positions, above -1.",
    )
    damping: NotNegative | None = Field(
        None,
        description="Damping constant c [N s/m]: adds c times the rate of length to the tension; default 0.",
    )
    thermal_expansion: Number | None = Field(
        None,
        description="Coefficient of thermal expansion alpha [1/K], for inputs of temperature; negative where "
        "it contracts.",
    )
    mass: Positive | None = Field(
        None, description="Own mass [kg]: of a bar spread evenly, of a cable half at each end; default 0."
    )
    mass_per_length: Positive | None = Field(
        None, description="Cables only: mass for each metre of rest length [kg/m]."
    )
    segments: Annotated[int, Field(ge=1, le=MAX_SEGMENTS)] | None = Field(
        None, description="Cables with mass only: number of equal pieces of a chain that sags; default 1."
    )
    friction: OfRings | None = Field(None, description=f"Cables through rings only: {FRICTION}; default 0.")
    wrap_deg: OfRings | None = Field(None, description=f"Cables with friction only: {WRAP}.")
    density: Positive | None = Field(
        None, description="Bars only: density [kg/m3]; needs radius; mass = density * section * length."
    )
    section: Section | None = Field(
        None,
        description='Round section in place of radius and inner_radius: "CHS 60.3x3.2" of the catalogue '
        "(EN 10210-2, mm), { tube = [outer diameter, wall] } or { rod = diameter } [m].",
    )
    radius: Positive | None = Field(None, description="Outer radius of the round section [m].")
    inner_radius: NotNegative | None = Field(
        None, description="Bars only: inner radius of a tube [m], less than radius; default 0."
    )
    tension_only: bool | None = Field(
        None, description="Cables only: no force when slack (default true); false makes a two-sided spring."
    )
