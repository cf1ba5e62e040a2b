"""Plans as JSON-ready data, in tables for the terminal, and in one sentence."""

import dataclasses
import math
from typing import Any

import numpy as np
from rich.table import Table

from tensegrity_codegen.report.long_table import LongTable, add_row, new_table, rank_rows
from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.page import join_names
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.records.plan_result import LIMIT_WORDS, Contradiction, Cover, PlanResult
from tensegrity_codegen.structure.limits import Limits

REACHED_WITHIN = 1e-6  # of the change of a target: one missed by less counts as reached


def describe_plan(plan: PlanResult) -> dict[str, Any]:
    """Return a plan as one JSON-ready object."""
    return {
        "status": plan.status,
        "message": plan.message,
        "n_steps": plan.n_steps,
        "progress": plan.progress,
        "targets": [
            {
                "name": name,
                "unit": unit,
                "start": float(plan.target[0, k]) if len(plan.target) else None,
                "reached": float(plan.target[-1, k]) if len(plan.target) else None,
                "goal": float(plan.goal[k]),
            }
            for k, (name, unit) in enumerate(zip(plan.target_name, plan.target_unit, strict=True))
        ],
        "actuators": {
            name: {
                "start": float(plan.rest_length[0, k]),
                "end": float(plan.rest_length[-1, k]),
                "change": float(plan.change[-1, k] - plan.change[0, k]),
            }
            for k, name in enumerate(plan.actuator_name)
            if len(plan.change)
        },
        "duration": None if plan.time is None else float(plan.time[-1]),
        **_extremes(plan),
        "binding": [[record.as_dict() for record in bindings] for bindings in plan.binding],
        "block": None if plan.block is None else plan.block.as_dict(),
        "branches": [record.as_dict() for record in plan.branches],
        "certificate": _describe_proof(plan),
        "warnings": plan.warnings,
    }


def targets_table(plan: PlanResult, name: str) -> Table:
    """Return a table of the targets: start, reached, goal."""
    table = new_table(f"{name}: targets", "target", start="right", reached="right", goal="right", unit="left")
    for k, target in enumerate(plan.target_name):
        ends = [f"{plan.target[row, k]:.6g}" for row in (0, -1)] if len(plan.target) else ["", ""]
        add_row(table, target, *ends, f"{plan.goal[k]:.6g}", plan.target_unit[k])
    return table


def actuators_table(plan: PlanResult, name: str) -> LongTable | None:
    """Return a table of the actuators: rest lengths at the start and at the end; None without a path."""
    if plan.n_steps == 0:
        return None
    start, end = plan.rest_length[0], plan.rest_length[-1]
    change = 1000 * (plan.change[-1] - plan.change[0])  # those of their own inputs
    return LongTable(
        f"{name}: rest lengths", ("actuator", "start\n[m]", "end\n[m]", "change\n[mm]"), "frrr",
        len(plan.actuator_name),
        lambda k: (plan.actuator_name[k], f"{start[k]:.6f}", f"{end[k]:.6f}", f"{change[k]:+.3f}"),
        "actuators", (("largest change", rank_rows(-np.abs(change))),),
    )  # fmt: skip


def binding_table(plan: PlanResult, name: str) -> LongTable | None:
    """Return a table of the limits that block a path, with their multipliers; None without a block."""
    if plan.block is None or not plan.block.binding:
        return None
    binding = plan.block.binding

    def describe(k: int) -> tuple[str, ...]:
        item = binding[k]
        unit = f"/{item.unit}" if "/" not in item.unit else "m/N"
        value, gained = f"{item.bound:.6g} {item.unit}", f"{item.multiplier:.4g} {unit}"
        return LIMIT_WORDS[item.limit], item.name, value, gained

    return LongTable(
        f"{name}: limits that bind", ("limit", "of", "value", "progress for a unit"), "ffrr", len(binding),
        describe, "limits", (("most progress for one per cent of the limit", list(range(len(binding)))),),
    )  # fmt: skip


