"""The order of operations: a permutation that keeps what depends on what, and spreads what waits."""

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.print import instructions as order
from tensegrity_codegen.codegen.print.instructions import Instruction, order_instructions, read_instructions
from tests.cases import thorough


def random_function(seed: int, count: int = 300) -> ca.Function:
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 5)
    values = [x[k] for k in range(5)]
    for _ in range(count):
        a, b = (values[rng.integers(max(0, len(values) - 40), len(values))] for _ in range(2))
        values.append([a + b, a * b, a / (b + 2), ca.sqrt(a * a + b)][rng.integers(4)])
    return ca.Function("f", [x], [ca.vertcat(*values[-7:])])


def printed(instructions: list[Instruction]) -> list[int]:
    return [k for k, item in enumerate(instructions) if item.is_operation or item.operation == ca.OP_OUTPUT]


@pytest.mark.parametrize("reach", [1, 20, 800])
@pytest.mark.parametrize("seed", [1, *thorough(2, 3)])
def test_every_operation_comes_once_and_after_its_operands(
    seed: int, reach: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(order, "LOOK_AHEAD", reach)
    instructions = read_instructions(random_function(seed))
    found = order_instructions(instructions)
    assert sorted(found) == printed(instructions)
    place = {k: n for n, k in enumerate(found)}
    for k in found:
        for operand in instructions[k].operands:
            assert not instructions[operand].is_operation or place[operand] < place[k]


@pytest.mark.parametrize("reach", [1, 20])
def test_none_passes_another_beyond_reach(reach: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(order, "LOOK_AHEAD", reach)
    instructions = read_instructions(random_function(4))
    original = {k: n for n, k in enumerate(printed(instructions))}
    waiting = set(original.values())
    for k in order_instructions(instructions):
        assert original[k] < min(waiting) + reach
        waiting.remove(original[k])


def members(count: int) -> ca.Function:
    """Lengths of vectors that do not depend on each other, one after the other."""
    x = ca.SX.sym("x", 3, count)
    return ca.Function("lengths", [x], [ca.vertcat(*[ca.norm_2(x[:, k]) for k in range(count)])])


def test_what_does_not_depend_on_each_other_goes_side_by_side() -> None:
    instructions = read_instructions(members(6))
    found = order_instructions(instructions)
    place = {k: n for n, k in enumerate(found)}
    readers = {o: k for k in found for o in instructions[k].operands}
    sums = [k for k in found if instructions[k].operation == ca.OP_ADD]
    apart = [place[readers[k]] - place[k] for k in sums]
    assert np.mean(apart) > 3  # in CasADi's order each sum is read at once


def test_lives_are_ended_where_registers_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    instructions = read_instructions(members(40))

    def most_alive() -> int:
        last = {o: n for n, k in enumerate(found) for o in instructions[k].operands}
        place = {k: n for n, k in enumerate(found)}
        return max(sum(place[o] <= n < last[o] for o in last if o in place) for n in range(len(found)))

    monkeypatch.setattr(order, "REGISTERS", 10**6)
    found = order_instructions(instructions)
    with_many = most_alive()
    monkeypatch.setattr(order, "REGISTERS", 6)
    found = order_instructions(instructions)
    assert most_alive() < with_many
