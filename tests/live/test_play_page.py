"""Pages with the compiled model inside, in a real browser: numbers, pulled nodes, sliders, clock."""

import ctypes
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tensegrity_codegen.cli.app import main
from tensegrity_codegen.cli.picture import request_play
from tensegrity_codegen.live.engine import add_engine
from tensegrity_codegen.live.live_scene import build_live_scene
from tensegrity_codegen.pipeline.build_library import build_library
from tensegrity_codegen.pipeline.compile_scene import load_scene
from tensegrity_codegen.scene.write import write_scene
from tensegrity_codegen.tables.manifest import STATUS
from tests.codegen.compilers import require_compiler
from tests.live.pages import EXAMPLES, require_three, write_page
from tests.live.test_worker import QUAD
from tests.report.browser import find_browser
from tests.report.driver import Browser, Tab, running_browser
from tests.rigid_scenes import HANGING as RODS

# Zig compiles the C library of WebAssembly the first time, for minutes where the processor is shared.
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.optimised,
    pytest.mark.timeout(1800),
    pytest.mark.skipif(find_browser() is None, reason="no chromium is installed"),
]
RTOL = 1e-7
SLICE = 1 / 120  # s, as in worker.js


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    require_compiler("zig")
    with running_browser() as running:
        yield running


def open_page(browser: Browser, name: str, folder: Path, width: int = 1400) -> Tab:
    subject, request = load_scene(EXAMPLES / f"{name}.toml")
    built = build_library(subject, request_play(subject, request), target="wasm32")
    scene = add_engine(build_live_scene(subject), subject, built.manifest, built.path.read_bytes(), rtol=RTOL)
    tab = Tab(browser, width, 860, "light")
    tab.open(write_page(scene, folder / f"{name}.html"))
    return tab


