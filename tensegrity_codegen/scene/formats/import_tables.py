"""Import of a structure from two CSV tables, one of nodes and one of members.

nodes:   node,x,y,z,vx,vy,vz,mass,anchored,fx,fy,fz             (needed: node, x, y, z)
members: member,kind,node_i,node_j,rest_length,spring_constant,axial_stiffness,damping,mass,prestress,
         density,radius,tension_only,class,section,youngs_modulus,mass_per_length,inner_radius,
         least_tension,most_tension,yield_stress,buckling       (needed: kind, node_i, node_j)
SI units; docs/import.md says what each column means, and by which other names columns are known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tensegrity_codegen.scene.formats.files.csv_table import MAX_TABLE_BYTES, Row, read_lines, read_table
from tensegrity_codegen.scene.formats.files.documents import read_numbers
from tensegrity_codegen.scene.formats.format import Format
from tensegrity_codegen.scene.formats.imported import (
    POSITIVE,
    ImportResult,
    Network,
    NetworkMember,
    build_result,
    check_ends,
    read_text,
)
from tensegrity_codegen.scene.names import check_known
from tensegrity_codegen.structure.limits import MEMBER_LIMITS
from tensegrity_codegen.system.errors import DuplicateNameError, InvalidValueError, StructureError

NODE_COLUMNS = ("node", "x", "y", "z", "vx", "vy", "vz", "mass", "anchored", "fx", "fy", "fz")
MEMBER_COLUMNS = (
    *("member", "kind", "node_i", "node_j", "rest_length", "spring_constant", "axial_stiffness", "damping"),
    *("mass", "prestress", "density", "radius", "tension_only", "class", "section", "youngs_modulus"),
    *("mass_per_length", "inner_radius", *MEMBER_LIMITS),
)
OTHER_NODE_NAMES = {"id": "node", "name": "node", "fixed": "anchored"}
OTHER_MEMBER_NAMES = {"id": "member", "name": "member", "type": "kind", "from": "node_i", "to": "node_j"}
_ANCHORED = {"": False, "0": False, "false": False, "no": False, "1": True, "true": True, "yes": True}
_FLAG = {"": None, "0": False, "false": False, "no": False, "1": True, "true": True, "yes": True}
_AXES = ("x", "y", "z", "xy", "xz", "yz", "xyz")


def import_tables(
    nodes_path: str | Path,
    members_path: str | Path,
    *,
    name: str | None = None,
    gravity: Sequence[float] | None = None,
) -> ImportResult:
    """Return the scene document that two CSV tables state, and notes on what was changed or assumed."""
    nodes_path, members_path = Path(nodes_path), Path(members_path)
    network = Network()
    if _names_members(nodes_path) and not _names_members(members_path):
        nodes_path, members_path = members_path, nodes_path
        network.notes.append(f"the tables were given in the other order: {nodes_path} has the nodes")
    node_rows = read_table(nodes_path, NODE_COLUMNS, NODE_COLUMNS[:4], OTHER_NODE_NAMES)
    member_rows = read_table(members_path, MEMBER_COLUMNS, MEMBER_COLUMNS[1:4], OTHER_MEMBER_NAMES)
    for path, rows, section in ((nodes_path, node_rows, "nodes"), (members_path, member_rows, "members")):
        if not rows:
            problem = f"the table has no {section}"
            raise StructureError(problem, where=str(path), allowed="a row below the header")
        if rows[0].decimal_comma:
            network.notes.append(f"{path}: commas within numbers were read as decimal commas")
    for foreign, row in _name_rows(node_rows, "node").items():
        network.nodes[foreign] = _read_node(row)
        force = [row.number(column) or 0.0 for column in ("fx", "fy", "fz")]
        if any(force):
            network.loads.append((foreign, force))
    if any(row.cells.get("member") for row in member_rows):
        named = _name_rows(member_rows, "member")
    else:
        named = {f"m{number}": row for number, row in enumerate(member_rows, 1)}
        network.notes.append(f"the table names no members: they are m1 to m{len(named)}, in its order")
    network.members = [_read_member(foreign, row, network.nodes) for foreign, row in named.items()]
    limits = {foreign: row_limits for foreign, row in named.items() if (row_limits := _read_limits(row))}
    network.control = {"limits": {"members": limits}} if limits else {}
    result = build_result(network, nodes_path, name, gravity)
    of_limits = {f"limits.{path}": place for path, place in result.places.items()}
    return replace(result, places={**result.places, **of_limits})


def _names_members(path: Path) -> bool:
    """Return whether the header of a table names columns that only members have, and need."""
    _, header = next(read_lines(read_text(path, MAX_TABLE_BYTES, "a CSV table"), path), (0, []))
    return {OTHER_MEMBER_NAMES.get(name.lower(), name.lower()) for name in header} >= set(MEMBER_COLUMNS[1:4])


def _name_rows(rows: list[Row], column: str) -> dict[str, Row]:
    """Return rows by the names in a column; raises DuplicateNameError."""
    seen: dict[str, Row] = {}
    for row in rows:
        foreign = row.text(column)
        if foreign in seen:
            problem = f"two {column}s under one name"
            allowed = f"each name once (it stands in line {seen[foreign].line} too)"
            raise DuplicateNameError(problem, where=row.where(column), given=foreign, allowed=allowed)
        seen[foreign] = row
    return seen


def _read_node(row: Row) -> dict[str, Any]:
    node: dict[str, Any] = {"position": [_needed(row, column) for column in "xyz"]}
    mass = row.number("mass")
    if mass is not None:
        if not mass > 0:
            problem, location = "the value is out of range", row.where("mass")
            raise InvalidValueError(problem, where=location, given=mass, allowed="greater than 0, or empty")
        node["mass"] = mass
    anchored = row.cells.get("anchored", "").lower()
    if anchored not in _ANCHORED and anchored not in _AXES:
        problem = "not a valid value of anchored"
        allowed = f"0, 1, true, false, yes, no, empty, or axes: {', '.join(_AXES)}"
        raise InvalidValueError(problem, where=row.where("anchored"), given=anchored, allowed=allowed)
    held = _ANCHORED.get(anchored, anchored)
    if held:
        node["anchored"] = held
    velocity = [row.number(column) or 0.0 for column in ("vx", "vy", "vz")]
    if any(velocity):
        node["velocity"] = velocity
    return node


def _needed(row: Row, column: str) -> float:
    row.text(column)
    return row.number(column) or 0.0


def _read_member(name: str, row: Row, nodes: Mapping[str, Any]) -> NetworkMember:
    kind = row.text("kind").lower()
    if kind not in ("bar", "cable"):
        raise InvalidValueError(
            "not a kind of member", where=row.where("kind"), given=row.text("kind"), allowed="bar, cable"
        )
    problem = "the member joins a node that is not in the table of nodes"
    ends = row.text("node_i"), row.text("node_j")
    for column, end in zip(("node_i", "node_j"), ends, strict=True):
        check_known(end, nodes, problem, "names of nodes", row.where(column))
    check_ends(*ends, ends[1], row.where("node_j"))
    member: dict[str, Any] = {"kind": kind}
    for column in (*POSITIVE, "damping", "prestress"):
        value = row.number(column)
        if value is not None and (value or column != "damping"):
            member[column] = value
    if row.cells.get("class"):
        member["class"] = row.cells["class"]
    if section := row.cells.get("section"):
        text = section.replace(",", ".") if row.decimal_comma else section
        member["section"] = _read_section(text, row.where("section"))
    if _is_two_sided(row, kind):
        member["tension_only"] = False
    return NetworkMember(name, ends, member, row.where("node_j"), row.where)


def _read_section(text: str, where: str) -> Any:
    """Return the section of a scene: "rod 0.02", "tube 0.06 0.003", or a name of the catalogue."""
    shape, *sizes_text = text.split()
    if shape.lower() not in ("rod", "tube"):
        return text
    sizes = read_numbers(" ".join(sizes_text), where, (1 if shape.lower() == "rod" else 2,))
    return {shape.lower(): sizes[0] if len(sizes) == 1 else sizes}


def _read_limits(row: Row) -> dict[str, Any]:
    """Return the limits of a member; buckling may be yes or no too."""
    flag = _FLAG.get(row.cells.get("buckling", "").lower()) if "buckling" in row.cells else None
    limits: dict[str, Any] = {}
    for key in MEMBER_LIMITS:
        value = flag if key == "buckling" and flag is not None else row.number(key)
        limits |= {} if value is None else {key: value}
    return limits


def _is_two_sided(row: Row, kind: str) -> bool:
    """Return whether a cable is said to push too; raises InvalidValueError for another word or a bar."""
    flag = row.cells.get("tension_only", "").lower()
    if flag not in _FLAG or (kind == "bar" and _FLAG[flag]):
        problem = "a bar takes both signs of force" if flag in _FLAG else "neither yes nor no"
        allowed = "0, 1, true, false, yes, no or empty; for bars empty or no"
        raise InvalidValueError(problem, where=row.where("tension_only"), given=flag, allowed=allowed)
    return kind == "cable" and _FLAG[flag] is False


FORMAT = Format(
    title="tables of nodes and members (CSV)", sources=("nodes.csv", "members.csv"), endings=(),
    read=import_tables, order=1,
    instead={"rigid": "leave spring_constant and axial_stiffness of a bar empty: such a bar is rigid"},
)  # fmt: skip
