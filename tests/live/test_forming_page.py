"""Pages in which a net is formed by sliders, in a real browser: shapes and forces are those of `form`."""

import csv
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import compile_scene, find_equilibrium, form, read_scene
from tensegrity_codegen.live.engine import add_forming
from tensegrity_codegen.live.live_scene import build_live_scene
from tensegrity_codegen.pipeline.forming.form import Form
from tensegrity_codegen.system.errors import InvalidValueError
from tests.cases import thorough
from tests.live.pages import GALLERY, write_page
from tests.report.browser import find_browser
from tests.report.driver import Browser, Tab, running_browser

in_browser = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
NET = GALLERY / "cable_net.toml"
DENSITY = {"edge": 20000.0, "sagging": 3000.0, "hogging": 3000.0, "edge1": 24000.0}
DOCUMENT = read_scene(NET).to_document()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with running_browser() as running:
        yield running


def open_form(browser: Browser, found: Form, density: dict[str, float], folder: Path, width: int) -> Tab:
    shown = build_live_scene(found.structure, tension=found.member_tension)
    tab = Tab(browser, width, 860, "light")
    tab.open(write_page(add_forming(shown, found, density), folder / "net.html"))
    return tab


@pytest.fixture(scope="module")
def tab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Tab:
    return open_form(browser, form(NET, density=DENSITY), DENSITY, tmp_path_factory.mktemp("net"), 1400)


def move(tab: Tab, sliders: dict[str, float]) -> dict[str, Any]:
    """Set sliders, all others to their start; return the state and what can be taken away."""
    script = """(values => {
      for (const input of document.querySelectorAll("#sliders input")) {
        if (!(input.dataset.name in values)) input.parentElement.dispatchEvent(new Event("dblclick"));
        else {
          input.value = values[input.dataset.name];
          input.dispatchEvent(new Event("input"));
        }
      }
      return {...tensegrity.state, ...tensegrity.formed,
        rest: Array.from(tensegrity.app.model.restLength),
        reaction: Array.from(tensegrity.app.state.reaction),
        text: document.getElementById("formed").innerText};
    })"""
    found: dict[str, Any] = tab.ask(f"{script}({json.dumps(sliders)})")
    return found


def change(height: float, load: float) -> dict[str, Any]:
    """Return the document of the net with supports and loads of other sizes."""
    nodes = {
        name: node | {"position": [*node["position"][:2], height * node["position"][2]]}
        if "anchored" in node
        else node
        for name, node in DOCUMENT["nodes"].items()
    }
    loads = [item | {"force": [load * value for value in item["force"]]} for item in DOCUMENT["loads"]]
    return {**DOCUMENT, "nodes": nodes, "loads": loads}


@in_browser
@pytest.mark.parametrize(
    ("sliders", "factors", "height", "load"),
    [
        ({}, {}, 1.0, 1.0),
        ({"hogging": -1, "heights": 2.5, "loads": 0}, {"hogging": 0.1}, 2.5, 0.0),
        ({"prestress": -0.5, "loads": 3, "edge1": 0.2}, {"all": 10**-0.5, "edge1": 10**0.2}, 1.0, 3.0),
        *thorough(
            ({"edge": 0.7, "sagging": -0.4}, {"edge": 10**0.7, "sagging": 10**-0.4}, 1.0, 1.0),
            ({"heights": 0, "sagging": 1}, {"sagging": 10.0}, 0.0, 1.0),
        ),
    ],
)
def test_the_page_finds_the_shapes_of_form(
    tab: Tab, sliders: dict[str, float], factors: dict[str, float], height: float, load: float
) -> None:
    shown = move(tab, sliders)
    density = {name: q * factors.get(name, 1.0) * factors.get("all", 1.0) for name, q in DENSITY.items()}
    found = form(change(height, load), density=density)
    assert shown["problem"] == ""
    np.testing.assert_allclose(np.reshape(shown["positions"], (-1, 3)), found.node_position, atol=1e-10)
    np.testing.assert_allclose(shown["tensions"], found.member_tension, rtol=1e-11)
    np.testing.assert_allclose(shown["rest"], found.rest_length, rtol=1e-11)
    lost = np.sum(np.reshape(shown["reaction"], (-1, 3)), axis=0) + found.structure.node_load.sum(axis=0)
    assert np.abs(lost).max() < 1e-9 * found.largest_force
    assert found.member_name[int(found.member_tension.argmax())] in shown["text"]
    # The scene to take away has this shape, and stands in it.
    scene = tomllib.loads(shown["scene"])
    again = form(scene, density=density)
    np.testing.assert_allclose(again.node_position, found.node_position, atol=1e-10)
    model = compile_scene(scene, for_=("equilibrium",))
    assert find_equilibrium(model).change < 1e-6
    rows = list(csv.DictReader(shown["members"].splitlines()))
    np.testing.assert_allclose([float(row["tension [N]"]) for row in rows], found.member_tension, rtol=1e-11)


