"""Actuators, sensors and limits made to break the reader: errors that name the key, or sound structures."""

import copy
import math
import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.scene.checks.check import check_structure
from tensegrity_codegen.scene.checks.scene_warnings import find_scene_warnings
from tensegrity_codegen.scene.describe import describe_bodies, describe_structure
from tensegrity_codegen.scene.read import parse_scene
from tensegrity_codegen.scene.subject import assemble_scene
from tensegrity_codegen.scene.toml_text import format_scene
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import TensegrityError
from tests.body_scenes import EVERYTHING
from tests.cases import draws
from tests.scene.samples import changed

NODES = changed("classes", "strut", to={"kind": "bar", "axial_stiffness": 2e5, "mass": 0.1, "radius": 0.01})
RIGID = changed("classes", "strut", to={"kind": "bar", "mass": 0.1, "radius": 0.01})

KNOWN = ("ab", "bc", "ac", "string", "strut", "strings", "t1", "rope", "a", "c", "u1", "m", "leg.A")
NAMES = st.sampled_from(
    [*KNOWN, "all", "int", "", "a b", "x" * 70, "ä", "\x00", "__", "members", "leg.", "."]
)
NUMBERS = st.sampled_from(
    [0, -0.0, 1, 0.5, -1, 1e-320, 1e308, -1e308, 10**400, 2**63, math.nan, math.inf, -math.inf, True]
) | st.floats(0.0, 100.0)
VALUES: st.SearchStrategy[Any] = st.recursive(
    NAMES | NUMBERS | st.none() | st.booleans(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=2),
    max_leaves=4,
)
LISTS = st.lists(NAMES, max_size=3) | NAMES


def tables(usual: dict[str, st.SearchStrategy[Any]]) -> st.SearchStrategy[dict[str, Any]]:
    """Return tables with some of the usual keys, and sometimes with a wrong value or key."""
    sound = st.fixed_dictionaries({}, optional=usual)
    wrong = st.dictionaries(st.sampled_from(list(usual)) | NAMES, VALUES, max_size=1)
    return st.one_of(sound, st.builds(lambda one, other: {**one, **other}, sound, wrong))


ACTUATORS = tables(
    {"name": st.sampled_from(["m1", "m2", "u1"]), "members": LISTS, "rate": NUMBERS, "delay": NUMBERS,
     "range": st.lists(NUMBERS, max_size=3)},
)  # fmt: skip
SENSORS = tables(
    {"kind": st.sampled_from(["member_length", "member_tension", "node_position", "node_velocity"]),
     "name": NAMES, "members": LISTS, "nodes": LISTS, "points": LISTS, "noise": NUMBERS},
)  # fmt: skip
OF_MEMBERS = {
    "least_tension": NUMBERS, "most_tension": NUMBERS, "yield_stress": NUMBERS,
    "buckling": NUMBERS | st.booleans(),
}  # fmt: skip
LIMITS = tables(
    {
        **OF_MEMBERS,
        "clearance": NUMBERS,
        "least_stiffness": NUMBERS,
        "classes": st.dictionaries(NAMES, tables(OF_MEMBERS), max_size=2),
        "members": st.dictionaries(NAMES, tables(OF_MEMBERS), max_size=2),
    }
)


VECTORS = st.lists(NUMBERS, min_size=1, max_size=4)
GROUNDS = tables(
    {
        **dict.fromkeys(("normal", "velocity"), VECTORS),
        **dict.fromkeys(("slope_deg", "offset", "stiffness", "penetration", "exponent"), NUMBERS),
        **dict.fromkeys(("dissipation", "friction", "static_friction"), NUMBERS),
        **dict.fromkeys(("stick_stiffness", "stick_damping"), NUMBERS),
        "contacts": LISTS,
        "radius": NUMBERS | st.just("bar"),
        "restitution": st.fixed_dictionaries({"value": NUMBERS | st.floats(0, 1), "speed": NUMBERS}),
    }
)


def read(document: dict[str, Any]) -> Any:
    return assemble_scene(parse_scene(document, "s.toml"), "s.toml")


def check_error(error: TensegrityError, section: str) -> None:
    assert error.exit_code == 2
    assert error.where.startswith(f"s.toml: {section}"), error.where
    assert error.problem


@draws(50)
@given(st.sampled_from([NODES, RIGID, EVERYTHING]), GROUNDS | VALUES)
def test_hostile_grounds(base: dict[str, Any], ground: Any) -> None:
    try:
        subject, request = read({**copy.deepcopy(base), "ground": ground})
    except TensegrityError as error:
        check_error(error, "ground")
        return
    find_scene_warnings(subject)
    written = describe_structure(subject, request) if isinstance(subject, Structure) else None
    again, _ = read(tomllib.loads(format_scene(written or describe_bodies(subject, request))))
    assert again.ground == subject.ground


@draws(20)
@given(
    st.sampled_from([NODES, RIGID, EVERYTHING]),
    st.lists(ACTUATORS, max_size=2) | VALUES,
    st.lists(SENSORS, max_size=2) | VALUES,
    LIMITS | VALUES,
)
def test_hostile_control(base: dict[str, Any], actuators: Any, sensors: Any, limits: Any) -> None:
    for sections in ({"actuators": actuators}, {"sensors": sensors}, {"limits": limits}):
        document = {**copy.deepcopy(base), **sections}
        try:
            subject, request = read(document)
        except TensegrityError as error:
            check_error(error, *sections)
            continue
        find_scene_warnings(subject)
        if isinstance(subject, Structure):
            check_structure(subject)
            written = describe_structure(subject, request)
        else:
            written = describe_bodies(subject, request)
        again, _ = read(tomllib.loads(format_scene(written)))
        assert (again.actuators, again.sensors) == (subject.actuators, subject.sensors)
        assert again.limits == subject.limits
