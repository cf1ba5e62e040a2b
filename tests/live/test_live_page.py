"""Live pages in a real browser: turned, scrubbed, pointed at; what they show is the motion itself."""

import json
import math
import re
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.live.live_scene import LiveStart, build_live_scene
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.report.pictures.view import Direction
from tensegrity_codegen.runtime.trajectory.trajectory import Trajectory
from tests.cases import thorough
from tests.live.pages import GALLERY, load, sway, write_page
from tests.report.browser import find_browser
from tests.report.driver import Browser, Tab, running_browser

pytestmark = pytest.mark.skipif(find_browser() is None, reason="no chromium is installed")
PRISM = load("prism")
MOTION = sway(PRISM)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with running_browser() as running:
        yield running


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(build_live_scene(PRISM, MOTION), tmp_path_factory.mktemp("live") / "prism.html")


@pytest.fixture(scope="module")
def tab(browser: Browser, page: Path) -> Tab:
    opened = Tab(browser, 1400, 860, "light")
    opened.open(page)
    return opened


def place_of(tab: Tab, node: str) -> tuple[float, float]:
    """Where a node stands in the window [px]."""
    x, y = tab.ask(f"tensegrity.place({PRISM.node_name.index(node)})")
    box = tab.ask("(({left, top}) => [left, top])(document.getElementById('view').getBoundingClientRect())")
    return x + box[0], y + box[1]


