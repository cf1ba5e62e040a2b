"""The verb `identify`: values with their errors, the scene it writes, exit codes."""

from pathlib import Path

import pytest

from tensegrity_codegen.scene.write import write_scene
from tests.cli.conftest import Run
from tests.sweeps.fitting.scenes import FALL, ROPE, change, measure


@pytest.fixture
def files(folder: Path) -> tuple[Path, Path]:
    scene, table = folder / "fall.toml", folder / "measured.csv"
    write_scene(change(FALL, members__rope__spring_constant=120.0), scene)
    data = measure(FALL, [k / 50 for k in range(1, 101)], ["weight.z"], 5e-4)
    rows = zip(data["time"], data["weight.z"], strict=True)
    table.write_text("time [s],weight.z [m]\n" + "".join(f"{t},{z}\n" for t, z in rows), encoding="utf-8")
    return scene, table


def test_values_come_with_their_errors(run: Run, files: tuple[Path, Path]) -> None:
    by = [word for key in ROPE for word in ("--by", key)]
    ended = run.good("identify", *files, *by, "--out", "found.toml", "--json")
    rope = ended.data["values"][ROPE[0]]
    assert abs(rope["value"] - 100.0) < 4.0 * rope["standard_error"] < 0.5
    assert rope["start"] == 120.0
    assert rope["interval"][0] < rope["value"] < rope["interval"][1]
    again = run.good("identify", "found.toml", files[1], *by, "--json")
    assert again.data["values"][ROPE[0]]["start"] == rope["value"]
    text = run.good("identify", *files, *by).out
    assert text.startswith("ok: 100 values")
    assert "standard error" in text


def test_what_is_not_explained_ends_with_code_3(run: Run, files: tuple[Path, Path]) -> None:
    ended = run("identify", *files, "--by", "members.rope.damping", "--noise", "position=1e-6", "--json")
    assert (ended.code, ended.data["status"]) == (3, "not_explained")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--by", "members.rope.colour"), "unknown key"),
        (("--by", ROPE[0], "--bounds", f"{ROPE[0]}=1"), "KEY=LOW:HIGH"),
        (("--by", ROPE[0], "--bounds", f"{ROPE[0]}=1:2"), "exclude"),
        (("--by", ROPE[0], "--noise", "little"), "KIND=SIZE"),
        (("--by", ROPE[0], "--hold-out", "2"), "not a part"),
        (("--by", ROPE[0], "--out", "found.csv"), ".toml"),
    ],
)
def test_wrong_options_end_with_code_2(
    run: Run, files: tuple[Path, Path], options: tuple[str, ...], word: str
) -> None:
    ended = run("identify", *files, *options)
    assert ended.code == 2
    assert word in ended.err
    assert not Path("found.csv").exists()
