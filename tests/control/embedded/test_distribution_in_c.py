"""The distribution of tensions in C beside that in Python: random samples, forced limits, wrong numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegrity_codegen.control.embedded.daqp_source import emit_daqp
from tensegrity_codegen.control.feedback.loop.tension_distribution import (
    TensionDistribution,
    design_distribution,
)
from tensegrity_codegen.runtime.model.model import CompiledModel
from tensegrity_codegen.runtime.records.timed_motion import Motion
from tests.cases import thorough
from tests.codegen.build_c import has_sanitizers, run
from tests.codegen.compilers import require_compiler
from tests.control.embedded.daqp import require_daqp_archive
from tests.control.embedded.distribute_alone import DistributionInC, compile_unit
from tests.control.feedback.tower_motion import build_tower, move_tower

pytest.importorskip("daqp")

Array = NDArray[np.float64]
Sample = tuple[float, Array, Array, Array, Array]


@pytest.fixture(scope="module")
def daqp() -> str:
    return emit_daqp(require_daqp_archive())


@pytest.fixture(scope="module")
def distribution(model: CompiledModel, motion: Motion) -> TensionDistribution:
    return design_distribution(model, motion, least_tension=3.0)


@pytest.fixture(scope="module")
def in_c(
    distribution: TensionDistribution, daqp: str, tmp_path_factory: pytest.TempPathFactory
) -> DistributionInC:
    return DistributionInC(distribution, daqp, tmp_path_factory.mktemp("prism"))


def draw_sample(distribution: TensionDistribution, rng: np.random.Generator) -> Sample:
    """Return a sample off the motion: small errors and large ones, near bounds, beyond them, equal bounds."""
    motion, count = distribution.motion, len(distribution.bounds.names)
    time = float(rng.uniform(0.0, motion.time[-1]))
    point = motion.at(time)
    coordinate = point.coordinate + 0.02 * rng.choice([0.0, 1.0]) * rng.normal(size=len(point.coordinate))
    wanted = point.input[distribution.bounds.place] + 10 ** rng.uniform(-4, -1.5) * rng.normal(size=count)
    reach = 10 ** rng.uniform(-4, -1.5)
    middle = wanted + reach * rng.choice([0.0, 1.0]) * rng.normal(size=count)
    low, high = middle - reach * rng.uniform(size=count), middle + reach * rng.uniform(size=count)
    high[0] = low[0] if rng.uniform() < 0.1 else high[0]
    return time, coordinate, wanted, low, high


def compare(distribution: TensionDistribution, in_c: DistributionInC, count: int, seed: int) -> set[str]:
    """Compare so many random samples; returns the statuses that occurred."""
    rng, seen, gaps = np.random.default_rng(seed), set(), []
    for _ in range(count):
        sample = draw_sample(distribution, rng)
        expected, found = distribution.distribute(*sample), in_c.distribute(*sample)
        assert (found.status, found.yielding.tolist()) == (expected.status, expected.yielding.tolist())
        gaps.append(float(np.abs(found.command - expected.command).max()))
        assert ((found.command >= sample[3]) & (found.command <= sample[4])).all()
        seen.add(found.status)
    # Active bounds that almost depend on each other amplify rounding, in both programs alike.
    assert max(gaps) < 1e-10
    assert np.mean(np.array(gaps) < 1e-12) > 0.98
    return seen


def test_numbers_are_those_of_python(distribution: TensionDistribution, in_c: DistributionInC) -> None:
    seen = compare(distribution, in_c, 200, 0)
    assert {"ok", "rate_limited", "least_tension"} <= seen


@pytest.mark.thorough
def test_numbers_are_those_of_python_in_many_samples_of_the_tower(daqp: str, tmp_path: Path) -> None:
    model = build_tower()
    distribution = design_distribution(model, move_tower(model), least_tension=1.0)
    in_c = DistributionInC(distribution, daqp, tmp_path)
    assert {"ok", "rate_limited", "least_tension", "tension_limited"} <= compare(distribution, in_c, 5000, 1)


@pytest.mark.parametrize(
    "groups",
    [
        ((3, 4), (4, 5), (6, 7, 8), (8,), (9,), (10, 11)),  # cables of several motors, and the reverse
        *thorough((((3, 4, 5), (6,), (7,), (8,), (9, 10, 11)),)),  # motors of several cables
    ],
)
def test_motors_of_several_cables_and_cables_of_several_motors(
    distribution: TensionDistribution, daqp: str, tmp_path: Path, groups: tuple[tuple[int, ...], ...]
) -> None:
    incidence = np.zeros((12, len(groups)))
    for column, members in enumerate(groups):
        incidence[list(members), column] = 1.0
    count, bounds, cables = len(groups), distribution.bounds, distribution.cables
    other = replace(
        distribution,
        bounds=replace(
            bounds,
            **{
                name: getattr(bounds, name)[:count]
                for name in ("names", "place", "least", "most", "rate", "delay")
            },
            members=groups,
        ),
        cables=replace(cables, incidence=incidence, limited=np.flatnonzero(incidence.any(axis=1))),
    )
    assert "least_tension" in compare(other, DistributionInC(other, daqp, tmp_path), 100, 2)


@pytest.mark.thorough
def test_own_preferred_tensions_and_weight(
    model: CompiledModel, motion: Motion, daqp: str, tmp_path: Path
) -> None:
    least = np.where(np.arange(12) % 2, 3.0, -np.inf)
    other = design_distribution(model, motion, least_tension=least, preferred=np.arange(12.0), weight=1e-3)
    compare(other, DistributionInC(other, daqp, tmp_path), 50, 3)


def test_a_program_that_is_cut_short_gives_a_status_and_a_safe_command(
    distribution: TensionDistribution, in_c: DistributionInC, daqp: str, tmp_path: Path
) -> None:
    short, rng, cut = DistributionInC(distribution, daqp, tmp_path, iterations=2), np.random.default_rng(4), 0
    for _ in range(100):
        sample = draw_sample(distribution, rng)
        whole, found = in_c.distribute(*sample), short.distribute(*sample)
        assert short.iterations <= 3
        if found.status == "not_solved":
            cut += 1
            assert found.command.tolist() == np.clip(sample[2], sample[3], sample[4]).tolist()
        else:
            assert np.abs(found.command - whole.command).max() < 1e-10
    assert 10 < cut < 100


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["coordinate", "wanted"])
def test_numbers_that_are_not_finite_give_a_status_and_a_safe_command(
    distribution: TensionDistribution, in_c: DistributionInC, place: str, value: float
) -> None:
    time, coordinate, wanted, low, high = draw_sample(distribution, np.random.default_rng(5))
    (coordinate if place == "coordinate" else wanted)[1] = value
    found = in_c.distribute(time, coordinate, wanted, low, high)
    assert found.status == "not_solved"
    assert ((found.command >= low) & (found.command <= high)).all()


@pytest.mark.thorough
def test_sanitizers_find_nothing(distribution: TensionDistribution, daqp: str, tmp_path: Path) -> None:
    if not has_sanitizers(require_compiler("gcc"), tmp_path):
        pytest.skip("no sanitizers here")
    compile_unit(
        distribution, daqp, tmp_path, options=("-O0", "-g", "-fsanitize=address,undefined"), program=True
    )
    rng = np.random.default_rng(6)
    samples = [draw_sample(distribution, rng) for _ in range(40)]
    for sample in samples[:3]:
        sample[1][0] = np.nan
    rows = [
        np.concatenate([*sample[1:], distribution.bounds.least, distribution.bounds.most])
        for sample in samples
    ]
    (tmp_path / "samples.bin").write_bytes(np.array(rows).tobytes())
    run([str(tmp_path / "unit")], tmp_path)


def test_it_asks_for_no_memory_and_has_no_data(
    distribution: TensionDistribution, daqp: str, tmp_path: Path
) -> None:
    compile_unit(distribution, daqp, tmp_path)
    table = [line.split()[-2:] for line in run(["nm", "unit.o"], tmp_path).stdout.splitlines()]
    data = [symbol for kind, symbol in table if kind in "dDbBC"]
    assert len(data) == 1  # that of the test
    assert data[0].startswith("memory")
    assert {symbol for kind, symbol in table if kind == "U"} <= {
        "pinned_prism_compute_member_length", "pinned_prism_compute_equilibrium_matrix",
        "memcpy", "memset", "sqrt", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail",
    }  # fmt: skip
