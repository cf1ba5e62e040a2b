"""Operations that all members of a kind share, found in a function's instructions: they become one loop.

A member is a square root, its length. Operations that depend on the length of one member alone, and those
that only they read, belong to this member. Members whose operations are the same but for their numbers and
for values that come from outside form a loop. Every operation stays as it is, and so do all results, to the
bit; a compiler turns such a loop into vectors.
"""

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca

from tensegrity_codegen.codegen.print.instructions import Instruction

MIN_MEMBERS = 4  # of a loop; fewer are written one by one
SUMS = frozenset(
    {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG}
)  # that join members at nodes, or take differences of nodes
SEVERAL = -1  # in place of a member: an operation depends on the lengths of several

Reference = tuple[
    str, int
]  # ("operation" | "value" | "number", index in the loop's body, columns or numbers)


@dataclass(frozen=True)
class MemberLoop:
    """Operations that some members share.

    members: square roots, one a member; body: operation and operands of each step; steps: instructions of
    each step, member by member, None where a member has no such step; values: of each member the instructions
    that it takes from outside; numbers: likewise its constants; number_operations: the operations that take
    these up; results: steps that are read outside.
    """

    members: tuple[int, ...]
    body: tuple[tuple[int, tuple[Reference, ...]], ...]
    steps: tuple[tuple[int | None, ...], ...]
    values: tuple[tuple[int, ...], ...]
    numbers: tuple[tuple[float, ...], ...]
    number_operations: tuple[int, ...]
    results: tuple[int, ...]


def find_member_loops(
    instructions: Sequence[Instruction],
    readers: Sequence[Sequence[int]],
    number: Mapping[int, int] = MappingProxyType({}),
    label: Mapping[int, str] = MappingProxyType({}),
) -> tuple[MemberLoop, ...]:
    """Return the loops of a function.

    readers: of each instruction those that take up its value; number: square root -> number of its member,
    where that is known, which orders a loop; label: instruction -> what its value is to a member.
    """
    own: dict[int, list[int]] = {}
    for k, root in enumerate(_find_owners(instructions, readers)):
        if root is not None:
            own.setdefault(root, []).append(k)
    keys = _Keys(instructions, label)
    members = {root: keys.describe(steps) for root, steps in own.items()}
    # A member whose operations are among those of another shares its loop.
    groups: dict[int, list[int]] = {}
    for root in sorted(members, key=lambda root: -len(members[root].steps)):
        leader = next((leader for leader in groups if members[leader].covers(members[root])), root)
        groups.setdefault(leader, []).append(root)
    loops = []
    for leader, group in groups.items():
        roots = sorted(group, key=lambda root: (number.get(root, len(instructions)), root))
        if len(roots) >= MIN_MEMBERS:
            loops.append(_build_loop(instructions, readers, members[leader], members, roots))
    return tuple(loops)


def _find_owners(instructions: Sequence[Instruction], readers: Sequence[Sequence[int]]) -> list[int | None]:
    """Return the member that each instruction belongs to, if any."""
    owner: list[int | None] = [None] * len(instructions)
    for k, instruction in enumerate(instructions):
        members = {owner[operand] for operand in instruction.operands} - {None}
        if instruction.is_operation and members:
            owner[k] = members.pop() if len(members) == 1 else SEVERAL
        elif instruction.operation == ca.OP_SQRT:
            owner[k] = k
    own = [member if member is not None and member != SEVERAL else None for member in owner]
    # Operations before a length belong to it where nobody else reads them, but for differences of nodes.
    for k in reversed(range(len(instructions))):
        if instructions[k].is_operation and owner[k] is None and readers[k]:
            members = {own[reader] for reader in readers[k]}
            own[k] = members.pop() if len(members) == 1 else None
    for k, instruction in enumerate(instructions):
        is_outside = all(own[operand] is None for operand in instruction.operands)
        if own[k] is not None and owner[k] is None and instruction.operation in SUMS and is_outside:
            own[k] = None
    # Sums at nodes are outside, and so are operations that few members have.
    for k in reversed(range(len(instructions))):
        is_last = all(own[reader] != own[k] for reader in readers[k])
        if own[k] is not None and owner[k] is not None and instructions[k].operation in SUMS and is_last:
            own[k] = None
    counts, trees = _count_trees(instructions, own)
    return [member if counts[trees[k]] >= MIN_MEMBERS else None for k, member in enumerate(own)]


