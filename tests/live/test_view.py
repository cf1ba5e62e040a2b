"""Live pages in notebooks: what the frame holds, where pages start, what is refused."""

import html
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tensegrity_codegen import LivePage, view
from tensegrity_codegen.live.live_scene import Channel, LiveStart, build_live_scene
from tensegrity_codegen.report.pictures.view import read_view
from tensegrity_codegen.system.errors import InvalidValueError, NonFiniteError
from tests.live.pages import load, require_three, sway
from tests.report.browser import find_browser
from tests.report.driver import Tab, running_browser

PRISM = load("prism")
MOTION = sway(PRISM, 5)
NOTEBOOK = """<!doctype html><meta charset="utf-8"><title>notebook</title>
<meta name="viewport" content="width=device-width">
<body style="margin:0"><p>Output of a cell:</p>{cell}</body>"""
INSIDE = "document.querySelector('iframe')?.contentWindow?.tensegrity"


def data_of(page: LivePage) -> dict[str, Any]:
    found = re.search(r'<script[^>]*id="scene"[^>]*>(.*?)</script>', page.html, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_a_page_shows_itself_in_a_frame_and_is_written(tmp_path: Path) -> None:
    require_three()
    page = view(MOTION, height=400, view="top", labels="nodes", follow=True)
    cell = page._repr_html_()
    frame = re.search(r'<iframe [^>]*srcdoc="([^"]*)"', cell)
    assert frame is not None
    assert html.unescape(frame[1]) == page.html
    assert "height:400px" in cell
    page.write(tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == page.html
    assert "prism" in repr(page)
    assert len(repr(page)) < 200
    data = data_of(page)
    assert data["start"] == {"labels": "nodes", "follow": True}
    assert data["view"] == pytest.approx([0.0, -1e-4, 1.0], abs=1e-12)
    assert data_of(view(PRISM))["start"] == {"labels": "none", "follow": False}


@pytest.mark.parametrize(
    ("options", "where"),
    [
        ({"height": 10}, "height"),
        ({"height": 400.0}, "height"),
        ({"height": True}, "height"),
        ({"view": "under"}, "view"),
        ({"labels": "cables"}, "labels"),
        ({"settle": "no"}, "settle"),
        ({"follow": 1}, "follow"),
        ({"follow": True}, "follow"),
    ],
)
def test_choices_that_do_not_exist_are_refused(options: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidValueError) as caught:
        view(PRISM, **options)
    assert caught.value.where == where
    assert caught.value.allowed


def test_a_motion_with_a_sample_that_is_not_finite_has_no_page() -> None:
    position = MOTION.node_position.copy()
    position[3, 0, 1] = math.nan
    with pytest.raises(NonFiniteError, match="node_position is not finite in sample 3"):
        build_live_scene(PRISM, replace(MOTION, node_position=position))


def test_only_what_stands_still_can_be_settled() -> None:
    require_three()
    with pytest.raises(InvalidValueError, match="equilibrium"):
        view(MOTION, settle=True)
    with pytest.raises(InvalidValueError, match="cannot be drawn"):
        view(3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "eye"), [("front", (0, -1, 0)), ("side", (1, 0, 0)), ("30,-90", (0, 0, -1))]
)
def test_the_first_view_is_the_chosen_one(text: str, eye: tuple[float, ...]) -> None:
    scene = build_live_scene(PRISM, start=LiveStart(view=read_view(text)))
    assert math.dist(scene.data["view"], eye) < 2e-3
    assert scene.data["up"] == [0.0, 0.0, 1.0]


def test_a_planar_scene_is_seen_along_its_normal() -> None:
    build_live_scene(load("planar"), start=LiveStart(view=read_view("front")))
    with pytest.raises(InvalidValueError, match="in its plane"):
        build_live_scene(load("planar"), start=LiveStart(view=read_view("top")))


def values_of(channel: Channel) -> np.ndarray[Any, Any]:
    import base64
    import gzip

    data = gzip.decompress(base64.b64decode(channel.data))
    return np.frombuffer(data, dtype=np.dtype(channel.kind).newbyteorder("<")).reshape(channel.shape)


def test_loads_that_change_are_in_the_page() -> None:
    assert "load_motion" not in build_live_scene(PRISM, MOTION).channels
    load = np.tile(PRISM.node_load, (5, 1, 1))
    load[:, 2, 0] = np.linspace(0.0, 4.0, 5)
    scene = build_live_scene(PRISM, replace(MOTION, node_load=load))
    loaded = values_of(scene.channels["loaded"])
    np.testing.assert_allclose(values_of(scene.channels["load_motion"]), load[:, loaded], atol=1e-6)
    assert scene.data["largest_load"] == pytest.approx(4.0)
    # Supports hold what is pushed into them.
    pushed = np.tile(PRISM.node_load, (5, 1, 1))
    held = np.flatnonzero(PRISM.node_anchored.any(axis=1))
    pushed[:, held, 2] -= 7.0
    reactions = [
        values_of(build_live_scene(PRISM, replace(MOTION, node_load=item)).channels["reaction"])
        for item in (np.tile(PRISM.node_load, (5, 1, 1)), pushed)
    ]
    np.testing.assert_allclose((reactions[1] - reactions[0])[..., 2], 7.0, atol=1e-4)


@pytest.mark.thorough
@pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
@pytest.mark.parametrize("width", [400, 1400])
def test_a_notebook_page_shows_the_structure_in_its_frame(width: int, tmp_path: Path) -> None:
    require_three()
    load = np.tile(PRISM.node_load, (5, 1, 1))
    load[:, 4, 0] = np.linspace(0.0, 4.0, 5)
    page = view(replace(MOTION, node_load=load), view="front", labels=True, follow=True)
    path = tmp_path / "notebook.html"
    path.write_text(NOTEBOOK.format(cell=page._repr_html_()), encoding="utf-8")
    with running_browser() as browser:
        tab = Tab(browser, width, 860, "light")
        tab.open(path, ready=f"{INSIDE}?.ready === true")
        camera = tab.ask(f"{INSIDE}.camera")
        towards = np.subtract(camera["position"], camera["target"])
        assert towards / np.linalg.norm(towards) == pytest.approx([0, -1, 0], abs=1e-3)
        assert tab.ask(f"{INSIDE}.app.labels.kind") == "all"
        assert tab.ask(f"{INSIDE}.app.stage.follow") is True
        tab.frame()
        assert 0.002 < tab.ask(f"{INSIDE}.coverage()") < 0.6
        for k in (0, 4):
            tab.ask(f"{INSIDE}.seekFrame({k}); {INSIDE}.state")
            shown = tab.ask(f"Array.from({INSIDE}.app.model.load.slice(12, 15))")
            assert shown == pytest.approx(load[k, 4], abs=1e-6)
        tab.photograph(tmp_path / "notebook.png")
        assert tab.complaints() == []
        assert tab.requests() == []
