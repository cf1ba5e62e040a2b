"""Which events integrators search for: those that a request names, and those that analyses add."""

import tomllib
from dataclasses import replace

import pytest

from tensegrity_codegen.codegen.emit import GeneratedSource, emit
from tensegrity_codegen.codegen.integrators.events import find_events
from tensegrity_codegen.pipeline.analyses import want_analyses
from tensegrity_codegen.pipeline.compile_scene import compile_scene, load_scene
from tensegrity_codegen.runtime.integrate.options import Stepping
from tensegrity_codegen.runtime.simulate.simulate import simulate
from tensegrity_codegen.tables.request import ModelRequest
from tests.models import EXAMPLES

CORD = EXAMPLES / "two_nodes.toml"
SEARCH = ("typedef struct two_nodes_run", "two_nodes_event;", "cable_margin", "two_nodes_integrate_rk4_run")


def generate(**changes: object) -> GeneratedSource:
    structure, request = load_scene(CORD)
    return emit(structure, replace(request, emitter="unrolled", **changes))


def explain(source: GeneratedSource) -> str:
    return next(part.why for part in source.manifest.parts if part.name == "event_search")


def test_a_scene_without_the_key_has_no_search_and_is_told_which_key_adds_it() -> None:
    source = generate()
    text = source.files["two_nodes.c"] + source.files["two_nodes.h"]
    assert [word for word in SEARCH if word in text] == []
    assert [function.quantity for function in source.manifest.functions] == list(
        load_scene(CORD)[1].quantities
    )
    assert (source.manifest.integrators[0].events, source.manifest.integrators[0].unwatched) == ((), 1)
    assert "1 cable" in explain(source)
    assert 'events = ["auto"] under [model]' in explain(source)
    assert len(source.files["two_nodes.c"].splitlines()) < 450  # with the search 1,328


@pytest.mark.parametrize("events", [("auto",), ("cable", "condition"), ("condition", "auto")])
def test_the_key_adds_the_search(events: tuple[str, ...]) -> None:
    source = generate(events=events)
    assert source.manifest.integrators[0].events == ("cable", "condition")
    text = source.files["two_nodes.c"] + source.files["two_nodes.h"]
    assert [word for word in SEARCH[1:] if word not in text] == []
    assert explain(source) == "integrators monitor cable, condition"


def test_a_scene_states_the_key_as_a_list() -> None:
    document = tomllib.loads(CORD.read_text(encoding="utf-8"))
    document["model"]["events"] = ["auto", "condition"]
    assert load_scene(document)[1].events == ("auto", "condition")


def test_analyses_of_motions_ask_for_events_where_the_scene_says_nothing() -> None:
    structure, request = load_scene(CORD)
    for analysis in ("simulate", "simulate_batch", "control"):
        assert want_analyses(structure, request, (analysis,)).events == ("auto",)
        assert want_analyses(structure, replace(request, events=()), (analysis,)).events == ()
    for analysis in ("equilibrium", "linearize", "analyse"):
        assert want_analyses(structure, request, (analysis,)).events is None


def test_derivatives_of_motions_need_events() -> None:
    structure, request = load_scene(CORD)
    assert find_events(request, lambda _: True, structure) == ((), ())
    request = replace(request, parameters={"rest_length": (0,)}, columns=("rest_length",))
    found = find_events(request, lambda _: True, structure)
    assert found == (("cable", "condition"), ("cable_margin",))


def test_a_motion_by_a_library_without_events_says_what_it_does_not_see() -> None:
    """As one by a library whose scene states events = []."""
    model = compile_scene(CORD, quantities=("kinetic_energy",))
    motion = simulate(model, 0.2, samples=3, method="rk4", stepping=Stepping(step=1e-3))
    assert "are not monitored (model.events)" in motion.message
    assert motion.events == ()


def test_single_precision_has_no_events_but_those_that_are_named() -> None:
    structure, request = load_scene(CORD)
    single = ModelRequest(request.quantities, integrators=("rk4",), precision="single", events=("auto",))
    assert emit(structure, single).manifest.integrators[0].events == ()
