"""Analysis `equilibrium`: every row is what `find_equilibrium` finds alone."""

from typing import Any

import numpy as np
import pytest

from tensegrity_codegen.analyses.cases.registry import ANALYSES, build_analysis
from tensegrity_codegen.analyses.equilibrium import SNAP_RESULTS, FindEquilibrium
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.paths.find_equilibrium import find_equilibrium as find_and_judge
from tensegrity_codegen.runtime.statics.equilibrium import find_equilibrium
from tensegrity_codegen.system.errors import InvalidValueError, LibraryError, TensegrityError, UnknownKeyError
from tests.analyses.cases.compiling import check_alike, compile_for, vary
from tests.analyses.cases.scenes import BODIES, PRISM, SINGLE, TRIANGLE
from tests.cases import thorough
from tests.sweeps.status_words import decode_statuses

COUNT = 4
KEPT = ("node_position", "member_tension", "smallest_eigenvalue", "change", "total_energy", "coordinate")


@pytest.mark.parametrize("scene", [TRIANGLE, BODIES, *thorough(PRISM)], ids=lambda scene: str(scene["name"]))
def test_rows_are_those_of_single_searches(scene: dict[str, Any]) -> None:
    operation = FindEquilibrium((*KEPT, "top = max(member_tension)", "iterations"))
    model = compile_for(scene, operation)
    given = {name: value for name, value in vary(model, COUNT, 1).items() if name != "velocity"}
    if scene is PRISM:
        given["node_load"][:, :, :2] = 0
        given["node_load"][1, 0, 0] = 1.0  # nothing holds it
    result = operation.run(model, given, COUNT)
    check_alike(result, operation, model, COUNT)
    for k, word in enumerate(decode_statuses(result.status)):
        own = {name: value[k] for name, value in given.items()}
        alone = find_equilibrium(
            model, coordinate=own.pop("coordinate"), arguments=own, raise_on_failure=False
        )
        assert word == alone.status
        kept = {name: array[k] for name, array in result.arrays.items()}
        if not alone.is_found:
            assert result.messages[k] == alone.message
            assert all(np.isnan(kept[name]).all() for name in (*KEPT[:-1], "coordinate_value"))
            assert kept["iterations"] == -1
            continue
        force, size = alone.largest_force, alone.extent
        assert alone.distance_of(kept["node_position"]) <= 1e-6 * size
        np.testing.assert_allclose(kept["member_tension"], alone.member_tension, atol=1e-6 * force)
        assert kept["top"] == kept["member_tension"].max()
        assert kept["smallest_eigenvalue"] == pytest.approx(alone.smallest_eigenvalue, rel=1e-4, abs=1e-6)
        assert kept["change"] == pytest.approx(alone.change, rel=1e-5, abs=1e-6 * size)
        assert kept["total_energy"] == pytest.approx(alone.energy, rel=1e-6, abs=1e-9)


def test_usual_results() -> None:
    operation = FindEquilibrium()
    model = compile_for(TRIANGLE, operation)
    result = operation.run(model, {"pull": np.array([0.0, np.nan, 0.01])}, 3)
    check_alike(result, operation, model, 3)
    assert decode_statuses(result.status) == ("converged", "non_finite_input", "converged")
    assert np.isnan(result.arrays["node_position"][1]).all()


def test_rows_say_of_snapping_what_one_search_says() -> None:
    """Two bars to an apex that snaps through at 296.05 N: of 0, 200 and 400 N."""
    bar = {"kind": "bar", "axial_stiffness": 1e5}
    scene = {
        "name": "truss",
        "axes": "xz",
        "nodes": {
            "l": {"position": [-1, 0], "anchored": True},
            "r": {"position": [1, 0], "anchored": True},
            "t": {"position": [0, 0.2], "mass": 1.0},
        },
        "members": {"a": bar | {"nodes": ["l", "t"]}, "b": bar | {"nodes": ["r", "t"]}},
        "loads": [{"node": "t", "force": [0, -200.0]}],
    }
    operation = FindEquilibrium(tuple(SNAP_RESULTS))
    load = np.zeros((3, 3, 2))
    load[:, 2, 1] = 0.0, -200.0, -400.0
    # The first case of a sweep, from which the library is built, need not have the loads of the scene.
    model = compile_for(scene | {"loads": [{"node": "t", "force": [0, -1.0]}]}, operation)
    result = operation.run(model, {"node_load": load}, 3)
    factor = result.arrays["limit_load_factor"]
    np.testing.assert_array_equal(result.arrays["snapped"], [0, 0, 1])
    assert np.isnan(factor[:2]).all()
    rest = 1.04**0.5  # P = 2 EA (1 / l - 1 / rest) h is largest where l^3 = rest
    most = 2e5 * (rest ** (-1 / 3) - 1 / rest) * (rest ** (2 / 3) - 1) ** 0.5
    assert 400 * factor[2] == pytest.approx(most, rel=1e-8)
    # The verb says the same of the scene of this case.
    own = scene | {"loads": [{"node": "t", "force": [0, -400.0]}]}
    alone = find_and_judge(compile_for(own, operation)).snap
    assert alone is not None
    assert factor[2] == pytest.approx(alone.limit_load_factor)
    assert result.messages == ("", "", *alone.describe())


def test_what_cannot_be_done_is_refused() -> None:
    structure, request = load_scene(TRIANGLE)
    for operation in (FindEquilibrium(tolerance=0.0), FindEquilibrium(("member_tension.max",))):
        with pytest.raises(InvalidValueError):
            operation.needs(structure, request)
    with pytest.raises(TensegrityError, match="smallest_eigenvalue"):
        FindEquilibrium(("smallest_eigenvalu",)).needs(structure, request)
    with pytest.raises(LibraryError, match="double precision"):
        FindEquilibrium().run(compile_for(SINGLE, FindEquilibrium()), {}, 2)


def test_operations_are_built_by_name() -> None:
    built = build_analysis("equilibrium", "member_tension", tolerance=1e-6, method=None)
    assert built == FindEquilibrium(("member_tension",), tolerance=1e-6)
    assert built.describe()["tolerance"] == 1e-6
    for do in ANALYSES:
        assert build_analysis(do).describe()["do"] == do
    with pytest.raises(TensegrityError, match="simulate"):
        build_analysis("simulat")
    with pytest.raises(UnknownKeyError, match="t_end"):
        build_analysis("equilibrium", t_end=3.0)