def certificate_table(plan: PlanResult, name: str) -> LongTable | None:
    """Return a table of the members in the displacements that prove it; None without such a proof."""
    proof = plan.certificate
    if not isinstance(proof, Certificate):
        return None
    change = proof.elongation
    return LongTable(
        f"{name}: displacements that prove it", ("member", "change of length"), "fr",
        len(plan.member_name), lambda e: (plan.member_name[e], f"{change[e]:+.3g}"), "members",
        (("largest change of length", rank_rows(-np.abs(change))),),
    )  # fmt: skip


def describe_extremes(plan: PlanResult) -> list[str]:
    """Return the least tension, clearance and eigenvalue along the path, a line each."""
    data = _extremes(plan)
    lines = []
    if data["largest_tension"] is not None:
        lines.append(
            f"tensions of cables from {data['least_tension']['value']:.4g} N "
            f"({data['least_tension']['member']}) to {data['largest_tension']['value']:.4g} N "
            f"({data['largest_tension']['member']})"
        )
    if data["least_distance"] is not None:
        lines.append(
            f"least distance between bars {data['least_distance']['value']:.4g} m "
            f"({data['least_distance']['bars']})"
        )
    if plan.n_steps:
        lines.append(f"smallest eigenvalue of the stiffness {data['smallest_eigenvalue']:.4g} N/m")
    return lines


def _extremes(plan: PlanResult) -> dict[str, Any]:
    """Return the extremes along the path: tensions of cables, distances, eigenvalue, residual."""
    data: dict[str, Any] = dict.fromkeys(
        ("least_tension", "largest_tension", "least_distance", "smallest_eigenvalue", "largest_residual")
    )
    if plan.status == "infeasible" and plan.block is None:  # there is no path
        return data
    cables = np.flatnonzero(np.array(plan.is_cable))
    if len(cables):
        tension = plan.member_tension[:, cables]
        for key, index in (("least_tension", tension.argmin()), ("largest_tension", tension.argmax())):
            step, column = np.unravel_index(int(index), tension.shape)
            member = plan.member_name[cables[column]]
            data[key] = {"value": float(tension[step, column]), "member": member, "step": int(step)}
    if plan.bar_distance.size:
        step, pair = np.unravel_index(int(plan.bar_distance.argmin()), plan.bar_distance.shape)
        data["least_distance"] = {
            "value": float(plan.bar_distance[step, pair]),
            "bars": plan.bar_pair_name[pair],
            "step": int(step),
        }
    data["smallest_eigenvalue"] = float(plan.smallest_eigenvalue.min())
    data["largest_residual"] = float(plan.residual.max())
    return data


def _describe_proof(plan: PlanResult) -> dict[str, Any] | None:
    proof = plan.certificate
    if proof is None:
        return None
    if isinstance(proof, Cover):
        return {"kind": "cover", "half": proof.half, "change": proof.change.tolist(), "end": proof.end}
    if not isinstance(proof, Certificate):
        return {"kind": "contradiction", **dataclasses.asdict(proof)}
    return {
        "kind": "displacements",
        "is_verified": proof.is_verified,
        "shortening": [plan.member_name[e] for e in proof.shortening],
        "error": proof.error,
        "load_work": proof.load_work,
        "displacement": proof.displacement,
        "elongation": dict(zip(plan.member_name, proof.elongation.tolist(), strict=True)),
    }


# The result of a plan, in one sentence of numbers: the headline of its page.


def describe_plan_finding(plan: PlanResult, limits: Limits) -> str:
    """Return whether the targets are reached, when, and the smallest tension of the cables on the way."""
    if plan.status == "infeasible":
        return _describe_contradiction(plan)
    if plan.status == "blocked":
        return "; ".join(filter(None, (_describe_block(plan), _describe_tension(plan, limits))))
    if not plan.n_steps:
        return f"Reached at the start: {_name_targets(plan)}; nothing moves"
    duration = "" if plan.time is None else f" in {format_short(float(plan.time[-1]))} s"
    clauses = [f"Reached{_describe_error(plan)}: {_name_targets(plan)}{duration}"]
    tension = _describe_tension(plan, limits)
    return "; ".join([*clauses, tension] if tension else clauses)