@pytest.fixture(scope="module")
def tab(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Tab:
    return open_page(browser, "tower", tmp_path_factory.mktemp("play"))


@pytest.fixture(autouse=True)
def start(tab: Tab) -> None:
    tab.ask("tensegrity.order('pull', { pull: null })")
    tab.ask("tensegrity.order('method', { name: 'rk54' })")
    tab.ask("tensegrity.order('reset')")


def run_native(name: str, t_end: float, atol: float, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates and tensions of native C after the same calls as in the page."""
    subject, request = load_scene(EXAMPLES / f"{name}.toml")
    built = build_library(subject, request_play(subject, request))
    library, manifest = ctypes.CDLL(str(built.path)), built.manifest
    nominal = {item.name: np.array(item.nominal, dtype=float) for item in manifest.arguments}
    state = np.concatenate([nominal["coordinate"], nominal["velocity"]])
    spec = next(item for item in manifest.integrators if item.name == method)
    clock, step, work, vibration = np.zeros(1), np.zeros(1), np.zeros(spec.work_size), np.zeros(3)
    sampled, counts = np.zeros(1, dtype=np.int64), np.zeros(6, dtype=np.int64)

    def at(array: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    integrate, double, whole = getattr(library, spec.symbol), ctypes.c_double, ctypes.c_longlong
    tail = (None, None, at(sampled), at(counts), at(counts[1:]), at(work))
    if method == "radau":
        tail = (None, None, None, at(sampled), at(counts), at(vibration), at(work))
    while clock[0] < t_end:
        status = integrate(
            double(min(t_end, clock[0] + SLICE)), double(RTOL), double(atol), whole(20000),
            at(clock), at(step), at(state), *(at(nominal[key]) for key in spec.arguments),
            whole(0), *tail,
        )  # fmt: skip
        assert status == 0
    n = len(nominal["coordinate"])
    nominal |= {"coordinate": state[:n].copy(), "velocity": state[n:].copy()}
    function = next(item for item in manifest.functions if item.quantity == "member_tension")
    tension = np.zeros(function.shape)
    assert (
        getattr(library, function.symbol)(*(at(nominal[key]) for key in function.arguments), at(tension)) == 0
    )
    return state[:n], tension


@pytest.mark.parametrize("method", ["rk54", "radau"])
def test_the_page_computes_the_numbers_of_native_c(tab: Tab, method: str) -> None:
    tab.ask(f"tensegrity.order('method', {{ name: '{method}' }})")
    found = tab.ask("tensegrity.advance(0.25).then(({ nodes, tension, time, status }) =>"
                    " [Array.from(nodes), Array.from(tension), time, status])")  # fmt: skip
    assert found[2:] == [0.25, 0]
    atol = tab.ask("tensegrity.app.engine.described.atol")
    coordinate, tension = run_native("tower", 0.25, atol, method)
    subject, _ = load_scene(EXAMPLES / "tower.toml")
    position = subject.node_position.ravel().copy()
    places = subject.coordinate_node_axis
    position[3 * places[:, 0] + places[:, 1]] = coordinate
    moved = np.abs(position - subject.node_position.ravel()).max()
    assert moved > 1e-4
    assert np.abs(np.array(found[0]) - position).max() < 1e-6 * moved
    assert np.abs(np.array(found[1]) - tension).max() < 1e-6 * np.abs(tension).max()


def test_panels_have_the_first_values_before_the_run(tab: Tab) -> None:
    tab.ask("tensegrity.app.restart()")
    tab.wait("document.querySelector('#energy + .cursor').hidden")
    for name, unit in (("energy", "J"), ("tension", "N")):
        values = tab.ask(f"[...document.querySelectorAll('#{name}-legend b')].map(value => value.innerText)")
        assert values
        assert all(value.endswith(unit) for value in values)
        assert tab.ask(f"document.querySelector('#{name} + .cursor').hidden")


def test_pause_step_and_reset_move_the_clock(tab: Tab) -> None:
    tab.ask("tensegrity.play()")
    tab.wait("tensegrity.run.time > 0.05")
    tab.press(" ")
    tab.wait("!tensegrity.run.running")
    before = tab.ask("tensegrity.run.time")
    tab.press("n")
    tab.wait(f"tensegrity.run.time > {before}")
    assert tab.ask("tensegrity.run.time") == pytest.approx(before + 1 / 60)
    tab.press("Backspace")
    tab.wait("tensegrity.run.time === 0")
    tab.wait("document.getElementById('run-facts').innerText === 'paused'")


def test_a_node_follows_the_pointer_and_its_energy_stays_bounded(tab: Tab) -> None:
    tab.frame()
    node = tab.ask("tensegrity.names.nodes.indexOf('t3_3')")
    x, y = tab.ask(f"tensegrity.place({node})")
    top = tab.ask("document.getElementById('view').getBoundingClientRect().top")
    tab.mouse("Moved", x, y + top)
    tab.mouse("Pressed", x, y + top, button="left")
    tab.wait("tensegrity.app.pull !== null")
    tab.mouse("Moved", x + 90, y + top, button="left")
    tab.wait(f"tensegrity.place({node})[0] > {x + 20}")
    tab.wait("document.getElementById('run-facts').innerText.includes('pulled by')")
    tab.mouse("Released", x + 90, y + top, button="left")
    tab.wait("tensegrity.app.pull === null")
    assert tab.ask("tensegrity.app.stage.controls.enabled")
    tab.press(" ")
    tab.wait("!tensegrity.run.running")
    assert tab.ask("tensegrity.run.status") == 0


def test_the_mouse_does_not_make_stiff_bars_vibrate(browser: Browser, tmp_path: Path) -> None:
    (tmp_path / "quad.toml").write_text(QUAD, encoding="utf-8")
    opened = open_page(browser, str(tmp_path / "quad"), tmp_path)
    opened.frame()
    bars = np.flatnonzero(load_scene(tmp_path / "quad.toml")[0].is_bar).tolist()
    look = f"{bars}.forEach(e => most = Math.max(most, Math.abs(tensegrity.run.tension[e])))"
    look = f"{look}; if (tensegrity.run.force > 2) count++; requestAnimationFrame(look);"
    opened.ask(f"(() => {{ window.most = 0; window.count = 0; const look = () => {{ {look} }}; look(); }})()")
    x, y = opened.ask("tensegrity.place(tensegrity.names.nodes.indexOf('t1'))")
    y += opened.ask("document.getElementById('view').getBoundingClientRect().top")
    opened.mouse("Moved", x, y)
    opened.mouse("Pressed", x, y, button="left")
    opened.wait("tensegrity.app.pull !== null")
    for step in range(1, 7):
        opened.mouse("Moved", x + 20 * step, y, button="left")
    opened.wait("tensegrity.run.time > 1 && count > 10")  # held still
    opened.mouse("Released", x + 120, y, button="left")
    opened.wait("tensegrity.app.pull === null")
    assert opened.ask("tensegrity.run.status") == 0
    assert 350 < opened.ask("most") < 510  # N; up to 466 N without a pull
    opened.send("Page.close")


def test_a_pull_at_rest_takes_energy_out_of_vibrations(tab: Tab) -> None:
    # Pulled towards where it stands for 2 s of the model: the total energy must not grow.
    start = tab.ask("tensegrity.order('advance', { time: 0.2 }).then(({ total }) => total)")
    tab.ask(
        "(({ nodes }) => tensegrity.order('pull', { pull:"
        " { node: 15, target: Array.from(nodes.slice(45, 48)), stiffness: 30, damping: 1 } }))"
        "(tensegrity.run)"
    )
    end = tab.ask("tensegrity.order('advance', { time: 2.2 }).then(({ total }) => total)")
    assert end < start + 1e-3 * abs(start)


def test_a_slider_changes_the_model(tab: Tab) -> None:
    tab.ask("tensegrity.order('reset')")
    plain = tab.ask("tensegrity.advance(0.1).then(({ nodes }) => Array.from(nodes))")
    tab.ask("tensegrity.order('reset')")
    tab.ask("(() => { const slider = document.querySelector('[data-name=\"gravity z\"]'); slider.value = 9;"
            " slider.dispatchEvent(new Event('input')); })()")  # fmt: skip
    lifted = tab.ask("tensegrity.advance(0.1).then(({ nodes }) => Array.from(nodes))")
    assert np.mean(lifted[2::3]) > np.mean(plain[2::3]) + 1e-3
    slider = "document.querySelector('[data-name=\"gravity z\"]')"
    tab.ask(f"{slider}.parentElement.dispatchEvent(new Event('dblclick'))")
    tab.ask("tensegrity.order('reset')")
    again = tab.ask("tensegrity.advance(0.1).then(({ nodes }) => Array.from(nodes))")
    assert again == plain


def test_a_run_that_stops_says_why(tab: Tab) -> None:
    tab.ask("tensegrity.order('set', { name: 'gravity', values: [0, 0, NaN] })")
    assert tab.ask("tensegrity.advance(0.1).then(({ status }) => status)") != 0
    tab.wait("document.getElementById('run-facts').innerText.startsWith('stopped at')")
    tab.ask("tensegrity.order('set', { name: 'gravity', values: [0, 0, -9.81] })")
    tab.ask("tensegrity.order('reset')")
    assert tab.ask("tensegrity.advance(0.1).then(({ status }) => status)") == 0


@pytest.mark.parametrize("method", ["rk54", "radau"])
def test_a_motion_that_leaves_all_bounds_stops_with_its_status(tab: Tab, method: str) -> None:
    tab.ask(f"tensegrity.order('method', {{ name: '{method}' }})")
    tab.ask("tensegrity.order('set', { name: 'damping', values: new Array(39).fill(-1e3) })")
    tab.ask("tensegrity.play()")
    tab.wait("!tensegrity.run.running && tensegrity.run.status !== 0")
    tab.wait("document.getElementById('run-facts').innerText.startsWith('stopped at')")
    text = tab.ask("document.getElementById('run-facts').innerText")
    # Which limit a blow-up meets first depends on how the worker divides the time between pictures.
    assert any(name in text for name in (*STATUS[1:], "unstable")), text
    time_then = tab.ask("tensegrity.run.time")
    tab.ask("tensegrity.play()")
    tab.frame()
    assert tab.ask("tensegrity.run.time") == time_then
    assert all(math.isfinite(value) for value in tab.ask("tensegrity.state.positions"))
    assert "NaN" not in tab.ask("document.body.innerText")
    tab.ask("tensegrity.order('set', { name: 'damping', values: new Array(39).fill(0.5) })")
    tab.ask("tensegrity.order('reset')")
    assert tab.ask("tensegrity.advance(0.1).then(({ status }) => status)") == 0


def test_very_stiff_bars_start_with_the_implicit_method(browser: Browser, tmp_path: Path) -> None:
    text = (EXAMPLES / "prism.toml").read_text(encoding="utf-8")
    assert "spring_constant = 2e5 " in text
    stiff = tmp_path / "stiff.toml"
    stiff.write_text(text.replace("spring_constant = 2e5 ", "spring_constant = 2e9 "), encoding="utf-8")
    subject, request = load_scene(stiff)
    built = build_library(subject, request_play(subject, request), target="wasm32")
    scene = add_engine(build_live_scene(subject), subject, built.manifest, built.path.read_bytes(), rtol=1e-6)
    opened = Tab(browser, 1400, 860, "light")
    opened.open(write_page(scene, tmp_path / "stiff.html"))
    assert opened.ask("document.getElementById('method').value") == "radau"
    found = opened.ask("tensegrity.advance(0.1).then(({ total, steps, method }) => [total, steps, method])")
    assert found[2] == "radau"
    assert found[1] < 10_000  # rk54 takes more than 30,000
    opened.ask("tensegrity.order('reset')")
    first = opened.ask("tensegrity.run.total")
    assert found[0] == pytest.approx(first, rel=1e-3)
    forces = opened.ask("tensegrity.advance(0.1).then(({ tension }) => Array.from(tension))")
    assert np.abs(forces).max() < 1e3  # not the rounding of positions times 2e9 N/m
    opened.send("Page.close")


def test_a_finger_drags_a_node(browser: Browser, tmp_path: Path) -> None:
    phone = open_page(browser, "tower", tmp_path, width=400)
    phone.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)  # makes buttons larger
    phone.frame()
    node = phone.ask("tensegrity.names.nodes.indexOf('t3_3')")
    x, y = phone.ask(f"tensegrity.place({node})")
    top = phone.ask("document.getElementById('view').getBoundingClientRect().top")
    camera = phone.ask("tensegrity.camera")
    path = [(x + 6 * k, y + top) for k in range(10)]
    for k, (left, down) in enumerate(path):
        kind = "touchMove" if k else "touchStart"
        phone.send("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": left, "y": down}])
    phone.wait("tensegrity.app.pull !== null && tensegrity.run.force > 0")
    phone.wait(f"tensegrity.place({node})[0] > {x + 10}")
    phone.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    phone.wait("tensegrity.app.pull === null")
    for name, values in phone.ask("tensegrity.camera").items():  # the picture did not turn
        assert values == pytest.approx(camera[name], abs=1e-9)
    assert phone.complaints() == []
    phone.send("Page.close")


@pytest.mark.parametrize("name", ["prism", "svd_tower"])
def test_a_settled_structure_stays_where_it_is(name: str, browser: Browser, tmp_path: Path) -> None:
    scene = EXAMPLES / f"{name}.toml"
    page = tmp_path / "a.html"
    require_three()
    with pytest.raises(SystemExit) as ended:
        main(["play", str(scene), "--settle", "--out", str(page), "--json"])
    assert not ended.value.code
    opened = Tab(browser, 1400, 860, "light")
    opened.open(page)
    first = np.array(opened.ask("Array.from(tensegrity.run.nodes)"))
    last = np.array(opened.ask("tensegrity.advance(0.5).then(({ nodes }) => Array.from(nodes))"))
    assert np.abs(last - first).max() < 1e-4 * np.ptp(first)
    opened.send("Page.close")


@pytest.mark.parametrize("name", ["prism", "icosahedron", "tower", "svd_tower"])
def test_the_clock_is_honest(
    name: str, browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    opened = open_page(browser, name, tmp_path, width=400)
    opened.ask("tensegrity.play()")
    opened.wait("tensegrity.run.speed !== null && tensegrity.run.time > 0.2")
    began, first = time.monotonic(), opened.ask("tensegrity.run.time")
    opened.wait(f"tensegrity.run.time > {first} + 0.5")
    last, wall = opened.ask("tensegrity.run.time"), time.monotonic() - began
    speed = opened.ask("tensegrity.run.speed")
    with capsys.disabled():
        print(json.dumps({"scene": name, "speed": round(speed, 3), "wall": round(wall, 2)}))
    assert 0 < speed < 1.5
    assert last - first <= 1.1 * wall + 0.2
    assert math.isfinite(opened.ask("tensegrity.run.total"))
    assert opened.ask("document.documentElement.scrollWidth") <= 400
    assert opened.complaints() == []
    assert opened.requests() == []
    opened.send("Page.close")


@pytest.mark.parametrize("width", [400, 1400])
def test_a_point_of_a_body_is_dragged(browser: Browser, tmp_path: Path, width: int) -> None:
    write_scene(RODS, tmp_path / "hanging.toml", overwrite=False)
    opened = open_page(browser, str(tmp_path / "hanging"), tmp_path, width=width)
    opened.frame()
    assert 0.005 < opened.ask("tensegrity.coverage()") < 0.6
    node = opened.ask("tensegrity.names.nodes.indexOf('block_eye')")
    x, y = opened.ask(f"tensegrity.place({node})")
    y += opened.ask("document.getElementById('view').getBoundingClientRect().top")
    opened.mouse("Moved", x, y)
    opened.mouse("Pressed", x, y, button="left")
    opened.wait(f"tensegrity.app.pull?.node === {node}")
    opened.mouse("Moved", x + 60, y, button="left")
    opened.wait(f"tensegrity.place({node})[0] > {x + 10}")
    opened.mouse("Released", x + 60, y, button="left")
    opened.wait("tensegrity.app.pull === null")
    assert opened.complaints() == []
    opened.send("Page.close")
