"""Tables: what `import` makes of them is the structure, bit by bit; motions; what they cannot have."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import load_scene
from tensegrity_codegen.export.exporter import ExportSource, write_export
from tensegrity_codegen.scene.formats.format import read_files
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError, OutputError
from tests.export.scenes import HOIST, load_source, write_loose, write_motion

# What the tables have of a structure.
NUMBERS = (
    *("node_position", "node_velocity", "node_mass", "node_load", "connectivity", "is_bar", "tension_only"),
    *("rest_length", "spring_constant", "axial_stiffness", "damping", "member_mass", "radius"),
)
EVERYTHING: dict[str, Any] = {
    "name": "everything",
    "nodes": {
        "a": {"position": [0.1, 1e-17, -3e5], "anchored": True},
        "b": {"position": [1 / 3, 0, 1e300 / 1e301], "velocity": [0.1, -0.2, 2 / 7], "mass": 0.3},
        "c": {"position": [0, 1, 0], "anchored": "xz", "mass": 1e-5},
    },
    "members": {
        "ab": {"kind": "bar", "nodes": ["a", "b"], "mass": 0.7, "radius": 0.013},
        "bc": {
            "kind": "cable",
            "nodes": ["b", "c"],
            "prestress": 1.7,
            "axial_stiffness": 1e4,
            "damping": 0.1,
        },
        "ca": {"kind": "cable", "nodes": ["c", "a"], "spring_constant": 1 / 7, "tension_only": False},
    },
    "loads": [{"node": "b", "force": [0, 0.1, -1 / 3]}],
}


def check_round_trip(source: ExportSource, folder: Path) -> Structure:
    """Export to tables, import these, and compare the structures; return the imported one."""
    structure = source.structure
    assert isinstance(structure, Structure)
    write_export("csv", source, folder / "tables")
    files = [folder / "tables" / name for name in ("nodes.csv", "members.csv")]
    result = read_files(files, name=structure.name, gravity=structure.gravity.tolist())
    write_scene(result.document, folder / "back.toml", overwrite=False)
    back, _ = load_scene(folder / "back.toml")
    assert isinstance(back, Structure)
    assert (back.node_name, back.member_name) == (structure.node_name, structure.member_name)
    for name in NUMBERS:
        np.testing.assert_array_equal(getattr(back, name), getattr(structure, name), name, strict=True)
    return back


@pytest.mark.parametrize("name", ["prism", "prism12", "icosahedron", "tower", "two_nodes", "planar"])
def test_import_reads_an_example_back_bit_by_bit(name: str, tmp_path: Path) -> None:
    source = load_source(tmp_path, name)
    back = check_round_trip(source, tmp_path)
    held = source.structure.node_anchored if name != "planar" else None  # type: ignore[union-attr]
    if held is not None:
        np.testing.assert_array_equal(back.node_anchored, held)


def test_import_reads_every_column_back(tmp_path: Path) -> None:
    path = tmp_path / "everything.toml"
    write_scene(EVERYTHING, path, overwrite=False)
    back = check_round_trip(ExportSource(path, *load_scene(path)), tmp_path)
    assert back.node_anchored.tolist() == [[True] * 3, [False] * 3, [True, False, True]]
    assert back.is_rigid.tolist() == [True, False, False]


def test_import_reads_classes_tubes_and_limits_back(tmp_path: Path) -> None:
    classes = {
        "strut": {
            "kind": "bar",
            "youngs_modulus": 2.1e11,
            "section": {"tube": [0.06, 0.003]},
            "density": 7850,
        },
        "rope": {"kind": "cable", "youngs_modulus": 1.6e11, "section": {"rod": 0.02}, "mass_per_length": 2.4},
    }
    members = {
        "ab": {"class": "strut", "nodes": ["a", "b"]},
        "bc": {"class": "rope", "nodes": ["b", "c"]},
        "ca": {"class": "rope", "nodes": ["c", "a"]},
    }
    limits = {
        "yield_stress": 7e8,
        "buckling": 1.5,
        "clearance": 0.1,
        "classes": {"strut": {"yield_stress": 3.55e8}, "rope": {"least_tension": 10.0}},
        "members": {"ca": {"most_tension": 1e4}},
    }
    path = tmp_path / "steel.toml"
    own = {"nodes": EVERYTHING["nodes"], "classes": classes, "members": members, "limits": limits}
    write_scene({"name": "steel", **own}, path, overwrite=False)
    source = ExportSource(path, *load_scene(path))
    back = check_round_trip(source, tmp_path)
    assert isinstance(source.structure, Structure)
    assert back.member_class == ("strut", "rope", "rope")
    np.testing.assert_array_equal(back.inner_radius, source.structure.inner_radius)
    for name in MEMBER_LIMITS:
        np.testing.assert_array_equal(
            getattr(back.limits, name), getattr(source.structure.limits, name), strict=True
        )
    notes = write_export("csv", source, tmp_path / "again").notes
    assert "limits of the whole structure are not in the tables" in notes
    assert not any("inner radii" in note or "sections" in note for note in notes)


def test_axes_that_are_not_modelled_are_anchored(tmp_path: Path) -> None:
    source = load_source(tmp_path, "planar")
    back = check_round_trip(source, tmp_path)
    free = [axis for axis in range(3) if not back.node_anchored[:, axis].all()]
    assert tuple(free) == source.structure.axes
    assert back.n_coordinates == source.structure.n_coordinates  # type: ignore[union-attr]


def test_what_is_not_in_the_tables_is_listed(tmp_path: Path) -> None:
    path = write_loose(tmp_path)
    exported = write_export("csv", ExportSource(path, *load_scene(path)), tmp_path / "tables")
    lost = next(note for note in exported.notes if "sections" in note)
    for section in ("gravity", "model", "parameters", "groups", "inputs"):
        assert section in lost
    assert "loads" not in lost


def test_a_motion_is_a_third_table(tmp_path: Path) -> None:
    source = load_source(tmp_path, "prism")
    position = write_motion(tmp_path / "m.npz", source.structure)
    exported = write_export("csv", source, tmp_path / "tables", trajectory=tmp_path / "m.npz")
    assert exported.facts["n_samples"] == 5
    with (tmp_path / "tables" / "motion.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    names = [f"{node}.{axis} [m]" for node in source.structure.node_name for axis in "xyz"]
    assert header == [
        "time [s]", *names, *(f"{member}.tension [N]" for member in source.structure.member_name),
    ]  # fmt: skip
    table = np.array(rows, dtype=float)
    assert table[:, 0].tolist() == [0.0, 0.125, 0.25, 0.375, 0.5]
    np.testing.assert_array_equal(table[:, 1:19].reshape(5, 6, 3), position)
    np.testing.assert_array_equal(table[:, 19:], np.outer(1.0 + table[:, 0], np.arange(1.0, 13.0)))


def test_scenes_of_bodies_and_names_of_files_are_refused(tmp_path: Path) -> None:
    bodies = load_source(tmp_path, "svd_tower")
    with pytest.raises(FormulationError, match="no bodies") as caught:
        write_export("csv", bodies, tmp_path / "tables")
    assert "json" in caught.value.hint
    with pytest.raises(OutputError, match="a folder with several files") as other:
        write_export("csv", bodies, tmp_path / "tables.csv")
    assert other.value.hint == "tables"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["svd_tower.toml"]


def test_cables_through_rings_are_refused(tmp_path: Path) -> None:
    write_scene(HOIST, tmp_path / "hoist.toml", overwrite=False)
    source = ExportSource(tmp_path / "hoist.toml", *load_scene(tmp_path / "hoist.toml"))
    with pytest.raises(FormulationError, match="rings are not supported here: tables") as caught:
        write_export("csv", source, tmp_path / "tables")
    assert "rope" in caught.value.where
    assert not (tmp_path / "tables").exists()


def test_tables_that_exist_are_replaced_on_request_only(tmp_path: Path) -> None:
    source = load_source(tmp_path, "two_nodes")
    write_export("csv", source, tmp_path / "tables")
    before = (tmp_path / "tables" / "nodes.csv").read_bytes()
    with pytest.raises(OutputError, match="already"):
        write_export("csv", load_source(tmp_path, "prism"), tmp_path / "tables")
    assert (tmp_path / "tables" / "nodes.csv").read_bytes() == before
    write_export("csv", load_source(tmp_path, "prism"), tmp_path / "tables", overwrite=True)
    assert (tmp_path / "tables" / "nodes.csv").read_bytes() != before
