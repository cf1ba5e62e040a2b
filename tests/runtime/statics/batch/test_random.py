"""Random structures, starts and loads: rows have the verdicts and places of the search for one case."""

import numpy as np
import pytest

from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.runtime.statics.batch.find_equilibria import find_equilibria
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.random_structures import AXES, make_structure

CASES = 6
FEATURES = ("gravity", "damping", "loads", "velocity", "anchors", "bar_mass", "inputs", "slack")


@pytest.mark.parametrize("seed", [1, *thorough(0, *range(2, 30))])
def test_random_cases_end_as_they_do_alone(seed: int) -> None:
    random = np.random.default_rng(seed)
    axes = AXES[random.integers(len(AXES))]
    count = int(random.integers(3, 6 if len(axes) == 1 else 12))
    wants = {name: bool(random.integers(2)) for name in FEATURES}
    structure = make_structure(random, count, axes, wants)
    request = ModelRequest((), parameters={"node_load": tuple(range(count))})
    model = build_library(structure, want_analyses(structure, request, ["equilibria"])).load()
    start, load = model.nominal("coordinate"), model.nominal("node_load")
    start = start + random.normal(scale=random.choice([0.0, 0.05]), size=(CASES, *start.shape))
    load = load + random.normal(scale=random.choice([0.0, 1.0]), size=(CASES, *load.shape))
    found = find_equilibria(model, coordinate=start, arguments={"node_load": load}, max_iterations=200)
    for k in range(CASES):
        alone = find_equilibrium(
            model,
            coordinate=start[k],
            arguments={"node_load": load[k]},
            max_iterations=200,
            raise_on_failure=False,
        )
        assert found.status[k] == alone.status
        if not alone.is_found:
            assert found.message[k][:30] == alone.message[:30]
            continue
        assert found.saddles_left[k] == alone.saddles_left
        assert found.energy[k] == pytest.approx(alone.energy, rel=1e-6, abs=1e-9)
        assert alone.distance_of(found.node_position[k]) <= 1e-4 * alone.extent