def _name_targets(plan: PlanResult) -> str:
    """Return the targets with start and goal: "twist 155 to 165 deg"; of many their number."""
    if len(plan.target_name) > 2:
        return f"{len(plan.target_name)} targets"
    texts = [
        f"{name} {_pair(float(plan.target[0, k]), float(plan.goal[k]))} {unit}".rstrip()
        for k, (name, unit) in enumerate(zip(plan.target_name, plan.target_unit, strict=True))
    ]
    return ", ".join(texts)


def _pair(start: float, goal: float) -> str:
    """Return two numbers with the digits that tell them apart."""
    digits = 3
    while digits < 9 and start != goal and format_short(start, digits) == format_short(goal, digits):
        digits += 1
    return f"{format_short(start, digits)} to {format_short(goal, max(digits, 4))}"


def _describe_error(plan: PlanResult) -> str:
    """Return how far the end is from the goals: "" if it meets them, or " within 0.02 deg"."""
    missed = np.abs(plan.target[-1] - plan.goal)
    change = np.abs(plan.goal - plan.target[0])
    far = np.flatnonzero(missed > REACHED_WITHIN * np.maximum(change, 1e-300))
    if not len(far):
        return ""
    units = {plan.target_unit[k] for k in far.tolist()}
    if len(units) > 1:
        return f" within {format_short(100 * float(np.max(missed[far] / change[far])), 2)} % of the way"
    return f" within {format_short(float(missed[far].max()), 2)} {units.pop()}".rstrip()


def _describe_tension(plan: PlanResult, limits: Limits) -> str:
    """Return the smallest tension of the cables, the member and its limit; "" without cables or path."""
    cables = np.flatnonzero(plan.is_cable)
    if not len(cables) or not len(plan.member_tension):
        return ""
    tension = plan.member_tension[:, cables]
    column = int(tension.min(axis=0).argmin())
    bound = float(limits.least_tension[cables[column]])
    limit = f", limit {format_short(bound)} N" if math.isfinite(bound) else ""
    return f"smallest cable tension {format_short(float(tension.min()))} N{limit}"


def _describe_block(plan: PlanResult) -> str:
    """Return the end of the path, and the limits that bind there."""
    progress = 0.0 if plan.block is None else plan.block.progress
    sentence = f"Blocked at {format_short(100 * progress)} % of the way"
    if len(plan.target_name) == 1 and len(plan.target):
        unit = f" {plan.target_unit[0]}".rstrip()
        values = [format_short(float(value), 4) for value in (plan.target[-1, 0], plan.goal[0])]
        sentence += f", {plan.target_name[0]} {values[0]} of {values[1]}{unit}"
    if plan.block is None or not plan.block.binding:
        return sentence
    limit = plan.block.binding[0].limit
    names = [binding.name for binding in plan.block.binding if binding.limit == limit]
    further = {LIMIT_WORDS[binding.limit] for binding in plan.block.binding} - {LIMIT_WORDS[limit]}
    of = join_names(names)
    sentence += f": limited by {LIMIT_WORDS[limit]}{f' of {of}' if of else ''}"
    return f"{sentence}, {' and '.join(sorted(further))}" if further else sentence


def _describe_contradiction(plan: PlanResult) -> str:
    proof = plan.certificate
    if isinstance(proof, Contradiction):
        limit = LIMIT_WORDS.get(proof.limit, proof.limit.replace("_", " "))
        return (
            f"No plan exists: {proof.target} needs {format_short(proof.given)} {proof.unit} of {proof.name}, "
            f"the limit ({limit}) is {format_short(proof.allowed)} {proof.unit}"
        )
    if isinstance(proof, Cover):
        return f"No plan exists: {_describe_block(plan).replace('Blocked', 'blocked', 1)}"
    if proof is None:
        return "No plan exists"
    count = len(proof.shortening)
    return (
        f"No plan exists: in the shape of the target cables are slack, for a motion shortens {count} "
        f"cable{'s' * (count != 1)}, lengthens none and changes no bar"
    )
