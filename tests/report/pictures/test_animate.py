import itertools
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from tensegrity_codegen.report.pictures.animate import MAX_FRAMES, find_frames, write_animation
from tensegrity_codegen.report.pictures.view import PictureChoices
from tensegrity_codegen.system.errors import InvalidValueError, MissingExtraError, NonFiniteError, OutputError
from tests.cases import thorough
from tests.report.samples import frame, make_trajectory
from tests.runtime.build import prism

needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")


def read_gif(path):
    """Return the frames as arrays and the length of the film in ms."""
    frames, length = [], 0
    with Image.open(path) as film:
        for k in range(film.n_frames):
            film.seek(k)
            frames.append(np.array(film.convert("RGB"), dtype=int))
            length += film.info["duration"]
    return frames, length


def test_frames_are_the_nearest_samples():
    time = np.linspace(0.0, 1.0, 101)
    assert find_frames(time, 10, 1.0).tolist() == [0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 100]
    assert find_frames(np.array([0.0, 0.4, 1.0]), 5, 1.0).tolist() == [0, 0, 1, 1, 2, 2]
    assert len(find_frames(time, 10, 3.0)) == 31


def test_last_sample_is_always_shown():
    assert find_frames(np.linspace(0.0, 0.01, 11), 25, 1.0).tolist() == [0, 10]
    assert find_frames(np.array([0.0]), 25, 1.0).tolist() == [0]
    assert find_frames(np.array([2.0, 2.5]), 2, 1.0).tolist() == [0, 1]


def test_too_long_a_film_says_which_slow_down_would_do():
    time = np.linspace(0.0, 1000.0, 11)
    with pytest.raises(InvalidValueError) as caught:
        find_frames(time, 25, 1.0)
    assert f"at most {MAX_FRAMES}" in caught.value.allowed
    assert "slow_down 0.11" in caught.value.hint
    assert len(find_frames(time, 25, 0.11)) <= MAX_FRAMES


@pytest.mark.parametrize("structure", [frame(), *thorough(prism())])
def test_gif_has_a_frame_for_each_moment_and_keeps_time(tmp_path, structure):
    path = write_animation(structure, make_trajectory(structure, 41), tmp_path / "a.gif", fps=8)
    frames, length = read_gif(path)
    assert len(frames) == 9
    assert length == pytest.approx(9 * 125, abs=10)
    assert all(not np.array_equal(a, b) for a, b in itertools.pairwise(frames))


def test_only_the_structure_and_the_clock_move(tmp_path):
    structure = frame()
    frames, _ = read_gif(write_animation(structure, make_trajectory(structure), tmp_path / "a.gif", fps=2))
    changed = np.any([np.abs(one - frames[0]).max(axis=-1) > 40 for one in frames[1:]], axis=0)
    height, width = changed.shape
    assert changed.any()
    # The legend below and the heading at the left stand still; the corner of the paper is white.
    assert not changed[int(0.93 * height) :].any()
    assert not changed[: int(0.1 * height), : width // 2].any()
    assert frames[0][0, 0].tolist() == [255, 255, 255]


def test_samples_that_are_held_are_drawn_once(tmp_path):
    calls = []
    path = write_animation(
        frame(), make_trajectory(frame(), 3), tmp_path / "a.gif", fps=20, progress=calls.append
    )
    frames, length = read_gif(path)
    assert len(frames) == 3
    assert length == 21 * 50
    assert calls == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_one_sample_without_tensions_makes_a_film_of_one_frame(tmp_path):
    run = make_trajectory(prism(), 1, member_tension=np.zeros((1, 12)))
    with Image.open(write_animation(prism(), run, tmp_path / "a.gif")) as film:
        assert getattr(film, "n_frames", 1) == 1


@needs_ffmpeg
@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="ffprobe, which reads films, is not installed")
def test_mp4_has_its_frames_and_an_even_size(tmp_path):
    path = write_animation(frame(), make_trajectory(frame(), 3), tmp_path / "a.mp4", fps=4)
    assert path.read_bytes()[4:8] == b"ftyp"
    entries = "stream=codec_name,width,height,nb_frames,r_frame_rate"
    command = ["ffprobe", "-v", "error", "-show_entries", entries, "-of", "csv=p=0", str(path)]
    codec, width, height, rate, count = subprocess.check_output(command, text=True).strip().split(",")
    assert (codec, rate, count) == ("h264", "4/1", "5")
    assert int(width) % 2 == int(height) % 2 == 0


@pytest.mark.parametrize("size", [(301, 200), (300, 201)])
def test_an_odd_size_of_mp4_is_refused(size, tmp_path):
    with pytest.raises(InvalidValueError, match="even") as caught:
        write_animation(
            prism(), make_trajectory(prism()), tmp_path / "a.mp4", choices=PictureChoices(size=size)
        )
    assert caught.value.where == "size"
    assert list(tmp_path.iterdir()) == []


def test_missing_ffmpeg_is_named_and_a_gif_proposed(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingExtraError) as caught:
        write_animation(prism(), make_trajectory(prism()), tmp_path / "film.mp4")
    assert "ffmpeg" in caught.value.problem
    assert "film.gif" in caught.value.hint
    assert list(tmp_path.iterdir()) == []


def test_failing_ffmpeg_leaves_the_old_film_and_its_message(tmp_path, monkeypatch):
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho no such coder >&2\nexit 7\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent))
    (tmp_path / "a.mp4").write_text("old")
    with pytest.raises(OutputError, match="code 7: no such coder"):
        write_animation(prism(), make_trajectory(prism()), tmp_path / "a.mp4", overwrite=True)
    assert (tmp_path / "a.mp4").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "bin"]


@pytest.mark.parametrize("name", ["a.avi", "a.png", "a"])
def test_unknown_suffix_lists_the_allowed_ones(tmp_path, name):
    with pytest.raises(InvalidValueError, match=r"\.gif, \.mp4"):
        write_animation(prism(), make_trajectory(prism()), tmp_path / name)


def test_missing_folder_is_noticed_before_drawing(tmp_path):
    calls = []
    with pytest.raises(OutputError, match="missing"):
        write_animation(
            prism(), make_trajectory(prism()), tmp_path / "missing" / "a.gif", progress=calls.append
        )
    assert calls == []


@pytest.mark.parametrize(
    "change", [{"fps": 0}, {"fps": 51}, {"fps": np.nan}, {"slow_down": 0.0}, {"slow_down": np.inf}]
)
def test_speeds_out_of_range_are_refused(tmp_path, change):
    with pytest.raises(InvalidValueError, match=next(iter(change))):
        write_animation(prism(), make_trajectory(prism()), tmp_path / "a.gif", **change)


def test_interrupted_film_leaves_nothing(tmp_path):
    def stop(fraction):
        raise KeyboardInterrupt

    for name in ("a.gif", "a.mp4") if shutil.which("ffmpeg") else ("a.gif",):
        with pytest.raises(KeyboardInterrupt):
            write_animation(prism(), make_trajectory(prism()), tmp_path / name, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_a_motion_that_is_not_finite_is_refused(tmp_path):
    run = make_trajectory(prism())
    position = run.node_position.copy()
    position[3, 0, 0] = np.nan
    with pytest.raises(NonFiniteError, match="node_position"):
        write_animation(prism(), make_trajectory(prism(), node_position=position), tmp_path / "a.gif")


def test_missing_pillow_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingExtraError, match=r"\[plot\]"):
        write_animation(prism(), make_trajectory(prism()), tmp_path / "a.gif")
