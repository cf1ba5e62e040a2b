import io
from dataclasses import replace

import numpy as np
from rich.console import Console

from tensegrity_codegen.report.long_table import LongTable
from tensegrity_codegen.report.tables import (
    functions_table,
    left_out_table,
    members_table,
    nodes_table,
    run_table,
)
from tensegrity_codegen.structure.limits import Limits
from tensegrity_codegen.structure.member_limits import check_members
from tensegrity_codegen.tables.manifest import FunctionSpec, IntegratorSpec, LeftOut, Manifest
from tests.report.samples import frame, make_trajectory
from tests.runtime.build import prism

MANIFEST = Manifest(
    abi_version=2, name="toy", scene_hash="", formulation="node_position", emitter="unrolled",
    precision="double", flags="reference", made_by={},
    axes=(0, 1, 2), node_name=(), member_name=(), connectivity=(), coordinate_node_axis=(),
    coordinate_name=(), node_position=(), node_velocity=(), input_name=(), arguments=(),
    functions=(
        FunctionSpec("acceleration", "toy_a", ("coordinate", "gravity"), (18,), "m/s2", "", 12345),
        FunctionSpec("total_energy", "toy_e", (), (), "J", "", 7),
    ),
    integrators=(IntegratorSpec("rk4", "toy_i", ("gravity",), 90),),
    left_out=(
        LeftOut("damping", "no member [has] damping", 0, 2, 1500, 33000, measured=True),
        LeftOut("loads", "no node has a load", 1, 1, 6, 120, measured=True),
    ),
)  # fmt: skip


def rows(table):
    """Return the header and the rows as plain texts."""
    table = table.__rich__() if isinstance(table, LongTable) else table
    header = [str(column.header) for column in table.columns]
    body = list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True))
    return header, body


def render(table):
    console = Console(file=io.StringIO(), width=200, color_system=None)
    console.print(table)
    return console.file.getvalue()


def test_functions_are_listed_with_arguments_shape_unit_and_operations():
    header, body = rows(functions_table(MANIFEST))
    assert header == ["quantity", "arguments", "shape", "unit", "operations"]
    assert body[0] == ("acceleration", "coordinate, gravity", "18", "m/s2", "12,345")
    assert body[1] == ("total_energy", "none", "1", "J", "7")
    assert body[2][:2] == ("integrate_rk4", "state, gravity")


def test_left_out_has_bytes_where_they_are_measured_and_keeps_brackets():
    _, body = rows(left_out_table(MANIFEST))
    assert body[0] == ("damping\nno member [has] damping", "0", "2", "1,500", "33,000")
    assert body[1][-1] == "120"
    assert "no member [has] damping" in render(left_out_table(MANIFEST))
    counted = replace(MANIFEST, left_out=(LeftOut("loads", "no node has a load", 1, 1, 6),))
    header, body = rows(left_out_table(counted))
    assert header == ["what, and why", "functions", "arguments", "operations"]
    assert body == [("loads\nno node has a load", "1", "1", "6")]


def test_nodes_show_the_modelled_axes_how_far_they_moved_and_what_is_held():
    structure = frame()
    moved = structure.node_position.copy()
    moved[2] += [0.03, 0, 0.04]
    header, body = rows(nodes_table(structure, moved))
    assert header == ["node", "x [m]", "z [m]", "moved [m]", "held"]
    assert body[0] == ("n0", "0.000000", "0.000000", "0", "xz")
    assert body[1][-1] == "z"
    assert body[2] == ("n2", "2.030000", "1.040000", "0.05", "")


def test_members_show_strain_tension_and_state():
    structure = frame()
    tension = np.array([-3.0, 2.0, 10.0, 0.0, 1.0, 1e-3])
    header, body = rows(members_table(structure, structure.member_length(), tension))
    assert header[:3] == ["member", "class", "nodes"]
    assert body[0][2] == "n0–n2"
    assert body[0][-2:] == ("-3", "compressed")
    assert body[1][-1] == "taut"
    assert body[2][3:] == ("1.90000", "2.00000", "+5.26", "+10", "taut")
    assert body[3][-1] == "slack"