def _count_trees(
    instructions: Sequence[Instruction], own: Sequence[int | None]
) -> tuple[Counter[int], list[int]]:
    """Return of how many members each tree of operations is one, and the tree of each instruction."""
    number: dict[tuple[object, ...], int] = {}
    trees: list[int] = []
    for k, instruction in enumerate(instructions):
        key: tuple[object, ...] = (instruction.operation == ca.OP_CONST,)
        if own[k] is not None:
            inner = (trees[operand] if own[operand] == own[k] else -1 for operand in instruction.operands)
            key = (instruction.operation, *inner)
        trees.append(number.setdefault(key, len(number)))
    return Counter(tree for tree, _ in {(trees[k], m) for k, m in enumerate(own) if m is not None}), trees


@dataclass(frozen=True)
class _Member:
    """Operations of one member, and its values from outside, as key -> instruction; constants likewise.

    Keys of operations tell trees apart, and those of constants the operation and the operand. passed: key
    of an operation that other members may lack, as it passes a value on -> key of that value; operands: keys
    of the operands of each operation, None for constants.
    """

    steps: Mapping[int, int]
    values: Mapping[int, int]
    constants: Mapping[tuple[int, int], float]
    passed: Mapping[int, int]
    operands: Mapping[int, tuple[int | None, ...]]

    def covers(self, member: "_Member") -> bool:
        """Whether the operations of the other member are among these, with all values that these take."""
        if not (member.steps.keys() <= self.steps.keys() and self.values.keys() <= member.values.keys()):
            return False
        return all(
            tuple(k if k is None else self.find_in(member, k) for k in self.operands[key]) == operands
            for key, operands in member.operands.items()
        )

    def find_in(self, member: "_Member", key: int) -> int:
        """Return the key of the same value in another member, which may lack operations that pass it on."""
        while key in self.passed and key not in member.steps:
            key = self.passed[key]
        return key


class _Keys:
    """Numbers of trees of operations, the same for equal trees of different members."""

    def __init__(self, instructions: Sequence[Instruction], label: Mapping[int, str]) -> None:
        self.instructions = instructions
        self.label = label
        self.number: dict[tuple[object, ...], int] = {}
        self.squares = {i.operands[0] for i in instructions if i.operation == ca.OP_SQRT}

    def describe(self, own: Sequence[int]) -> _Member:
        """Return the member that has these instructions."""
        steps: dict[int, int] = {}
        values: dict[int, int] = {}
        constants: dict[tuple[int, int], float] = {}
        passed: dict[int, int] = {}
        key_of: dict[int, int] = {}
        operands: dict[int, tuple[int | None, ...]] = {}
        tree: dict[int, int] = {}  # as it is taken up: a value that is passed on has the tree of that value
        for k in own:
            instruction = self.instructions[k]
            for operand in instruction.operands:
                if self.instructions[operand].operation != ca.OP_CONST and operand not in tree:
                    tree[operand] = self._choose(("value", self.label.get(operand, "")), values)
                    values[tree[operand]] = operand
                    key_of[operand] = tree[operand]
            key = self._choose((instruction.operation, *map(tree.get, instruction.operands)), steps)
            steps[key], tree[k], key_of[k] = k, key, key
            operands[key] = tuple(map(key_of.get, instruction.operands))
            for position, operand in enumerate(instruction.operands):
                if operand not in tree:
                    constants[key, position] = self.instructions[operand].value
            source = self._find_source(k)
            if source is not None and source in own:
                tree[k], passed[key] = tree[source], key_of[source]
        return _Member(steps, values, constants, passed, operands)

    def _find_source(self, k: int) -> int | None:
        """Return the value that an operation of a cable passes on: if it is taut, and off length zero."""
        instruction = self.instructions[k]
        if instruction.operation == ca.OP_IF_ELSE_ZERO:
            return instruction.operands[1]
        is_offset = instruction.operation == ca.OP_ADD and k in self.squares
        source, offset = instruction.operands if is_offset else (0, 0)
        return source if is_offset and self.instructions[offset].operation == ca.OP_CONST else None

    def _choose(self, tree: tuple[object, ...], taken: Mapping[int, int]) -> int:
        """Return the number of a tree; where a member has the same more than once, of its next occurrence."""
        for occurrence in itertools.count():
            number = self.number.setdefault((*tree, occurrence), len(self.number))
            if number not in taken:
                return number
        raise AssertionError


