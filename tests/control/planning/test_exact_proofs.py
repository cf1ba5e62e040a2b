"""Proofs that there is no plan, checked in exact rational arithmetic on a random sample.

Doubles are rational numbers, so positions, loads and displacements are taken as they are. Only changes of
length that are meant to be zero are not exactly zero: an elimination in fractions corrects the displacements
until no bar, and no cable that is meant to keep its length, changes it. What is left to check are signs: a
displacement v changes the length l of a member d by d.v / l, and only l is irrational, and positive.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tensegrity_codegen.control.planning.plan import plan
from tensegrity_codegen.runtime.analysis.certificate import Certificate
from tensegrity_codegen.runtime.records.plan_result import Contradiction, PlanResult
from tensegrity_codegen.structure.structure import Structure
from tests.cases import thorough
from tests.control.planning.structures import (
    CLASSES,
    actuate,
    assemble,
    build_prism,
    compile_plan,
    limit,
)
from tests.control.planning.test_refusals import build_two_cables

ZERO = 1e-9  # of the largest shortening: a change of length that is meant to be none
MOST_CORRECTION = 1e-6  # of the largest displacement


def solve_exactly(rows: list[list[Fraction]], values: list[Fraction]) -> list[Fraction]:
    """Return the values, corrected so that all rows are zero; the largest entries of the rows are pivots."""
    rows = [list(row) for row in rows]
    pivots: list[tuple[int, int]] = []
    for k, row in enumerate(rows):
        column = max(range(len(row)), key=lambda j: abs(row[j]))
        if row[column] == 0:
            continue
        rows[k] = row = [entry / row[column] for entry in row]
        for other in range(len(rows)):
            if other != k and rows[other][column] != 0:
                factor = rows[other][column]
                rows[other] = [a - factor * b for a, b in zip(rows[other], row, strict=True)]
        pivots.append((k, column))
    chosen = {column for _, column in pivots}
    free = [0 if j in chosen else value for j, value in enumerate(values)]
    solved = list(values)
    for k, column in pivots:
        solved[column] = -sum((a * b for a, b in zip(rows[k], free, strict=True)), Fraction(0))
    return solved


def prove_exactly(structure: Structure, found: PlanResult, required: np.ndarray) -> bool:
    """Return whether displacements prove that no tensions of cables balance, some of them required."""
    proof = found.certificate
    assert isinstance(proof, Certificate)
    assert found.proof_position is not None
    assert found.proof_displacement is not None
    position = [[Fraction(x) for x in row] for row in found.proof_position.tolist()]
    held = structure.node_anchored.ravel()
    assert not np.any(found.proof_displacement.ravel()[held])
    # Changes of the squared lengths over two, as rows over the components of the displacements.
    rows = []
    for i, j in structure.connectivity.tolist():
        row = [Fraction(0)] * held.size
        for axis in range(3):
            apart = position[i][axis] - position[j][axis]
            for node, sign in ((i, 1), (j, -1)):
                row[3 * node + axis] = Fraction(0) if held[3 * node + axis] else sign * apart
        rows.append(row)
    kept = [row for row, change in zip(rows, proof.elongation, strict=True) if abs(change) <= ZERO]
    given = [Fraction(x) for x in found.proof_displacement.ravel().tolist()]
    moved = solve_exactly(kept, given)
    correction = max(abs(a - b) for a, b in zip(moved, given, strict=True))
    assert correction <= Fraction(MOST_CORRECTION) * max(abs(x) for x in given)
    # No bar changes its length, no cable becomes longer, loads do no negative work.
    change = [sum((a * b for a, b in zip(row, moved, strict=True)), Fraction(0)) for row in rows]
    load = [Fraction(x) for x in structure.node_load.ravel().tolist()]
    work = sum((f * x for f, x in zip(load, moved, strict=True)), Fraction(0))
    bars = [change[e] for e in np.flatnonzero(structure.is_bar)]
    cables = [change[e] for e in np.flatnonzero(~structure.is_bar)]
    if any(bars) or max(cables) > 0 or work < 0:
        return False
    return work > 0 or min(change[e] for e in np.flatnonzero(required)) < 0


@pytest.mark.parametrize("seed", [0, *thorough(*range(1, 12))])
def test_prisms_of_9_cables_have_no_tensions_at_another_twist(seed: int) -> None:
    draw = np.random.default_rng(seed)
    bars = int(draw.integers(3, 6))
    twist = 90.0 + 180.0 / bars + float(draw.choice([-1, 1]) * draw.uniform(1.0, 20.0))
    radii = draw.uniform(0.1, 0.3, 2)
    shape = {"kind": "prism", "bars": bars, "bottom_radius": radii[0], "top_radius": radii[1], "height": 0.3}
    classes = {**CLASSES, "cable": {**CLASSES["cable"], "prestress": 5.0}}
    structure = assemble({"name": "prism", "classes": classes, "shape": {**shape, "twist": twist}})
    structure = limit(actuate(structure))
    found = plan(compile_plan(structure), "height=0.25")
    assert found.status == "infeasible"
    assert prove_exactly(structure, found, ~structure.is_bar)


@pytest.mark.parametrize("seed", [0, *thorough(*range(1, 12))])
def test_shapes_that_targets_fix_have_no_tensions(seed: int) -> None:
    """The top of a prism on a fixed base, at the twist of its prestress, is to turn, lean and shift."""
    draw = np.random.default_rng(seed)
    shape = {"kind": "prism", "bars": 3, "bottom_radius": 0.15, "height": 0.3, "anchor_bottom": True}
    structure = assemble({"name": "held", "classes": CLASSES, "shape": {**shape, "prestress": 20.0}})
    structure = limit(actuate(structure))
    top = [k for k, name in enumerate(structure.node_name) if name.startswith("t")]
    place = structure.node_position.copy()
    angle = np.radians(draw.choice([-1, 1]) * draw.uniform(5.0, 15.0))
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    place[top] = place[top] @ turn.T + draw.uniform(-0.01, 0.01, (3, 3))
    targets = {
        f"{structure.node_name[k]}.{axis}": float(place[k, column])
        for k in top
        for column, axis in enumerate("xyz")
    }
    found = plan(compile_plan(structure), targets)
    assert found.status == "infeasible"
    assert prove_exactly(structure, found, ~structure.is_bar)
    # Another displacement proves nothing.
    assert found.proof_displacement is not None
    wrong = replace(found, proof_displacement=-found.proof_displacement)
    assert not prove_exactly(structure, wrong, ~structure.is_bar)


@pytest.mark.parametrize("seed", [0, 1, *thorough(*range(2, 12))])
def test_a_node_beyond_the_anchors_of_its_cables(seed: int) -> None:
    draw = np.random.default_rng(seed)
    lengths = np.hypot([1.1, 0.9], 1.0)
    tension = 10.0 * np.array([0.45, 0.55]) * lengths
    structure = build_two_cables(0.1, tuple(lengths - tension / 1000.0))
    side = float(draw.choice([-1, 1]) * draw.uniform(1.001, 2.0))
    found = plan(compile_plan(structure), {"m.x": side, "m.z": float(draw.uniform(-0.5, 0.5))}, steps=5)
    assert found.status == "infeasible"
    assert prove_exactly(structure, found, np.zeros(2, dtype=bool))


@pytest.mark.parametrize("seed", range(12))
def test_limits_of_one_member_contradict_its_length(seed: int) -> None:
    draw = np.random.default_rng(seed)
    structure = limit(actuate(build_prism(155.0), within=0.01), most=30.0)
    member = structure.member_name[int(draw.choice(np.flatnonzero(~structure.is_bar)))]
    index = structure.member_name.index(member)
    factor = float(draw.choice([draw.uniform(0.6, 0.8), draw.uniform(1.3, 1.6)]))
    length = factor * float(structure.member_length()[index])
    found = plan(compile_plan(structure), {f'member_length["{member}"]': length})
    proof = found.certificate
    assert isinstance(proof, Contradiction)
    item = next(item for item in structure.actuators if index in item.members)
    low, high = (Fraction(x) for x in item.range)
    constant, target = Fraction(float(structure.spring_constant[index])), Fraction(length)
    least, most = constant * (target - high), constant * (target - low)
    assert least > 30 or max(most, Fraction(0)) < 1
