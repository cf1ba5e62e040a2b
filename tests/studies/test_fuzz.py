"""Random scenes and settings: a status never calls good what is not, nothing hangs, nothing crashes."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tensegrity_codegen.structure.structure import Structure
from tensegrity_codegen.studies.stability.cases import Case, move_node, settle_bars, with_rigid_bars
from tensegrity_codegen.studies.stability.judge import Limits, Outcome
from tensegrity_codegen.studies.stability.methods import CaseModels, list_methods
from tensegrity_codegen.studies.stability.report import run_case
from tests.runtime.build import bar, cable, make_structure, prism, spring

# benchmarks/fuzz.py runs the same examples. Compiling takes longer than running: a few structures are
# compiled once each, with everything that may differ as run-time arguments, and drawn many times.
FloatArray = NDArray[np.float64]


def _planar() -> Structure:
    """Two crossing bars in a frame of four cables, one node held."""
    position = [[0, 0, 0], [0.6, 0, 0], [0.6, 0, 0.4], [0, 0, 0.4]]
    frame = [cable(i, (i + 1) % 4, 0.4, damping=0.1) for i in range(4)]
    members = [bar(0, 2, 0.72), bar(1, 3, 0.72), *frame]
    return make_structure(position, members, anchored={0: "xyz", 1: "z"}, axes="xz", gravity=(0, 0, -9.81))


def _chain() -> Structure:
    """A two-sided spring, a bar with mass and a cable in a row, hung from a point."""
    position = [[0, 0, 0], [0.1, 0, -1], [0, 0.1, -2], [0.2, 0, -2.9]]
    members = [spring(0, 1, 0.9), bar(1, 2, 1.0, mass=0.5), cable(2, 3, 0.9, damping=0.1)]
    return make_structure(position, members, anchored={0: "xyz"}, gravity=(0, 0, -9.81))


def _joined_bars() -> Structure:
    """Two bars that share a node, stayed by cables: class 2."""
    position = [[0, 0, 0], [0, 0, 1], [0.1, 0, 2], [1, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0]]
    stays = [cable(top, foot, 0.9, damping=0.1) for top in (1, 2) for foot in (3, 4, 5)]
    members = [bar(0, 1, 1.0, mass=0.3), bar(1, 2, 1.0, mass=0.3), *stays]
    held = dict.fromkeys((0, 3, 4, 5), "xyz")
    return make_structure(position, members, anchored=held, gravity=(0, 0, -9.81))


# What may be odd about one joined pair of nodes or one number, and whether only a named error is right then.
ODDITIES = {
    "one place": False,  # two joined nodes, whose cable may be slack
    "nearly one place": False,
    "nan": True,
    "inf": True,
    "denormal": False,
}
ODD_NUMBERS = {"nan": np.nan, "inf": np.inf, "denormal": 5e-324}
FAR = (2.0, 7.0)  # powers of ten [m]
BASES = {"prism": prism, "planar": _planar, "chain": _chain, "joined bars": _joined_bars}


@dataclass(frozen=True)
class Example:
    """What is drawn: a base, its bars, sizes as powers of ten or None for none, a method and its setting."""

    base: str
    seed: int
    method: str
    rigid: bool
    t_end: float
    tolerance: float  # power of ten, of rtol or of the step over the time
    stiffness: float  # of bars over cables
    masses: float  # largest over smallest
    damping: float | None  # of cables, over critical
    speed: float | None  # mean lengths a second
    shake: float | None  # of the nodes, mean lengths
    prestress: float | None  # strain of the cables; some negative
    keeps_tension: bool  # whether bars start at the tension of the base, or stretched as cables are
    offset: float | None  # of the origin, power of ten [m], in a direction of its own
    oddity: str | None  # one of ODDITIES


def examples(*, far: bool = False) -> st.SearchStrategy[Example]:
    """Examples of everything, from tame to absurd; far: half of them far from the origin.

    Each follows from one number: of many, hypothesis would repeat most from example to example.
    """
    return st.integers(0, 2**62).map(lambda number: draw_example(number, far=far))


def draw_example(number: int, *, far: bool = False) -> Example:
    """Return the example of a number; far: of every two numbers one lies 1e2 m to 1e7 m from the origin."""
    example = _draw(np.random.default_rng(number))
    place = np.random.default_rng([number, 1])
    moved = far and int(place.integers(2)) == 0
    return replace(example, offset=float(place.uniform(*FAR))) if moved else example


def _draw(rng: np.random.Generator) -> Example:

    def one_in(count: int) -> bool:
        return int(rng.integers(count)) == 0

    def power(least: float, most: float) -> float:
        return float(rng.uniform(least, most))

    def maybe(least: float, most: float, count: int = 2) -> float | None:
        return power(least, most) if one_in(count) else None

    method = str(rng.choice(["auto", "rk54", "rk853", "radau", "rk4"]))
    wild = (-320.0, 300.0) if one_in(20) else (-5.0, -0.5) if method == "rk4" else (-11.0, -1.0)
    return Example(
        base=str(rng.choice(sorted(BASES))),
        seed=int(rng.integers(2**32)),
        method=method,
        rigid=one_in(4),
        t_end=10 ** power(-2.5, 0.3),
        tolerance=power(*wild),
        stiffness=power(0.0, 12.0),
        masses=power(0.0, 9.0) if one_in(4) else power(0.0, 2.0),
        damping=maybe(-3.0, 3.0),
        speed=maybe(-3.0, 3.0),
        shake=maybe(-12.0, -0.3),
        prestress=maybe(-4.0, -0.3),
        keeps_tension=one_in(2),
        offset=maybe(0.0, 9.0, 10),
        oddity=str(rng.choice(sorted(ODDITIES))) if one_in(10) else None,
    )


@cache
def models_of(base: str) -> CaseModels:
    """Return the compiled models of a base."""
    return CaseModels(BASES[base](), compiler=None, flags="reference")


def run_example(example: Example, limits: Limits) -> Outcome:
    """Return how the method of an example ends, judged."""
    setting = 10.0**example.tolerance
    step, rtol = (setting, 1e-6) if example.method == "rk4" else (None, setting)
    refused = example.oddity is not None and ODDITIES[example.oddity]
    case = Case("fuzz", str(example.seed), build(example), example.t_end, rtol, step, refused)
    method = example.method
    if step is None and method not in list_methods(case.structure):
        method = "rk853"
    (outcome,) = run_case(models_of(example.base), case, limits, (method,))
    return outcome


def build(example: Example) -> Structure:
    """Return the structure of an example."""
    rng, base = np.random.default_rng(example.seed), BASES[example.base]()
    free = ~base.node_anchored & np.isin(np.arange(3), base.axes)
    length = float(base.member_length().mean())
    position = base.node_position + _noise(rng, free, example.shake, length)
    if example.offset is not None:
        position = position + _offset(example.seed, base.axes, 10.0**example.offset)
    changed = base.with_changes(
        node_position=position,
        node_velocity=_noise(rng, free, example.speed, length),
        node_mass=10.0 ** rng.uniform(-example.masses / 2, example.masses / 2, base.n_nodes),
    )
    changed = changed.with_changes(**_members(rng, changed, example))
    changed = settle_bars(with_rigid_bars(changed)) if example.rigid else changed
    return changed if example.oddity is None else _odd(rng, changed, example.oddity)


def _offset(seed: int, axes: tuple[int, ...], distance: float) -> FloatArray:
    """Return a vector (3,) of that length [m] along the axes of a structure."""
    drawn = np.random.default_rng([seed, 1]).standard_normal(3)
    along = np.where(np.isin(np.arange(3), axes), drawn, 0.0)
    return np.asarray(distance * along / np.linalg.norm(along))


def _odd(rng: np.random.Generator, structure: Structure, oddity: str) -> Structure:
    """Return the structure with one free coordinate or velocity, or two joined nodes, at an extreme."""
    if oddity in ODD_NUMBERS:
        name = str(rng.choice(["node_position", "node_velocity"]))
        node, axis = structure.coordinate_node_axis[rng.integers(structure.n_coordinates)]
        values = getattr(structure, name).copy()
        values[node, axis] = ODD_NUMBERS[oddity]
        return settle_bars(structure.with_changes(**{name: values}))
    i, j = structure.connectivity[rng.integers(structure.n_members)]
    i, j = (j, i) if structure.node_anchored[j].any() else (i, j)
    gap = 0.0 if oddity == "one place" else 10.0 ** rng.uniform(-15.0, -3.0)
    position = structure.node_position
    return move_node(structure, int(j), position[i] + gap * (position[j] - position[i]))


def _noise(
    rng: np.random.Generator, free: NDArray[np.bool_], power: float | None, length: float
) -> FloatArray:
    drawn = rng.standard_normal(free.shape) * length * (0.0 if power is None else 10.0**power)
    return np.where(free, drawn, 0.0)


def _members(rng: np.random.Generator, structure: Structure, example: Example) -> dict[str, FloatArray]:
    """Return rest lengths, spring constants and damping of all members."""
    count, is_bar, length = structure.n_members, structure.is_bar, structure.member_length()
    soft = 100.0 * 10.0 ** rng.uniform(-1.0, 1.0, count)
    mu = np.where(is_bar, 100.0 * 10.0**example.stiffness, soft)
    strain = rng.normal(0.3, 1.0, count) * (0.0 if example.prestress is None else 10.0**example.prestress)
    share = np.where(is_bar & example.keeps_tension, -100.0 / mu, 1.0)
    mass = float(np.median(structure.node_mass))
    ratio = 0.0 if example.damping is None else 10.0**example.damping
    return {
        "rest_length": np.maximum(length * (1.0 - strain * share), 1e-3 * length),
        "spring_constant": mu,
        "damping": np.where(is_bar, 0.0, 2.0 * ratio * np.sqrt(soft * mass)),
    }


LIMITS = Limits(run=0.1, reference=0.2, peers=False, compiles=False)
GRACE = 60.0  # s; a run looks at the clock every 2 s, and the machine may be busy
SEEN: Counter[str] = Counter()


@pytest.mark.thorough
@settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
@given(example=examples())
def test_a_result_called_good_is_within_ten_times_its_tolerance(example: Example) -> None:
    outcome = run_example(example, LIMITS)
    SEEN[outcome.verdict] += 1
    assert outcome.verdict != "wrong", (outcome.error, outcome.message)
    assert outcome.seconds < LIMITS.run + GRACE


def test_the_examples_are_neither_all_tame_nor_all_absurd() -> None:
    if SEEN:  # else another worker of this run has them
        assert SEEN["survived"] > 10
        assert SEEN["stopped"] > 3
