"""CSV tables through import and simulate, against SciPy over an independent NumPy model."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.structure.structure import Structure
from tests.cli.conftest import Run
from tests.reference import ReferenceModel

NODE_COLUMNS = ["node", "x", "y", "z", "vx", "vy", "vz", "mass", "anchored"]
MEMBER_COLUMNS = ["member", "kind", "node_i", "node_j", "rest_length", "spring_constant", "axial_stiffness",
                  "damping", "mass"]  # fmt: skip
# A tripod on sliding feet: own masses of bars, both stiffness laws, damping, velocities, anchored axes.
NODES: list[list[Any]] = [
    ["foot1", 1.0, 0.0, 0.0, "", "", "", 0.3, "z"],
    ["foot2", -0.5, 0.8, 0.0, "", "", "", 0.2, "xz"],
    ["foot3", -0.5, -0.8, 0.0, "", "", "", "", "1"],
    ["head", 0.0, 0.1, 1.2, 0.3, -0.2, 0.1, 0.5, ""],
    ["bob", 0.1, 0.0, 0.6, 0.0, 0.4, 0.0, 0.25, "false"],
]
MEMBERS: list[list[Any]] = [
    ["leg1", "bar", "foot1", "head", "", 2000, "", 0.4, 0.6],
    ["leg2", "bar", "foot2", "head", 1.45, "", 3000, "", 0.3],
    ["leg3", "bar", "foot3", "head", "", 2500, "", "", ""],
    ["hem1", "cable", "foot1", "foot2", 1.6, 300, "", "", ""],
    ["hem2", "cable", "foot2", "foot3", 1.5, "", 500, 0.2, ""],
    ["hem3", "cable", "foot3", "foot1", 1.5, 300, "", "", ""],
    ["cord", "cable", "head", "bob", 0.55, 150, "", 0.1, ""],
]
GRAVITY = [0.5, -1.0, -9.0]


def write_tables(folder: Path, nodes: list[list[Any]], members: list[list[Any]]) -> list[str]:
    for name, columns, rows in (("nodes", NODE_COLUMNS, nodes), ("members", MEMBER_COLUMNS, members)):
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([columns, *rows])
    return ["nodes.csv", "members.csv"]


def number(cell: Any, empty: float = 0.0) -> float:
    return empty if cell == "" else float(cell)


def structure_of_tables(members: list[list[Any]] = MEMBERS) -> Structure:
    """Build the structure from the rows above, without any of the package's readers."""
    names = [row[0] for row in NODES]
    position = np.array([row[1:4] for row in NODES], dtype=float)
    ends = np.array([[names.index(row[2]), names.index(row[3])] for row in members])
    length = np.linalg.norm(position[ends[:, 0]] - position[ends[:, 1]], axis=1)
    held = {"1": "xyz", "false": "", "": ""}
    letters = [held.get(row[8], row[8]) for row in NODES]
    is_bar = np.array([row[1] == "bar" for row in members])
    return Structure(
        name="tables",
        axes=(0, 1, 2),
        node_name=tuple(names),
        node_position=position,
        node_velocity=np.array([[number(cell) for cell in row[4:7]] for row in NODES]),
        node_mass=np.array([number(row[7]) for row in NODES]),
        node_anchored=np.array([[axis in word for axis in "xyz"] for word in letters]),
        node_load=np.zeros((len(NODES), 3)),
        gravity=np.array(GRAVITY),
        member_name=tuple(row[0] for row in MEMBERS),
        member_class=("",) * len(members),
        connectivity=ends,
        is_bar=is_bar,
        tension_only=~is_bar,
        rest_length=np.array([number(row[4], own) for row, own in zip(members, length, strict=True)]),
        spring_constant=np.array([number(row[5]) for row in members]),
        axial_stiffness=np.array([number(row[6]) for row in members]),
        damping=np.array([number(row[7]) for row in members]),
        member_mass=np.array([number(row[8]) for row in members]),
        radius=np.zeros(len(members)),
    )


