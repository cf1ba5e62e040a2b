"""Models that run in pages: what the library is asked for, and the sliders of the page."""

import functools

import numpy as np
import pytest

from tensegrity_codegen.cli import picture
from tensegrity_codegen.cli.picture import request_play
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.live.engine import add_engine, choose_method
from tensegrity_codegen.live.live_scene import build_live_scene
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tests.cases import thorough
from tests.live.pages import EXAMPLES
from tests.live.test_live_scene import unpack


@functools.cache
def describe(name: str):
    subject, request = load_scene(EXAMPLES / f"{name}.toml")
    manifest = emit(subject, request_play(subject, request)).manifest
    scene = add_engine(build_live_scene(subject), subject, manifest, b"\0asm", rtol=1e-6)
    return subject, manifest, scene


@pytest.mark.parametrize("name", ["svd_tower", "planar", *thorough("prism12", "tower", "two_nodes")])
def test_everything_that_the_page_calls_is_there(name: str) -> None:
    subject, manifest, scene = describe(name)
    engine = scene.data["engine"]
    assert {"node_load", "gravity"} <= set(engine["sizes"])
    assert engine["sizes"]["node_load"] == subject.n_nodes * len(manifest.axes)
    assert {"member_tension", "acceleration", "kinetic_energy", "total_energy"} <= set(engine["functions"])
    in_nodes = bool(manifest.coordinate_node_axis)
    assert in_nodes == ("node_position" not in engine["functions"])
    for argument in manifest.arguments:
        assert len(unpack(scene.channels[f"nominal_{argument.name}"])) == engine["sizes"][argument.name]
    places = unpack(scene.channels["coordinate_place"]).astype(int)
    if in_nodes:
        stated = unpack(scene.channels["stated_position"])
        assert stated[places] == pytest.approx(np.array(manifest.arguments[0].nominal))
    assert not {"reaction", "use"} & set(scene.channels)
    assert engine["pull"]["stiffness"] > 0
    assert engine["pull"]["place"] == sum(engine["sizes"][name] for name in manifest.driven if name != "pull")


def test_sliders_have_the_ranges_of_actuators_and_the_values_of_the_scene() -> None:
    subject, manifest, scene = describe("prism12")
    sliders = {slider["label"]: slider for slider in scene.data["engine"]["sliders"]}
    actuator = subject.actuators[0]
    rest = subject.rest_length[list(subject.inputs[0].targets)][0]
    found = sliders[actuator.name]
    assert (found["low"] + rest, found["high"] + rest) == pytest.approx(actuator.range)
    for slider in sliders.values():
        assert slider["low"] <= slider["value"] <= slider["high"]
        assert slider["low"] < slider["high"]
        nominal = next(item for item in manifest.arguments if item.name == slider["argument"]).nominal
        assert set(slider["places"]) <= set(range(len(nominal)))
        if not slider["is_factor"]:
            assert {nominal[place] for place in slider["places"]} == {slider["value"]}


@pytest.mark.parametrize(("factor", "method"), [(1.0, "rk54"), (1e4, "radau")])
def test_stiff_bars_choose_the_implicit_method_where_the_library_has_it(factor: float, method: str) -> None:
    structure, _ = load_scene(EXAMPLES / "prism.toml")
    spring = structure.spring_constant * np.where(structure.is_bar, factor, 1.0)
    stiff = structure.with_changes(spring_constant=spring)
    assert choose_method(stiff, ("rk54", "radau")) == method
    assert choose_method(stiff, ("rk54",)) == "rk54"


def test_stiff_cables_do_not_choose_it() -> None:
    structure, _ = load_scene(EXAMPLES / "prism.toml")
    stiff = structure.with_changes(spring_constant=structure.spring_constant * 1e6)
    assert choose_method(stiff, ("rk54", "radau")) == "rk54"


@pytest.mark.parametrize(("name", "methods"), [("prism12", ["rk54", "radau"]), ("svd_tower", ["rk54"])])
def test_pages_offer_the_methods_of_the_library(name: str, methods: list[str]) -> None:
    _, _, scene = describe(name)
    offered = scene.data["engine"]["methods"]
    assert [item["name"] for item in offered] == methods
    assert [item["is_stiff"] for item in offered] == [item == "radau" for item in methods]
    assert scene.data["engine"]["method"] in methods


@pytest.mark.parametrize(("most", "integrators"), [(2000, ("rk54", "radau")), (0, ("rk54",))])
def test_many_members_have_the_implicit_method_on_request_only(
    most: int, integrators: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(picture, "MOST_OFFERED", most)
    subject, request = load_scene(EXAMPLES / "two_nodes.toml")
    assert request_play(subject, request).integrators == integrators
    assert request_play(subject, request, "radau").integrators == ("rk54", "radau")
