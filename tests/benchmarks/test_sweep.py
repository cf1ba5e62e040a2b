"""The benchmark of sweeps: every way gives a line, and MuJoCo comes to the same end."""

import re
import sys

import pytest
import sweep


@pytest.mark.peers
@pytest.mark.parametrize(
    ("kind", "ways"),
    [
        ("equilibria", ["batch function", "sweep, 1 worker", "find_equilibrium", "scipy.optimize.root"]),
        ("motions", ["batch function", "sweep, 2 workers", "simulate in a loop", "solve_ivp", "MuJoCo"]),
        ("evaluations", []),
    ],
)
def test_every_way_has_a_line(
    kind: str, ways: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in ("mujoco", "zarr"):
        pytest.importorskip(package)
    words = ["sweep.py", "--only", kind, "--part", "0.004", "--rounds", "1", "--peers", "2"]
    monkeypatch.setattr(sys, "argv", words)
    sweep.main()
    said = capsys.readouterr().out
    for way in ways:
        assert re.search(rf"^{re.escape(way)}.* ms ", said, re.MULTILINE), said
    for error in re.findall(r"error (\S+) m", said):
        assert float(error) <= sweep.ERROR
    if kind == "evaluations":
        assert len(re.findall(r"largest memory: \d+ MB here", said)) == 2
