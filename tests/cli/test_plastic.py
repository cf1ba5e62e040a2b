"""The verbs on the scene of docs/memory.md, and what the page says of it."""

import csv
import re
from pathlib import Path

import pytest

from tests.cli.conftest import Run

PAGE = (Path(__file__).parents[2] / "docs/memory.md").read_text(encoding="utf-8")


@pytest.fixture
def hanger(folder: Path) -> Path:
    found = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    path = folder / "hanger.toml"
    path.write_text(found[1], encoding="utf-8")
    return path


def test_simulate_lists_yields_and_plastic_elongations(run: Run, hanger: Path) -> None:
    data = run.good("simulate", hanger, "--t-end", "0.5", "--json").data
    assert data["n_events"] == 19
    assert data["plastic_elongation"] == {
        "l": pytest.approx(0.0665177, abs=1e-6),
        "r": pytest.approx(0.0327539, abs=1e-6),
        "t": pytest.approx(0.0738221, abs=1e-6),
    }
    assert data["energy_drift"] < 1e-6
    assert data["total_energy_end"] < data["total_energy_start"] - 8.0
    text = run.good("simulate", hanger, "--t-end", "0.05").out
    assert "0.00265924 s l yields" in text
    assert "s r stops yielding" in text


def test_load_path_lists_yields_and_writes_plastic_elongations(run: Run, hanger: Path) -> None:
    data = run.good("load-path", hanger, "--load", "weight=30,-150", "--out", "path.csv", "--json").data
    stated = re.findall(r"^ (0\.\d+)  yield  (\w)$", PAGE, re.MULTILINE)
    assert len(stated) == 3
    found = [(event["load_factor"], event["names"]) for event in data["events"]]
    assert found == [(pytest.approx(float(factor), abs=1e-9), [name]) for factor, name in stated]
    rows = list(csv.DictReader(Path("path.csv").read_text(encoding="utf-8").splitlines()))
    first, last = rows[0], rows[-1]
    assert float(first["plastic_l"]) == 0.0
    assert float(last["plastic_l"]) > float(last["plastic_r"]) > 0.0
    rest = float(first["length_l"]) - float(first["tension_l"]) / 5e3
    elastic = float(last["length_l"]) - rest - float(last["plastic_l"])
    assert 5e3 * elastic == pytest.approx(float(last["tension_l"]), rel=1e-9)
    only = run.good("load-path", hanger, "--load", "weight=30,-150", "--events", "limit", "--json").data
    assert only["events"] == []


def test_equilibrium_states_plastic_elongations(run: Run, hanger: Path) -> None:
    hanger.write_text(PAGE.split("```toml\n")[1].split("```")[0].replace("mass = 2.0", "mass = 14.0"))
    data = run.good("equilibrium", hanger, "--json").data
    assert data["plastic_elongation"]["l"] > 0.0
    assert "plastic elongations at the end" in run.good("equilibrium", hanger).out


def test_bad_values_end_with_code_2(run: Run, hanger: Path) -> None:
    text = hanger.read_text(encoding="utf-8").replace("hardening = 0.05", "hardening = 1.0")
    hanger.write_text(text, encoding="utf-8")
    ended = run("simulate", hanger, "--t-end", "0.1")
    assert ended.code == 2
    assert "hardening" in ended.err
