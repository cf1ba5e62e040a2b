from collections.abc import Iterable
from importlib import import_module

import pytest

from tensegrity_codegen.runtime.statics.equilibrium import PROBLEMS
from tensegrity_codegen.system.errors import FormulationError
from tensegrity_codegen.tables.formulations import FORMULATIONS, choose_formulation, find_formulation
from tensegrity_codegen.tables.quantities import QUANTITIES
from tests.doc_tables import check_table


def test_each_formulation_has_its_expressions_under_its_name() -> None:
    for name, item in FORMULATIONS.items():
        assert item.name == name
        module = import_module(f"tensegrity_codegen.symbolic.formulations.{name}")
        assert callable(getattr(module, f"build_{name}"))


def test_records_name_what_there_is() -> None:
    for item in FORMULATIONS.values():
        named = (*item.simulation_quantities, *item.linear_quantities, item.massless_tension)
        assert [word for word in named if word not in QUANTITIES] == []
        assert item.statics in PROBLEMS
        for words in item.variants:
            assert all(word in item.options[key] for key, word in words.items())
    assert len({item.order for item in FORMULATIONS.values()}) == len(FORMULATIONS)


def test_the_formulation_of_equilibria_depends_on_rigid_bars() -> None:
    assert choose_formulation(rigid_bars=False).name == "node_position"
    assert choose_formulation(rigid_bars=True).name == "rigid_bar"


def test_an_unknown_formulation_is_refused_with_the_known_ones() -> None:
    with pytest.raises(FormulationError) as caught:
        find_formulation("node_positon")
    assert caught.value.allowed == ", ".join(FORMULATIONS)
    assert "node_position" in caught.value.hint


def test_the_table_of_formulations_is_written_from_the_records(update_golden: bool) -> None:
    def quoted(words: Iterable[str]) -> str:
        return ", ".join(f"`{word}`" for word in words)

    rows = [
        (
            f"`{name}`",
            item.sentence,
            "; ".join(f"`{key}`: {quoted(words)}" for key, words in item.options.items()),
            quoted(item.emitters),
            "yes" if item.has_statics else "",
        )
        for name, item in FORMULATIONS.items()
    ]
    head = ("formulation", "coordinates", "options, the default first", "emitters", "finds equilibria")
    check_table("model.md", "formulations", head, rows, update_golden)