def write_arch() -> dict[str, Any]:
    """Return an arch of bars over 5 m, its first joint tied to the ground, its fourth held in x."""
    nodes = {f"n{k}": {"position": [0.5 * k, 0.1], "anchored": k in (0, 10)} for k in range(11)}
    nodes["ground"] = {"position": [0.5, -1.0], "anchored": True}
    nodes["n4"]["anchored"] = "x"
    return {
        "name": "arch",
        "axes": "xz",
        "gravity": [0, -9.81],
        "nodes": nodes | {"n5": nodes["n5"] | {"mass": 2.0}},
        "classes": {
            "rib": {"kind": "bar", "axial_stiffness": 1e5},
            "rope": {"kind": "cable", "spring_constant": 50.0, "prestress": 1.0},
        },
        "members": {f"m{k}": {"nodes": [f"n{k}", f"n{k + 1}"], "class": "rib"} for k in range(10)}
        | {"tie": {"nodes": ["ground", "n1"], "class": "rope"}},
        "loads": [{"node": f"n{k}", "force": [0.2, -3.0]} for k in range(1, 10)],
    }


@in_browser
def test_bars_that_push_in_a_plane_and_what_has_no_shape(browser: Browser, tmp_path: Path) -> None:
    density = {"bars": -20.0, "m3": -30.0, "tie": 5.0}
    arch = write_arch()
    tab = open_form(browser, form(arch, density=density), density, tmp_path, 400)
    shown = move(tab, {"bars": 0.3, "loads": 1.5})
    arch["loads"] = [{**item, "force": [0.3, -4.5]} for item in arch["loads"]]
    found = form(arch, density=density | {"bars": -20.0 * 10**0.3})
    np.testing.assert_allclose(np.reshape(shown["positions"], (-1, 3)), found.node_position, atol=1e-12)
    np.testing.assert_allclose(shown["tensions"], found.member_tension, rtol=1e-11)
    again = form(tomllib.loads(shown["scene"]), density=density | {"bars": -20.0 * 10**0.3})
    np.testing.assert_allclose(again.node_position, found.node_position, atol=1e-12)
    assert tab.ask("document.documentElement.scrollWidth") == 400
    # A tie of 50 N/m cannot pull with 50 N/m: the last shape stays.
    refused = move(tab, {"tie": 1.0})
    assert refused["problem"].startswith("tie is too soft for")
    assert refused["problem"] in refused["text"]
    assert refused["positions"] == shown["positions"]
    assert move(tab, {})["problem"] == ""


@in_browser
def test_force_densities_that_cancel_have_no_shape(browser: Browser, tmp_path: Path) -> None:
    nodes = {name: {"position": [x, 0, 0], "anchored": name != "b"} for x, name in enumerate("abc")}
    kinds = {"pull": ("cable", "ab"), "push": ("bar", "bc")}
    members = {
        name: {"kind": kind, "nodes": list(ends), "axial_stiffness": 1e6, "rest_length": 1.0}
        for name, (kind, ends) in kinds.items()
    }
    loads = [{"node": "b", "force": [0.0, 0.0, -1.0]}]
    scene = {"name": "pair", "nodes": nodes, "members": members, "loads": loads}
    density = {"pull": 10.0, "push": -1.0}
    tab = open_form(browser, form(scene, density=density), density, tmp_path, 1400)
    assert "no shape is determined" in move(tab, {"push": 1.0})["problem"]


def test_members_without_a_force_density_have_no_page() -> None:
    found = form(NET, density={"edge": 20000.0}, force={"sagging": 8000.0, "hogging": 8000.0})
    with pytest.raises(InvalidValueError, match="needs the force density of every member") as raised:
        add_forming(build_live_scene(found.structure), found, {"edge": 20000.0})
    assert "144" in str(raised.value)
    assert raised.value.hint.startswith("`density`")