def test_a_prism_of_200_samples_is_small_and_complete(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(text.encode()) < 1_500_000
    assert "three.js authors" in text
    assert "Permission is hereby granted" in text
    assert 'content="tensegrity_codegen"' in text[:2000]


def test_positions_read_back_equal_the_motion(tab: Tab) -> None:
    found = tab.ask(
        "(() => { const rows = []; for (let k = 0; k < tensegrity.frames; k++) {"
        " tensegrity.seekFrame(k); tensegrity.app.read(tensegrity.app);"
        " const { positions, tensions, time } = tensegrity.state; rows.push([positions, tensions, time]); }"
        " return rows; })()"
    )
    rounding = tab.ask("tensegrity.rounding")
    assert len(found) == len(MOTION.time) == 200
    position = np.array([row[0] for row in found]).reshape(MOTION.node_position.shape)
    assert np.abs(position - MOTION.node_position).max() <= rounding["node_position"] + 1e-12
    tension = np.array([row[1] for row in found])
    assert np.abs(tension - MOTION.member_tension).max() <= rounding["member_tension"] + 1e-12
    assert [row[2] for row in found] == pytest.approx(MOTION.time)
    assert rounding["node_position"] < 1e-7


def test_the_mouse_turns_and_zooms_the_picture(tab: Tab) -> None:
    tab.ask("tensegrity.pause(); tensegrity.seekFrame(0); tensegrity.app.reset()")
    tab.frame()
    before = tab.ask("tensegrity.camera")
    tab.drag((300, 700), (520, 640))
    tab.frame()
    after = tab.ask("tensegrity.camera")
    distance = [math.dist(view["position"], view["target"]) for view in (before, after)]
    assert math.dist(before["position"], after["position"]) > 0.2 * distance[0]
    assert distance[1] == pytest.approx(distance[0], rel=1e-3)
    tab.mouse("Wheel", 500, 400, wheel=300)
    far = "(({position, target}) => Math.hypot(...position.map((v, k) => v - target[k])))(tensegrity.camera)"
    tab.wait(f"{far} > {1.05 * distance[1]}")
    tab.press("r")
    tab.frame()
    assert tab.ask("tensegrity.camera")["position"] == pytest.approx(before["position"], rel=1e-6, abs=1e-9)
    assert 0.005 < tab.ask("tensegrity.coverage()") < 0.5


def drift(sizes: float) -> Trajectory:
    """Return a motion of the prism that moves it upwards by a multiple of its size."""
    size = float(np.linalg.norm(np.ptp(PRISM.node_position, axis=0)))
    rise = np.linspace(0.0, sizes * size, len(MOTION.time))[:, None, None] * [0.0, 0.0, 1.0]
    return replace(MOTION, node_position=PRISM.node_position + rise)


INSIDE = """[...tensegrity.names.nodes.keys()].every(k => {
  const [x, y] = tensegrity.place(k), {width, height} = tensegrity.app.stage;
  return x > 0 && x < width && y > 0 && y < height; })"""
LOST = "!document.getElementById('left').hidden"


@pytest.mark.thorough
def test_a_page_starts_with_the_whole_motion_in_view_or_says_how_to_find_it(
    browser: Browser, tmp_path: Path
) -> None:
    opened = Tab(browser, 1000, 700, "light")
    scene = replace(build_live_scene(PRISM, drift(2.0)), warnings=("the first falls", "<second>"))
    opened.open(write_page(scene, tmp_path / "near.html"))
    assert opened.ask("document.getElementById('warnings').innerText.split('\\n').at(-1)") == "<second>"
    for frame in (0, len(MOTION.time) - 1):
        opened.ask(f"tensegrity.seekFrame({frame})")
        opened.frame()
        assert opened.ask(f"{INSIDE} && !({LOST}) && !tensegrity.app.stage.follow"), frame
    opened.ask("tensegrity.app.orbit(0, 0, 0.1)")
    opened.wait(LOST)
    opened.ask("document.getElementById('left-fit').click()")
    opened.wait(f"{INSIDE} && !({LOST})")
    opened.open(write_page(build_live_scene(PRISM, drift(30.0)), tmp_path / "far.html"))
    assert "30 times" in opened.ask("document.getElementById('follow-note').innerText")
    opened.ask(f"tensegrity.seekFrame({len(MOTION.time) - 1})")
    opened.wait(f"{INSIDE} && !({LOST})")
    opened.ask("tensegrity.app.followBy(false); tensegrity.app.fit(); tensegrity.seekFrame(0)")
    opened.wait(f"{LOST} && document.getElementById('follow-note').hidden")
    opened.press("o")
    opened.wait(f"{INSIDE} && !({LOST})")
    assert opened.complaints() == []
    opened.send("Page.close")


def distance_of(view: dict[str, list[float]]) -> float:
    return math.dist(view["position"], view["target"])


@pytest.mark.thorough
def test_one_finger_turns_two_zoom_and_a_tap_chooses(browser: Browser, page: Path) -> None:
    phone = Tab(browser, 400, 800, "light")
    phone.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    phone.open(page)
    phone.frame()
    before = phone.ask("tensegrity.camera")
    phone.touch([(60 + 25 * k, 420.0) for k in range(7)])
    phone.frame()
    turned = phone.ask("tensegrity.camera")
    assert math.dist(before["position"], turned["position"]) > 0.2 * distance_of(before)
    assert distance_of(turned) == pytest.approx(distance_of(before), rel=1e-3)
    assert phone.ask("tensegrity.chosen") is None
    phone.touch([(180 - 15 * k, 300.0) for k in range(7)], [(220 + 15 * k, 300.0) for k in range(7)])
    phone.frame()
    assert distance_of(phone.ask("tensegrity.camera")) < 0.7 * distance_of(turned)
    phone.ask("tensegrity.app.reset()")
    phone.frame()
    x, y = place_of(phone, PRISM.node_name[0])
    phone.touch([(x, y)])
    phone.wait("tensegrity.chosen !== null")
    assert phone.ask("document.getElementById('chosen').innerText").startswith(PRISM.node_name[0])
    for name in ("play", "fit", "from", "turn", "picture", "film", "theme"):
        box = f"document.getElementById('{name}').getBoundingClientRect()"
        width, height = phone.ask(f"(({{ width, height }}) => [width, height])({box})")
        assert min(width, height) >= 40
    assert phone.ask("document.documentElement.scrollWidth") <= 400
    assert phone.complaints() == []
    phone.send("Page.close")


def box_of(tab: Tab, name: str) -> dict[str, float]:
    """Edges of an element in the window [px]."""
    found = tab.ask(f"document.getElementById('{name}').getBoundingClientRect().toJSON()")
    return dict(found)


@pytest.mark.parametrize(
    ("width", "height"), [(400, 480), *thorough((400, 800), (700, 400), (1000, 480), (1400, 860))]
)
def test_nothing_covers_the_legend_and_all_is_reached_without_scrolling_the_picture_away(
    browser: Browser, page: Path, width: int, height: int
) -> None:
    opened = Tab(browser, width, height, "light")
    opened.open(page)
    opened.frame()
    legend, stage, bar, start = (box_of(opened, name) for name in ("legend", "stage", "transport", "start"))
    assert stage["top"] <= legend["top"]
    assert legend["bottom"] <= stage["bottom"] <= bar["top"]
    assert bar["bottom"] <= height
    assert start["left"] >= legend["right"] or start["top"] >= legend["bottom"]
    aside = opened.ask("document.querySelector('aside').getBoundingClientRect().toJSON()")
    assert aside["height"] >= 100
    assert aside["bottom"] <= bar["top"] + 1
    assert opened.ask("document.documentElement.scrollHeight <= innerHeight")
    assert opened.ask(INSIDE)
    texts = opened.ask("[...document.querySelectorAll('button')].map(item => item.innerText).filter(Boolean)")
    assert len(set(texts)) == len(texts)
    opened.ask("document.getElementById('start').click()")
    opened.wait("document.getElementById('start').hidden && tensegrity.time > 0")
    opened.send("Page.close")


@pytest.mark.parametrize("name", ["stated", *thorough("chosen")])
def test_views_along_an_axis_are_parallel_projections(browser: Browser, tmp_path: Path, name: str) -> None:
    start = LiveStart(view=Direction("top", -90.0, 90.0)) if name == "stated" else LiveStart()
    opened = Tab(browser, 1000, 700, "light")
    opened.open(write_page(build_live_scene(PRISM, start=start), tmp_path / "top.html"))
    if name == "chosen":
        opened.ask("tensegrity.lookFrom('top')")
    opened.frame()
    count = len(PRISM.node_name)
    place = np.array(opened.ask(f"[...Array({count}).keys()].map(k => tensegrity.place(k))"))
    # Right is x, up is y, at one scale, whatever z: a plan.
    plan = np.column_stack([PRISM.node_position[:, :2] * [1, -1], np.ones(count)])
    scale = np.linalg.lstsq(plan, place, rcond=None)[0]
    assert np.abs(plan @ scale - place).max() < 0.5
    assert scale[0, 0] == pytest.approx(scale[1, 1], rel=1e-3)
    bar = opened.ask("document.getElementById('measure').innerText"), box_of(opened, "measure")
    length = float(bar[0].split()[0]) / 1000  # mm
    drawn = opened.ask("document.querySelector('#measure i').getBoundingClientRect().width")
    assert drawn == pytest.approx(length * scale[0, 0], abs=1.0)
    opened.send("Page.close")


KEEP_FILES = """(() => { window.files = []; const make = URL.createObjectURL;
  URL.createObjectURL = blob => { files.push([blob.type, blob.size]); return make(blob); };
  HTMLAnchorElement.prototype.click = function () { files.at(-1).push(this.download); }; })()"""


@pytest.mark.thorough
def test_a_picture_and_a_film_are_saved(tab: Tab) -> None:
    tab.ask(KEEP_FILES)
    tab.ask("document.getElementById('picture').click()")
    tab.wait("files.length === 1 && files[0].length === 3")
    kind, size, name = tab.ask("files[0]")
    assert (kind, name) == ("image/png", "prism.png")
    assert size > 10_000
    tab.ask("tensegrity.app.player.speed = 5; document.getElementById('film').click()")
    tab.wait("files.length === 2 && files[1].length === 3")  # it ends with the motion
    kind, size, name = tab.ask("files[1]")
    assert kind.startswith("video/webm")
    assert name == "prism.webm"
    assert size > 10_000
    tab.ask("tensegrity.pause(); tensegrity.seekFrame(0); tensegrity.app.player.speed = 1")


def test_looks_can_be_changed_and_what_is_unknown_is_refused(tab: Tab) -> None:
    tab.ask("tensegrity.seekFrame(0); tensegrity.colorBy('tension')")
    limit = tab.ask("tensegrity.app.colorings.tension.limit")
    tab.ask(f"tensegrity.app.colorings.tension.limit = {limit / 4}; tensegrity.app.changed()")
    tab.wait("document.getElementById('scale-high').innerText.startsWith('≥')")
    tab.ask(f"tensegrity.app.colorings.tension.limit = {limit}; tensegrity.app.changed()")
    tab.wait("!document.getElementById('scale-high').innerText.startsWith('≥')")
    radii = np.array(tab.ask("Array.from(tensegrity.app.meshes.radii)"))
    tab.press("w")
    tab.frame()
    by_force = np.array(tab.ask("Array.from(tensegrity.app.meshes.radii)"))
    bars = PRISM.is_bar
    order = np.argsort(np.abs(MOTION.member_tension[0, bars]))
    assert (np.diff(by_force[bars][order]) >= 0).all()
    tab.press("w")
    tab.frame()
    assert np.array(tab.ask("Array.from(tensegrity.app.meshes.radii)")) == pytest.approx(radii)
    before = tab.ask("tensegrity.camera.position")
    tab.ask("document.getElementById('turn').click()")
    tab.wait(f"Math.hypot(...tensegrity.camera.position.map((x, k) => x - {before}[k])) > 0.01")
    tab.ask("document.getElementById('turn').click(); tensegrity.app.reset()")
    for call in (
        "colorBy('heat')",
        "lookFrom('below')",
        "choose({ member: 99 })",
        "orbit(NaN, 0)",
        "seek('a')",
    ):
        asked = f"(() => {{ try {{ tensegrity.{call}; }} catch (error) {{ return error.message; }} }})()"
        assert tab.ask(asked).startswith("allowed: ")
    tab.frame()
    assert tab.complaints() == []


@pytest.mark.thorough
def test_cables_and_arrows_are_thinner_than_bars(browser: Browser, tmp_path: Path) -> None:
    thin = replace(PRISM, radius=np.where(PRISM.is_bar, 1e-3, 0.0))
    opened = Tab(browser, 1400, 860, "light")
    opened.open(write_page(build_live_scene(thin, MOTION), tmp_path / "thin.html"))
    radii = np.array(opened.ask("Array.from(tensegrity.app.meshes.radii)"))
    assert radii[PRISM.is_bar] == pytest.approx(1e-3)
    assert radii[~PRISM.is_bar].max() < 0.7e-3
    assert np.ptp(radii[~PRISM.is_bar]) > 0.05e-3  # by the largest force
    assert opened.ask("tensegrity.app.arrows.mesh.material.uniforms.thinnest.value") < 0.7e-3
    opened.send("Page.close")


@pytest.mark.thorough
def test_axes_a_scale_bar_and_shadows_are_drawn(browser: Browser, page: Path, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    opened = Tab(browser, 1000, 700, "light")
    opened.open(page)
    opened.ask("tensegrity.app.showArrows(false)")

    def count(name: str, box: dict[str, float], tolerance: int = 5) -> int:
        """Pixels of a colour of the palette within a box."""
        opened.frame()
        opened.photograph(tmp_path / "page.png")
        pixels = np.asarray(image.open(tmp_path / "page.png").convert("RGB")).astype(int)
        color = opened.ask(
            f"[1, 3, 5].map(k => parseInt(tensegrity.app.palette.css.{name}.slice(k, k + 2), 16))"
        )
        left, top, right, bottom = (round(box[edge]) for edge in ("left", "top", "right", "bottom"))
        return int((np.abs(pixels[top:bottom, left:right] - color).max(axis=2) <= tolerance).sum())

    stage = box_of(opened, "stage")
    corner = stage | {"right": stage["left"] + 84, "bottom": stage["top"] + 84}
    assert count("ink", corner, 120) > 60  # three arms and letters, whose edges are smoothed
    assert count("ink", box_of(opened, "measure")) > 80
    assert count("shadow", stage) > 500
    opened.ask("tensegrity.orbit(0, -10)")  # from above
    assert count("shadow", stage) > 2000
    opened.ask("tensegrity.app.meshes.group.children.find(mesh => mesh.renderOrder === -2).visible = false")
    opened.ask("tensegrity.app.changed()")
    assert count("shadow", stage) < 300  # edges of other lines
    opened.send("Page.close")


@pytest.mark.thorough
def test_labels_of_large_numbers_are_not_cut(browser: Browser, tmp_path: Path) -> None:
    large = replace(
        MOTION, kinetic_energy=MOTION.kinetic_energy * 1e25, total_energy=MOTION.total_energy * 1e25
    )
    opened = Tab(browser, 1400, 860, "light")
    opened.open(write_page(build_live_scene(PRISM, large), tmp_path / "large.html"))
    opened.ask("""(() => { window.texts = []; const write = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
        texts.push([text, x - (this.textAlign === "right" ? this.measureText(text).width : 0)]);
        write.call(this, text, x, y); }; })()""")
    opened.press("t")  # draws the diagrams again
    opened.wait("texts.some(([text]) => text.includes('J'))")
    found = opened.ask("texts.filter(([text]) => text.endsWith('J'))")
    assert all(left >= 0 for _, left in found)
    assert any("e25 J" in text for text, _ in found)
    opened.send("Page.close")


def test_a_page_that_is_not_ready_yet_says_so_on_paper(browser: Browser, page: Path, tmp_path: Path) -> None:
    text = page.read_text(encoding="utf-8")
    waiting = tmp_path / "waiting.html"
    waiting.write_text(text[: text.rindex("<script>")] + "</body></html>", encoding="utf-8")
    opened = Tab(browser, 400, 700, "dark")
    opened.open(waiting, "document.readyState === 'complete'")
    cover = "document.elementFromPoint(200, 250)"
    assert opened.ask(f"{cover}.innerText") == "loading …"
    assert opened.ask(f"getComputedStyle({cover}).backgroundColor") == "rgb(20, 24, 29)"
    opened.open(page)
    opened.wait("document.getElementById('loading') === null")
    opened.send("Page.close")


def test_a_dome_has_lines_of_two_pixels_and_forces_in_one_unit_outside_of_it(
    browser: Browser, tmp_path: Path
) -> None:
    dome = load_scene(GALLERY / "snow_dome.toml")[0]
    opened = Tab(browser, 1400, 860, "light")
    opened.open(write_page(build_live_scene(dome), tmp_path / "dome.html"))
    pixel = "2 * Math.tan(stage.camera.fov * Math.PI / 360) / stage.height"
    least = opened.ask(
        f"(({{ stage, meshes }}) => 2 * meshes.shared.least.value / ({pixel}))(tensegrity.app)"
    )
    assert least == pytest.approx(2.0)
    ends = np.reshape(opened.ask("tensegrity.app.arrows.points()"), (-1, 2, 3))
    held = ends[-int(dome.node_anchored.all(axis=1).sum()) :]
    loads = np.linalg.norm(np.ptp(ends[: -len(held)], axis=1), axis=1)
    assert loads.min() == pytest.approx(opened.ask("tensegrity.app.arrows.shortest"), rel=1e-3)
    assert loads.min() > 0.03 * np.linalg.norm(np.ptp(dome.node_position, axis=0))  # seen beside reactions
    out = np.linalg.norm(held[:, :, :2], axis=2)  # from the axis of the dome: start, end
    assert np.all(out[:, 0] > 6.0)
    assert np.all(out[:, 1] > out[:, 0])
    words = opened.ask("document.getElementById('legend').innerText")
    assert re.search(r"load up to 7 kN, arrows at least [\d.]+ m", words)
    assert "reaction up to 83.5 kN" in words
    assert re.search(r"\d m, arrows \d+ kN", words)
    assert opened.ask("document.getElementById('headline').innerText").endswith("not in balance at ht")
    opened.send("Page.close")


def test_the_slider_scrubs_and_keys_step(tab: Tab) -> None:
    tab.ask("tensegrity.seekFrame(0)")
    box = tab.ask(
        "(({left, top, width, height}) => [left, top, width, height])"
        "(document.getElementById('time').getBoundingClientRect())"
    )
    place = (box[0] + 0.75 * box[2], box[1] + box[3] / 2)
    tab.mouse("Moved", *place)
    tab.mouse("Pressed", *place, button="left")
    tab.mouse("Released", *place, button="left")
    tab.wait("Math.abs(tensegrity.time - 1.5) < 0.05")
    tab.ask("document.activeElement.blur(); tensegrity.seekFrame(10)")
    tab.press(".")
    tab.frame()
    assert tab.ask("tensegrity.state.frame") == 11
    tab.press("Home")
    tab.frame()
    assert tab.ask("tensegrity.time") == 0.0


def test_play_moves_the_clock_and_pause_stops_it(tab: Tab) -> None:
    tab.ask("tensegrity.seekFrame(0)")
    tab.press(" ")
    tab.wait("tensegrity.time > 0.05")
    tab.press(" ")
    time = tab.ask("tensegrity.time")
    tab.frame()
    tab.frame()
    assert tab.ask("tensegrity.time") == time


def test_a_click_names_a_member_with_its_numbers(tab: Tab) -> None:
    tab.ask("tensegrity.seekFrame(0); tensegrity.app.reset()")
    tab.frame()
    member = PRISM.member_name.index("vertical1")
    first, second = (PRISM.node_name[k] for k in PRISM.connectivity[member])
    a, b = place_of(tab, first), place_of(tab, second)
    place = (0.6 * a[0] + 0.4 * b[0], 0.6 * a[1] + 0.4 * b[1])
    tab.mouse("Moved", *place)
    tab.wait("!document.getElementById('tip').hidden")
    assert "vertical1" in tab.ask("document.getElementById('tip').innerText")
    tab.mouse("Pressed", *place, button="left")
    tab.mouse("Released", *place, button="left")
    tab.wait("tensegrity.chosen !== null")
    assert tab.ask("tensegrity.chosen") == {"member": member}
    text = tab.ask("document.getElementById('chosen').innerText")
    for word in ("vertical1", "length", "tension", "force density"):
        assert word in text
    tension = float(MOTION.member_tension[0, member])
    assert f"{tension:.4g}".rstrip("0") in text
    tab.press("Escape")
    assert tab.ask("tensegrity.chosen") is None


def test_colours_follow_tensions_and_slack_cables_are_told_apart(tab: Tab) -> None:
    tab.ask("tensegrity.colorBy('tension'); tensegrity.seekFrame(0)")
    tab.frame()
    slack = np.array(tab.ask("tensegrity.state.slack"), dtype=bool)
    lengths = np.array(tab.ask("tensegrity.state.lengths"))
    loose = PRISM.tension_only & (MOTION.member_tension[0] <= 0) & (lengths < 0.999 * PRISM.rest_length)
    assert slack[loose].all()
    assert not slack[MOTION.member_tension[0] > 0].any()
    colors = np.array(tab.ask("tensegrity.colors")).reshape(-1, 4)
    assert set(colors[slack, 3]) <= {0}
    assert set(colors[~slack, 3]) == {255}
    pressed = PRISM.is_bar & (MOTION.member_tension[0] < 0)
    pulled = ~slack & (MOTION.member_tension[0] > 0.2 * MOTION.member_tension.max())
    assert (colors[pressed, 2] >= colors[pressed, 0]).all()  # blue
    assert (colors[pulled, 0] > colors[pulled, 2]).all()  # vermilion
    tab.ask("tensegrity.colorBy('kind')")
    tab.frame()
    kinds = np.array(tab.ask("tensegrity.colors")).reshape(-1, 4)[:, :3]
    assert len(np.unique(kinds[PRISM.is_bar & ~slack], axis=0)) == 1
    tab.ask("tensegrity.colorBy('tension')")


def test_the_page_asks_for_nothing_and_does_not_complain(tab: Tab) -> None:
    assert tab.complaints() == []
    assert tab.requests() == []


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(400, 800), (1400, 860)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_width_and_theme(browser: Browser, page: Path, width: int, height: int, scheme: str) -> None:
    opened = Tab(browser, width, height, scheme)
    opened.open(page)
    opened.frame()
    assert opened.ask("document.documentElement.scrollWidth") <= width
    paper = opened.ask("getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 24, 29)")
    assert 0.005 < opened.ask("tensegrity.coverage()") < 0.6
    assert opened.complaints() == []
    opened.send("Page.close")


@pytest.mark.thorough
def test_a_camera_that_follows_keeps_a_falling_structure_in_the_picture(
    browser: Browser, tmp_path: Path
) -> None:
    fall = np.array([0.0, 0.0, -500.0]) * MOTION.time[:, None, None] ** 2
    falling = replace(MOTION, node_position=MOTION.node_position + fall)
    opened = Tab(browser, 1000, 700, "light")
    opened.open(write_page(build_live_scene(PRISM, falling), tmp_path / "fall.html"))
    opened.ask("tensegrity.app.followBy(true); tensegrity.seekFrame(150)")
    opened.frame()
    target = opened.ask("tensegrity.camera.target")
    middle = falling.node_position[150].mean(axis=0)
    assert math.dist(target, middle) < 0.5 * np.ptp(PRISM.node_position, axis=0).max()
    assert opened.ask("tensegrity.coverage()") > 0.003
    opened.send("Page.close")


@pytest.mark.thorough
def test_names_of_any_letters_stand_as_they_are(browser: Browser, tmp_path: Path) -> None:
    names = ("</script><i>", "Knoten ß\\")
    structure = load("two_nodes").with_changes(
        name='</script><b>ü "x" <!-- &', node_name=names, member_name=("</style><script>alert(1)</script>",)
    )
    opened = Tab(browser, 400, 700, "dark")
    opened.open(write_page(build_live_scene(structure), tmp_path / "odd.html"))
    opened.ask("tensegrity.choose({ member: 0 }); tensegrity.app.labelBy('nodes')")
    opened.frame()
    assert opened.ask("tensegrity.names.nodes") == list(names)
    assert opened.ask("document.title") == structure.name
    assert opened.ask("document.getElementById('chosen').innerText").startswith(structure.member_name[0])
    assert opened.complaints() == []
    opened.send("Page.close")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["planar", "svd_tower", "two_nodes", "prism12"])
def test_other_structures_stand_still(browser: Browser, tmp_path: Path, name: str) -> None:
    path = write_page(build_live_scene(load(name)), tmp_path / f"{name}.html")
    opened = Tab(browser, 1000, 700, "light")
    opened.open(path)
    opened.frame()
    assert opened.ask("document.getElementById('transport').hidden") is True
    assert opened.ask("tensegrity.coverage()") > 0.0005
    assert opened.ask("tensegrity.app.colorings.tension.scale") == (
        "onesided" if name == "two_nodes" else "diverging"
    )
    unknown = opened.ask("tensegrity.state.tensions.filter(value => Number.isNaN(value)).length")
    assert unknown == (9 if name == "svd_tower" else 0)
    keys = opened.ask("document.getElementById('keys').innerText.split('\\n')")
    assert ("reactions unknown (3)" in keys) == (name == "svd_tower")
    assert name != "svd_tower" or "reaction" not in keys
    assert opened.complaints() == []
    opened.send("Page.close")


def see_simple_shapes(tab: Tab) -> None:
    """A slow picture has lines for cables while it moves, and all of them once it stands still."""
    fine = "tensegrity.app.meshes.group.children[0].visible"
    assert tab.ask(fine)
    tab.ask("tensegrity.app.stage.isSimple = true; tensegrity.play()")
    tab.wait("tensegrity.timing.isSimple")
    tab.frame()
    assert tab.ask(f"!{fine} && tensegrity.coverage() > 0.005")
    tab.ask("tensegrity.pause()")
    tab.wait(fine)
    tab.ask("tensegrity.seekFrame(0)")


@pytest.mark.thorough
def test_frame_times_of_ten_thousand_members(
    browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    side = 71
    names = [f"n{k}" for k in range(side * side)]
    place = np.array([(k // side, k % side, 0.0) for k in range(side * side)], dtype=float)
    pairs = [(k, k + 1) for k in range(side * side) if (k + 1) % side]
    pairs += [(k, k + side) for k in range(side * (side - 1))]
    count = len(pairs)
    structure = load("prism").with_changes(
        node_name=tuple(names), node_position=place, node_velocity=np.zeros_like(place),
        node_mass=np.ones(len(names)), node_anchored=np.zeros(place.shape, dtype=bool),
        node_load=np.zeros_like(place), member_name=tuple(f"m{k}" for k in range(count)),
        member_class=("rope",) * count, connectivity=np.array(pairs), is_bar=np.zeros(count, dtype=bool),
        tension_only=np.ones(count, dtype=bool), rest_length=np.full(count, 0.9),
        spring_constant=np.full(count, 10.0), axial_stiffness=np.zeros(count), damping=np.zeros(count),
        member_mass=np.zeros(count), radius=np.zeros(count), inner_radius=None, groups={}, inputs=(),
        law_parameter={}, interference=None,
    )  # fmt: skip
    motion = sway(structure, 40, 0.003)
    opened = Tab(browser, 1400, 860, "light")
    opened.open(write_page(build_live_scene(structure, motion), tmp_path / "net.html"))
    found = opened.ask("tensegrity.measure(20)")
    with capsys.disabled():
        total, script = (statistics.median(found[key][3:]) for key in ("total", "script"))
        print(json.dumps({"members": count, "frame_ms": round(total, 1), "script_ms": round(script, 1)}))
    assert count > 9900
    assert opened.ask("tensegrity.coverage()") > 0.01
    see_simple_shapes(opened)
    position = np.array(opened.ask("tensegrity.state.positions")).reshape(-1, 3)
    rounding = opened.ask("tensegrity.rounding.node_position")
    assert np.abs(position - motion.node_position[0]).max() <= rounding + 1e-12
    assert opened.complaints() == []
    opened.send("Page.close")
