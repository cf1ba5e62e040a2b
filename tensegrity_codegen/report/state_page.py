"""An equilibrium as a page: verdict, loads and supports, feet, members against their limits, nodes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tensegrity_codegen.report.analysis_tables import LIMIT_NAMES
from tensegrity_codegen.report.loads import compute_reactions
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.page import (
    Chapter,
    Figure,
    Page,
    Remark,
    Section,
    as_sentence,
    command_section,
)
from tensegrity_codegen.report.pages.page_table import (
    Cell,
    Column,
    Table,
    find_largest,
    make_table,
    number_cell,
    text_cell,
)
from tensegrity_codegen.report.pages.picture import draw_picture
from tensegrity_codegen.report.pictures.draw import pad_tension
from tensegrity_codegen.report.pictures.panel import set_up
from tensegrity_codegen.report.pictures.plots import draw_shown
from tensegrity_codegen.report.pictures.shown import show_structure
from tensegrity_codegen.report.pictures.view import PictureChoices
from tensegrity_codegen.runtime.statics.equilibrium_record import Equilibrium
from tensegrity_codegen.runtime.statics.on_ground import Feet
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS, MemberChecks
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.system.version import VERSION

MAX_NAMED = 16  # nodes up to which their names stay apart in a picture this small
ROUNDING = 1e-9  # part of the largest force of a support below which it has none
LEAD = (
    "The stable equilibrium under the loads below and the weights. Tensions are positive, compressions "
    "negative."
)


def build_state_page(
    equilibrium: Equilibrium, structure: Structure, member_name: tuple[str, ...], title: str, command: str
) -> Page:
    """Return the page of an equilibrium that was found.

    structure: the drawn one with all loads, its members first those of `member_name` (then edges of bodies);
    title: how it stands, as a sentence; command: the command line that makes the page.
    """
    tension = pad_tension(equilibrium.member_tension, structure)
    remarks = [text for text in (equilibrium.message, *equilibrium.warnings) if text]
    checks = equilibrium.members
    if checks is not None and checks.worst is not None:
        member, limit, use = checks.worst
        title += f"; {member} takes {100 * use:.3g} % of its limit of {LIMIT_NAMES[limit]}"
    sections = (
        forces_section(structure, equilibrium.node_position, tension, equilibrium.feet),
        *([_note(remarks)] if remarks else []),
        *([] if equilibrium.feet is None else [_feet(equilibrium.feet)]),
        members_section(structure, equilibrium.member_tension, checks, member_name),
        _nodes(equilibrium, structure),
        command_section(command),
    )
    counts = f"{describe_count(int((~structure.is_corner).sum()), 'node')}, "
    counts += f"{describe_count(len(member_name), 'member')}."
    return Page(
        subject=f"Equilibrium of {structure.name}",
        title=title.replace(" -", " \N{MINUS SIGN}"),
        lead=LEAD,
        chapters=(Chapter("equilibrium", structure.name, "", counts, sections),),
        facts=(f"tensegrity_codegen {VERSION}.", "Equations, signs and statuses: docs/statics.md."),
    )


def _note(texts: Sequence[str]) -> Section:
    remarks = tuple(Remark("differs", as_sentence(text)) for text in texts)
    return Section("remarks", "", "To note", "plain", "", remarks)


def forces_section(
    structure: Structure, position: FloatArray, tension: FloatArray | None, feet: Feet | None = None
) -> Section:
    """Return loads, and what supports carry at the tensions of all members; None: not in balance.

    position (n_nodes, 3) [m]; tension (n_members,) [N]; feet: the forces of the ground, if there is one.
    """
    load, axes = structure.node_load, list(structure.axes)
    nodes = np.flatnonzero(load.any(axis=1) | structure.node_anchored.any(axis=1))
    reaction = np.full((len(nodes), 3), np.nan)
    if tension is not None:
        reaction = compute_reactions(structure, position[None], tension[None], nodes)[0]
        reaction[np.abs(reaction) < ROUNDING * np.abs(reaction).max(initial=0.0)] = 0.0
    sums = {"loads": load.sum(axis=0), "weights": structure.total_mass * structure.gravity}
    sums |= {} if feet is None else {"ground": feet.force.sum(axis=0)}
    sums |= {"supports": reaction.sum(axis=0)} if structure.node_anchored.any() else {}
    totals = {name: np.round(force[axes], 6) for name, force in sums.items() if not np.isnan(force).any()}
    sentences = (f"{name} {', '.join(format_short(x, 4) for x in force)} N" for name, force in totals.items())
    claim = f"sums along {', '.join('xyz'[axis] for axis in axes)}: {'; '.join(sentences)}"
    heads = [f"{kind} {'xyz'[axis]} [N]" for kind in ("load", "support") for axis in axes]
    rows = [
        (structure.node_name[n], *(float(x) or None for x in (*load[n, axes], *reaction[k, axes])))
        for k, n in enumerate(nodes)
    ]
    columns = {"node": "", **dict.fromkeys(heads, "+.6g")}
    table = make_table("Loads, and forces of supports on nodes", columns, rows)
    labels = ("nodes",) if structure.n_nodes <= MAX_NAMED else ()
    shown = show_structure(structure, position, tension)
    shown = shown if feet is None else replace(shown, contact=feet.force[None])
    picture = draw_shown(set_up(shown, PictureChoices(labels=labels)), 0, "", "", is_vector=True)
    caption = f"Loads and {'forces of supports' if tension is not None else 'no reactions: no balance'}."
    figure = Figure(draw_picture(picture, "forces"), caption, caption, {"node_load": load.tolist()})
    return Section(
        "forces", "", "Loads and supports", "plain", claim, (figure, *([table] if len(nodes) else []))
    )


def members_section(
    structure: Structure,
    tension: FloatArray,
    checks: MemberChecks | None,
    member_name: tuple[str, ...],
    prestress: FloatArray | None = None,
) -> Section:
    """Return the members against their limits, and their sections.

    tension (n_members,) [N]; checks: None if no limit could be judged; prestress (n_members,): a column of
    shares of a prestress.
    """
    heads = {"tension": "N"} if prestress is None else {"prestress": "1", "tension": "N"}
    if checks is not None:
        heads |= {"stress": "MPa", "buckling factor": ""}
        heads |= {f"{LIMIT_NAMES[name]} used": "%" for name in MEMBER_CHECKS}
    columns = [Column("member", numeric=False), *(Column(head, unit) for head, unit in heads.items())]
    rows = tuple(
        (
            text_cell(name),
            *([] if prestress is None else [number_cell(float(prestress[e]), "+.4f")]),
            number_cell(float(tension[e]), "+.6g"),
            *([] if checks is None else _check(checks, e)),
        )
        for e, name in enumerate(member_name)
    )
    claim = "no limits are stated"
    head: tuple[int, ...] = ()
    if checks is not None and checks.worst is not None:
        member, limit, use = checks.worst
        claim = f"nearest to a limit: {member}, {LIMIT_NAMES[limit]}, {100 * use:.3g} % used"
        head = find_largest(np.nan_to_num(checks.member_use[: len(member_name)]))
    note = "the nearest to a limit" if head else ""
    table = Table("Members at the present tensions", tuple(columns), rows, head=head, head_note=note)
    return Section(
        "members", "", "Members", "plain", claim, (table, _tabulate_sections(structure, len(member_name)))
    )


def _check(checks: MemberChecks, member: int) -> Iterator[Cell]:
    yield _cell(checks.stress[member] / 1e6, ".3f")
    yield _cell(checks.buckling_factor[member], ".2f")
    for limit in MEMBER_CHECKS:
        yield _cell(100 * checks.use[limit][member], ".1f")


def _tabulate_sections(structure: Structure, count: int) -> Table:
    """Return the sections of the first members, equal ones of a class together."""
    inner = np.zeros_like(structure.radius) if structure.inner_radius is None else structure.inner_radius
    values = (structure.axial_stiffness, structure.spring_constant, structure.radius, inner)
    groups: dict[tuple[str, ...], list[int]] = {}
    for e in range(count):
        name = structure.member_class[e] or ("bar" if structure.is_bar[e] else "cable")
        sizes = zip((1e-3, 1.0, 1e3, 1e3), values, strict=True)
        look = (format_short(factor * float(value[e]) or None, 5) for factor, value in sizes)
        groups.setdefault((name, *look), []).append(e)
    heads = ("EA [kN]", "spring constant [N/m]", "outer radius [mm]", "inner radius [mm]")
    columns = {"class": "", "members": ".0f", **dict.fromkeys(heads, ".5g"), "mass [kg]": ".5g"}
    rows = [
        (look[0], len(group), *map(text_cell, look[1:]), float(structure.member_mass[group].sum()) or None)
        for look, group in groups.items()
    ]
    return make_table("Sections, with the mass of these members together", columns, rows)


def _feet(feet: Feet) -> Section:
    """Return the nodes that touch the ground, and its forces on them."""
    heads = ("force x [N]", "force y [N]", "force z [N]", "penetration [mm]")
    columns = {"node": "", "contact": "", **dict.fromkeys(heads, ".5g")}
    rows = [
        (feet.node_name[k], state, *map(float, feet.force[k]), 1e3 * float(feet.penetration[k]))
        for k, state in enumerate(feet.state)
        if state != "open"
    ]
    table = make_table("Forces of the ground on nodes", columns, rows)
    return Section(
        "feet", "", "Feet", "plain", f"{describe_count(len(rows), 'node')} on the ground", (table,)
    )


def _nodes(equilibrium: Equilibrium, structure: Structure) -> Section:
    """Return where nodes are, and how far they moved."""
    position, is_node = equilibrium.node_position, np.flatnonzero(~structure.is_corner)
    way = 1e3 * np.linalg.norm(position - structure.node_position, axis=1)
    rows = [(structure.node_name[n], *map(float, position[n]), float(way[n])) for n in is_node]
    columns = {"node": "", **dict.fromkeys(("x [m]", "y [m]", "z [m]"), ".6f"), "moved [mm]": ".4g"}
    table = make_table(
        "Positions", columns, rows, head=find_largest(way[is_node]), head_note="those that moved farthest"
    )
    claim = f"{structure.node_name[int(way.argmax())]} moved farthest, {way.max():.4g} mm"
    claim = claim if way.max() > 0.0 else "no node moved"
    return Section("nodes", "", "Nodes", "plain", claim, (table,))


def _cell(value: float, spec: str) -> Cell:
    if math.isinf(value):
        return text_cell("∞")
    return number_cell(float(value), spec)
