"""The manifest's list of optional parts of a C source, and their reasons."""

from tensegrity_codegen.codegen.build_manifest import list_parts
from tensegrity_codegen.tables.manifest import IntegratorSpec, SourcePart
from tensegrity_codegen.tables.request import ModelRequest


def part(name: str, *integrators: IntegratorSpec, unwatched: str = "") -> SourcePart:
    (found,) = [
        item for item in list_parts(ModelRequest(()), integrators, (), unwatched) if item.name == name
    ]
    return found


def test_events_are_searched_where_an_integrator_monitors_them() -> None:
    watching = IntegratorSpec("rk54", "a_integrate_rk54", (), 1, events=("cable", "condition"))
    assert part("event_search", watching, unwatched="lost").why == "integrators monitor cable, condition"
    bare = part("event_search", IntegratorSpec("rk54", "a_integrate_rk54", (), 1), unwatched="lost")
    assert bare == SourcePart("event_search", False, "lost")
    assert "no integrator" in part("event_search").why


def test_the_energy_is_corrected_where_it_was_asked_for() -> None:
    keeping = IntegratorSpec("rk54", "a_integrate_rk54", (), 1, keeps=("energy",))
    assert part("energy_correction", keeping) == SourcePart(
        "energy_correction", True, "keep names energy, for rk54"
    )
    assert not part("energy_correction").is_included
