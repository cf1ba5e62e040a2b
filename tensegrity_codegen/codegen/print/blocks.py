"""Blocks of straight-line code: operations that are needed only under a condition may stand in an `if`.

An operation is guarded by a condition if everything that reads it is guarded by that, or chooses it or zero
by that condition. Blocks cost jumps, which a core may foresee wrongly: a condition has them only where it
saves LEAST operations for each value that it chooses.
"""

from collections.abc import Sequence

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import Instruction

LEAST = 20


def find_guards(instructions: Sequence[Instruction]) -> dict[int, int]:
    """Return operation -> the condition that guards it, of those that stand in blocks.

    The largest blocks first; none stands within another.
    """
    unguarded = frozenset[int]()
    guards: list[frozenset[int] | None] = [None] * len(instructions)
    guarded: dict[int, list[int]] = {}
    chosen: dict[int, set[int]] = {}
    for k in reversed(range(len(instructions))):
        item, own = instructions[k], guards[k] or unguarded
        for condition in own if item.is_operation else ():
            guarded.setdefault(condition, []).append(k)
        chooses = item.operation == ca.OP_IF_ELSE_ZERO
        for place, operand in enumerate(item.operands):
            known, new = guards[operand], own
            if chooses and place == 1:
                new = own | {item.operands[0]}
                chosen.setdefault(item.operands[0], set()).add(operand)
            guards[operand] = new if known is None else known & new
    found: dict[int, int] = {}
    for condition, block in sorted(guarded.items(), key=lambda entry: -len(entry[1])):
        if len(block) >= LEAST * len(chosen[condition]) and found.keys().isdisjoint(block):
            found.update(dict.fromkeys(reversed(block), condition))
    return found
