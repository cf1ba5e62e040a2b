"""From nodes, loads and members of a scene to the arrays of a structure: ends, laws, rest lengths, masses."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensegrity_codegen.scene.assemble.member_values import STIFFNESS, Columns, resolve_values
from tensegrity_codegen.scene.checks.check_members import check_connectivity
from tensegrity_codegen.scene.names import check_known, key_path
from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.scene.schema.part_schema import Load, Member, MemberClass, Node
from tensegrity_codegen.system.arrays import BoolArray, FloatArray
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.system.name_patterns import find_matching
from tensegrity_codegen.tables.laws import LAWS, LINEAR
from tensegrity_codegen.tables.laws.law import Law, compute_spring_constant
from tensegrity_codegen.tables.strands import list_strands


def build_node_arrays(nodes: Mapping[str, Node], axes: tuple[int, ...], where: str) -> dict[str, Any]:
    """Return the fields of Structure that are about nodes, by name, without loads."""
    names = tuple(nodes)
    rows = list(nodes.values())
    paths = [("nodes", name) for name in names]
    position = spread_vectors([row.position for row in rows], axes, [(*p, "position") for p in paths], where)
    velocity = spread_vectors([row.velocity for row in rows], axes, [(*p, "velocity") for p in paths], where)
    return {
        "node_name": names,
        "node_position": position,
        "node_velocity": velocity,
        "node_mass": np.array([row.mass or 0.0 for row in rows], dtype=np.float64),
        "node_anchored": _anchored(names, rows, axes, where),
    }


def spread_vectors(
    vectors: Sequence[tuple[float, ...] | None],
    axes: tuple[int, ...],
    places: Sequence[tuple[str | int, ...]],
    where: str,
) -> FloatArray:
    """Return (n, 3) from vectors of 3 numbers or of one number for each modelled axis; None is zero."""
    table = np.zeros((len(vectors), 3))
    width = np.array([-1 if vector is None else len(vector) for vector in vectors], dtype=np.int64)
    wrong = np.flatnonzero((width != -1) & (width != 3) & (width != len(axes)))
    if wrong.size:
        full = "" if len(axes) == 3 else f" or {len(axes)}"
        problem, location = "a vector of the wrong size", key_path(where, *places[wrong[0]])
        allowed = f"3{full} numbers"
        raise InvalidValueError(problem, where=location, given=list(vectors[wrong[0]] or ()), allowed=allowed)
    for size, columns in ((3, (0, 1, 2)), (len(axes), axes)):
        rows = np.flatnonzero(width == size).tolist()
        if rows:
            table[np.ix_(rows, columns)] = np.array([vectors[row] for row in rows])
    return table


def _anchored(
    names: tuple[str, ...], rows: list[Node], axes: tuple[int, ...], where: str
) -> NDArray[np.bool_]:
    modelled = "".join("xyz"[axis] for axis in axes)
    letters = ["xyz" if row.anchored is True else (row.anchored or "") for row in rows]
    for name, row in zip(names, rows, strict=True):
        if isinstance(row.anchored, str) and not set(row.anchored) <= set(modelled):
            problem = "anchored on an axis that the scene does not model"
            location = key_path(where, "nodes", name, "anchored")
            allowed = f"true, false, or some of {modelled!r}"
            raise InvalidValueError(problem, where=location, given=row.anchored, allowed=allowed)
    flags = {
        letters_of_node: tuple(axis in letters_of_node for axis in "xyz") for letters_of_node in set(letters)
    }
    return np.array([flags[letters_of_node] for letters_of_node in letters], dtype=np.bool_).reshape(-1, 3)


def build_node_load(
    names: tuple[str, ...], loads: Sequence[Load], axes: tuple[int, ...], where: str, n_corners: int = 0
) -> FloatArray:
    """Return the load on each node, (n_nodes, 3) [N]; loads add up. Patterns leave out the last, corners."""
    index = {name: row for row, name in enumerate(names)}
    points = dict(list(index.items())[: len(names) - n_corners])
    refusal = 'nodes, or a pattern such as "t*"', "a load on a node that is not defined"
    paths = [("loads", number, "force") for number in range(len(loads))]
    force = spread_vectors([load.force for load in loads], axes, paths, where)
    total = np.zeros((len(names), 3))
    for number, load in enumerate(loads):
        patterns = (load.node,) if isinstance(load.node, str) else load.node
        key = key_path(where, "loads", number, "node")
        groups = [find_matching(name, index if name in index else points, key, *refusal) for name in patterns]
        total[list(set().union(*groups))] += force[number]
    return total


def build_member_arrays(
    classes: Mapping[str, MemberClass],
    members: Mapping[str, Member],
    node_name: tuple[str, ...],
    node_position: FloatArray,
    where: str,
) -> dict[str, Any]:
    """Return the fields of Structure that are about members, by name, and `segments`, (n_members,) of int."""
    names, rows = tuple(members), list(members.values())
    values, is_bar, tension_only = resolve_values(classes, members, where)
    _check_needed(values, names, is_bar, where)
    connectivity, ring_nodes = _find_nodes(names, rows, node_name, where)
    strands = list_strands(connectivity, ring_nodes)
    slack_length = np.where(tension_only & ~(values["segments"] > 1), values["rest_length"], np.nan)
    of_bodies = np.array(["." in name for name in node_name], dtype=np.bool_)
    check_connectivity(strands, names, node_name, node_position, slack_length, where, of_bodies)
    length = strands.lengths(node_position)
    stiffness = {key: _or_zero(values[key]) for key in STIFFNESS}
    laws = _find_laws(values, names, is_bar, where)
    rest_length = _rest_length({**values, **stiffness}, laws, length, tension_only, names, where)
    expansion = _or_zero(values["thermal_expansion"])
    return {
        "member_name": names,
        "member_class": tuple(row.class_name or "" for row in rows),
        "connectivity": connectivity,
        "ring_nodes": ring_nodes,
        "is_bar": is_bar,
        "tension_only": tension_only,
        "rest_length": rest_length,
        **stiffness,
        "damping": _or_zero(values["damping"]),
        "member_mass": _member_mass(values, length, rest_length),
        "segments": np.where(np.isnan(values["segments"]), 1, values["segments"]).astype(np.int64),
        "radius": _or_zero(values["radius"]),
        # None if no member is a tube
        "inner_radius": _or_zero(values["inner_radius"]) if (values["inner_radius"] > 0).any() else None,
        "thermal_expansion": expansion if expansion.any() else None,
        "law_parameter": _law_parameter(
            {**values, **stiffness},
            laws,
            compute_spring_constant(**stiffness, rest_length=rest_length),
            names,
            where,
        ),
    }


def compute_rest_length(
    length: FloatArray, tension: FloatArray, spring_constant: FloatArray, axial_stiffness: FloatArray
) -> FloatArray:
    """Return the rest length at which a member of `length` [m] has `tension` [N], all (n_members,).

    For linear springs. k: rho = l - t / k. EA: rho = EA l / (EA + t). The stiffness is the one that is not
    zero. A result that is not positive or not finite means that no rest length does it.
    """
    stiffness = {"spring_constant": spring_constant, "axial_stiffness": axial_stiffness}
    return LINEAR.find_rest_length(length, tension, stiffness)


def _find_nodes(
    names: tuple[str, ...], rows: list[Member], node_name: tuple[str, ...], where: str
) -> tuple[NDArray[np.int64], tuple[tuple[int, ...], ...]]:
    """Return both ends (n_members, 2), and the rings between them that members pass, () without any."""
    index = {name: row for row, name in enumerate(node_name)}
    try:
        pairs = [(index[row.nodes[0]], index[row.nodes[-1]]) for row in rows]
        rings = [tuple(index[node] for node in row.nodes[1:-1]) for row in rows]
    except KeyError:
        problem = "the member joins a node that is not defined"
        for name, row in zip(names, rows, strict=True):
            for node in row.nodes:
                check_known(node, index, problem, "names of nodes", where, "members", name, "nodes")
        raise
    return np.array(pairs, dtype=np.int64).reshape(-1, 2), tuple(rings) if any(rings) else ()


def _check_needed(given: Columns, names: tuple[str, ...], is_bar: BoolArray, where: str) -> None:
    """Raise for a cable without stiffness, and for a density or inner radius without a fitting radius."""
    missing = {key: np.isnan(values) for key, values in given.items()}
    rigid = missing["spring_constant"] & missing["axial_stiffness"]
    refuse_member = partial(refuse, section="members", names=names, where=where)
    allowed = "one of spring_constant [N/m], axial_stiffness [N]"
    hint = "give it to the member or to its class"
    refuse_member(rigid & ~is_bar, InvalidValueError, "a cable without stiffness", allowed=allowed, hint=hint)
    is_bad, problem = ~missing["density"] & missing["radius"], "a density without a radius"
    allowed = "density and radius, or mass alone"
    refuse_member(is_bad, InvalidValueError, problem, key="density", given=given["density"], allowed=allowed)
    is_bad = ~missing["inner_radius"] & ~(given["inner_radius"] < given["radius"])
    problem, allowed = "the inner radius is not less than the radius", "less than radius, which is needed too"
    value = given["inner_radius"]
    refuse_member(is_bad, InvalidValueError, problem, key="inner_radius", given=value, allowed=allowed)
    for key in ("prestress", "strain"):
        is_bad, problem = rigid & ~missing[key], f"a rigid bar has no {key}"
        allowed = "only with spring_constant or axial_stiffness"
        refuse_member(is_bad, InvalidValueError, problem, key=key, given=given[key], allowed=allowed)


def _find_laws(given: Columns, names: tuple[str, ...], is_bar: BoolArray, where: str) -> dict[Law, BoolArray]:
    """Return the members of each law; raise for a law that lacks a value or belongs to a rigid bar."""
    is_linear, laws = np.ones(len(names), dtype=np.bool_), {}
    report = partial(refuse, section="members", names=names, where=where)
    for law in LAWS:
        groups = (*law.keys, *law.optional_keys)
        present = [~np.all([np.isnan(given[key]) for key in group], axis=0) for group in groups]
        if not present:
            continue
        mask = np.any(present, axis=0)
        for group, here in zip(law.keys, present, strict=False):
            problem = f"a {law.name} member without {' or '.join(group)}"
            allowed = "; ".join(" or ".join(keys) for keys in law.keys)
            hint = "give it to the member or to its class"
            report(mask & ~here, InvalidValueError, problem, allowed=allowed, hint=hint)
        is_bad, problem = mask & ~is_linear, "a member of two laws"
        allowed = "the values of one law"
        report(is_bad, InvalidValueError, problem, allowed=allowed)
        laws[law] = mask
        is_linear &= ~mask
    return {LINEAR: is_linear, **laws}


def _law_parameter(
    given: Columns, laws: Mapping[Law, BoolArray], mu: FloatArray, names: tuple[str, ...], where: str
) -> dict[str, FloatArray]:
    """Return the parameters of laws that some members have, 0 if a member has another one."""
    parameters: dict[str, FloatArray] = {}
    report = partial(refuse, section="members", names=names, where=where)
    for law, mask in laws.items():
        if law.parameters and mask.any():
            allowed = "only with spring_constant or axial_stiffness"
            report(mask & (mu == 0), InvalidValueError, f"a rigid bar cannot be {law.name}", allowed=allowed)
            chosen = {key: np.where(mask, values, np.nan) for key, values in given.items()}
            parameters |= {name: _or_zero(values) for name, values in law.find_parameters(chosen, mu).items()}
            parameter = law.parameters[0].name
            is_bad = mask & (parameters[parameter] == 0)
            report(is_bad, InvalidValueError, f"{parameter} is zero", key=parameter, allowed="not 0")
    return parameters


def _rest_length(
    given: Columns,
    laws: Mapping[Law, BoolArray],
    length: FloatArray,
    tension_only: BoolArray,
    names: tuple[str, ...],
    where: str,
) -> FloatArray:
    """Return the rest lengths, (n_members,) [m]: given, from prestress or strain, or the present length."""
    refuse_prestress = partial(
        refuse, section="members", names=names, where=where, key="prestress", given=given["prestress"]
    )
    problem = "a tension-only cable cannot be in compression"
    refuse_prestress(tension_only & (given["prestress"] < 0), InvalidValueError, problem, allowed="0 or more")
    tension = _or_zero(given["prestress"])
    by_tension = np.zeros(len(length))
    for law, mask in laws.items():
        chosen = {key: values[mask] for key, values in given.items()}
        by_tension[mask] = law.find_rest_length(length[mask], tension[mask], chosen)
    rest_length = np.where(np.isnan(given["prestress"]), length, by_tension)
    bad = ~((rest_length > 0) & np.isfinite(rest_length)) & np.isnan(given["rest_length"])
    problem = "no rest length gives this prestress: it would not be positive"
    allowed = _prestress_limit(int(np.argmax(bad)), given, length, laws) if bad.any() else ""
    hint = "check the units of prestress [N] and stiffness ([N/m] or [N])"
    refuse_prestress(bad, InvalidValueError, problem, allowed=allowed, hint=hint)
    rest_length = np.where(np.isnan(given["strain"]), rest_length, length / (1 + _or_zero(given["strain"])))
    return np.where(np.isnan(given["rest_length"]), rest_length, given["rest_length"])


def _prestress_limit(row: int, given: Columns, length: FloatArray, laws: Mapping[Law, BoolArray]) -> str:
    if not laws[LINEAR][row]:
        return "less tension"
    spring, axial = (float(given[key][row]) for key in STIFFNESS)
    if axial > 0:
        return f"above -axial_stiffness = {-axial:.6g} N"
    return f"below spring_constant * length = {spring * float(length[row]):.6g} N"


def _or_zero(values: FloatArray) -> FloatArray:
    return np.where(np.isnan(values), 0.0, values)


def _member_mass(given: Columns, length: FloatArray, rest_length: FloatArray) -> FloatArray:
    """Return own masses, (n_members,) [kg].

    As given, or density * pi (R^2 - r^2) * length of bars, or mass_per_length * rest_length of cables.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # values that overflow are refused with the structure
        section = np.pi * (given["radius"] ** 2 - _or_zero(given["inner_radius"]) ** 2)
        by_density = _or_zero(given["density"] * section * length)
        by_density += _or_zero(given["mass_per_length"] * rest_length)
    return np.where(np.isnan(given["mass"]), by_density, given["mass"])