def _build_loop(
    instructions: Sequence[Instruction],
    readers: Sequence[Sequence[int]],
    leader: _Member,
    members: Mapping[int, _Member],
    roots: Sequence[int],
) -> MemberLoop:
    """Return the loop of these members, with all operations of the leader."""
    chosen = [members[root] for root in roots]
    reference: dict[int, Reference] = {k: ("value", n) for n, k in enumerate(leader.values.values())}
    body: list[tuple[int, tuple[Reference, ...]]] = []
    rows: list[list[int | None]] = []
    columns: list[list[float]] = []
    operations: list[int] = []

    def refer(numbers: list[float], operation: int) -> Reference:
        columns.append(numbers)
        operations.append(operation)
        return "number", len(columns) - 1

    place: dict[int, int] = {}
    for key, k in leader.steps.items():
        operation, operands = instructions[k].operation, list[Reference]()
        lacking = [key in leader.passed and key not in member.steps for member in chosen]
        for position, operand in enumerate(instructions[k].operands):
            if operand in reference:
                operands.append(reference[operand])
                continue
            number = leader.constants[key, position]
            column = [member.constants.get((key, position), number) for member in chosen]
            column = [0.0 if lacks else n for n, lacks in zip(column, lacking, strict=True)]
            operands.append(refer(column, operation))
        row = [member.steps.get(key) for member in chosen]
        if any(lacking):
            for m, member in enumerate(chosen):
                source = leader.find_in(member, key)
                if lacking[m] and source in member.steps:
                    row[m], rows[place[source]][m] = member.steps[source], None
            if operation == ca.OP_IF_ELSE_ZERO:  # taut, or a member that pushes too
                condition = leader.operands[key][0]
                is_free = all(
                    condition not in m.steps for m, lacks in zip(chosen, lacking, strict=True) if lacks
                )
                kind, limit = body[operands[0][1]][1][0] if operands[0][0] == "operation" else operands[0]
                if is_free and kind == "number" and body[operands[0][1]][0] == ca.OP_LT:  # they have no limit
                    pairs = zip(columns[limit], lacking, strict=True)
                    columns[limit] = [-math.inf if lacks else number for number, lacks in pairs]
                else:
                    body.append(
                        (ca.OP_OR, (operands[0], refer([float(lacks) for lacks in lacking], ca.OP_OR)))
                    )
                    rows.append([None] * len(chosen))
                    operands[0] = ("operation", len(body) - 1)
        place[key] = len(body)
        reference[k] = ("operation", len(body))
        body.append((operation, tuple(operands)))
        rows.append(row)
    inside = [set(member.steps.values()) for member in chosen]
    results = tuple(
        n
        for n, row in enumerate(rows)
        if any(k is not None and not own.issuperset(readers[k]) for k, own in zip(row, inside, strict=True))
    )
    values = tuple(tuple(member.values[key] for key in leader.values) for member in chosen)
    numbers = tuple(zip(*columns, strict=True)) if columns else tuple(() for _ in chosen)
    return MemberLoop(
        tuple(roots), tuple(body), tuple(map(tuple, rows)), values, numbers, tuple(operations), results
    )
