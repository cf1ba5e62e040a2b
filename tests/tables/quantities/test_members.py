"""The table of quantities in the documentation, and quantities of single members."""

from pathlib import Path

import pytest

from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import UnknownNameError
from tensegrity_codegen.tables.quantities import QUANTITIES, find_quantity
from tensegrity_codegen.tables.quantities.members import MEMBER_QUANTITIES
from tensegrity_codegen.tables.request import ModelRequest
from tests.doc_tables import check_table
from tests.runtime.build import prism

EXAMPLES = Path(__file__).resolve().parents[3] / "tensegrity_codegen/scene/examples"


def offered() -> dict[str, tuple[str, ...]]:
    """Return formulation -> the quantities that it offers."""
    structure = prism()
    bodies, wanted = load_scene(EXAMPLES / "lin_prism.toml")
    requests = {
        name: ModelRequest((), formulation=name, options={"bars": "all"} if name == "rigid_bar" else {})
        for name in ("node_position", "node_distance", "rigid_bar")
    }
    found = {name: build_model(structure, request).quantities for name, request in requests.items()}
    return {**found, "bodies": build_model(bodies, wanted).quantities}


def test_every_formulation_offers_every_quantity_of_members() -> None:
    for quantities in offered().values():
        assert {item.name for item in MEMBER_QUANTITIES} <= set(quantities)


def test_the_table_of_quantities_is_written_from_the_records(update_golden: bool) -> None:
    of = offered()
    rows = [
        (
            f"`{row.name}`",
            row.unit,
            " x ".join(row.shape) or "scalar",
            "all" if len(places) == len(of) else ", ".join(f"`{name}`" for name in places),
            row.sentence.replace("|", "\\|"),
        )
        for row in QUANTITIES.values()
        for places in [[name for name, quantities in of.items() if row.name in quantities]]
    ]
    head = ("quantity", "unit", "shape", "formulations", "meaning")
    check_table("quantities.md", "quantities", head, rows, update_golden)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("tension", "member_tension"),
        ("length", "member_length"),
        ("energy", "total_energy"),
        ("force", "member_tension"),
    ],
)
def test_a_short_name_leads_to_the_quantity_that_is_meant(given: str, meant: str) -> None:
    with pytest.raises(UnknownNameError, match="unknown quantity") as caught:
        find_quantity(given)
    assert caught.value.hint == f"did you mean {meant!r}?"
    assert "tension_column" not in caught.value.allowed
    assert find_quantity("tension_column").name == "tension_column"
