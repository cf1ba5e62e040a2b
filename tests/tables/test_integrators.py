"""The table of integrators: one row each, from which generator, methods and scene files follow."""

from dataclasses import replace
from pathlib import Path

import pytest

from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.codegen.integrators import integrators, work_memory
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.runtime.integrate.methods import METHODS
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables import integrators as tables
from tensegrity_codegen.tables.integrators import INTEGRATORS, called_quantities, find_row
from tensegrity_codegen.tables.integrators.integrator import Integrator
from tensegrity_codegen.tables.quantities import QUANTITIES

ROOT = Path(__file__).resolve().parents[2]
PRISM = ROOT / "tensegrity_codegen/scene/examples/prism.toml"


@pytest.mark.parametrize("row", INTEGRATORS.values(), ids=lambda row: row.name)
def test_every_row_is_a_method_with_known_quantities(row: Integrator) -> None:
    method = METHODS[row.name]
    assert (method.kind, method.order, method.in_batches) == (row.kind, row.order, row.in_batches)
    assert set(row.quantities) <= set(QUANTITIES)
    for item in (row, row.with_contacts or row):
        assert item.name == row.name
        assert item.tableau is not None or all(
            (ROOT / f"templates/c/{name}.h").is_file() for name in item.c_files
        )


def test_radau_is_an_explicit_call_with_the_jacobian_where_there_are_contacts() -> None:
    assert find_row("radau", False) is INTEGRATORS["radau"]
    assert find_row("rk54", True) is INTEGRATORS["rk54"]
    row = find_row("radau", True)
    assert (row.kind, row.quantities) == ("adaptive", ("state_jacobian",))
    assert called_quantities(["radau"], True) == ["state_jacobian"]
    assert called_quantities(["rodas", "radau"], True) == ["state_jacobian"]


def test_only_those_without_a_tableau_call_more_than_the_others() -> None:
    own = [name for row in INTEGRATORS.values() if row.tableau is None for name in row.quantities]
    assert called_quantities(INTEGRATORS, False) == own
    assert called_quantities(["unknown"], False) == []


@pytest.mark.parametrize("name", [name for name, row in INTEGRATORS.items() if row.tableau is None])
def test_an_integrator_without_tableau_is_named_in_its_own_module_alone(name: str) -> None:
    modules = (ROOT / "tensegrity_codegen").rglob("*.py")
    named = [path.name for path in modules if name in path.read_text(encoding="utf-8")]
    assert named == [f"{name}.py"]


def test_a_fixed_integrator_needs_no_tableau(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Integrator("rk4", "fixed", "four stages", 4, follows_events=False)
    for module in (tables, integrators, work_memory):
        monkeypatch.setattr(module, "INTEGRATORS", {**INTEGRATORS, "rk4": plain})
    structure, request = load_scene(PRISM)
    made = emit(structure, request.wanting(*request.quantities, integrators=("rk4", "rk54")))
    header, text = made.files["prism.h"], made.files["prism.c"]
    assert "Four stages with a fixed step" in header
    assert "int prism_integrate_rk4(" in text
    assert "prism_integrate_rk4_run" not in text + header
    assert "prism_integrate_rk54_run" in text
    assert made.manifest.integrators[0].events == ()


def test_a_quantity_that_a_model_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lacking = replace(INTEGRATORS["rodas"], quantities=("multiplier",))
    monkeypatch.setattr(tables, "INTEGRATORS", {**INTEGRATORS, "rodas": lacking})
    structure, request = load_scene(PRISM)
    with pytest.raises(FormulationError, match="the integrator 'rodas' needs the multiplier"):
        emit(structure, request.wanting(*request.quantities, integrators=("rodas",)))
