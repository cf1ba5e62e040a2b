"""The verb `stand`: verdict first, forces of feet, proof, tipping cables, exit codes."""

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.cli.scenes import FRAME, HANGING, write


def test_the_verdict_comes_first_with_the_forces_of_the_feet(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME)
    data = run.good("stand", path, "--json").data
    assert (data["status"], data["verdict"], data["distribution"]) == ("ok", "stands", "equilibrium")
    assert data["tipping_margin"] == pytest.approx(0.5, abs=1e-4)
    assert [round(data["feet"][foot]["force"][2], 9) for foot in ("left", "right")] == [14.715, 14.715]
    assert data["equilibrium"]["contacts"]["feet"]["top"]["state"] == "open"
    text = run.good("stand", path).out
    assert text.startswith("stands: its load meets the ground 0.5")
    assert "friction needed" in text


@pytest.mark.parametrize(
    ("load", "status"), [("top=3,0", "ok"), ("left=20,0", "slides"), ("top=20,0", "tips")]
)
def test_loads_slide_and_tip_it(run: Run, folder: Path, load: str, status: str) -> None:
    path = write(folder / "frame.toml", FRAME)
    ended = run("stand", path, "--load", load, "--json")
    assert ended.code == (0 if status == "ok" else 3)
    assert ended.data["status"] == status
    proof = ended.data["proof"]
    assert (proof is None) == (status == "ok")
    if proof is not None:  # power of weights and load
        names = ["left", "right", "top"]
        force = np.tile([0.0, 0.0, -9.81], (3, 1))
        force[names.index(load.partition("=")[0]), 0] += 20.0
        assert np.sum(np.array(proof) * force) == pytest.approx(1.0, rel=1e-9)


def test_as_drawn_and_frictionless(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME)
    drawn = run.good("stand", path, "--as-drawn", "--json").data
    assert (drawn["equilibrium"], drawn["tipping_margin"]) == (None, 0.5)
    pushed = run("stand", path, "--frictionless", "--load", "top=1,0", "--json")
    assert (pushed.code, pushed.data["status"]) == (3, "slides")


def test_cables_are_shortened_until_something_happens(run: Run, folder: Path) -> None:
    """A mast with two stays is drawn over by either of them, at the same length."""
    mast = FRAME.replace("[ground]", MAST + "\n[ground]").replace("[members]", NODES + "\n[members]")
    path = write(folder / "mast.toml", mast)
    data = run.good("stand", path, "--tip", "all", "--json").data
    assert [tip["status"] for tip in data["tips"]] == ["snaps", "snaps"]
    lengths = [tip["rest_length"] for tip in data["tips"]]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-6)
    assert 1.5 < lengths[0] < 2.05
    others = run.good("stand", path, "--tip", "stay", "--json").data["tips"]
    assert [tip["cable"] for tip in others] == ["stay"]


NODES = "head = { position = [0.5, 2], mass = 3 }"
MAST = """\
mast = { class = "strut", nodes = ["top", "head"] }
stay = { kind = "cable", spring_constant = 3000, rest_length = 2.05, nodes = ["right", "head"] }
back = { kind = "cable", spring_constant = 3000, rest_length = 2.05, nodes = ["left", "head"] }
"""


def test_wrong_scenes_and_cables_are_refused(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME)
    assert "--tip" in run.refused("stand", path, "--tip", "base").err
    assert "nothing to stand on" in run.refused("stand", write(folder / "small.toml", HANGING)).err


def test_equilibrium_lists_the_feet(run: Run, folder: Path) -> None:
    path = write(folder / "frame.toml", FRAME)
    out = run.good("equilibrium", path).out
    assert "frame: feet" in out
    steep = write(folder / "steep.toml", FRAME.replace("[ground]", "[ground]\nslope_deg = 35"))
    ended = run("equilibrium", steep, "--json")
    assert ended.code == 3
    assert ended.data["status"] in ("slides", "tips")
