"""Quantities of nodes: a record is all that formulations and emitters need to know of one."""

from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.codegen import source
from tensegrity_codegen.codegen.compilation.cache import Cache
from tensegrity_codegen.codegen.table import node_quantities as table_nodes
from tensegrity_codegen.codegen.table.quantities import BUILDERS
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.symbolic import quantities as symbolic_nodes
from tensegrity_codegen.tables import quantities
from tensegrity_codegen.tables.quantities.nodes import BARS_IN, NODE_QUANTITIES, NodeQuantity
from tensegrity_codegen.tables.quantities.quantity import Quantity
from tensegrity_codegen.tables.request import ModelRequest
from tests.cases import thorough
from tests.runtime.build import cable, make_structure, spring

NEW = (
    NodeQuantity(
        Quantity("node_kinetic_energy", "T_n", "J", ("n_nodes",), "Kinetic energies of point masses."),
        entries=lambda n: [n.mass * sum(v * v for v in n.velocity) / 2],
        uses=("mass", "velocity"),
    ),
    NodeQuantity(
        Quantity("node_power", "p", "N m", ("n_nodes", "n_axes"), "Positions times loads."),
        entries=lambda n: [r * f for r, f in zip(n.position, n.load, strict=True)],
        uses=("position", "load"),
    ),
    NodeQuantity(
        Quantity("pull_on_rest", "-f", "N", ("n_coordinates",), "Minus the force on free coordinates."),
        entries=lambda n: [-f for f in n.spring_force],
        uses=("spring_force",),
    ),
    NodeQuantity(
        Quantity("force_square", "f^2", "N2", ("n_nodes",), "Square of the force on each node."),
        entries=lambda n: [sum(f * f for f in n.force)],
        uses=("force",),
    ),
)


@pytest.mark.parametrize("item", NODE_QUANTITIES, ids=lambda item: item.name)
def test_a_record_uses_what_it_says(item: NodeQuantity) -> None:
    read = set()

    class Recorder:
        def __getattr__(self, name: str) -> list[float]:
            read.add(name)
            return [1.0, 2.0, 3.0]

    assert len(item.entries(Recorder())) == (
        3 if len(item.row.shape) == 2 or item.components != "n_nodes" else 1
    )
    assert read == set(item.uses) <= set(BARS_IN)


@pytest.fixture
def with_new_records(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the new records where those of the table are."""
    rows = {**quantities.QUANTITIES, **{item.name: item.row for item in NEW}}
    for module in (quantities, source):
        monkeypatch.setattr(module, "QUANTITIES", rows)
    for nodes in (symbolic_nodes, table_nodes):
        monkeypatch.setattr(nodes, "NODE_QUANTITIES", (*NODE_QUANTITIES, *NEW))
    for name, builder in table_nodes.node_builders().items():
        monkeypatch.setitem(BUILDERS, name, builder)  # type: ignore[misc]


@pytest.mark.usefixtures("with_new_records")
@pytest.mark.parametrize(
    "changeable", [{}, {"node_mass": (1,), "node_load": (1, 2), "anchor_position": (0,)}]
)
@pytest.mark.parametrize("emitter", ["table", *thorough("unrolled")])
def test_a_new_record_is_a_new_quantity(
    emitter: str, changeable: dict[str, tuple[int, ...]], tmp_path: Path
) -> None:
    structure = make_structure(
        [[0, 0, 1], [0.3, 0, -0.4], [1, 0.5, 0]],
        [cable(0, 1, 0.5), spring(1, 2, 0.7), cable(0, 2, 0.4)],
        anchored={0: "xyz"},
        gravity=(0, 0, -9.81),
        load={1: (1.0, 2.0, 3.0)},
        mass=[1.0, 2.0, 3.0],
    )
    served = NEW[:3] if emitter == "table" else NEW
    wanted = (*(item.name for item in served), "node_force", "node_residual")
    request = ModelRequest(wanted, emitter=emitter, parameters=changeable)
    model = build_library(structure, request, cache=Cache(tmp_path)).load()
    velocity = np.arange(1.0, 7.0)
    found = {name: model.compute(name, velocity=velocity) for name in wanted}
    rates = np.vstack([np.zeros(3), velocity.reshape(2, 3)])
    weight = structure.node_mass[:, None] * structure.gravity
    assert found["node_kinetic_energy"] == pytest.approx(structure.node_mass * (rates**2).sum(axis=1) / 2)
    assert found["node_power"] == pytest.approx(structure.node_position * (structure.node_load + weight))
    assert found["pull_on_rest"] == pytest.approx(-found["node_residual"])
    if emitter == "unrolled":
        assert found["force_square"] == pytest.approx((found["node_force"] ** 2).sum(axis=1))