def test_unloaded_two_sided_members_are_not_slack():
    structure = prism()
    _, body = rows(members_table(structure, structure.rest_length, np.zeros(12)))
    assert [row[-1] for row in body].count("slack") == 9
    assert [row[-1] for row in body].count("unloaded") == 3


def test_run_has_units_and_leaves_out_what_is_not_known():
    summary = make_trajectory(prism()).summary() | {"library": "lib[1].so", "n_steps": 12000, "out": None}
    facts = dict(rows(run_table(summary))[1])
    assert facts["simulated time"] == "1 s"
    assert facts["steps"] == "12,000"
    assert facts["total energy at the end"] == "2 J"
    assert facts["status"] == "ok"
    assert facts["library"] == "lib[1].so"
    assert "result file" not in facts
    assert "message" not in facts
    assert "lib[1].so" in render(run_table(summary))


def test_names_are_whole_on_a_narrow_terminal():
    structure = frame().with_changes(member_name=tuple(f"vertical{e}_12" for e in range(6)))
    console = Console(file=io.StringIO(), width=80, color_system=None)
    console.print(members_table(structure, structure.member_length(), np.full(6, -12345.678)))
    text = console.file.getvalue()
    assert all(name in text for name in structure.member_name)
    assert "…" not in text


def test_many_members_of_few_classes_are_shown_class_by_class():
    structure = frame().with_changes(member_class=("a", "b", "b", "c", "b", "c"))
    tension = np.array([-3.0, 2.0, 10.0, 4.0, 1.0, 4.0])
    short = members_table(structure, structure.member_length(), tension).short
    header, body = rows(short)
    assert header == ["class", "members", "length\n[m]", "tension\n[N]", "largest\nuse", "where"]
    assert body == [
        ("a", "1", "2.2361", "-3", "", "e0"),
        ("b", "3", "2 to 2.2361", "1 to 10", "", "e2"),
        ("c", "2", "1", "4", "", "e3"),
    ]
    assert short.pick(2) == [1, 2]
    limits = replace(Limits().for_members(6), most_tension=np.array([np.inf, 4.0, 40, 5, 40, 4.5]))
    limited = structure.with_changes(limits=limits)
    checks = check_members(limited, tension, limited.member_length())
    table = members_table(limited, limited.member_length(), tension, checks)
    assert [row[-2:] for row in rows(table.short)[1]] == [("", "e0"), ("0.5", "e1"), ("0.8889", "e5")]
    header, body = rows(table)
    assert header[-2:] == ["use", "state"]
    assert [row[-2] for row in body] == ["", "0.5", "0.25", "0.8", "0.025", "0.8889"]
    free = check_members(structure, tension, structure.member_length())
    assert "use" not in rows(members_table(structure, structure.member_length(), tension, free))[0]
    for classes in (("", "", "", "", "", ""), ("a", "a", "a", "a", "a", "a"), tuple("abcdef")):
        other = structure.with_changes(member_class=classes)
        assert members_table(other, other.member_length(), tension).short is None
    two = structure.with_changes(member_class=("a", "a", "b", "b", "a", "b"))
    assert members_table(two, two.member_length(), tension).short.count == 2


def test_slack_cables_do_not_hide_the_strength_of_the_others():
    """Cables without tension use infinitely much of a least tension; greatest strengths come beside it."""
    structure = frame().with_changes(member_class=("a", "b", "b", "c", "b", "c"))
    limits = replace(Limits().for_members(6), most_tension=np.full(6, 10.0), least_tension=np.full(6, 1.0))
    structure = structure.with_changes(limits=limits)
    tension = np.array([4.0, 0.0, 0.0, 0.5, 9.0, 2.0])
    checks = check_members(structure, tension, structure.member_length())
    table = members_table(structure, structure.member_length(), tension, checks)
    reasons = [reason for reason, _ in table.ranking]
    assert reasons[:2] == ["nearest to their limits or beyond", "nearest to their least tension or below"]
    assert table.pick(4) == [4, 0, 1, 2]
    assert table.caption == "3 members below the least tension, 2 of them without tension"
    assert table.short.caption == table.caption
    assert [row[-2:] for row in rows(table.short)[1]] == [("0.4", "e0"), ("0.9", "e4"), ("0.5", "e5")]
