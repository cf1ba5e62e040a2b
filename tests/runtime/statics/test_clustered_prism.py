"""The clustered prism of CTSFEM: two stages of four bars, whose diagonal strings run on over both stages.

S. Ma, M. Chen, Z. Yuan, R. E. Skelton, "Clustered Tensegrity Structures Finite Element Method" (software,
MPL 2.0): example 5CTS_prism_dynamic, geometry and stiffnesses of its script, results of its file
prism_static.mat. Its static solver stops at a residual of about 1e-5 N.
"""

import numpy as np

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
