"""`simulate --until contact`: the run ends at the first contact, and says where."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import GOOD, write

# Two bars, crossed, 1 m apart; the upper one comes down with 2 m/s.
BARS = """\
name = "bars"

[classes.rod]
kind = "bar"
axial_stiffness = 1e5
radius = 0.05

[nodes]
a = { position = [0, -0.5, 0], mass = 1.0 }
b = { position = [0, 0.5, 0], mass = 1.0 }
c = { position = [-0.5, 0, 1], mass = 1.0, velocity = [0, 0, -2] }
d = { position = [0.5, 0, 1], mass = 1.0, velocity = [0, 0, -2] }

[members]
low = { class = "rod", nodes = ["a", "b"] }
high = { class = "rod", nodes = ["c", "d"] }
"""


@pytest.fixture
def bars(folder: Path) -> Path:
    return write(folder / "bars.toml", BARS)


@pytest.mark.parametrize("method", [(), ("--method", "rk4", "--step", 1e-3), ("--method", "scipy_dop853")])
def test_the_run_ends_at_the_contact(run: Run, bars: Path, method: tuple[object, ...]) -> None:
    words = ("--t-end", 1, "--samples", 11, "--until", "contact", "--out", "bars.npz", *method)
    ended = run("simulate", bars, *words, "--json")
    assert (ended.code, ended.data["status"]) == (0, "ok")
    (event,) = ended.data["events"]
    assert (event["kind"], event["names"]) == ("contact", ["low_high"])
    assert ended.data["t_end"] == event["time"] == pytest.approx(0.45, rel=1e-9)
    with np.load("bars.npz", allow_pickle=False) as file:
        assert file["time"].tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.45])
        assert file["event_time"].tolist() == [event["time"]]
        assert file["event_kind"].tolist() == ["contact"]
        assert file["event_name"].tolist() == ["low_high"]
    shown = run("simulate", bars, "--t-end", 1, "--until", "contact")
    assert shown.code == 0
    assert "contact of low_high at t = 0.45 s" in " ".join(shown.out.split())


def test_a_run_without_contact_goes_to_its_end(run: Run, bars: Path) -> None:
    ended = run.good("simulate", bars, "--t-end", 0.4, "--until", "contact", "--json")
    assert ended.data["events"] == []
    assert ended.data["t_end"] == 0.4
    assert "no contact" in ended.data["message"]


def test_bars_in_contact_at_the_start_say_so(run: Run, folder: Path) -> None:
    scene = write(folder / "bars.toml", BARS.replace(", 1], mass", ", 0.08], mass"))
    ended = run.good("simulate", scene, "--t-end", 1, "--until", "contact", "--json")
    assert (ended.data["t_end"], ended.data["n_samples"]) == (0.0, 1)
    assert ended.data["events"][0]["time"] == 0.0
    assert ended.data["events"][0]["margin"] == pytest.approx(-0.02)


def test_distances_are_in_the_library_only_where_they_are_asked_for(run: Run, bars: Path) -> None:
    held = []
    for words in ((), ("--until", "contact")):
        library = run("simulate", bars, "--t-end", 0.1, *words, "--json").data["library"]
        manifest = json.loads((Path(library).parent / "manifest.json").read_text(encoding="utf-8"))
        held.append({function["quantity"] for function in manifest["functions"]})
    assert held[1] - held[0] == {"bar_distance"}


def test_wrong_usage_is_refused(run: Run, bars: Path, folder: Path) -> None:
    ended = run.refused("simulate", bars, "--t-end", 1, "--until", "touch", "--json")
    assert ended.data["error"] == "UnknownNameError"
    assert "contact" in ended.err
    scene = write(folder / "small.toml", GOOD)
    ended = run.refused("simulate", scene, "--t-end", 1, "--until", "contact", "--json")
    assert "no two bars that could touch" in ended.err


def test_the_run_ends_where_a_condition_holds(run: Run, bars: Path) -> None:
    words = ("--t-end", 1, "--samples", 11, "--until", "c.z < 0.5", "--out", "low.npz")
    ended = run("simulate", bars, *words, "--json")
    assert (ended.code, ended.data["status"]) == (0, "ok")
    (event,) = ended.data["events"]
    assert (event["kind"], event["names"]) == ("condition", ["c.z < 0.5"])
    assert ended.data["t_end"] == event["time"] == pytest.approx(0.25, rel=1e-9)
    by_quantity = run("simulate", bars, "--t-end", 1, "--until", "kinetic_energy - 8.1", "--json")
    assert (by_quantity.code, by_quantity.data["t_end"]) == (0, 1.0)


@pytest.mark.parametrize(
    "words",
    [
        ("--until", "__import__('os').remove('x')"),
        ("--until", "c.q < 1"),
        ("--until", "c.z <"),
        ("--until", "c.z < 0.5", "--method", "scipy_rk45"),
        ("--until", "memberlength[0] - 1"),
    ],
)
def test_what_is_no_condition_is_refused(run: Run, bars: Path, words: tuple[str, ...]) -> None:
    ended = run.refused("simulate", bars, "--t-end", 1, *words, "--json")
    assert ended.data["status"] == "error"
