"""Equilibria that say whether they were snapped to: a truss with a closed form, in Python and in a sweep."""

import tomllib
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium
from tensegrity_codegen.analyses.equilibrium import FindEquilibrium
from tensegrity_codegen.system.errors import InvalidValueError
from tests.analyses.cases.compiling import compile_for

# Two bars of 1e5 N between feet 2 m apart to an apex 0.2 m up, with 400 N and 1 kg on it.
TRUSS: dict[str, Any] = tomllib.loads("""
name = "truss"
axes = "xz"
gravity = [0, -9.81]
[nodes]
l = { position = [-1, 0], anchored = true }
r = { position = [1, 0], anchored = true }
t = { position = [0, 0.2], mass = 1 }
[members]
a = { kind = "bar", axial_stiffness = 1e5, nodes = ["l", "t"] }
b = { kind = "bar", axial_stiffness = 1e5, nodes = ["r", "t"] }
[[loads]]
node = "t"
force = [0, -400]
""")
KEPT = ("snapped", "limit_load_factor", "limit_prestress_factor", "smallest_eigenvalue", "node_position")


def find_limit() -> float:
    """Return the part of the loads at which P = 2 EA y (1 / sqrt(1 + y^2) - 1 / l0) is largest."""
    length = np.hypot(1, 0.2)
    y = np.sqrt(length ** (2 / 3) - 1)
    return float(2e5 * y * (1 / np.sqrt(1 + y * y) - 1 / length) / 409.81)


def test_python_and_a_sweep_say_that_a_truss_snapped() -> None:
    found = find_equilibrium(compile_scene(TRUSS, for_="equilibrium"))
    assert found.snap is not None
    assert found.snap.snapped is True
    assert found.snap.limit_load_factor == pytest.approx(find_limit(), rel=1e-8)
    assert any(text.startswith("snapped: ") for text in found.warnings)
    operation = FindEquilibrium(KEPT)
    model = compile_for(TRUSS, operation)
    load = np.zeros((2, 3, 2))
    load[:, 2, 1] = -400.0, -200.0
    rows = operation.run(model, {"node_load": load}, 2)
    np.testing.assert_array_equal(rows.arrays["snapped"], [1, 0])
    assert rows.arrays["limit_load_factor"][0] == pytest.approx(find_limit(), rel=1e-8)
    assert np.isnan(rows.arrays["limit_load_factor"][1])
    assert rows.arrays["smallest_eigenvalue"][0] == pytest.approx(found.smallest_eigenvalue, rel=1e-6)


def test_loads_that_are_added_are_told_apart() -> None:
    """Beyond the limit by a load that is an argument, as with --load."""
    light = TRUSS | {"loads": [{"node": "t", "force": [0, -200]}]}
    model = compile_scene(light, for_="equilibrium")
    added = np.zeros_like(model.nominal("node_load"))
    added[2, 1] = -400.0
    snap = find_equilibrium(model, arguments={"node_load": added}).snap
    assert snap is not None
    assert snap.limit_load_factor == pytest.approx(find_limit(), rel=1e-8)
    assert snap.limit_added_load_factor == pytest.approx((409.81 * find_limit() - 209.81) / 200, rel=1e-7)


def test_it_is_unknown_where_loads_are_constants_and_not_asked_where_switched_off() -> None:
    model = compile_scene(TRUSS, for_="analyse")
    snap = find_equilibrium(model).snap
    assert snap is not None
    assert snap.snapped is None
    assert "constants" in snap.reason
    assert find_equilibrium(model, snap_check=False).snap is None
    with pytest.raises(InvalidValueError, match="snap_check"):
        find_equilibrium(model, snap_check="no")  # type: ignore[arg-type]
