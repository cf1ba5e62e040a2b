import pytest

from tensegrity_codegen.runtime.accuracy.integrate import ONCE
from tensegrity_codegen.runtime.integrate.methods import METHODS, find_method, list_methods
from tensegrity_codegen.scene.schema.model_schema import INTEGRATORS
from tensegrity_codegen.system.errors import UnknownNameError
from tensegrity_codegen.tables.tableaus import EXPLICIT
from tests.doc_tables import check_table


def test_every_integrator_of_a_scene_is_a_method_and_every_kind_has_its_function() -> None:
    assert [name for name in INTEGRATORS if name not in METHODS] == []
    assert set(EXPLICIT) <= set(METHODS)
    assert {item.kind for item in METHODS.values()} == set(ONCE)
    assert all(name == item.name for name, item in METHODS.items())


def test_what_methods_can_do() -> None:
    assert list_methods("has_fixed_step") == ("rk4",)
    assert set(list_methods("in_batches")) == set(EXPLICIT)
    assert "radau" not in list_methods("keeps_energy")
    assert all(name.startswith("scipy_") for name in list_methods("scipy"))
    assert not set(list_methods("scipy")) & set(list_methods("finds_events"))


def test_an_unknown_method_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownNameError) as caught:
        find_method("rk5")
    assert caught.value.allowed == ", ".join(METHODS)


def test_the_table_of_methods_is_written_from_the_records(update_golden: bool) -> None:
    def mark(able: bool) -> str:
        return "yes" if able else ""

    rows = [
        (
            f"`{name}`",
            item.sentence,
            str(item.order or ""),
            "SciPy" if item.scipy else "C",
            mark(item.finds_events),
            mark(item.in_batches),
            mark(item.keeps_energy),
            "tables, functions" if item.takes_schedule else "tables",
        )
        for name, item in METHODS.items()
    ]
    head = ("method", "what it is", "order", "by", "ends steps at events", "in batches")
    head += ("can keep the energy", "inputs over time by")
    check_table("motions.md", "methods", head, rows, update_golden)