# The pull of a damped cable jumps when it goes slack, which no fixed step meets: accuracy has a price there.
@pytest.mark.thorough
@pytest.mark.parametrize(
    ("damped", "rtol", "error"), [(True, 1e-6, 1e-5), (False, 1e-8, 1e-6)], ids=["damped cables", "tight"]
)
def test_an_imported_structure_moves_as_an_independent_simulation_says(
    damped: bool, rtol: float, error: float, run: Run, folder: Path
) -> None:
    members = [row if damped or row[1] == "bar" else [*row[:7], "", *row[8:]] for row in MEMBERS]
    tables = write_tables(folder, NODES, members)
    gravity = ",".join(str(value) for value in GRAVITY)
    assert run("import", *tables, "-o", "tripod.toml", "--gravity", gravity).code == 0
    words = ["--t-end", 0.5, "--samples", 11, "--rtol", rtol, "--atol", rtol / 100, "--out", "a.npz"]
    assert run("simulate", "tripod.toml", *words).code == 0

    model = ReferenceModel(structure_of_tables(members), parameters={})
    n = model.nominal("coordinate").size

    def derivative(_: float, x: Any) -> Any:
        return np.concatenate([x[n:], model.compute("acceleration", coordinate=x[:n], velocity=x[n:])])

    start = np.concatenate([model.nominal("coordinate"), model.nominal("velocity")])
    when = np.linspace(0, 0.5, 11)
    expected = solve_ivp(derivative, (0, 0.5), start, "DOP853", t_eval=when, rtol=1e-10, atol=1e-12).y.T
    free = ~model.structure.node_anchored
    with np.load("a.npz") as file:
        np.testing.assert_allclose(file["time"], when, rtol=1e-14)
        np.testing.assert_allclose(file["node_position"][:, free], expected[:, :n], atol=error)
        np.testing.assert_allclose(file["node_velocity"][:, free], expected[:, n:], atol=10 * error)
        tension = [model.compute("member_tension", coordinate=x[:n], velocity=x[n:]) for x in expected]
        np.testing.assert_allclose(file["member_tension"], tension, atol=3000 * error)
        assert np.ptp(file["node_position"][:, 3], axis=0).min() > 0.01  # it did move
        assert (file["node_velocity"][:, ~free] == 0).all()


