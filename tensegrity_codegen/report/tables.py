"""Tables for the terminal: contents of a library, omissions, nodes, members, facts of a run."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tensegrity_codegen.report.long_table import LongTable, Ranking, add_row, new_table, rank_rows
from tensegrity_codegen.runtime.trajectory.trajectory import Foot
from tensegrity_codegen.structure.bodies import BodySystem
from tensegrity_codegen.structure.member_limits import MEMBER_CHECKS, MemberChecks
from tensegrity_codegen.structure.outline import hide_bodies
from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.system.arrays import FloatArray
from tensegrity_codegen.system.summaries import describe_count
from tensegrity_codegen.tables.manifest import Manifest

if TYPE_CHECKING:
    from rich.table import Table

    from tensegrity_codegen.runtime.statics.equilibrium_record import SegmentError

# Names and units of the facts about a run.
RUN_ROWS = {
    "status": ("status", ""),
    "message": ("message", ""),
    "method": ("method", ""),
    "why_method": ("why this method", ""),
    "t_end": ("simulated time", "s"),
    "n_samples": ("samples", ""),
    "n_steps": ("steps", ""),
    "n_evaluations": ("force evaluations", ""),
    "n_events": ("events", ""),
    "step": ("step", "s"),
    "error_estimate": ("estimated error / tolerance", ""),
    "total_energy_start": ("total energy at the start", "J"),
    "total_energy_end": ("total energy at the end", "J"),
    "friction_work": ("work of friction", "J"),
    "impact_work": ("work of impacts", "J"),
    "damping_work": ("work of damping", "J"),
    "belt_work": ("work of the belt", "J"),
    "viscous_work": ("work of viscous members", "J"),
    "largest_kinetic_energy": ("largest kinetic energy", "J"),
    "energy_drift": ("energy drift / largest kinetic energy", ""),
    "library": ("library", ""),
    "out": ("result file", ""),
}


def functions_table(manifest: Manifest) -> "Table":
    """Return a table of the emitted functions: arguments, shape, unit, operations."""
    table = new_table(
        f"{manifest.name}: functions", "quantity", "arguments", "shape", "unit", operations="right"
    )
    for function in manifest.functions:
        add_row(
            table, function.quantity, ", ".join(function.arguments) or "none", _shape(function.shape),
            function.unit, f"{function.operations:,}",
        )  # fmt: skip
    for integrator in manifest.integrators:
        passed = ", ".join(("state", *integrator.arguments))
        add_row(table, f"integrate_{integrator.name}", passed, "", "", "")
    for solver in manifest.solvers:
        passed = ", ".join(("coordinate", *solver.arguments))
        add_row(table, f"find_{solver.name}", passed, "", "", "")
    return table


def describe_parts(manifest: Manifest) -> str:
    """Return which parts the C source has besides its functions, and why it has no others: one line each."""
    rows = [
        f"{'with' if part.is_included else 'without'} {part.name.replace('_', ' ')}: {part.why}"
        for part in manifest.parts
    ]
    return "\n".join(rows)


def left_out_table(manifest: Manifest) -> "Table":
    """Return a table of the features that the library omits, with reasons and savings."""
    counts = ["functions", "arguments", "operations"]
    counts += ["object_bytes"] if any(feature.measured for feature in manifest.left_out) else []
    table = new_table(f"{manifest.name}: left out", "what, and why", **dict.fromkeys(counts, "right"))
    for feature in manifest.left_out:
        numbers = [f"{getattr(feature, name):,}" for name in counts]
        add_row(table, f"{feature.what}\n{feature.why}", *numbers)
        table.add_section()
    return table


def memory_table(code_bytes: int | None, stack_bytes: Mapping[str, int]) -> "Table":
    """Return a table of the program memory of a library and the stack of its functions [bytes]."""
    size = "unknown" if code_bytes is None else f"{code_bytes:,} bytes"
    table = new_table(f"code and constants: {size}; stack at most", "function", bytes="right")
    for name, size_of in sorted(stack_bytes.items(), key=lambda entry: -entry[1]):
        add_row(table, name, f"{size_of:,}")
    return table


def nodes_table(structure: Structure, node_position: FloatArray) -> LongTable:
    """Return a table of the nodes at node_position (n_nodes, 3) [m] with their held axes."""
    structure = hide_bodies(structure)
    node_position = node_position[: structure.n_nodes]
    letters = ["xyz"[axis] for axis in structure.axes]
    moved = np.linalg.norm(node_position - structure.node_position, axis=1)

    def describe(n: int) -> list[str]:
        held = "".join("xyz"[axis] for axis in structure.axes if structure.node_anchored[n, axis])
        components = [f"{node_position[n, axis]:.6f}" for axis in structure.axes]
        return [structure.node_name[n], *components, f"{moved[n]:.3g}", held]

    return LongTable(
        f"{structure.name}: nodes", ("node", *(f"{letter} [m]" for letter in letters), "moved [m]", "held"),
        f"f{'r' * len(letters)}rl", structure.n_nodes, describe, "nodes",
        (("moved farthest", rank_rows(-moved)),),
    )  # fmt: skip


def feet_table(
    name: str,
    node_name: Sequence[str],
    force: FloatArray,
    state: Sequence[str] = (),
    penetration: FloatArray | None = None,
) -> LongTable:
    """Return a table of forces of the ground on nodes (n, 3) [N], those that are open left out.

    state, penetration: of each node, [m].
    """
    rows = [k for k in range(len(node_name)) if not state or state[k] != "open"]
    size = np.linalg.norm(force, axis=1)
    shown = np.where(np.abs(force) > 1e-12 * size.max(initial=0.0), force, 0.0)

    def describe(node: int) -> list[str]:
        k = rows[node]
        contact_cells = [] if penetration is None else [state[k], f"{penetration[k]:.6g}"]
        return [node_name[k], *(f"{x:.6g}" for x in shown[k]), *contact_cells]

    contact_heads = () if penetration is None else ("contact", "penetration [m]")
    return LongTable(
        f"{name}: feet", ("node", "force x [N]", "force y [N]", "force z [N]", *contact_heads),
        "frrr" + "lr"[: len(contact_heads)], len(rows), describe, "feet",
        (("largest force", rank_rows(-size[rows])),),
    )  # fmt: skip


def touched_table(name: str, feet: Sequence[Foot]) -> LongTable:
    """Return a table of the feet of a motion."""

    def describe(k: int) -> list[str]:
        foot = feet[k]
        numbers = (foot.first_touch, foot.slide, foot.largest_force, foot.largest_use, foot.penetration)
        return [foot.node, str(foot.touches), *(f"{x:.4g}" for x in numbers)]

    heads = ("node", "touches", "first [s]", "slide [m]", "most N [N]", "F / (mu N)", "depth [m]")
    ranking = (("largest force", range(len(feet))),)
    return LongTable(f"{name}: feet", heads, "frrrrrr", len(feet), describe, "feet", ranking)


def tips_table(name: str, tips: Sequence[Any]) -> LongTable:
    """Return a table of the cables and how far each must be shortened until the structure tips (Tip)."""

    def describe(k: int) -> list[str]:
        tip = tips[k]
        edge = " and ".join(tip.edge) if tip.status == "tips" else ""
        return [tip.cable, tip.status, f"{tip.shortening:.6g}", f"{tip.rest_length:.6g}", edge]

    heads = ("cable", "what happens", "shortened by [m]", "rest length [m]", "about")
    ranking = (("least shortening", range(len(tips))),)
    return LongTable(f"{name}: tipping", heads, "flrrl", len(tips), describe, "cables", ranking)


def segments_table(name: str, segments: Sequence["SegmentError"]) -> LongTable:
    """Return a table of cables in segments: tensions and sags, and by how much these err."""

    def describe(k: int) -> list[str]:
        segment = segments[k]
        errors = (
            segment.end_tension - segment.extrapolated_end_tension,
            segment.sag - segment.extrapolated_sag,
        )
        tension, sag = f"{segment.end_tension:.6g}", f"{segment.sag:.6g}"
        return [
            segment.cable,
            str(segment.n_segments),
            tension,
            f"{errors[0]:+.2g}",
            sag,
            f"{errors[1]:+.2g}",
        ]

    heads = ("cable", "segments", "end tension\n[N]", "error\n[N]", "sag\n[m]", "error\n[m]")
    worst = rank_rows(np.array([-segment.relative for segment in segments]))
    return LongTable(
        f"{name}: cables in segments", heads, "frrrrr", len(segments), describe, "cables",
        (("largest error", worst),),
    )  # fmt: skip


def members_table(
    structure: Structure,
    member_length: FloatArray,
    member_tension: FloatArray,
    checks: MemberChecks | None = None,
) -> LongTable:
    """Return a table of the members: lengths (n_members,) [m], tensions (n_members,) [N], and their state.

    The strain is (l - rho) / rho, from the stated rest lengths rho. checks: members against their limits;
    their use is a column if there are any.
    """
    structure = hide_bodies(structure)
    member_length, member_tension = (x[: structure.n_members] for x in (member_length, member_tension))
    strain = 100 * (member_length - structure.rest_length) / structure.rest_length
    use = _find_uses(checks, structure.n_members, MEMBER_CHECKS)
    used = [] if np.isnan(use).all() else ["use"]

    def describe(e: int) -> list[str]:
        # In a word the state of the member; a tension-only one without tension is slack
        value, state = member_tension[e], "taut"
        if not value > 0:
            state = "slack" if structure.tension_only[e] else "compressed" if value < 0 else "unloaded"
        kind = structure.member_class[e] or ("bar" if structure.is_bar[e] else "cable")
        nodes = "–".join(structure.node_name[n] for n in structure.path(e))
        return [
            structure.member_name[e], kind, nodes, f"{structure.rest_length[e]:.5f}",
            f"{member_length[e]:.5f}", f"{strain[e]:+.2f}", f"{value:+.5g}",
            *(_show_use(use[e]) for _ in used), state,
        ]  # fmt: skip

    heads = ("rest\nlength\n[m]", "length\n[m]", "strain\n[%]", "tension\n[N]", *used, "state")
    return LongTable(
        f"{structure.name}: members", ("member", "class", "nodes", *heads), f"fffrrrr{'r' * len(used)}l",
        structure.n_members, describe, "members", rank_members(structure, member_tension, checks),
        _count_loose(checks, structure.n_members), short=classes_table(
            structure, {"length\n[m]": member_length, "tension\n[N]": member_tension}, member_tension, checks
        ),
    )  # fmt: skip


LEAST_TENSION = "least_tension"
STRENGTHS = tuple(limit for limit in MEMBER_CHECKS if limit != LEAST_TENSION)


def _find_uses(checks: MemberChecks | None, count: int, limits: Sequence[str]) -> FloatArray:
    """Return the largest part of limits that each of the first members uses, which are those of tables."""
    uses = [] if checks is None else [checks.use[limit][:count] for limit in limits]
    return np.asarray(np.fmax.reduce([np.full(count, np.nan), *uses]))


def _count_loose(checks: MemberChecks | None, count: int) -> str:
    """Return how many members are below their least tension, and slack, as a sentence; empty for none."""
    use = _find_uses(checks, count, [LEAST_TENSION])
    slack = f", {np.isinf(use).sum()} of them without tension" if np.isinf(use).any() else ""
    return (
        f"{describe_count((use > 1).sum(), 'member')} below the least tension{slack}"
        if (use > 1).any()
        else ""
    )


def _show_use(use: float) -> str:
    return "" if np.isnan(use) else f"{use:.4g}"


def classes_table(
    structure: Structure | BodySystem,
    values: Mapping[str, FloatArray],
    member_tension: FloatArray,
    checks: MemberChecks | None = None,
) -> LongTable | None:
    """Return a table of the classes of members; None for one, or more than half as many as members.

    A row has the range of each of the values (n_members,), by their heading, the largest use of a limit, and
    the member that has it; without limits that of the largest force. Tensions below the least one, whose use
    would hide that of the strength, are counted below the table.
    """
    rows: dict[str, list[int]] = {}
    for e, name in enumerate(structure.member_class):
        rows.setdefault(name or ("bar" if structure.is_bar[e] else "cable"), []).append(e)
    if not 2 <= len(rows) <= len(structure.member_class) // 2 or not any(structure.member_class):
        return None
    count = len(member_tension)
    use, strength = (_find_uses(checks, count, limits) for limits in (MEMBER_CHECKS, STRENGTHS))
    use = np.where((use > 1) & ~np.isnan(strength), strength, use)
    weight = np.where(np.isnan(use), np.abs(member_tension) / (1 + np.abs(member_tension).max()) - 2, use)
    worst = {name: max(members, key=lambda e: weight[e]) for name, members in rows.items()}
    names = list(rows)

    def describe(k: int) -> list[str]:
        members, at = rows[names[k]], worst[names[k]]
        texts = [
            " to ".join(dict.fromkeys(f"{x:.5g}" for x in (value[members].min(), value[members].max())))
            for value in values.values()
        ]
        return [names[k], str(len(members)), *texts, _show_use(use[at]), structure.member_name[at]]

    heads = ("class", "members", *values, "largest\nuse", "where")
    order = rank_rows(np.array([-weight[worst[name]] for name in names]))
    return LongTable(
        f"{structure.name}: members by class", heads, f"fr{'r' * len(values)}rf", len(names), describe,
        "classes", (("nearest to their limits, largest force", order),), _count_loose(checks, count),
    )  # fmt: skip


def sizes_table(
    structure: Structure,
    tension: FloatArray,
    radius: FloatArray,
    mass: FloatArray,
    limit: Sequence[str],
    case: Sequence[str],
) -> LongTable:
    """Return a table of members with their sections.

    tension (n_cases, n_members) [N]; radius [m], mass [kg], what decides them and in which load case,
    (n_members,) each.
    """
    length = structure.member_length()

    def describe(e: int) -> list[str]:
        ends = [f"{x:.6g}" for x in dict.fromkeys((tension[:, e].min(), tension[:, e].max()))]
        kind = structure.member_class[e] or ("bar" if structure.is_bar[e] else "cable")
        numbers = (f"{length[e]:.5g}", " to ".join(ends), f"{radius[e]:.6g}", f"{mass[e]:.6g}")
        return [structure.member_name[e], kind, *numbers, limit[e], case[e]]

    heads = ("member", "class", "length\n[m]", "tension\n[N]", "radius\n[m]", "mass\n[kg]", "limit", "case")
    ranking = (("largest mass", rank_rows(-mass)),)
    return LongTable(
        f"{structure.name}: sections", heads, "ffrrrrlf", structure.n_members, describe, "members", ranking
    )


def rank_members(
    structure: Structure | BodySystem, member_tension: FloatArray, checks: MemberChecks | None = None
) -> Ranking:
    """Return which members matter most: nearest to their limits, least tension, largest compression.

    structure: with its bars; member_tension (n_members,) [N]: tensions; checks: members against their limits;
    if there are any, these count in place of the compression of bars, and least tensions by themselves.
    """
    strength, least_use = (
        _find_uses(checks, len(member_tension), limits) for limits in (STRENGTHS, [LEAST_TENSION])
    )
    limited, held = (np.flatnonzero(~np.isnan(use)) for use in (strength, least_use))
    bars = np.flatnonzero(structure.is_bar)
    cables = np.flatnonzero(~structure.is_bar)
    facts = [
        ("nearest to their limits or beyond", limited, -strength),
        ("nearest to their least tension or below", held, -least_use),
        ("cables with least tension", cables if not len(held) else cables[:0], member_tension),
        ("bars with most compression", bars if not len(limited) else bars[:0], member_tension),
    ]
    return tuple(
        (reason, rows[rank_rows(value[rows])].tolist()) for reason, rows, value in facts if len(rows)
    )


def run_table(summary: Mapping[str, Any]) -> "Table":
    """Return a table of the facts about a run that `Trajectory.summary` gives, without the unknown ones."""
    table = new_table("", "fact", "value")
    table.show_header = False
    for key, value in summary.items():
        name, unit = RUN_ROWS.get(key, (key.replace("_", " "), ""))
        if value is None or value == "" or isinstance(value, list | dict):
            continue
        text = (
            f"{value:.6g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else value
        )
        add_row(table, name, f"{text} {unit}".rstrip())
    return table


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(str(size) for size in shape) or "1"
