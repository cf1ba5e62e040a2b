"""The clustered prism and the clustered D-bar of CTSFEM, with the results that it ships.

S. Ma, M. Chen, Z. Yuan, R. E. Skelton, "Clustered Tensegrity Structures Finite Element Method" (software,
MPL 2.0): examples dynamic/5CTS_prism_dynamic and static/1Dbar, geometry and stiffnesses of their scripts,
results of their files prism_static.mat and cable_net_CTS_linear_elastic.mat. Prism: two stages of four bars,
whose diagonal strings run on over both. D-bar: two crossed bars of 2 m in a square of strings, of which one
runs on around a corner. Their static solver stops at a residual of about 1e-5 N.
"""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium

PLACES = (
    *((-1, 1, 0), (1, 1, 0), (1, -1, 0), (-1, -1, 0)),
    *((-1, 0, 1), (0, 1, 1), (1, 0, 1), (0, -1, 1)),
    *((-1, -1, 2), (-1, 1, 2), (1, 1, 2), (1, -1, 2)),
)
BARS = ((1, 8), (4, 7), (3, 6), (2, 5), (7, 10), (6, 9), (5, 12), (8, 11))
DIAGONALS = ((4, 8, 12), (3, 7, 11), (2, 6, 10), (1, 5, 9))  # one string over two stages each
RINGS = {  # EA [N], rest length [m]
    ((1, 4), (4, 3), (3, 2), (2, 1)): (62115.65935772409, 1.9967853752244262),
    ((5, 8), (8, 7), (7, 6), (6, 5)): (759.9850922417542, 1.4119404793953165),
    ((9, 12), (12, 11), (11, 10), (10, 9)): (43922.4039497202, 1.9967853752244262),
}

# Change of the rest lengths of the diagonals [m]; place of node 12 [m]; tensions [N] of the first bar, a
# diagonal, and the middle and top rings.
RESULTS = (
    (-0.7 / 3, (0.998937170140586, -0.9989371776144392, 1.64163068313722),
     (-54.36425038020552, 28.7410190245685, 62.69807092186842, 23.953646682612778)),
    (-1.4 / 3, (0.9994788467302307, -0.999478852562866, 1.2140744452027494),
     (-101.64773229262612, 48.92659673677421, 117.29133634889776, 47.78365088091523)),
    (-0.7, (1.0000245281024518, -1.000024530694745, 0.5750630067987456),
     (-144.42785160450578, 62.67938676521367, 166.77728172786857, 71.78980276295128)),
)  # fmt: skip


def test_winches_fold_the_prism_as_ctsfem_says() -> None:
    members = {
        f"bar{k}": {
            "kind": "bar", "nodes": [f"n{i}" for i in ends], "axial_stiffness": 52214477.692084685,
            "rest_length": 2.4494978682206967,
        }
        for k, ends in enumerate(BARS)
    }  # fmt: skip
    members |= {
        f"diagonal{k}": {
            "kind": "cable", "nodes": [f"n{i}" for i in path], "axial_stiffness": 62115.65935772409,
            "rest_length": 2.823880958790633,
        }
        for k, path in enumerate(DIAGONALS)
    }  # fmt: skip
    rings = [(ends, *values) for ring, values in RINGS.items() for ends in ring]
    members |= {
        f"ring{k}": {
            "kind": "cable", "nodes": [f"n{i}" for i in ends], "axial_stiffness": stiffness,
            "rest_length": rest, "tension_only": False,
        }
        for k, (ends, stiffness, rest) in enumerate(rings)
    }  # fmt: skip
    nodes = {
        f"n{k}": {"position": list(place)} | ({"anchored": True} if k <= 4 else {"mass": 1.0})
        for k, place in enumerate(PLACES, start=1)
    }
    winch = {"name": "winch", "kind": "rest_length", "members": [f"diagonal{k}" for k in range(4)]}
    document = {"name": "ctsfem_prism", "nodes": nodes, "members": members, "inputs": [winch]}
    model = compile_scene(document, for_="equilibrium")
    chosen = [model.manifest.member_name.index(name) for name in ("bar0", "diagonal0", "ring4", "ring8")]
    start = None
    for change, place, tension in RESULTS:
        found = find_equilibrium(model, arguments={"input": [change]}, coordinate=start)
        start = found.coordinate
        assert found.status == "converged"
        np.testing.assert_allclose(found.node_position[11], place, atol=2e-8)
        np.testing.assert_allclose(found.member_tension[chosen], tension, atol=5e-5)


# --- the D-bar ---------------------------------------------------------------------------------------