def test_the_imported_scene_holds_the_tables_bit_by_bit(run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    run("import", *tables, "-o", "tripod.toml", "--gravity", "0.5,-1,-9", "--name", "tables")
    found, expected = load_scene("tripod.toml")[0], structure_of_tables()
    for name in ("node_name", "member_name", "axes", "name"):
        assert getattr(found, name) == getattr(expected, name)
    for name in ("node_position", "node_velocity", "node_mass", "node_anchored", "gravity", "connectivity",
                 "is_bar", "tension_only", "spring_constant", "axial_stiffness", "damping", "member_mass",
                 ):  # fmt: skip
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    np.testing.assert_allclose(found.rest_length, expected.rest_length, rtol=1e-15)


@pytest.mark.parametrize("gravity", ["0,0,-9.81", "-1,0,0", "-1e-3,-2,-3"])
@pytest.mark.parametrize("joined", [True, False])
def test_gravity_may_start_with_a_minus(gravity: str, joined: bool, run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    words = [f"--gravity={gravity}"] if joined else ["--gravity", gravity]
    assert run("import", *tables, "-o", "tripod.toml", *words).code == 0
    assert load_scene("tripod.toml")[0].gravity.tolist() == [float(part) for part in gravity.split(",")]


def test_a_rigid_bar_is_imported_and_keeps_its_length(run: Run, folder: Path) -> None:
    rigid = [["leg1", "bar", "foot1", "head", "", "", "", "", 0.6], *MEMBERS[1:]]
    still = [[*row[:4], "", "", "", *row[7:]] for row in NODES]  # its velocity would stretch the bar
    ended = run("import", *write_tables(folder, still, rigid), "-o", "tripod.toml", "--json")
    assert ended.code == 0
    assert any("rigid" in note for note in ended.data["notes"])
    structure, request = load_scene("tripod.toml")
    assert request.formulation == "rigid_bar"
    ended = run("simulate", "tripod.toml", "--t-end", 0.2, "--out", "a.npz", "--json")
    assert ended.code == 0
    with np.load("a.npz") as file:
        i, j = structure.connectivity[structure.member_name.index("leg1")]
        length = np.linalg.norm(file["node_position"][:, i] - file["node_position"][:, j], axis=1)
    assert np.abs(length - structure.member_length()[0]).max() < 1e-13


def test_columns_may_be_missing(run: Run, folder: Path) -> None:
    (folder / "nodes.csv").write_text("node,x,y,z,anchored\na,0,0,0,1\nb,0,0,-1,\n", encoding="utf-8")
    text = "kind,node_i,node_j,axial_stiffness\ncable,a,b,100\n"
    (folder / "members.csv").write_text(text, encoding="utf-8")
    ended = run("import", "nodes.csv", "members.csv", "-o", "pair.toml", "--json")
    assert ended.code == 0
    assert (ended.data["n_nodes"], ended.data["n_members"]) == (2, 1)
    structure, _ = load_scene("pair.toml")
    assert structure.rest_length.tolist() == [1.0]


BAD_ROWS = {
    "unknown node": (1, 0, 3, "nobody", "UnknownNameError"),
    "unknown kind": (1, 0, 1, "rope", "InvalidValueError"),
    "self": (1, 0, 3, "foot1", "StructureError"),
    "negative stiffness": (1, 0, 5, "-5", "InvalidValueError"),
    "zero rest length": (1, 3, 4, "0", "InvalidValueError"),
    "NaN mass": (0, 0, 7, "nan", "NonFiniteError"),
    "infinite position": (0, 0, 1, "inf", "NonFiniteError"),
    "text": (0, 0, 1, "1 m", "InvalidValueError"),
    "empty position": (0, 0, 1, "", "InvalidValueError"),
    "twice": (0, 1, 0, "foot1", "DuplicateNameError"),
    "anchored": (0, 0, 8, "maybe", "InvalidValueError"),
    "cable with mass": (1, 3, 8, "1", "InvalidValueError"),
}


@pytest.mark.parametrize("case", BAD_ROWS)
def test_a_bad_cell_is_named_with_file_line_and_column(case: str, run: Run, folder: Path) -> None:
    table, row, column, value, error = BAD_ROWS[case]
    tables = [[list(line) for line in NODES], [list(line) for line in MEMBERS]]
    tables[table][row][column] = value
    files = write_tables(folder, *tables)
    ended = run("import", *files, "-o", "tripod.toml", "--json")
    assert ended.code == 2
    assert ended.data["error"] == error
    name = (NODE_COLUMNS, MEMBER_COLUMNS)[table][column]
    assert ended.data["where"] == f"{files[table]}: line {row + 2}, column {name}"
    assert not Path("tripod.toml").exists()


@pytest.mark.parametrize("gravity", ["0,0", "0,0,down", "0,0,nan", "", "9.81"])
def test_a_gravity_that_is_none_is_refused(gravity: str, run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    ended = run("import", *tables, "-o", "tripod.toml", f"--gravity={gravity}", "--json")
    assert ended.code == 2
    assert ended.data["where"] == "--gravity"
    assert not Path("tripod.toml").exists()


@pytest.mark.parametrize("sources", [["nodes.csv"], ["a.step"], ["nodes.csv", "members.csv", "more.csv"]])
def test_sources_that_are_none_are_refused(sources: list[str], run: Run, folder: Path) -> None:
    write_tables(folder, NODES, MEMBERS)
    ended = run("import", *sources, "-o", "tripod.toml", "--json")
    assert ended.code == 2
    assert "nodes.csv members.csv" in ended.data["allowed"]


@pytest.mark.parametrize("spoil", ["missing", "folder", "binary", "empty", "rubbish"])
def test_files_that_are_no_tables_are_refused(spoil: str, run: Run, folder: Path) -> None:
    write_tables(folder, NODES, MEMBERS)
    path = folder / "members.csv"
    path.unlink()
    if spoil == "folder":
        path.mkdir()
    elif spoil != "missing":
        content = {"binary": b"\xff\xfe\0\x01" * 9, "empty": b"", "rubbish": b"x;y\n" * 2_500_000}
        path.write_bytes(content[spoil])
    ended = run("import", "nodes.csv", "members.csv", "-o", "tripod.toml", "--json")
    assert ended.code == 2
    assert ended.data["where"].startswith("members.csv")
    assert not Path("tripod.toml").exists()


def test_a_file_is_kept_unless_told_otherwise(run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    (folder / "tripod.toml").write_text("precious", encoding="utf-8")
    assert run("import", *tables, "-o", "tripod.toml").code == 2
    assert (folder / "tripod.toml").read_text(encoding="utf-8") == "precious"
    assert run("import", *tables, "-o", "tripod.toml", "--overwrite").code == 0


@pytest.mark.parametrize("name", ['a"b', "a;b", "../a", "a\nb", "", "for"])
def test_a_scene_name_that_is_no_identifier_is_refused(name: str, run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    ended = run("import", *tables, "-o", "tripod.toml", "--name", name, "--json")
    assert ended.code == 2
    assert ended.data["error"] == "InvalidNameError"
    assert not Path("tripod.toml").exists()


def test_foreign_names_are_changed_and_told(run: Run, folder: Path) -> None:
    nodes = [["foot 1;", *NODES[0][1:]], *NODES[1:]]
    members = [[cell if cell != "foot1" else "foot 1;" for cell in row] for row in MEMBERS]
    ended = run("import", *write_tables(folder, nodes, members), "-o", "tripod.toml", "--json")
    assert ended.code == 0
    assert any("foot 1;" in note for note in ended.data["notes"])
    assert run("check", "tripod.toml").code == 0


BODY = """
nodes: {o: [0, 0, 0], x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], w: [-1, -1, -1]}
pair_groups: {rod: [[o, x], [o, y], [o, z], [o, w]]}
"""


@pytest.mark.thorough
def test_one_rigid_body_can_be_checked_settled_and_simulated(run: Run, folder: Path) -> None:
    (folder / "body.yaml").write_text(BODY, encoding="utf-8")
    assert run("import", "body.yaml", "-o", "body.toml", "--gravity", "0,0,-9.81").code == 0
    assert run("check", "body.toml").code == 0
    ended = run("simulate", "body.toml", "--t-end", 1, "--samples", 3, "--out", "a.npz", "--json")
    assert ended.code == 0
    with np.load("a.npz") as file:  # it falls as one, without turning
        np.testing.assert_allclose(np.diff(file["node_position"][[0, -1]], axis=0)[0, :, 2], -9.81 / 2)
    assert run("import", "body.yaml", "-o", "body.toml", "--overwrite").code == 0
    assert run("equilibrium", "body.toml").code == 0


def test_tables_and_rigid_rods_do_not_go_together(run: Run, folder: Path) -> None:
    ended = run("import", *write_tables(folder, NODES, MEMBERS), "-o", "tripod.toml", "--rigid", "--json")
    assert ended.code == 2
    assert ended.data["where"] == "--rigid"


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["-o", "tripod.toml"], "--name tripod gives it another name"),
        (["-o", "my tripod.toml"], "--name NAME gives it another name"),
        (["-o", "nodes.toml"], ""),
        (["-o", "tripod.toml", "--name", "legs"], ""),
    ],
)
def test_the_name_of_the_scene_is_stated(words: list[str], shown: str, run: Run, folder: Path) -> None:
    ended = run("import", *write_tables(folder, NODES, MEMBERS), *words, "--json")
    assert ended.code == 0
    assert load_scene(folder / words[1])[0].name == (words[3] if "--name" in words else "nodes")
    assert ('the scene is called "nodes"' in ended.err) == bool(shown)
    assert shown in ended.err
    assert not any("is called" in text for text in ended.data.get("warnings", ()))
