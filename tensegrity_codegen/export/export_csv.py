"""Export to tables (CSV): the nodes and members that `import` reads, and the samples of a motion."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.export.exporter import Exported, Exporter, ExportSource
from tensegrity_codegen.runtime.trajectory.motion_tables import list_columns
from tensegrity_codegen.runtime.trajectory.read_trajectory import read_trajectory
from tensegrity_codegen.scene.formats.import_tables import MEMBER_COLUMNS, NODE_COLUMNS
from tensegrity_codegen.scene.read import read_scene
from tensegrity_codegen.structure.body_support import require_no_bodies
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.structure.sliding import require_no_rings
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.errors import FormulationError

# Sections of a scene that the tables have.
WRITTEN = ("name", "axes", "shape", "classes", "nodes", "members", "loads", "limits")
MOTION = ("time [s]", ".x [m]", ".y [m]", ".z [m]", ".tension [N]")  # ends of the columns of a motion


def encode_tables(source: ExportSource, path: Path, *, trajectory: Path | None = None) -> Exported:
    """Return nodes.csv and members.csv, and with a trajectory motion.csv: times, positions and tensions.

    Numbers are the shortest texts that read back bit-equal. Raises FormulationError for scenes of bodies, and
    the errors of `read_trajectory`. path: the folder, which is not written here.
    """
    structure = source.structure
    if not isinstance(structure, Structure):
        raise FormulationError(
            "tables have nodes and members, and no bodies",
            where=str(source.path),
            allowed="scenes of nodes and members",
            hint="the format json writes scenes of bodies",
        )
    require_no_bodies(structure, "tables of nodes and members", "the format json writes such scenes")
    require_no_rings(structure, "tables of members with two nodes", "the format json writes such scenes")
    files = {
        "nodes.csv": _format_table(NODE_COLUMNS, _list_nodes(structure)),
        "members.csv": _format_table(MEMBER_COLUMNS, _list_members(structure)),
    }
    facts: dict[str, Any] = {"n_nodes": structure.n_nodes, "n_members": structure.n_members}
    if trajectory is not None:
        motion = read_trajectory(trajectory, structure)
        columns = list_columns(replace(motion, input=None))
        moving = {key: values.tolist() for key, values in columns.items() if key.endswith(MOTION)}
        files["motion.csv"] = _format_table(list(moving), zip(*moving.values(), strict=True))
        facts["n_samples"] = len(motion.time)
    return Exported(facts, tuple(_list_losses(source, structure)), files)


def _format_table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue().encode()


def _list_nodes(structure: Structure) -> Iterable[list[Any]]:
    """Yield the rows of nodes; axes that the scene does not model are anchored."""
    held = structure.node_anchored | ~np.isin(np.arange(3), structure.axes)
    for row, name in enumerate(structure.node_name):
        velocity, load = structure.node_velocity[row].tolist(), structure.node_load[row].tolist()
        mass = float(structure.node_mass[row]) or ""
        letters = "".join(letter for letter, is_held in zip("xyz", held[row], strict=True) if is_held)
        yield [name, *structure.node_position[row].tolist(), *velocity, mass, letters, *load]


def _list_members(structure: Structure) -> Iterable[list[Any]]:
    """Yield the rows of members; rigid bars have no rest length, which is their present length."""
    numbers = ("rest_length", "spring_constant", "axial_stiffness", "damping")
    limits = structure.limits.for_members(structure.n_members)
    inner = np.zeros(structure.n_members) if structure.inner_radius is None else structure.inner_radius
    for row, (name, ends) in enumerate(zip(structure.member_name, structure.connectivity, strict=True)):
        kind = "bar" if structure.is_bar[row] else "cable"
        values = [float(getattr(structure, key)[row]) or "" for key in numbers]
        if structure.is_rigid[row]:
            values[0] = ""
        mass, radius = float(structure.member_mass[row]) or "", float(structure.radius[row]) or ""
        slack = "" if kind == "bar" else "yes" if structure.tension_only[row] else "no"
        nodes = [structure.node_name[end] for end in ends]
        limit = {key: float(getattr(limits, key)[row]) for key in MEMBER_LIMITS}
        stated = ["" if limit[key] == none else limit[key] for key, none in MEMBER_LIMITS.items()]
        stated[-1] = "no" if limit["buckling"] < 0 else stated[-1]
        further = [structure.member_class[row], "", "", "", float(inner[row]) or "", *stated]
        yield [name, kind, *nodes, *values, mass, "", "", radius, slack, *further]


def _list_losses(source: ExportSource, structure: Structure) -> list[str]:
    """Return a sentence for each fact of the scene that is not in the tables."""
    unwritten = [key for key in read_scene(source.path).to_document() if key not in WRITTEN]
    has_limits = max(structure.limits.clearance, structure.limits.least_stiffness) > -np.inf
    facts = [
        (bool(unwritten), f"sections of the scene that are not in the tables: {', '.join(unwritten)}"),
        (len(structure.axes) < 3, "the axes that the scene does not model are anchored in the tables"),
        (has_limits, "limits of the whole structure are not in the tables"),
        (bool(structure.law_parameter), "member laws other than a linear spring are not in the tables"),
    ]
    return [sentence for is_lost, sentence in facts if is_lost]


EXPORTER = Exporter(
    name="csv",
    title="a folder with the tables of nodes and members that `import` reads (CSV)",
    endings=(".csv",),
    write=encode_tables,
    options=("trajectory",),
    order=35,
    is_folder=True,
)
