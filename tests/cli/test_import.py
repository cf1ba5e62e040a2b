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
from tests.scene.formats.test_import_tables import FOUR, STEEL

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
    run.good("import", *tables, "-o", "tripod.toml", "--gravity", gravity)
    words = ["--t-end", 0.5, "--samples", 11, "--rtol", rtol, "--atol", rtol / 100, "--out", "a.npz"]
    run.good("simulate", "tripod.toml", *words)

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


@pytest.mark.parametrize("words", [("--gravity=-1e-3,-2,-3",), ("--gravity", "-1e-3,-2,-3")])
def test_gravity_may_start_with_a_minus(words: tuple[str, ...], run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    run.good("import", *tables, "-o", "tripod.toml", *words)
    assert load_scene("tripod.toml")[0].gravity.tolist() == [-1e-3, -2.0, -3.0]


def test_a_rigid_bar_is_imported_and_keeps_its_length(run: Run, folder: Path) -> None:
    rigid = [["leg1", "bar", "foot1", "head", "", "", "", "", 0.6], *MEMBERS[1:]]
    still = [[*row[:4], "", "", "", *row[7:]] for row in NODES]  # its velocity would stretch the bar
    ended = run.good("import", *write_tables(folder, still, rigid), "-o", "tripod.toml", "--json")
    assert any("rigid" in note for note in ended.data["notes"])
    structure, request = load_scene("tripod.toml")
    assert request.formulation == "rigid_bar"
    ended = run.good("simulate", "tripod.toml", "--t-end", 0.2, "--out", "a.npz", "--json")
    with np.load("a.npz") as file:
        i, j = structure.connectivity[structure.member_name.index("leg1")]
        length = np.linalg.norm(file["node_position"][:, i] - file["node_position"][:, j], axis=1)
    assert np.abs(length - structure.member_length()[0]).max() < 1e-13


def test_a_bad_cell_is_named_with_file_line_and_column(run: Run, folder: Path) -> None:
    """Two faults; tests/scene/formats/test_import_tables.py has all faults."""
    for column, value, name in ((2, "nobody", "node_i"), (4, "0", "rest_length")):
        members = [[*row[:column], value, *row[column + 1 :]] if row[0] == "hem1" else row for row in MEMBERS]
        ended = run.refused("import", *write_tables(folder, NODES, members), "-o", "tripod.toml", "--json")
        assert ended.data["where"] == f"members.csv: line 5, column {name}"
        assert not Path("tripod.toml").exists()


@pytest.mark.parametrize("words", [[], ["--scale", "0.5"]])
@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("CHS 60.3x3.2", "CHS60.3*3.2", "line 2, column section"),
        ("0.06 0.003", "0.06 0.03", "line 3, column section"),
        ("7.5e8", "-7.5e8", "line 5, column yield_stress"),
    ],
)
def test_values_that_no_scene_may_have_are_named_by_line_and_column(
    words: list[str], old: str, new: str, place: str, run: Run, folder: Path
) -> None:
    for name, text in (("n.csv", FOUR), ("m.csv", STEEL.replace(old, new, 1))):
        (folder / name).write_text(text, encoding="utf-8")
    ended = run("import", "n.csv", "m.csv", "--out", "scene.toml", *words)
    assert (ended.code, ended.err.startswith(f"error: m.csv: {place}: ")) == (2, True)


@pytest.mark.parametrize("gravity", ["0,0", "0,0,down", "0,0,nan"])
def test_a_gravity_that_is_none_is_refused(gravity: str, run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    ended = run.refused("import", *tables, "-o", "tripod.toml", f"--gravity={gravity}", "--json")
    assert ended.data["where"] == "--gravity"
    assert not Path("tripod.toml").exists()


@pytest.mark.parametrize("sources", [["nodes.csv"], ["a.step"], ["nodes.csv", "members.csv", "more.csv"]])
def test_sources_that_are_none_are_refused(sources: list[str], run: Run, folder: Path) -> None:
    write_tables(folder, NODES, MEMBERS)
    ended = run.refused("import", *sources, "-o", "tripod.toml", "--json")
    assert "nodes.csv members.csv" in ended.data["allowed"]


def test_a_missing_table_is_refused(run: Run, folder: Path) -> None:
    write_tables(folder, NODES, MEMBERS)
    (folder / "members.csv").unlink()
    ended = run.refused("import", "nodes.csv", "members.csv", "-o", "tripod.toml", "--json")
    assert ended.data["where"].startswith("members.csv")
    assert not Path("tripod.toml").exists()


def test_a_scene_name_that_is_no_identifier_is_refused(run: Run, folder: Path) -> None:
    tables = write_tables(folder, NODES, MEMBERS)
    ended = run.refused("import", *tables, "-o", "tripod.toml", "--name", "../a", "--json")
    assert ended.data["error"] == "InvalidNameError"
    assert not Path("tripod.toml").exists()


BODY = """
nodes: {o: [0, 0, 0], x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], w: [-1, -1, -1]}
pair_groups: {rod: [[o, x], [o, y], [o, z], [o, w]]}
"""


@pytest.mark.thorough
def test_one_rigid_body_can_be_checked_settled_and_simulated(run: Run, folder: Path) -> None:
    (folder / "body.yaml").write_text(BODY, encoding="utf-8")
    run.good("import", "body.yaml", "-o", "body.toml", "--gravity", "0,0,-9.81")
    run.good("check", "body.toml")
    run.good("simulate", "body.toml", "--t-end", 1, "--samples", 3, "--out", "a.npz", "--json")
    with np.load("a.npz") as file:  # it falls as one, without turning
        np.testing.assert_allclose(np.diff(file["node_position"][[0, -1]], axis=0)[0, :, 2], -9.81 / 2)
    run.good("import", "body.yaml", "-o", "body.toml", "--overwrite")
    run.good("equilibrium", "body.toml")


def test_tables_and_rigid_rods_do_not_go_together(run: Run, folder: Path) -> None:
    ended = run.refused(
        "import", *write_tables(folder, NODES, MEMBERS), "-o", "tripod.toml", "--rigid", "--json"
    )
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
    ended = run.good("import", *write_tables(folder, NODES, MEMBERS), *words, "--json")
    assert load_scene(folder / words[1])[0].name == (words[3] if "--name" in words else "nodes")
    assert ('the scene is called "nodes"' in ended.err) == bool(shown)
    assert shown in ended.err
    assert not any("is called" in text for text in ended.data.get("warnings", ()))
