"""What a plan found, in one sentence of numbers: the headline of its page."""

import math

import numpy as np

from tensegrity_codegen.report.number_text import format_short
from tensegrity_codegen.report.pages.joined_series import join_names
from tensegrity_codegen.runtime.records.plan_result import LIMIT_WORDS, Contradiction, PlanResult
from tensegrity_codegen.structure.limits import Limits

EXACT = 1e-6  # of the change of a target: what is missed by less counts as reached


def describe_plan_finding(found: PlanResult, limits: Limits) -> str:
    """Return whether the targets are reached, when, and the smallest tension of the cables on the way.

    Parameters
    ----------
    found : PlanResult
        The plan.
    limits : Limits
        Limits of the members of the plan.
    """
    if found.status == "infeasible":
        return _describe_contradiction(found)
    if found.status == "blocked":
        return "; ".join(filter(None, (_describe_block(found), _describe_tension(found, limits))))
    if not found.n_steps:
        return f"Reached at the start: {_name_targets(found)}; nothing moves"
    parts = [f"Reached{_describe_error(found)}: {_name_targets(found)}{_describe_time(found)}"]
    tension = _describe_tension(found, limits)
    return "; ".join([*parts, tension] if tension else parts)


def _name_targets(found: PlanResult) -> str:
    """Return the targets with start and goal: "twist 155 to 165 deg"; of many their number."""
    if len(found.target_name) > 2:
        return f"{len(found.target_name)} targets"
    texts = [
        f"{name} {_pair(float(found.target[0, k]), float(found.goal[k]))} {unit}".rstrip()
        for k, (name, unit) in enumerate(zip(found.target_name, found.target_unit, strict=True))
    ]
    return ", ".join(texts)


def _pair(start: float, goal: float) -> str:
    """Return two numbers with the digits that tell them apart."""
    digits = 3
    while digits < 9 and start != goal and format_short(start, digits) == format_short(goal, digits):
        digits += 1
    return f"{format_short(start, digits)} to {format_short(goal, max(digits, 4))}"


def _describe_error(found: PlanResult) -> str:
    """Return how far the end is from the goals: "" if it meets them, or " within 0.02 deg"."""
    missed = np.abs(found.target[-1] - found.goal)
    change = np.abs(found.goal - found.target[0])
    far = np.flatnonzero(missed > EXACT * np.maximum(change, 1e-300))
    if not len(far):
        return ""
    units = {found.target_unit[k] for k in far.tolist()}
    if len(units) > 1:
        return f" within {format_short(100 * float(np.max(missed[far] / change[far])), 2)} % of the way"
    return f" within {format_short(float(missed[far].max()), 2)} {units.pop()}".rstrip()


def _describe_time(found: PlanResult) -> str:
    return "" if found.time is None else f" in {format_short(float(found.time[-1]))} s"


def _describe_tension(found: PlanResult, limits: Limits) -> str:
    """Return the smallest tension of the cables, the member and its limit; "" without cables or path."""
    cables = np.flatnonzero(found.is_cable)
    if not len(cables) or not len(found.member_tension):
        return ""
    tension = found.member_tension[:, cables]
    column = int(tension.min(axis=0).argmin())
    bound = float(limits.least_tension[cables[column]])
    limit = f", limit {format_short(bound)} N" if math.isfinite(bound) else ""
    return f"smallest cable tension {format_short(float(tension.min()))} N{limit}"


def _describe_block(found: PlanResult) -> str:
    """Return where the path ends, and what binds there."""
    progress = 0.0 if found.block is None else found.block.progress
    text = f"Blocked at {format_short(100 * progress)} % of the way"
    if len(found.target_name) == 1 and len(found.target):
        unit = f" {found.target_unit[0]}".rstrip()
        values = [format_short(float(value), 4) for value in (found.target[-1, 0], found.goal[0])]
        text += f", {found.target_name[0]} {values[0]} of {values[1]}{unit}"
    if found.block is None or not found.block.binding:
        return text
    first = found.block.binding[0].limit
    names = [item.name for item in found.block.binding if item.limit == first]
    others = {LIMIT_WORDS[item.limit] for item in found.block.binding} - {LIMIT_WORDS[first]}
    of = join_names(names)
    text += f": limited by {LIMIT_WORDS[first]}{f' of {of}' if of else ''}"
    return f"{text}, {' and '.join(sorted(others))}" if others else text


def _describe_contradiction(found: PlanResult) -> str:
    proof = found.certificate
    if isinstance(proof, Contradiction):
        word = LIMIT_WORDS.get(proof.limit, proof.limit.replace("_", " "))
        return (
            f"No plan exists: {proof.target} needs {format_short(proof.given)} {proof.unit} of {proof.name}, "
            f"the limit ({word}) is {format_short(proof.allowed)} {proof.unit}"
        )
    if proof is None:
        return "No plan exists"
    count = len(proof.shortening)
    return (
        f"No plan exists: in the shape of the target cables are slack, for a motion shortens {count} "
        f"cable{'s' * (count != 1)}, lengthens none and changes no bar"
    )
