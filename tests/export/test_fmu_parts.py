"""Names, units and dependencies in model descriptions."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegrity_codegen.export.fmu.description import find_exponents, join_names, quote_name
from tensegrity_codegen.system.errors import InvalidNameError
from tensegrity_codegen.tables.quantities import ARGUMENTS, QUANTITIES

QCHARS = "!#$%&()*+,-./:;<>=?@[]^{}|~ "


def read_quoted(text: str) -> str:
    """Read a q-name of the standard back; fails for what is none."""
    assert len(text) > 2
    assert text[0] == text[-1] == "'"
    found, k, inner = "", 0, text[1:-1]
    while k < len(inner):
        if inner[k] == "\\":
            assert inner[k + 1] in "'\"?\\abfnrtv"
            found += inner[k + 1]
            k += 2
        else:
            assert inner[k].isascii()
            assert inner[k].isalnum() or inner[k] in QCHARS + "_"
            found += inner[k]
            k += 1
    return found


@given(st.text(min_size=1, max_size=20))
def test_every_name_is_quoted_or_refused(name: str) -> None:
    try:
        quoted = quote_name(name)
    except InvalidNameError:
        assert not all(" " <= letter <= "~" and letter != "`" for letter in name)
        return
    if quoted == name:
        assert name.isidentifier()
    else:
        assert read_quoted(quoted) == name


def test_a_name_without_letters_is_refused() -> None:
    with pytest.raises(InvalidNameError):
        quote_name("")


def test_parts_are_joined_by_dots_and_numbers_are_indices_from_one() -> None:
    assert join_names("member_law", ("bar1", 2)) == "member_law.bar1[3]"
    assert join_names("total_energy", ()) == "total_energy"
    assert join_names("node_load", ("t 1", "x")) == "node_load.'t 1'.x"


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("m", {"m": 1}),
        ("N/m", {"kg": 1, "s": -2}),
        ("N s/m", {"kg": 1, "s": -1}),
        ("rad/s2", {"rad": 1, "s": -2}),
        ("K", {"K": 1}),
        ("N m", {"kg": 1, "m": 2, "s": -2}),
        ("Pa", {"kg": 1, "m": -1, "s": -2}),
        ("1", {}),
        ("m or N", None),
        ("m, rad", None),
        ("", None),
    ],
)
def test_units_have_the_exponents_of_their_base_units(unit: str, exponents: dict[str, int] | None) -> None:
    assert find_exponents(unit) == exponents


def test_the_unit_of_every_dense_quantity_is_known_or_several() -> None:
    rows = [row for row in (*QUANTITIES.values(), *ARGUMENTS.values()) if not row.sparse]
    unknown = [row.unit for row in rows if find_exponents(row.unit) is None]
    assert all("," in unit or " or " in unit or " per " in unit or unit == "mixed" for unit in unknown)


def test_dependencies_are_those_of_the_structure(tmp_path: Path) -> None:
    from tensegrity_codegen.codegen.emit import emit
    from tensegrity_codegen.export.fmu.description import list_variables
    from tensegrity_codegen.export.fmu.layout import Layout, find_tangent
    from tensegrity_codegen.pipeline.compile_scene import load_scene
    from tests.export.scenes import write_loose

    structure, request = load_scene(write_loose(tmp_path))
    own = request.wanting("acceleration", "member_length", "member_tension", integrators=("rk853",))
    outputs = ("node_position", "member_length", "member_tension")
    layout = Layout(emit(structure, own).manifest, structure, outputs)
    tangent = find_tangent(layout, own)
    assert tangent is not None
    variables = list_variables(layout, tangent)
    named = {item.name: item for item in variables}
    needs = {name: {variables[k].name for k in item.dependencies or ()} for name, item in named.items()}
    ends = layout.manifest.connectivity[layout.manifest.member_name.index("vertical1")]
    nodes = {layout.manifest.node_name[node] for node in ends}
    free = {f"coordinate.{name}" for name in layout.manifest.coordinate_name if name[:2] in nodes}
    assert needs["member_length.vertical1"] == free
    assert "input.winch" in needs["member_tension.vertical1"]
    assert "input.winch" not in needs["member_tension.vertical2"]
    assert needs["node_position.t1.z"] == {"coordinate.t1_z"}
    assert needs["node_position.b1.z"] == set()
    assert needs["der(coordinate.t1_x)"] == {"velocity.t1_x"}
    assert np.count_nonzero(tangent.pattern) < tangent.pattern.size