D_BAR = (  # nodes, EA [N], rest length [m]
    ((1, 3), 102438920.88241433, 2.000019524019843),
    ((2, 4), 102438920.88241433, 2.000019524019843),
    ((1, 2, 3), 439224.03949720325, 2.8238809587906335),
    ((3, 4), 439224.03949720325, 1.4119404793953167),
    ((4, 1), 439224.03949720325, 1.4119404793953167),
)
D_BAR_STEPS = (  # of ten: by how much m3 is shorter [m], tensions [N]
    (0.5 / 9, (-4891.236143, -5532.713026, 3649.912182, 2362.62172, 5064.072615)),
    (1.0 / 9, (-7622.225244, -9232.142212, 5848.82193, 3255.735432, 8820.009994)),
    (2.5 / 9, (-12832.78102, -17873.4929, 10407.72769, 4185.646415, 18044.62545)),
    (0.5, (-16512.75235, -25890.07637, 14017.40116, 3925.139569, 26914.20864)),
)


def d_bar() -> dict[str, Any]:
    members = {
        f"m{k}": {
            "kind": "bar" if k < 2 else "cable", "nodes": [f"n{i}" for i in path],
            "axial_stiffness": stiffness, "rest_length": rest,
        }
        for k, (path, stiffness, rest) in enumerate(D_BAR)
    }  # fmt: skip
    places = ((0.0, 0.0), (1.0, 1.0), (2.0, 0.0), (1.0, -1.0))
    nodes = {f"n{k}": {"position": list(place), "mass": 1.0} for k, place in enumerate(places, start=1)}
    winch = {"name": "winch", "kind": "rest_length", "members": ["m3"]}
    return {"name": "dbar", "axes": "xy", "nodes": nodes, "members": members, "inputs": [winch]}


def sum_energy(place: Any) -> tuple[float, Any, Any, Any]:
    """Return energy, forces and stiffness of the D-bar at positions (8,), written here anew, and CTSFEM's."""
    place = np.reshape(place, (4, 2))
    energy, force, stiff, printed = 0.0, np.zeros(8), np.zeros((8, 8)), np.zeros((8, 8))
    for path, stiffness, rest in D_BAR:
        length, slope, bend, full = 0.0, np.zeros(8), np.zeros((8, 8)), np.zeros((8, 8))
        for a, b in pairwise(path):
            span = place[b - 1] - place[a - 1]
            piece = np.linalg.norm(span)
            difference = np.zeros((2, 8))
            difference[:, 2 * b - 2 : 2 * b], difference[:, 2 * a - 2 : 2 * a] = np.eye(2), -np.eye(2)
            along = difference.T @ span / piece
            length, slope = length + piece, slope + along
            full += difference.T @ difference / piece
            bend += (difference.T @ difference - np.outer(along, along)) / piece
        tension = stiffness * (length / rest - 1.0)
        energy += tension**2 * rest / stiffness / 2
        force += tension * slope
        stiff += stiffness / rest * np.outer(slope, slope) + tension * bend
        printed += stiffness / rest * np.outer(slope, slope) + tension * full
    return energy, force, stiff, printed


def test_the_d_bar_is_folded_as_ctsfem_says() -> None:
    model = compile_scene(d_bar(), for_="equilibrium")
    start = None
    for change, tension in D_BAR_STEPS:
        found = find_equilibrium(model, arguments={"winch": -change}, coordinate=start)
        start = found.coordinate
        np.testing.assert_allclose(found.member_tension, tension, atol=5e-5)


def test_the_d_bar_of_ctsfem_starts_on_a_saddle() -> None:
    """Without a winch all is in balance at 1 kN in the bars, and unstable; ours is the equilibrium beside it.

    The stiffness that CTSFEM prints counts the part along each member in both of its terms: 998 for -1.6 N/m.
    """
    energy, force, stiff, printed = sum_energy([0, 0, 1, 1, 2, 0, 1, -1])
    assert np.abs(force).max() < 1e-4
    assert np.linalg.eigvalsh(stiff)[0] == pytest.approx(-1.60731, abs=1e-4)
    assert np.linalg.eigvalsh(printed)[3] == pytest.approx(998.3927, abs=1e-3)
    found = find_equilibrium(compile_scene(d_bar(), for_="equilibrium"))
    assert found.is_start_unstable
    assert found.smallest_eigenvalue == pytest.approx(3.2237, abs=1e-3)
    lower, force, stiff, _ = sum_energy(found.node_position[:, :2])
    assert np.abs(force).max() < 1e-4
    assert np.linalg.eigvalsh(stiff)[3] == pytest.approx(3.2237, abs=1e-3)
    assert lower - energy == pytest.approx(-2.583e-3, abs=1e-5)
    others = np.sort(found.member_tension[3:])
    np.testing.assert_allclose(others, [666.192, 746.327], atol=0.02)
