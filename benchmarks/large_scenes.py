"""Scenes of any size for measurements: the shape `tower`, and imported tables of random points."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

NEIGHBOURS = 12  # that a node may be joined to; a sixth as many nodes as members

TOWER = """\
name = "tower"
gravity = [0, 0, -9.81]

[model]
quantities = {quantities}
integrators = ["rk54"]
emitter = "table"

[classes.bar]
kind = "bar"
axial_stiffness = 2e5
radius = 0.01

[classes.cable]
kind = "cable"
axial_stiffness = 1e4
prestress = 10.0

[shape]
kind = "tower"
stages = {stages}
radius = 0.5
height = 1.0
node_mass = 0.1
anchor_bottom = true
"""


def write_scene_of(kind: str, members: int, folder: Path, quantities: tuple[str, ...]) -> Path:
    """Write a scene of about so many members and return its file; kind: "tower" or "random"."""
    path = folder / f"{kind}.toml"
    if kind == "tower":
        path.write_text(TOWER.format(quantities=list(quantities), stages=round((members + 6) / 18)))
        return path
    from tensegrity_codegen.scene.formats.import_tables import import_tables
    from tensegrity_codegen.scene.write import write_scene

    _write_tables(members, folder / "nodes.csv", folder / "members.csv")
    document = import_tables(folder / "nodes.csv", folder / "members.csv", name="random").document
    document["model"] = {"quantities": list(quantities), "integrators": ["rk54"], "emitter": "table"}
    write_scene(document, path)
    return path


def _write_tables(members: int, nodes_path: Path, members_path: Path) -> None:
    """Write nodes at random places and members between near ones, shuffled, bars without common nodes."""
    rng = np.random.default_rng(1)
    count = max(members // 6, NEIGHBOURS + 1)
    place = rng.uniform(0.0, count ** (1 / 3), (count, 3))
    pairs, length = _join(place, members)
    used = np.unique(pairs)
    place, pairs = place[used], np.searchsorted(used, pairs)
    order = rng.permutation(len(pairs))
    pairs, length = pairs[order], length[order]
    is_bar = _choose_bars(pairs, len(place))
    rows = [f"n{k},{x!r},{y!r},{z!r},0.1,{int(k < 3)}" for k, (x, y, z) in enumerate(place.tolist())]
    nodes_path.write_text("\n".join(["node,x,y,z,mass,anchored", *rows]) + "\n")
    rest = (length * np.where(is_bar, 1.01, 0.98)).tolist()
    rows = [
        f"m{e},{'bar' if bar else 'cable'},n{i},n{j},{rho!r},{1e5 if bar else 1e3}"
        for e, ((i, j), rho, bar) in enumerate(zip(pairs.tolist(), rest, is_bar.tolist(), strict=True))
    ]
    head = "member,kind,node_i,node_j,rest_length,spring_constant"
    members_path.write_text("\n".join([head, *rows]) + "\n")


def _join(place: NDArray[np.float64], members: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the shortest pairs (n, 2) of near nodes and their lengths (n,)."""
    _, near = cKDTree(place).query(place, k=NEIGHBOURS)
    first = np.repeat(np.arange(len(place)), NEIGHBOURS - 1)
    pairs = np.unique(np.sort(np.stack([first, near[:, 1:].ravel()], axis=1), axis=1), axis=0)
    length = np.linalg.norm(place[pairs[:, 0]] - place[pairs[:, 1]], axis=1)
    chosen = np.sort(np.argsort(length)[:members])
    return pairs[chosen], length[chosen]


def _choose_bars(pairs: NDArray[np.int64], n_nodes: int) -> NDArray[np.bool_]:
    """Return which members are bars: the first at both of their nodes."""
    taken, is_bar = np.zeros(n_nodes, dtype=bool), np.zeros(len(pairs), dtype=bool)
    for member, (i, j) in enumerate(pairs.tolist()):
        if not taken[i] and not taken[j]:
            taken[i] = taken[j] = is_bar[member] = True
    return is_bar
